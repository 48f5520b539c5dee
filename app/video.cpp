#include "app/video.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>

#include <string>

#include "app/command.h"
#include "base/output_file.h"

extern char** environ;

namespace brume::app {
namespace {

namespace fs = std::filesystem;

/// Runs a program from the path, without input or output. @return its exit status; -1: it could not be started
int run_program(const std::vector<std::string>& words) {
  std::vector<char*> arguments;
  for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 1, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY, 0);
  pid_t child = 0;
  const int error = posix_spawnp(&child, arguments[0], &actions, nullptr, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) return -1;
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

/// A path between the quotes of ffmpeg's lists.
std::string quoted(const fs::path& path) {
  std::string text = "'";
  for (const char c : fs::absolute(path).string()) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

}  // namespace

bool write_video(const fs::path& path, const std::vector<fs::path>& pictures, double frame_rate) {
  if (pictures.empty()) {
    warn(fmt::format("{}: no frame to show", path.string()));
    return false;
  }
  // ffmpeg's list of files, since frames may be missing; the film appears under its name once it is whole.
  fs::path list = path, film = path;
  list += ".list";
  film.replace_filename("." + path.stem().string() + ".part" + path.extension().string());
  std::string text;
  for (const fs::path& picture : pictures)
    text += fmt::format("file {}\nduration {:.9f}\n", quoted(picture), 1 / frame_rate);
  write_text(list, text);
  const int status = run_program({"ffmpeg", "-y", "-loglevel", "error", "-f", "concat", "-safe", "0", "-i",
                                  list.string(), "-r", fmt::format("{:.6g}", frame_rate), "-vf",
                                  "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", film.string()});
  std::error_code ignored;
  fs::remove(list, ignored);
  if (status == 0) {
    fs::rename(film, path);
    return true;
  }
  fs::remove(film, ignored);
  warn(status == -1 || status == 127
           ? fmt::format("{}: no film, since ffmpeg is not there; the PNGs are", path.string())
           : fmt::format("{}: ffmpeg made no film of that kind (exit status {}); the PNGs are there", path.string(),
                         status));
  return false;
}

}  // namespace brume::app

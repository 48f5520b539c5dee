#include "apps/cli/video.h"

#include <fmt/format.h>

#include <string>

#include "apps/cli/command.h"
#include "apps/cli/program.h"
#include "base/output_file.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

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
  OutputFile output(path);
  fs::path list = output.part(), film = output.part();
  list += ".list";
  film += path.extension();
  std::string text;
  for (const fs::path& picture : pictures)
    text += fmt::format("file {}\nduration {:.9f}\n", quoted(picture), 1 / frame_rate);
  write_text(list, text);
  const std::optional<int> status =
      run_program({"ffmpeg", "-y", "-loglevel", "error", "-f", "concat", "-safe", "0", "-i", list.string(), "-r",
                   fmt::format("{:.6g}", frame_rate), "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p",
                   film.string()});
  std::error_code ignored;
  fs::remove(list, ignored);
  if (status == 0) {
    fs::rename(film, output.part());
    output.commit();
    return true;
  }
  fs::remove(film, ignored);
  warn(!status ? fmt::format("{}: no film, since ffmpeg is not there; the PNGs are", path.string())
               : fmt::format("{}: ffmpeg made no film of that kind (exit status {}); the PNGs are there", path.string(),
                             *status));
  return false;
}

}  // namespace brume::app

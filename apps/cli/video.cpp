#include "apps/cli/video.h"

#include <fmt/format.h>

#include <string>

#include "apps/cli/command.h"
#include "base/command.h"
#include "base/output_file.h"
#include "base/text.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

/// A path between the quotes of ffmpeg's lists.
std::string quoted(const fs::path& path) {
  return "'" + replaced(fs::absolute(path).string(), "'", "'\\''") + "'";
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
  const fs::path program = find_program("ffmpeg");
  int status = -1;
  const auto remove_rest = [&] {
    std::error_code ignored;
    fs::remove(list, ignored);
    fs::remove(film, ignored);
  };
  if (!program.empty()) try {
      const Command make{.program = program,
                         .words = {"ffmpeg", "-y", "-loglevel", "error", "-f", "concat", "-safe", "0", "-i",
                                   list.string(), "-r", fmt::format("{:.6g}", frame_rate), "-vf",
                                   "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", film.string()},
                         .supervised = false};
      const CommandEnd end = run_command(make, {0, {}, &interrupted});
      status = end.signal == 0 ? end.status : 1;
    } catch (const Interrupted&) {
      remove_rest();
      throw;
    }
  if (status == 0) fs::rename(film, output.part());
  remove_rest();
  if (status == 0) {
    output.commit();
    return true;
  }
  warn(program.empty() ? fmt::format("{}: no film, since ffmpeg is not there; the PNGs are", path.string())
                       : fmt::format("{}: ffmpeg made no film of that kind (exit status {}); the PNGs are there",
                                     path.string(), status));
  return false;
}

}  // namespace brume::app

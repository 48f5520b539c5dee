#include "farm/opencue.h"

#include <fmt/format.h>

#include "base/text.h"

namespace brume {

std::string opencue_outline(const Shot& shot, const std::vector<Stage>& stages, const std::filesystem::path& round) {
  std::string text =
      fmt::format(R"(#!/usr/bin/env python
# Launches {} through OpenCue: python THIS_FILE [SHOW] [SHOT]
# A layer is a stage, its frame N the N-th line of the stage's commands. A layer waits for the one before; a frame that
# fails is retried as the show says, and eaten frames are told by: brume submit status {}
import getpass
import sys

import outline
import outline.cuerun
from outline.modules.shell import Shell

show = sys.argv[1] if len(sys.argv) > 1 else "testing"
shot = sys.argv[2] if len(sys.argv) > 2 else {}
job = outline.Outline({}, show=show, shot=shot, user=getpass.getuser())
)",
                  shot.name, shell_word(shot.folder.string()), quoted(shot.name), quoted("brume_" + shot.name));
  std::string before;
  for (const Stage& stage : stages) {
    // OpenCue joins these words with blanks, and a shell runs them.
    std::vector<std::string> arguments = {
        quoted(stage.name),
        fmt::format("command=[\"sh\", {}, {}, \"#IFRAME#\", \"1\"]", quoted(shell_word((round / "run.sh").string())),
                    quoted(stage.name)),
        fmt::format("range=\"1-{}\"", stage.commands.size()), "chunk=1"};
    if (shot.threads > 0) arguments.push_back(fmt::format("threads={}", shot.threads));
    text += fmt::format("\n{} = Shell({})\njob.add_layer({})\n", stage.name, join(arguments), stage.name);
    if (!before.empty()) text += fmt::format("{}.depend_all({})\n", stage.name, before);
    before = stage.name;
  }
  return text + "\noutline.cuerun.launch(job, use_pycuerun=False)\n";
}

}  // namespace brume

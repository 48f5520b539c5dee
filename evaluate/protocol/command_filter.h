#pragma once
#include <filesystem>
#include <span>

#include "evaluate/protocol/external_filter.h"

namespace brume {

/// A command line that cleans a frame.
struct CommandFilter {
  std::string command;                   ///< words, in which {PLACES} are filled in; no shell runs them
  std::filesystem::path folder;          ///< where it runs, so that its relative paths begin there
  std::vector<std::string> layers = {};  ///< that it reads beside the colour; "guides": all of them
  bool statistics = false;               ///< whether it reads variance and halves
  double memory_limit = 0;               ///< bytes that it may hold; 0: no limit
  std::vector<std::filesystem::path> depends =
      {};  ///< files and folders that decide its result beside those in its words
};

/// The filter that a command is.
///
/// For each signal of a frame it is run once in a scratch folder's files. Its seconds are the program's own, from its
/// start to its end; writing the frame for it and reading its picture are the exchange's. Its memory is what it and all
/// it starts hold at most. The environment has OMP_NUM_THREADS, the number of threads that filters may use.
/// @param known  the layers that a frame can have
/// @throws InputError: a program or script that is not there, unknown places or layers, nothing that it reads or writes
ExternalFilter command_filter(const CommandFilter& settings, std::span<const LayerName> known);

/// What it is called where nobody says: "mine" of "python3 mine.py {frame} {output}".
std::string command_label(const std::string& command);

/// What can stand in braces, and what it becomes: for documentation.
struct CommandPlace {
  std::string name, meaning;
};
const std::vector<CommandPlace>& command_places();

}  // namespace brume

#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "base/progress.h"
#include "image/layers.h"

namespace brume {

/// Header and windows of a file, without a channel. @throws InputError: missing, not an EXR, truncated
Layers read_header(const std::filesystem::path& path);

inline constexpr const char* kNotThere = "is not there";

/// What is wrong with an EXR that should be finished: it is missing, damaged, or `differs` finds its header wrong.
/// Empty: nothing. Times of files say nothing, as clocks differ from machine to machine.
/// @param thorough  reads it to its last pixel; else the header and both ends   @throws Interrupted
std::string what_is_wrong_with(const std::filesystem::path& path,
                               const std::function<std::string(const Layers& header)>& differs, bool thorough,
                               const Task& task);

/// What a finished frame holds.
struct FrameContent {
  int64_t first = 0, end = 0;                  ///< samples of each pixel, the last exclusive
  bool open_ended = false;                     ///< any number of them will do: time or error ended the render
  std::string filter;                          ///< that cleaned it; empty: none
  std::optional<std::string> parameters = {};  ///< of the filter; nothing: any

  /// "holds the samples 0 .. 3, not 0 .. 7"; empty where a header says this.
  std::string differs(const Layers& header) const;
};

}  // namespace brume

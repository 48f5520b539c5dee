#pragma once
#include <filesystem>
#include <optional>
#include <vector>

#include "render/session/render_state.h"
#include "workflows/host.h"

namespace brume {

struct MergeOptions {
  /// Files, and frames in memory. A file's name with a place for a number stands for all that are there.
  std::vector<RenderPart> parts;
  std::vector<int> numbers;      ///< of the parts that must be there; empty: those that are
  std::filesystem::path output;  ///< empty: none
  bool mergeable = false;        ///< keep the sums of the samples, so that more parts can be merged later
  bool resume = false;           ///< leave out what is merged already: the output is whole and of this render
  bool when_complete = false;    ///< be content while parts are missing
  bool discard = false;          ///< remove the parts' files once the output has been read back whole
};

/// Joins the parts of a render, and writes the frame where an output is named.
/// @return nothing where it was merged before, or parts are missing   @throws InputError, Interrupted
std::optional<Layers> merge_frames(const MergeOptions& options, const Host& host);

}  // namespace brume

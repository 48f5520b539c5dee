#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "filters/run/apply.h"
#include "workflows/frame.h"
#include "workflows/host.h"
#include "workflows/sequence.h"

namespace brume {

/// The files of a frame, or of one beside it in its sequence; patterns for a whole sequence. Empty: there is none.
struct FrameFiles {
  std::filesystem::path frame, guides, records;  ///< read
  std::filesystem::path output, preview;         ///< written
  int distance = 0;                              ///< in frames, to the one that is cleaned: before < 0 < after
  std::filesystem::path second = {};             ///< read: the same frame by another seed, as its other half
};

/// How a file that is not written as brume writes its own is read, and given back.
struct FileOptions {
  bool keep = false;          ///< give a frame by brume back as it came, too, but for what is cleaned
  std::string suffix;         ///< clean layers stand beside the noisy ones, under names with this behind
  std::filesystem::path map;  ///< TOML file that says which layer plays which part; empty: recognised by itself
  int samples = 0;            ///< per pixel, where the header does not say it

  bool asked() const { return keep || !suffix.empty() || !map.empty(); }
};

/// How a frame is cleaned.
struct DenoiseOptions {
  std::vector<FilterSettings> filters;             ///< empty: the best that the frame's layers allow
  ApplyOptions how{.component = Component::kAll};  ///< its exposure, records and sequence are filled in
  PictureOptions picture;                          ///< exposure for the filters too; of the preview
  std::optional<int> extra_frames;                 ///< before and after; in a sequence else as the filter declares
  FileOptions file;
  bool resume = false;  ///< in a sequence: leave out frames whose outputs are whole and made from the same
};

/// Cleans a frame in memory with one filter.
/// @param guides  of this frame; null: none. Left out, with a word, where they explain it worse than its own features
/// @return R G B, what else the filter makes, and a header with the filter and its parameters
/// @throws InputError, Interrupted
Layers denoise_frame(const Layers& frame, const NamedFrame* guides, const DenoiseOptions& options, const Host& host);

/// A frame of a sequence in memory; it and its guides must outlive the call.
struct MemoryFrame {
  std::string name;  ///< for errors and notes
  const Layers* frame = nullptr;
  const NamedFrame* guides = nullptr;  ///< of this frame; null: none
};

/// Cleans the frames of a sequence in memory, each as denoise_sequence does: filters that look through time see those
/// before and after. One that cannot be cleaned ends it.
/// @param get  frame i, called in rising order; the same is asked for again while it is beside another
/// @param let_go  told that frame i is not needed any more
std::vector<Layers> denoise_frames(size_t count, const std::function<MemoryFrame(size_t i)>& get,
                                   const std::function<void(size_t i)>& let_go, const DenoiseOptions& options,
                                   const Host& host);

/// Cleans a frame from file to file: OUT.exr, or OUT.FILTER.exr where there are several filters. Frames beside it are
/// found by the number in its name. @throws InputError, Interrupted
void denoise_frame(const FrameFiles& files, const DenoiseOptions& options, const Host& host);

/// Cleans the frames of a sequence, one after another; each file of it is read once while it is in use.
SequenceEnd denoise_sequence(const FrameFiles& patterns, const std::vector<int>& frames, const DenoiseOptions& options,
                             const Host& host);

}  // namespace brume

#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "base/progress.h"
#include "image/exr_io.h"
#include "image/layers.h"
#include "render/transport/integrator.h"

namespace brume {

/// What tells apart the renders that two headers are of, "the seed is 0 in the first, 4 in the second"; empty where
/// scene, seed, frame, layers, statistics, program and crop are the same.
/// @param in_a, in_b  how the two are called
std::string differing_render(const Layers& a, const Layers& b, const std::string& in_a = "in the first",
                             const std::string& in_b = "in the second");

/// Throws InputError, naming both sides and what differs, unless two frames are parts of one render: the same scene,
/// seed, frame, crop, layers, statistics and program.
/// @param same_samples  and they also begin at the same sample
void check_same_render(const Layers& a, const std::string& name_a, const Layers& b, const std::string& name_b,
                       bool same_samples);

/// The layers a frame's header says were recorded, for a film that takes its sums.
struct LayerRequest recorded_in(const Layers& frame);

/// What indirect_limit took, in a header: indirectLimitPaths, indirectLimitTaken, indirectLimitFound.
void write_limited_light(Layers& frame, const LimitedLight& limited);
LimitedLight limited_light_of(const Layers& frame);

/// Why the expected picture is not exact, in a header: biased = "false", or "true: reason; another".
void write_biases(Layers& frame, const std::vector<std::string>& biases);
std::vector<std::string> biases_of(const Layers& frame);

/// Writes a render's checkpoints. A disk that is full, or gone for a while, costs the checkpoint and not the render:
/// the last one that could be written stays, and the next is tried again.
class CheckpointWriter {
 public:
  /// @param warn  told when writing begins to fail, and when it works again
  CheckpointWriter(std::filesystem::path path, std::function<void(const std::string&)> warn)
      : path_(std::move(path)), warn_(std::move(warn)) {}
  /// @return whether it was written
  bool write(const Layers& frame, const WordRows& state);

 private:
  std::filesystem::path path_;
  std::function<void(const std::string&)> warn_;
  bool failing_ = false;
};

/// A part of a render: a file, or a frame in memory that has its sums as words.
struct RenderPart {
  std::string name;  ///< for errors
  std::filesystem::path file;
  const Layers* frame = nullptr;  ///< instead of the file

  static RenderPart of_file(const std::filesystem::path& file) { return {file.string(), file}; }
};

/// Merges parts of one render, written with keep_state or as checkpoints: the same bits as one render of all their
/// samples.
/// @param keep_state  the result can be merged or resumed again
/// @throws InputError: other scenes, seeds, crops, layers or program versions (says which), overlapping samples, no
/// state; Interrupted
Layers merge_parts(const std::vector<RenderPart>& parts, bool keep_state, const Task& task = {});
/// The same of files.
Layers merge_parts(const std::vector<std::filesystem::path>& files, bool keep_state, const Task& task = {});

}  // namespace brume

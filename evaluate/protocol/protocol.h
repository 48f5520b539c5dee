#pragma once
#include <filesystem>
#include <functional>
#include <optional>

#include "evaluate/protocol/cache.h"
#include "evaluate/protocol/results.h"

namespace brume {

/// Of the frames that are reported; the others count up from it.
inline constexpr int64_t kFirstNoisySeed = 1;
/// Of the first reference; the second has the next.
inline constexpr int64_t kReferenceSeed = 1000001;
/// Of the frame that searches are made on.
inline constexpr int64_t kTuningSeed = 2000001;

/// A rendered frame and what it cost.
struct TimedFrame {
  Layers layers;
  double seconds = 0;  ///< of sampling; guides not included
};

/// One frame of a scene.
struct FrameRequest {
  int spp = 0;
  int64_t seed = 0;
  RecordedData data;
  std::filesystem::path records;  ///< where to write what happened to each sample; empty: nowhere
};

/// One scene to evaluate. The protocol does not know who renders it.
struct EvaluationScene {
  std::string name;
  std::string hash;  ///< of everything that decides its picture
  double exposure = 1.0;
  /// A frame's direct, indirect, coverage and beauty, and what else was asked for.
  std::function<TimedFrame(const FrameRequest& request, const Task& task)> render;
  /// Seconds that the guides of a frame of so many samples take; null where there are none to time.
  std::function<double(int spp, const Task& task)> time_guides = {};
  /// Frames of another renderer, which are what they are: `render` reads them.
  struct Foreign {
    int references = 1;  ///< one or two; their seeds are kReferenceSeed and the next
    int spp = 0;         ///< of the noisy frames
    int seeds = 0;       ///< how many there are, from kFirstNoisySeed on
  };
  std::optional<Foreign> foreign = {};
};

/// How many stages evaluate() will announce.
size_t stage_count(const std::vector<EvaluationScene>& scenes, const EvaluationSettings& settings);

/// Runs the protocol of the gradient-kernel paper's Table 1. `stage(name)` gives each step its own task.
/// Everything rendered, filtered and found lies in the cache, and is not made again. A filter that fails on a frame, or
/// takes longer than it may, is a line that says so.
/// @throws InputError; Interrupted
Evaluation evaluate(const std::vector<EvaluationScene>& scenes, const EvaluationSettings& settings, const Cache& cache,
                    const std::function<Task(const std::string&)>& stage);

}  // namespace brume

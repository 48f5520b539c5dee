#pragma once
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/progress.h"
#include "image/layers.h"
#include "render/camera.h"
#include "render/film.h"
#include "render/integrator.h"
#include "render/media.h"
#include "render/surfaces.h"

namespace brume {

/// What a render cost and whether it kept its promises.
struct RenderReport {
  double seconds = 0, cpu_seconds = 0;  ///< of the sampling alone, without loading
  PathCounters counters;
  uint64_t invalid_samples = 0;
  struct Where {
    int x, y;
    uint32_t sample;
  };
  std::optional<Where> first_invalid;  ///< first in row order
  int samples_per_pixel = 0;           ///< that the frame holds now

  /// One line a person reads, and a line for each promise not kept.
  std::string summary() const;
};

struct RenderResult {
  Layers layers;
  RenderReport report;
};

/// Which samples to take, and what to do on the way.
struct RenderJob {
  int spp = 64;  ///< of the whole picture
  int64_t seed = 0;
  int part = 1, parts = 1;  ///< this render takes the part-th of `parts` equal shares of the samples, counted from 1
  struct Crop {
    int x0, y0, x1, y1;  ///< x1, y1 exclusive
  };
  std::optional<Crop> crop;
  double time_limit = 0;    ///< seconds of sampling after which no new pass begins; 0: none
  double target_error = 0;  ///< relative error (Film::relative_error) at which to stop; 0: none

  bool keep_state = false;  ///< the result carries the sums of its samples, to be merged
  /// Written every checkpoint_seconds, at the end and when interrupted. A checkpoint that cannot be written ends
  /// nothing: `warn` is told, and the next one is tried.
  std::filesystem::path checkpoint;
  double checkpoint_seconds = 300;
  std::filesystem::path resume;  ///< a checkpoint (or part) to go on from
  std::string program;           ///< who renders: states of another program version are refused

  std::filesystem::path
      records;  ///< per-sample records go here (PathRecord); needs LayerRequest::records, and one pass

  /// Called whenever a tile's pixels have changed, from any thread, one at a time.
  std::function<void(const Film&, int tile)> watch;
  /// Called at once with what someone who waits for the picture should know.
  std::function<void(const std::string&)> warn;
  /// Called between passes with what the frame holds; to fill in what its caller adds to headers.
  std::function<void(Layers&)> stamp;
};

/// A scene loaded and ready: volumes read, structures built, plan made. Rendering does not change it.
class PreparedScene {
 public:
  /// @throws InputError: what the loaders of volumes, lights and surfaces throw
  PreparedScene(Scene scene, const LayerRequest& layers, const Task& task = {});
  PreparedScene(const PreparedScene&) = delete;  // its parts refer to one another
  PreparedScene& operator=(const PreparedScene&) = delete;

  const Scene& scene() const { return scene_; }
  const Plan& plan() const { return context_.plan; }
  /// The first medium, or null where nothing scatters.
  const Medium* medium() const { return media_.media().empty() ? nullptr : &media_.media()[0]; }
  const Lights& lights() const { return lights_; }
  const PathContext& context() const { return context_; }
  const dvec3& world_shift() const { return media_.world_shift(); }
  const std::vector<std::string>& notes() const { return notes_; }
  std::string explain() const { return brume::explain(context_.plan, scene_, media_, lights_, surfaces_.get()); }

  /// The same bits for any number of threads, any split into parts and any interruption in between.
  /// @throws Interrupted after a checkpoint was written, where one was asked for; InputError
  RenderResult render(const RenderJob& job, const Task& task = {}) const;
  RenderResult render(int spp, int64_t seed, const Task& task = {}) const;
  /// One sample of a pixel, as render() takes it: to look into one that went wrong.
  PathSample replay(int64_t seed, int x, int y, uint32_t sample) const;

  /// The camera ray and the random numbers of one sample.
  PathRequest request(const Camera& camera, int64_t seed, int x, int y, uint32_t sample,
                      const PixelStart& start = {}) const;
  /// Of the pixels of a window, row by row.
  std::vector<PixelStart> pixel_starts(const Camera& camera, const RenderJob::Crop& window,
                                       const Task& task = {}) const;

 private:
  void calibrate_flash();
  /// A grid of pixels spread over the picture.
  std::vector<std::pair<int, int>> coarse_pixels(int grid) const;
  void describe(Layers& layers, const Camera& camera, const RenderJob& job, int first, int end,
                const RenderReport& report) const;

  Scene scene_;
  std::vector<std::string> notes_;
  SceneMedia media_;
  std::unique_ptr<Surfaces> surfaces_;
  Lights lights_;
  LaneGrid lane_grid_;
  std::vector<LaneGrid> glow_grids_;
  PathContext context_;
};

/// Merges parts of one render, written with keep_state or as checkpoints: the same bits as one render of all their
/// samples.
/// @param keep_state  the result can be merged or resumed again
/// @throws InputError: other scenes, seeds, crops, layers or program versions (says which), overlapping samples, no
/// state; Interrupted
Layers merge_parts(const std::vector<std::filesystem::path>& files, bool keep_state, const Task& task = {});

}  // namespace brume

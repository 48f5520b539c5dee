#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/progress.h"
#include "image/layers.h"
#include "render/camera.h"
#include "render/integrator.h"
#include "volume/vdb_io.h"

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

  /// One line a person reads, and a line for each promise not kept.
  std::string summary() const;
};

struct RenderResult {
  Layers layers;
  RenderReport report;
};

/// A scene loaded and ready: volumes read, structures built, plan made. Rendering does not change it.
class PreparedScene {
 public:
  /// @throws InputError: what read_vdb_info, load_density and the lights throw
  PreparedScene(Scene scene, const LayerRequest& layers, const Task& task = {});

  const Scene& scene() const { return scene_; }
  const Plan& plan() const { return context_.plan; }
  const Medium* medium() const { return medium_ ? &*medium_ : nullptr; }
  const Lights& lights() const { return lights_; }
  const PathContext& context() const { return context_; }
  const dvec3& world_shift() const { return world_shift_; }
  const std::vector<std::string>& notes() const { return notes_; }
  std::string explain() const { return context_.plan.explain(scene_, lights_, medium()); }

  /// The same bits for any number of threads.  @throws Interrupted
  RenderResult render(int spp, int64_t seed, const Task& task = {}) const;
  /// One sample of a pixel, as render() takes it: to look into one that went wrong.
  PathSample replay(int64_t seed, int x, int y, uint32_t sample) const;

 private:
  Scene scene_;
  std::vector<std::string> notes_;
  dvec3 world_shift_{0};
  std::unique_ptr<DensityField> field_;
  std::optional<Medium> medium_;
  Lights lights_;
  PathContext context_;
};

}  // namespace brume

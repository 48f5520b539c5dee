#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "base/progress.h"
#include "render/guides/guides.h"
#include "render/session/explain.h"
#include "render/session/render_job.h"
#include "render/world/camera.h"
#include "render/world/media.h"
#include "render/world/surfaces.h"

namespace brume {

/// A scene loaded and ready: volumes read, structures built, plan made. Rendering does not change it.
class PreparedScene {
 public:
  /// @throws InputError: what the loaders of volumes, lights and surfaces throw
  PreparedScene(Scene scene, const LayerRequest& layers, const Task& task = {});
  PreparedScene(const PreparedScene&) = delete;  // its parts refer to one another
  PreparedScene& operator=(const PreparedScene&) = delete;

  /// Takes the place of another scene of the same world (world_of), and other layers, for the renders that follow: what
  /// was read, built and solved stays. They have the bits that they would have had of a scene prepared anew. Not while
  /// a render runs.
  /// @throws InputError as Camera; std::logic_error for another world; Interrupted. Then all is as it was
  void become(Scene scene, const LayerRequest& layers, const Task& task = {});

  const Scene& scene() const { return scene_; }
  const Plan& plan() const { return context_.plan; }
  /// The first medium, or null where nothing scatters.
  const Medium* medium() const { return media_.media().empty() ? nullptr : &media_.media()[0]; }
  const SceneMedia& media() const { return media_; }
  const Lights& lights() const { return lights_; }
  const PathContext& context() const { return context_; }
  /// Whether some dielectric lets light through straight, which is biased.
  bool straight_shadows() const { return surfaces_ && surfaces_->any_straight(); }
  const dvec3& world_shift() const { return media_.world_shift(); }
  const std::vector<std::string>& notes() const { return notes_; }
  /// @param samples  that guides are to serve
  std::string explain(int samples, const Task& task = {}) const {
    return brume::explain(plan(), scene_, media_, lights_, surfaces_.get(), guides(samples, task));
  }
  /// Those that serve pictures of so many samples per pixel: solved when they are first asked for, then kept. Null
  /// unless guides are recorded. @throws Interrupted
  const Guides* guides(int samples, const Task& task = {}) const;
  /// Whether guides() gives them at once.
  bool has_guides(int samples) const;
  /// Solves what guides() gives, on any thread, even while this becomes other scenes of its world.
  std::function<void(const Task&)> guides_solver(int samples) const;
  /// How many have been solved.
  size_t guides_solved() const;

  /// The same bits for any number of threads, any split into parts and any interruption in between.
  /// @throws Interrupted after a checkpoint was written, where one was asked for; InputError
  RenderResult render(const RenderJob& job, const Task& task = {}) const;
  RenderResult render(int spp, int64_t seed, const Task& task = {}) const;
  /// One sample of a pixel, as render() takes it: to look into one that went wrong.
  PathSample replay(int64_t seed, int x, int y, uint32_t sample) const;

  Camera camera() const { return {scene_.camera, scene_.film.width, scene_.film.height, world_shift()}; }
  /// The camera ray and the random numbers of one sample.
  PathRequest request(const Camera& camera, int64_t seed, int x, int y, uint32_t sample,
                      const EntryBound& start = {}) const {
    return camera_request(scene_, plan(), camera, seed, x, y, sample, start);
  }
  /// Of the pixels of a window, row by row.
  std::vector<EntryBound> entry_bounds(const Camera& camera, const RenderJob::Crop& window,
                                       const Task& task = {}) const;

 private:
  using GuidesKey = std::pair<double, double>;  // detail, Guides::most_nodes
  struct KeptGuides {
    std::mutex solving;
    std::optional<Guides> solved;
  };
  KeptGuides& kept_guides(int samples) const;
  PathContext context_for(const Scene& scene, const Camera& camera, Plan plan, const Task& task);
  std::vector<std::string> notes_for(const Scene& scene, const LayerRequest& layers) const;
  void find_isosurfaces(const Task& task);
  void prepare_lanes(const Task& task);

  Scene scene_;
  std::vector<std::string> world_notes_, notes_;
  SceneMedia media_;
  std::unique_ptr<Surfaces> surfaces_;
  Lights lights_;
  std::vector<LaneGrid> lane_grids_, emission_grids_;  // of media and emissions
  std::vector<DisplacedLaneGrid> displaced_grids_;     // of media
  StopSignal stop_;                                    // while it is prepared
  PathContext context_;
  mutable std::mutex guides_mutex_;
  mutable std::map<GuidesKey, KeptGuides> guides_;
};

}  // namespace brume

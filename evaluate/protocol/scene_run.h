#pragma once
#include <memory>

#include "evaluate/protocol/protocol.h"
#include "evaluate/protocol/result_store.h"
#include "evaluate/protocol/studies.h"

namespace brume {

/// What the search found for a contender at one spp of one scene.
struct Found {
  FilterSettings here;                      // on this scene's frame
  std::optional<FilterSettings> elsewhere;  // on the other scenes' frames, where there are any
};

/// The protocol on one scene: its frames, references and lines.
class SceneRun {
 public:
  SceneRun(const EvaluationScene& scene, const EvaluationSettings& settings, const ResultStore& store);

  const EvaluationScene& scene() const { return scene_; }
  const std::vector<int>& spp() const { return spp_; }
  int seeds() const { return seeds_; }
  bool is_searched() const { return settings_.tune && !scene_.foreign; }
  SceneResult& result() { return result_; }
  void load_references(int spp, const Task& task);
  void render(int spp, int seed, const Task& task);
  TuningFrame tuning_frame(int spp, const Task& task);
  void filter_and_measure(const std::vector<std::vector<Found>>& found, const Task& task);
  /// Each filter with its best settings of this scene, its layers left out and its parameters changed one by one.
  void study(const Task& task);

 private:
  /// What a render costs that records only what a method reads; measured where it is asked for first.
  double render_seconds(NoisyFrames& frames, const Contender* contender, const Task& task);
  /// A method's line with its errors.
  MethodResult run(NoisyFrames& frames, const Contender* contender, const FilterSettings* filter, Tuning tuning,
                   const Task& task);
  FilterRun filter_run(const Contender& contender, const FilterSettings& filter) const;
  /// A filter on the frames of all seeds, and its errors, into a line.
  /// @param example  whether the line is to have one
  void run_all(const FilterRun& run, NoisyFrames& frames, MethodResult& m, const Task& task, bool example = true);
  /// Fills in the errors of a line, which are taken of its pictures where they are not known.
  /// @param pictures  those that are in memory
  void measure(MethodResult& m, NoisyFrames& frames, const Task& task, std::vector<std::optional<Layers>> pictures = {},
               bool example = true);
  /// Doubles the references' samples until their noise is the wanted share of the best method's error.
  void refine_references(const std::vector<std::unique_ptr<NoisyFrames>>& frames, const Task& task);
  bool is_studied(int spp) const;
  MethodResult studied(const FilterRun& run, const MethodResult& like, NoisyFrames& frames, const Task& task);
  void ablate(const Contender& contender, const FilterSettings& settings, const MethodResult& best, NoisyFrames& frames,
              const Task& task);
  void vary(const Contender& contender, const FilterSettings& settings, const MethodResult& best, NoisyFrames& frames,
            const Task& task);
  /// What decides the errors of a picture.
  std::string errors_key(const std::string& picture_key) const;
  /// @param noisy  whether it is a frame that nothing has cleaned
  PictureErrors errors_of_picture(const Layers& picture, bool noisy, const Task& task) const;
  /// Of a layer of a picture against one of the references, by region.
  std::vector<Errors> errors_of_layer(const Layers& picture, const LayerName& own, const LayerName& theirs,
                                      ErrorScope scope, const Task& task) const;
  const RgbPlanes second() const { return references_.back().layers.rgb(layer::beauty); }
  /// One render for all methods that need no statistics.
  void prepare_light_data();
  void describe();

  const EvaluationScene& scene_;
  const EvaluationSettings& settings_;
  const ResultStore& store_;
  RecordedData data_, light_data_;
  ApplyOptions options_;
  ErrorScope scope_ = ErrorScope::kPixels;
  std::vector<int> spp_;
  int seeds_ = 0, reference_spp_ = 0;
  std::vector<TimedFrame> references_;
  SceneResult result_;
};

}  // namespace brume

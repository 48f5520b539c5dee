#pragma once
#include <string>
#include <vector>

#include "base/progress.h"
#include "image/layers.h"

namespace brume {

/// What helps a filter to tell an edge from noise, made from the layers of a frame: one to three channels, mapped by
/// one scale so that the 1st to 99th percentile of the whole frame is [0, 1].
struct Feature {
  std::string name;
  std::vector<Plane> mean;
  std::vector<Plane> variance;        ///< of the mean; 0 where the frame does not know it
  std::vector<Plane> half_a, half_b;  ///< the mean again where the frame has no halves
};

/// Which features a frame offers, and their scales: decided once over the whole frame, so that tiles agree.
class FeaturePlan {
 public:
  /// @param named  names, `guides` for all that are made from guides; empty: all others    @throws InputError for a
  /// name that is none, with the nearest
  FeaturePlan(const Layers& frame, const std::vector<std::string>& named, const Task& task);
  FeaturePlan() = default;  ///< none

  /// Which parts of the features are made; the others stay empty.
  struct Parts {
    bool variance = true, halves = true;
  };
  /// The features of (a crop of) the frame.
  std::vector<Feature> build(const Layers& frame, Parts parts, const Task& task) const;
  /// What was taken and what was left out, and why, in one line.
  const std::string& note() const { return note_; }
  bool empty() const { return chosen_.empty(); }

  /// What the caller named; otherwise what the filter prefers, or all there is where the frame has nothing of that.
  static FeaturePlan choose(const Layers& frame, const std::vector<std::string>& named,
                            const std::vector<std::string>& preferred, const Task& task);

  /// Stands for every feature that is made from guides.
  static constexpr std::string_view kGuides = "guides";
  static bool is_of_guides(std::string_view name);

  /// Every name, for help and errors.
  static std::vector<std::string> names();
  /// The layers they are made from.
  static const std::vector<LayerName>& sources();

 private:
  struct Chosen {
    size_t index;  // in the table
    float offset, scale;
  };
  std::vector<Chosen> chosen_;
  std::string note_;
};

}  // namespace brume

#pragma once
#include "filters/inputs/features.h"
#include "filters/inputs/planes.h"
#include "filters/kernels/block_weights.h"

namespace brume {

using kernels::Distance;
using kernels::Membership;
using kernels::WeightModel;

/// A neighbour's place, and its share in the kernel over distance.
struct Offset {
  int dx, dy;
  float weight = 1;
};

/// The square of half width `radius`, every neighbour alike.
std::vector<Offset> square_window(int radius);
/// The same with exp(-r^2 / (2 sigma^2)); sigma <= 0: alike.
std::vector<Offset> gaussian_window(int radius, double sigma);

/// Taps of a patch whose pixels count alike.
std::vector<float> box_patch(int radius);

/// The distance of non-local means between noisy planes.
Distance noise_distance(std::span<const Plane* const> guide, std::span<const Plane* const> variance, int patch_radius,
                        float k);

/// A noisy picture, and the variance of its pixels.
struct Noisy {
  RgbPlanes mean, variance;
};
/// The same between a pixel of one frame and its neighbours in another, or in the same.
Distance noise_distance(const Noisy& here, const Noisy& there, int patch_radius, float k);

/// Distances of features in units of their own noise and slope, the rule of Rousselle, Manzi and Zwicker 2013, equation
/// 6: ((df)^2 - (V_p + min(V_p, V_q))) / (k^2 max(tau, V_p, |grad f_p|^2)), where the gradient takes the smaller of the
/// two one-sided differences along each axis.
class FeatureDistances {
 public:
  FeatureDistances(const std::vector<Feature>& features, float k, float tau, const Task& task);
  /// @param there  the features of the neighbours' frame, where it is another
  void add_to(WeightModel& model, const std::vector<Feature>* there = nullptr) const;

 private:
  std::vector<Distance> distances_;
  std::vector<Plane> own_;
};

/// Sum over planes: one variance for a feature of several channels.
Plane sum_of(const std::vector<Plane>& planes);

struct Averages {
  std::vector<Plane> values;
  Plane weight;  ///< sum of the weights
  Plane noise;   ///< sum w^2 V / (sum w)^2, where a variance was given
};

/// sum s_o w(p, p + o) v(p + o) / sum s_o w(p, p + o) over the offsets, for each plane of values; a pixel whose weights
/// all vanish keeps its value.
Averages weighted_average(const WeightModel& model, std::span<const Offset> offsets,
                          std::span<const Plane* const> values, const Task& task);

/// A frame of a sequence as the window of another sees it: how its pixels compare with that frame's, which of them, and
/// what they hold.
struct Slice {
  WeightModel model;
  std::vector<Offset> offsets;
  std::vector<const Plane*> values;
};
/// The same over the frames of a sequence; values[c] is where the window lies.
std::vector<Plane> average_over_frames(std::span<const Slice> slices, std::span<const Plane* const> values,
                                       const Task& task);

/// One of several averages whose weights share their distances.
struct Variant {
  float scale = 1;               ///< of the joined distance
  const Plane* place = nullptr;  ///< 1 / (2 sigma^2) of each pixel's own kernel over distance in the picture
  std::vector<float> offsets;    ///< s_o of each offset; 0: leave it out. Empty: the offset's own
};
std::vector<Averages> weighted_averages(const WeightModel& model, std::span<const Offset> offsets,
                                        std::span<const Variant> variants, std::span<const Plane* const> values,
                                        const Plane* variance, const Task& task);

/// The weights of one offset at every pixel.
Plane weights_toward(const WeightModel& model, int dx, int dy, int width, int height, const Task& task);

/// Calls body(block) for blocks that cover an image, on the task's threads.
void for_each_block(int width, int height, int block_width, int block_height, const Task& task,
                    const std::function<void(const Box&)>& body);

}  // namespace brume

#pragma once
#include <vector>

#include "filters/inputs/planes.h"

namespace brume {

/// Where the variance of a signal comes from.
enum class NoiseSource {
  kLayers,   ///< the frame's mean_variance, its level corrected by the halves where there are any
  kSpatial,  ///< the picture itself (filters/patch/picture_noise.h), for frames without statistics
};

/// Whether a frame has two half images of a signal that hold samples both: not where its header says that pixels have
/// one sample.
bool has_halves(const Layers& frame, const LayerName& signal);

/// How much noise a picture carries at each pixel: variance of the pixel mean, per channel, above 0 wherever there is
/// any doubt (docs/methods.md, Noise of a frame):
/// - V * box21(V_halves) / box21(V), because low-discrepancy samples vary less than V says; V_halves = (A - B)^2 / 4
/// - at least a quarter of its neighbours' median, because a pixel that happened to stay black is no certain pixel
/// - one sample per pixel: the variance among 3 x 3 pixels, which holds signal too
/// @param half_a, half_b  null: no correction       @param samples  per pixel; null: unknown
Rgb corrected_variance(const RgbPlanes& mean, const RgbPlanes& variance, const RgbPlanes& half_a,
                       const RgbPlanes& half_b, const Plane* samples, const Task& task);

/// From the difference of two halves alone, averaged over 5 x 5 pixels.
Rgb variance_of_halves(const RgbPlanes& mean, const RgbPlanes& half_a, const RgbPlanes& half_b, const Task& task);

/// Raises a variance to a quarter of its neighbours' median, because a pixel that happened to stay black is no certain
/// pixel, and to what rounding leaves of the mean.
void lift_variance(Plane& variance, const Plane& mean, const Task& task);

/// How much noise a picture carries, as one number: its standard deviation in CIE-Lab units. From the difference of the
/// halves; without them from the variance, colour channels being taken to err together, as they do where samples are
/// grey. Root mean square over blocks of 8 x 8 pixels, and of those that have any noise the median, so that neither
/// fireflies nor empty background decide.
/// @param medium  pixels at 0 are left out; null: all count
double lab_noise(const RgbPlanes& mean, const RgbPlanes& variance, const RgbPlanes& half_a, const RgbPlanes& half_b,
                 double exposure, const Plane* medium, const FrameSpace& space = {});

/// The median of a picture's luminances above zero, with the weights of Xu and Pattanaik 2005; 0 where there is none.
/// Of large pictures a grid of some ten thousand pixels is read. No single pixel moves it far.
double typical_luminance(const RgbPlanes& picture);

/// What becomes of pixels far brighter than their surroundings and their own noise explain.
enum class Outliers {
  kKeep,
  kExtreme,       ///< only those that outshine everything around them (filters/inputs/extremes.h)
  kClamp,         ///< down to the limit; their energy is lost
  kRedistribute,  ///< down to the limit; the energy goes to the neighbourhood (Gaussian, sigma 5)
};

/// A signal with its statistics, owned, on its way to a filter.
struct NoisySignal {
  Rgb mean, variance, half_a, half_b;
  std::vector<Rgb> buckets;
};

/// Limits a pixel's luminance to median5x5 + 6 sqrt(median V) wherever one of its buckets holds more than half of its
/// light (without buckets: wherever it is also beyond twice the 5 x 5 maximum of its other pixels); the colour's
/// direction stays.
/// @return  per pixel luminance removed
Plane limit_outliers(NoisySignal& signal, Outliers how, const FrameSpace& space, const Task& task);

/// How far the functions above look.
inline constexpr int kNoiseReach = 64, kOutlierReach = 17;

}  // namespace brume

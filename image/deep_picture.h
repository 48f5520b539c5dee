#pragma once
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "image/layers.h"

namespace brume {

/// Where along the camera's axis what is seen of a pixel lies, surfaces and media by what they cover: without noise,
/// from the march of guides.
namespace layer {
inline constexpr LayerName depth_mean{"depth_mean", "Z", "mean depth of what is seen; 1e10 where nothing covers"};
inline constexpr LayerName depth_half{"depth_half", "Z", "depth in front of which half of what covers the pixel lies"};
inline constexpr LayerName depth_first{"depth_first", "Z", "depth in front of which a hundredth of it lies"};
inline constexpr LayerName mist{"mist", "Y", "0 near, 1 far: render.mist_start, mean by what covers, 1 behind it"};
}  // namespace layer

/// A picture whose pixels hold samples at several depths, as deep OpenEXR files do ("Interpreting OpenEXR Deep
/// Pixels").
///
/// A sample is a point, or a volume from Z to ZBack that is equally dense everywhere. Colours are multiplied by the
/// sample's own alpha, not by what stands before it. Samples of a tidy pixel are in order and do not overlap.
class DeepPicture {
 public:
  struct Channel {
    enum class Type { kHalf, kFloat, kUint };
    Type type = Type::kFloat;
    std::vector<float> values;  ///< of all samples, pixel by pixel; of whole numbers their bits
  };

  DeepPicture() = default;
  /// @param counts  samples of each pixel, row by row
  DeepPicture(const PixelWindow& data, const PixelWindow& display, std::span<const uint32_t> counts);

  int width() const { return data.width(); }
  int height() const { return data.height(); }
  size_t samples() const { return begin.back(); }
  size_t most_samples() const;  ///< of a pixel
  Channel& add(const std::string& name, Channel::Type type = Channel::Type::kFloat);
  const Channel* find(const std::string& name) const;
  /// Of a pixel, counted row by row: it has the samples from the first to before the second.
  std::pair<size_t, size_t> range(size_t pixel) const { return {begin[pixel], begin[pixel + 1]}; }

  PixelWindow data, display;
  std::vector<size_t> begin = {0};  ///< of each pixel's samples; one more for the end
  std::map<std::string, Channel> channels;
  std::map<std::string, Attribute> header;
};

/// A pixel's samples one by one, for what changes their number: z, z_back, then alpha and what is composited, in the
/// order of the caller.
struct DeepPixel {
  size_t stride = 0;          ///< numbers of each sample, at least 3
  std::vector<float> values;  ///< sample by sample
  static constexpr size_t kZ = 0, kZBack = 1, kAlpha = 2;

  size_t size() const { return stride ? values.size() / stride : 0; }
  float* at(size_t sample) { return values.data() + sample * stride; }
  const float* at(size_t sample) const { return values.data() + sample * stride; }
};

/// What of a sample a holdout at a depth leaves in front of it: a factor of its alpha, and one of its colours.
struct DeepShare {
  double alpha, colour;
};
/// @param alpha  of the sample   @param share  of its length that is in front
DeepShare front_share(double alpha, double share);

/// Sorts, splits samples where they overlap and merges what then lies at the same place.
/// Source: OpenEXR, "Interpreting OpenEXR Deep Pixels", 3.1 and 3.2
void make_tidy(DeepPixel& pixel);

/// What a tidy pixel shows in front of a depth: each of its numbers from alpha on, composited front to back.
std::vector<double> composited(const DeepPixel& pixel, float before);

/// Gives a picture the colours that another flat one has: each sample's red, green and blue change as the pixel's do;
/// where a pixel had none they are shared as the samples cover it. Depths and alphas stay.
/// @param from  flattened(picture)   @param to  the same size, R G B
void recolour(DeepPicture& picture, const Layers& from, const Layers& to);

/// The picture seen from the front: every channel but Z and ZBack composited, those of whole numbers left out. With
/// alpha for each colour (AR, AG, AB) those count, and A, where it is missing, is their mean.
/// @param before  only what is in front of this depth
/// @throws InputError: no Z or no alpha
Layers flattened(const DeepPicture& picture, float before);
Layers flattened(const DeepPicture& picture);

}  // namespace brume

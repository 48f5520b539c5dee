#pragma once
#include <array>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/vec.h"
#include "image/plane.h"

namespace brume {

/// A named group of channels in a frame; the full channel name is "NAME.C", or "C" for the top layer.
struct LayerName {
  std::string_view name;      ///< empty for the beauty on top
  std::string_view channels;  ///< one letter each
  std::string_view meaning;

  std::string channel(size_t index) const { return channel_of("", index); }
  /// "NAME.STATISTIC.C", where the statistic is mean_variance, half_a or half_b.
  std::string channel_of(std::string_view statistic, size_t index) const;
  std::string label() const { return name.empty() ? "beauty" : std::string(name); }
  friend bool operator==(const LayerName& a, const LayerName& b) {
    return a.name == b.name && a.channels == b.channels;
  }
};

/// The layers brume records and its filters read (DESIGN.md section 3).
namespace layer {
inline constexpr LayerName beauty{"", "RGB", "radiance: direct + indirect, exactly"};
inline constexpr LayerName alpha{"", "A", "1 - mean transmittance to the background"};
inline constexpr LayerName direct{"direct", "RGB", "background seen through the medium and light scattered once"};
inline constexpr LayerName indirect{"indirect", "RGB", "light scattered twice or more"};
inline constexpr LayerName gradient{"gradient", "XYZ",
                                    "mean over the paths of the unit direction of the density gradient, world space, "
                                    "where the path meets the medium's surface"};
inline constexpr LayerName coverage{"coverage", "A", "fraction of the paths that met the medium's surface"};
inline constexpr LayerName transmittance{"transmittance", "RGB", "mean transmittance to the background"};
inline constexpr LayerName sample_count{"sample_count", "Y", "samples taken"};
inline constexpr LayerName invalid_count{"invalid_count", "Y", "samples rejected as not finite"};
}  // namespace layer

/// Suffixes of a layer's statistics.
namespace statistic {
inline constexpr std::string_view mean_variance = "mean_variance";  ///< variance of the pixel mean: sample variance / n
inline constexpr std::string_view half_a = "half_a";                ///< mean of the even samples
inline constexpr std::string_view half_b = "half_b";                ///< mean of the odd samples
}  // namespace statistic

using Attribute = std::variant<std::string, int, float, std::array<float, 16>>;

/// Channels of one size under their full names, and what the header says about them.
class Layers {
 public:
  Layers() = default;
  Layers(int width, int height) : width_(width), height_(height) {}

  int width() const { return width_; }
  int height() const { return height_; }

  /// The channel `name`, made and filled with `value` if it is not there.
  Plane& add(const std::string& name, float value = 0.0f);
  /// Takes over a plane. @throws std::logic_error when its size is another
  void set(const std::string& name, Plane plane);
  const Plane* find(const std::string& name) const;
  Plane* find(const std::string& name);
  /// @throws std::logic_error naming the channel and what is there instead
  const Plane& at(const std::string& name) const;

  bool has(const LayerName& layer, std::string_view statistic = "") const;
  /// Three channels of a layer, in its order. @throws std::logic_error
  std::array<const Plane*, 3> rgb(const LayerName& layer, std::string_view statistic = "") const;
  std::array<Plane*, 3> add_rgb(const LayerName& layer, std::string_view statistic = "");

  const std::map<std::string, Plane>& channels() const { return channels_; }
  std::vector<std::string> names() const;

  std::map<std::string, Attribute> header;
  std::string text(const std::string& key, const std::string& otherwise = "") const;
  /// A number in the header, whichever way it was written; nothing when it is absent or no number.
  std::optional<double> number(const std::string& key) const;

 private:
  int width_ = 0, height_ = 0;
  std::map<std::string, Plane> channels_;
};

/// How many values of the plane are NaN or infinite.
size_t count_not_finite(const Plane& plane);

}  // namespace brume

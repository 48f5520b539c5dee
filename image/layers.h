#pragma once
#include <array>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/vec.h"
#include "image/color_space.h"
#include "image/plane.h"
#include "image/stored_plane.h"

namespace brume {

/// Three channels that belong together, read only.
using RgbPlanes = std::array<const Plane*, 3>;

/// A named group of channels in a frame; the full channel name is "NAME.C", or "C" for the top layer.
struct LayerName {
  std::string_view name;      ///< empty for the beauty on top
  std::string_view channels;  ///< one letter each
  std::string_view meaning;

  std::string channel(size_t index) const { return channel_of("", index); }
  /// "NAME.STATISTIC.C", where the statistic is mean_variance, half_a or half_b.
  std::string channel_of(std::string_view statistic, size_t index) const;
  /// All of them, in order.
  std::vector<std::string> channel_names(std::string_view statistic = "") const;
  std::string label() const { return name.empty() ? "beauty" : std::string(name); }
  friend bool operator==(const LayerName& a, const LayerName& b) {
    return a.name == b.name && a.channels == b.channels;
  }
};

/// The layers brume records and its filters read (docs/methods.md, Layers and statistics).
namespace layer {
inline constexpr LayerName beauty{"", "RGB", "radiance: direct + indirect, exactly"};
inline constexpr LayerName alpha{"", "A", "1 - mean transmittance to the background"};
inline constexpr LayerName direct{"direct", "RGB", "background, emission, surfaces lit directly, light scattered once"};
inline constexpr LayerName indirect{"indirect", "RGB", "light scattered twice or more"};
inline constexpr LayerName background{"background", "RGB", "part of direct: lights and sky seen through the medium"};
inline constexpr LayerName emission{"emission", "RGB", "part of direct: the medium's own emission"};
inline constexpr LayerName single{"single", "RGB", "part of direct: light scattered once by a medium"};
inline constexpr LayerName surface{"surface", "RGB", "part of direct: surfaces that emit or are lit directly"};
inline constexpr LayerName surface_emission{"surface_emission", "RGB", "part of surface: what it emits itself"};
inline constexpr LayerName volume_indirect{"volume_indirect", "RGB",
                                           "part of indirect: paths whose first event is in a medium"};
inline constexpr LayerName surface_indirect{"surface_indirect", "RGB",
                                            "part of indirect: paths whose first event is on a surface"};
inline constexpr LayerName gradient{
    "gradient", "XYZ",
    "mean over the paths of the unit direction of the density gradient, world space, where the path meets the medium's isosurface"};
inline constexpr LayerName gradient_first_scatter{"gradient_first_scatter", "XYZ",
                                                  "the same where the path scatters first; 0 for paths that do not"};
inline constexpr LayerName gradient_transmittance_weighted{
    "gradient_transmittance_weighted", "XYZ",
    "the same over the camera ray, weighted by transmittance times extinction: the expectation of gradient_first_scatter without its noise"};
inline constexpr LayerName coverage{"coverage", "A", "fraction of the paths that met the medium's isosurface"};
inline constexpr LayerName transmittance{"transmittance", "RGB", "mean transmittance to the background"};
inline constexpr LayerName scatter_depth{
    "scatter_depth", "Z", "distance to the first scattering; divide by the scattered share, scatter_share"};
inline constexpr LayerName scatter_position{"scatter_position", "XYZ", "where that is, world space; divide likewise"};
inline constexpr LayerName scatter_density{"scatter_density", "Y", "density there; divide likewise"};
inline constexpr LayerName scatter_share{"scatter_share", "A",
                                         "fraction of the paths whose first event is in a medium"};
inline constexpr LayerName optical_depth{"optical_depth", "Y", "of the camera ray, marched, clamped at 50"};
inline constexpr LayerName albedo{"albedo", "RGB", "at the first event: single-scattering albedo, or the surface's"};
inline constexpr LayerName surface_albedo{"surface_albedo", "RGB", "of the first surface, where it is the first event"};
inline constexpr LayerName surface_share{"surface_share", "A",
                                         "fraction of the paths whose first event is on a surface"};
inline constexpr LayerName normal{"normal", "XYZ", "of the first surface, where it is the first event"};
inline constexpr LayerName depth{"depth", "Z", "distance to that surface"};
inline constexpr LayerName position{"position", "XYZ", "where that is, world space"};
inline constexpr LayerName flash{"flash", "RGB", "virtual flash image, media version: direct plus a lamp at the eye"};
inline constexpr LayerName catcher{"catcher", "RGB", "light that shadow catchers reflect to the camera"};
inline constexpr LayerName catcher_unshadowed{"catcher_unshadowed", "RGB", "the same if nothing cast a shadow"};
inline constexpr LayerName sample_count{"sample_count", "Y", "samples taken"};
inline constexpr LayerName invalid_count{"invalid_count", "Y", "samples rejected as not finite"};
}  // namespace layer

/// Suffixes of a layer's statistics.
namespace statistic {
inline constexpr std::string_view mean_variance = "mean_variance";  ///< variance of the pixel mean: sample variance / n
inline constexpr std::string_view half_a = "half_a";                ///< mean of the even samples
inline constexpr std::string_view half_b = "half_b";                ///< mean of the odd samples
/// Means of the samples whose index is k modulo 8.
inline constexpr std::array<std::string_view, 8> buckets = {"bucket_0", "bucket_1", "bucket_2", "bucket_3",
                                                            "bucket_4", "bucket_5", "bucket_6", "bucket_7"};
}  // namespace statistic

using Attribute = std::variant<std::string, int, float, std::array<float, 16>, Chromaticities>;

/// A header's `chromaticities`; else those of ACES where it says that it is a container of that; else those of the
/// space that `colorInteropID` or OpenImageIO's `oiio:ColorSpace` names.
std::optional<Chromaticities> chromaticities_of(const std::map<std::string, Attribute>& header);

/// A rectangle of pixels, `hi` exclusive; row 0 is on top.
struct PixelWindow {
  ivec2 lo{0}, hi{0};

  int width() const { return hi.x - lo.x; }
  int height() const { return hi.y - lo.y; }
  bool empty() const { return hi.x <= lo.x || hi.y <= lo.y; }
  /// What lies in both; may be empty.
  PixelWindow common(const PixelWindow& other) const { return {glm::max(lo, other.lo), glm::min(hi, other.hi)}; }
  /// "x0,y0,x1,y1", as `render --crop` takes it.
  std::string text() const;
  friend bool operator==(const PixelWindow&, const PixelWindow&) = default;
};

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
  /// A channel, or a stored one.
  void remove(const std::string& name) { channels_.erase(name), stored_.erase(name); }
  const Plane* find(const std::string& name) const;
  Plane* find(const std::string& name);
  /// @throws std::logic_error naming the channel and what is there instead
  const Plane& at(const std::string& name) const;

  bool has(const LayerName& layer, std::string_view statistic = "") const;
  /// Three channels of a layer, in its order. @throws std::logic_error
  RgbPlanes rgb(const LayerName& layer, std::string_view statistic = "") const;
  std::array<Plane*, 3> add_rgb(const LayerName& layer, std::string_view statistic = "");

  const std::map<std::string, Plane>& channels() const { return channels_; }

  /// Channels in less memory, which only some code reads: they are not among channels().
  void set_stored(const std::string& name, StoredPlane plane);
  /// Rows of such a channel from y on.
  void store_rows(const std::string& name, int y, const Plane& rows, const Task& task);
  const std::map<std::string, StoredPlane>& stored() const { return stored_; }

  /// Channels of raw 32-bit words, row by row: state that must survive a file bit for bit.
  std::vector<uint32_t>& add_words(const std::string& name);
  const std::vector<uint32_t>* find_words(const std::string& name) const;
  const std::map<std::string, std::vector<uint32_t>>& words() const { return words_; }

  /// Where the pixels lie in the picture that is shown, as in an OpenEXR header: the data window begins at `origin`,
  /// the display window at `display_origin` and has the size `display`. A crop lies inside the display window, overscan
  /// around it. A frame without display is shown as it is.
  ivec2 origin{0}, display{0}, display_origin{0};
  PixelWindow data_window() const { return {origin, origin + ivec2(width_, height_)}; }
  PixelWindow display_window() const;
  /// A frame of the same size, place and header that has no channels.
  Layers without_channels() const;
  /// Takes over another frame's place, which has as many pixels. @throws std::logic_error when it has not
  void lie_like(const Layers& other);
  /// The pixels of a window, with this frame's header and display window; 0 where the frame has none. Words are left.
  Layers cut(const PixelWindow& window) const;

  std::vector<std::string> names() const;

  std::map<std::string, Attribute> header;
  std::string text(const std::string& key, const std::string& otherwise = "") const;
  /// A number in the header, whichever way it was written; nothing when it is absent or no number.
  std::optional<double> number(const std::string& key) const;
  /// What its R, G and B are, where the header says so; nothing: linear Rec. 709.
  std::optional<Chromaticities> chromaticities() const { return chromaticities_of(header); }

 private:
  int width_ = 0, height_ = 0;
  std::map<std::string, Plane> channels_;
  std::map<std::string, StoredPlane> stored_;
  std::map<std::string, std::vector<uint32_t>> words_;
};

/// The frame over its display window, as it is shown: overscan cut off, 0 where it has no pixels.
Layers over_display_window(Layers frame);

/// How many values of the plane are NaN or infinite.
size_t count_not_finite(const Plane& plane);

}  // namespace brume

#include "filters/regression/transport/pixels.h"

#include <algorithm>
#include <cmath>

#include "base/vec.h"
#include "filters/inputs/noise.h"

namespace brume {
namespace {

// A pixel shows the medium where its opacity is above this.
constexpr float kLeastOpacity = 1e-3f;
// Halves whose difference is below this share of their sum differ by rounding.
constexpr float kNoisy = 2e-3f;
// An edge is where normals change by so much, all components together, in a square of so many pixels on either side.
constexpr int kEdgeRadius = 1;
constexpr float kEdgeOfNormals = 0.5f;
// Standard errors that a gain must exceed.
constexpr double kSureOfMedia = 3, kSureOfSurfaces = 2;
// Around what is cleaned, more than local means reach; and what boxes are rounded to, so that lattices lie alike.
constexpr int kMargin = 32, kRounded = 64;

float normal_length(const Layers& layers, int x, int y) {
  float squares = 0;
  for (const std::string& channel : layer::normal.channel_names()) {
    const float v = layers.at(channel)(x, y);
    squares += std::isfinite(v) ? v * v : 0.0f;
  }
  return std::sqrt(squares);
}

bool shows_surfaces(const Layers& layers) {
  if (!layers.has(layer::normal)) return false;
  for (int y = 0; y < layers.height(); ++y)
    for (int x = 0; x < layers.width(); ++x)
      if (normal_length(layers, x, y) > 0) return true;
  return false;
}

}  // namespace

CleanedPixels::CleanedPixels(const std::vector<Guide>& guides, const Layers& layers, const RgbPlanes& half_a,
                             const RgbPlanes& half_b)
    : layers_(layers), half_a_(half_a), half_b_(half_b) {
  bool known = false;
  for (const Guide& g : guides) {
    if (g.kind == GuideClass::kOpacity) opacity_ = &g.channels[0].plane();
    known |= g.kind == GuideClass::kSurface;
    if (g.kind == GuideClass::kSurface || g.name == "normal")
      for (const ChannelView& channel : g.channels) surfaces_.push_back(&channel.plane());
  }
  unknown_surfaces_ = opacity_ && !known && shows_surfaces(layers);
}

bool CleanedPixels::operator()(int x, int y) const {
  return !opacity_ || (*opacity_)(x, y) > kLeastOpacity ||
         std::any_of(surfaces_.begin(), surfaces_.end(), [&](const Plane* p) { return (*p)(x, y) != 0; }) ||
         (unknown_surfaces_ && normal_length(layers_, x, y) > 0) || is_noisy(x, y);
}

/// Whether the halves differ at a pixel or beside it, as where a lens blurs the sky.
bool CleanedPixels::is_noisy(int x, int y) const {
  if (!half_a_[0]) return false;
  const Box around = Box{x, y, x + 1, y + 1}.grown(1, layers_.width(), layers_.height());
  for (size_t c = 0; c < 3; ++c)
    for (int v = around.y0; v < around.y1; ++v)
      for (int u = around.x0; u < around.x1; ++u) {
        const float a = (*half_a_[c])(u, v), b = (*half_b_[c])(u, v);
        if (std::abs(a - b) > kNoisy * std::abs(a + b)) return true;
      }
  return false;
}

Box cleaned_box(const Layers& layers, const LayerName& signal) {
  const bool halves = has_halves(layers, signal);
  const auto half = [&](std::string_view which) { return halves ? layers.rgb(signal, which) : RgbPlanes{}; };
  const CleanedPixels cleaned(guides_of(layers), layers, half(statistic::half_a), half(statistic::half_b));
  Box box{layers.width(), layers.height(), 0, 0};
  std::vector<std::pair<int, int>> rows(static_cast<size_t>(layers.height()), {layers.width(), 0});
  for_each_row(layers.height(), {}, [&](int y) {
    auto& [from, to] = rows[static_cast<size_t>(y)];
    for (int x = 0; x < layers.width() && from > x; ++x)
      if (cleaned(x, y)) from = x;
    for (to = layers.width(); to > from && !cleaned(to - 1, y);) --to;
  });
  for (int y = 0; y < layers.height(); ++y) {
    const auto& [from, to] = rows[static_cast<size_t>(y)];
    if (from >= to) continue;
    box = {std::min(box.x0, from), std::min(box.y0, y), std::max(box.x1, to), y + 1};
  }
  if (box.x0 >= box.x1) return {0, 0, 0, 0};
  const auto down = [](int v) { return std::max(0, (v - kMargin) / kRounded * kRounded); };
  const auto up = [](int v) { return (v + kMargin + kRounded - 1) / kRounded * kRounded; };
  return {down(box.x0), down(box.y0), std::min(layers.width(), up(box.x1)), std::min(layers.height(), up(box.y1))};
}

SurfaceShares::SurfaceShares(const std::vector<const Plane*>& normal, const std::vector<const Plane*>& materials,
                             const Task& task) {
  const int width = normal[0]->width(), height = normal[0]->height();
  share = make_plane(width, height, quiet(task), [&](int x, int y) {
    return std::min(1.0f, glm::length(color_at({normal[0], normal[1], normal[2]}, x, y)));
  });
  Plane change(width, height);
  for (const Plane* p : normal) {
    const Plane low = window_minimum(*p, kEdgeRadius, task), high = window_maximum(*p, kEdgeRadius, task);
    for_each_pixel(width, height, quiet(task),
                   [&](int x, int y) { change(x, y) += (high(x, y) - low(x, y)) / kEdgeOfNormals; });
  }
  const auto add = [&](const auto& value) {
    Plane part = make_plane(width, height, quiet(task), value);
    if (any_above_0(part)) parts.push_back(std::move(part));
  };
  for (const Plane* material : materials)
    add([&](int x, int y) { return change(x, y) > 1 ? 0.0f : std::min((*material)(x, y), share(x, y)); });
  if (materials.empty()) add([&](int x, int y) { return change(x, y) > 1 ? 0.0f : share(x, y); });
  add([&](int x, int y) { return change(x, y) > 1 ? share(x, y) : 0.0f; });
}

std::vector<MixingRegion> regions_of(const Plane& mask, const SurfaceShares& surfaces, const Task& task) {
  std::vector<MixingRegion> regions;
  for (const Plane& part : surfaces.parts) regions.push_back({part, kSureOfSurfaces});
  regions.push_back({make_plane(mask.width(), mask.height(), quiet(task),
                                [&](int x, int y) {
                                  return mask(x, y) * (surfaces.share.empty() ? 1.0f : 1 - surfaces.share(x, y));
                                }),
                     kSureOfMedia});
  return regions;
}

}  // namespace brume

#include "filters/regression/transport_columns.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "base/vec.h"
#include "filters/api/requirements.h"
#include "filters/regression/regression.h"

namespace brume {
namespace {

// A pixel shows the medium where its opacity is above this.
constexpr float kLeastOpacity = 1e-3f;
// Halves whose difference is below this share of their sum differ by rounding.
constexpr float kNoisy = 2e-3f;
// An edge is where normals change by so much, all components together, in a square of so many pixels on either side.
constexpr int kEdgeRadius = 1;
constexpr float kEdgeOfNormals = 0.5f;
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

void ColourColumns::add(const Guide& g) {
  coloured |= g.coloured;
  if (g.coloured)
    for (size_t c = 0; c < 3; ++c) of[c].push_back({g.channels[c]});
  else
    for (const ChannelView& channel : g.channels)
      for (auto& columns : of) columns.push_back({channel});
}

void ColourColumns::add(const Plane& p) {
  for (auto& columns : of) columns.push_back({&p});
}

void ColourColumns::standardise(const Plane& weight, const Task& task) {
  for (size_t c = 0; c < sets(); ++c) of[c] = standardised(std::move(of[c]), weight, task);
}

void ColourColumns::scale_like(const ColourColumns& own) {
  for (size_t c = 0; c < sets(); ++c)
    for (size_t k = 0; k < of[c].size(); ++k) {
      of[c][k].offset = own.of[c][k].offset;
      of[c][k].scale = own.of[c][k].scale;
    }
}

namespace {

/// What the guides that predict the light make of it; of guides that predict nothing, as of other versions, their
/// light.
Plane brightness(const std::vector<Guide>& guides, const std::function<bool(const Guide&)>& predicts,
                 const FilterFrame& frame, const Task& task) {
  Plane bright(frame.width(), frame.height());
  const bool predicted = std::any_of(guides.begin(), guides.end(), [&](const Guide& g) { return predicts(g); });
  const auto add = [&](const auto& light) {
    for_each_row(bright.height(), quiet(task), [&](int y) {
      for (int x = 0; x < bright.width(); ++x) bright(x, y) += light(x, y);
    });
  };
  for (const Guide& g : guides) {
    if (predicted && predicts(g))
      add([&](int x, int y) {
        const auto at = [&](size_t c) { return g.channels[c % g.channels.size()].plane()(x, y); };
        return luminance(vec3(at(0), at(1), at(2)));
      });
    if (!predicted &&
        (g.kind == GuideClass::kSingle || g.kind == GuideClass::kEmission || g.kind == GuideClass::kSurface))
      for (const ChannelView& channel : g.channels)
        add([&](int x, int y) { return channel.plane()(x, y) / static_cast<float>(g.channels.size()); });
  }
  return bright;
}

}  // namespace

TransportColumns::TransportColumns(const FilterFrame& frame, const Plane& one, const Task& task) {
  const std::vector<Guide> guides = guides_of(frame.layers);
  for (const Guide& g : guides) names.push_back(g.name);
  const bool direct = frame.name == layer::direct, indirect = frame.name == layer::indirect,
             beauty = frame.name == layer::beauty;
  const auto opacity =
      std::find_if(guides.begin(), guides.end(), [](const Guide& g) { return g.kind == GuideClass::kOpacity; });
  guided = opacity != guides.end();
  const auto has = [&](GuideClass kind) {
    return std::any_of(guides.begin(), guides.end(), [&](const Guide& g) { return g.kind == kind; });
  };
  // Of a picture whose parts are not apart all that is predicted, each by a coefficient of its own.
  const auto is_expected = [&](const Guide& g) {
    return g.kind == GuideClass::kPredicted &&
           ((!direct && !indirect) || g.name == "predicted_" + std::string(frame.name.name));
  };
  const CleanedPixels cleaned(guides, frame.layers, frame.half_a, frame.half_b);
  const bool surfaces = has(GuideClass::kSurface), unknown_surfaces = cleaned.unknown_surfaces();
  mask =
      make_plane(frame.width(), frame.height(), quiet(task), [&](int x, int y) { return cleaned(x, y) ? 1.0f : 0.0f; });
  if (guided) all.add(*opacity);
  // Premultiplied guides fall to 0 where there is nothing to see, and so does the light that they explain; a constant
  // is needed for light that no guide knows.
  if (!guided || surfaces || unknown_surfaces || ((direct || beauty) && !has(GuideClass::kBackground))) all.add(one);
  predicted = all;
  // What shines through is known but for the noise of the transmittance: its coefficient is 1 everywhere.
  if (direct || beauty)
    for (const Guide& g : guides)
      if (g.kind == GuideClass::kBackground) all.add(g);
  all.free = all.of[0].size();
  medium = few = all;
  medium.free = few.free = 0;
  for (const Guide& g : guides) {
    if (is_expected(g)) predicted.add(g);
    if (is_expected(g) || g.kind == GuideClass::kOpacity || g.name == "normal" || g.name == "depth" ||
        (g.kind == GuideClass::kBackground && !indirect))
      add_features_of(g, task);
  }
  predicted.free = predicted.of[0].size();
  shape = predicted;
  shape.free = 0;
  for (const Guide& g : guides) {
    if (g.kind == GuideClass::kOpacity || g.kind == GuideClass::kMaterial) continue;
    if (is_expected(g)) continue;
    if (g.kind == GuideClass::kPredicted) {
      if (!direct) shape.add(g);
      continue;
    }
    if (g.kind == GuideClass::kGeometry || g.kind == GuideClass::kEmission || g.kind == GuideClass::kSurface ||
        (g.kind == GuideClass::kBackground && !direct))
      shape.add(g);
    if (g.kind == GuideClass::kBackground || (direct && g.kind == GuideClass::kMultiple)) continue;
    all.add(g);
    if (g.kind != GuideClass::kMultiple) medium.add(g);
  }
  bright = brightness(guides, is_expected, frame, task);
  for (const Guide& g : guides)
    if (g.name == "normal")
      solid = make_plane(frame.width(), frame.height(), quiet(task), [&](int x, int y) {
        const vec3 n(g.channels[0].plane()(x, y), g.channels[1].plane()(x, y), g.channels[2].plane()(x, y));
        return std::min(1.0f, glm::length(n));
      });
  const auto channels = [&](std::string_view name) -> std::vector<const Plane*> {
    std::vector<const Plane*> planes;
    for (const Guide& g : guides)
      if (g.name == name)
        for (const ChannelView& channel : g.channels) planes.push_back(&channel.plane());
    return planes;
  };
  if (!solid.empty()) part_solids(channels("normal"), channels("surface_material"), task);
  if (unknown_surfaces) add_surfaces(frame.layers, opacity->channels[0].plane(), task);
  if (!guided) add_features(frame.layers);
}

void TransportColumns::part_solids(const std::vector<const Plane*>& normal, const std::vector<const Plane*>& materials,
                                   const Task& task) {
  const int width = mask.width(), height = mask.height();
  Plane change(width, height);
  const auto add_change = [&](const Plane& plane, float unit) {
    const Plane low = window_minimum(plane, kEdgeRadius, task), high = window_maximum(plane, kEdgeRadius, task);
    for_each_row(height, quiet(task), [&](int y) {
      for (int x = 0; x < width; ++x) change(x, y) += (high(x, y) - low(x, y)) / unit;
    });
  };
  for (const Plane* p : normal) add_change(*p, kEdgeOfNormals);
  std::vector<Plane> shares;
  Plane edge =
      make_plane(width, height, quiet(task), [&](int x, int y) { return change(x, y) > 1 ? solid(x, y) : 0.0f; });
  for (const Plane* material : materials)
    shares.push_back(make_plane(width, height, quiet(task), [&](int x, int y) {
      return change(x, y) > 1 ? 0.0f : std::min((*material)(x, y), solid(x, y));
    }));
  if (materials.empty())
    shares.push_back(
        make_plane(width, height, quiet(task), [&](int x, int y) { return change(x, y) > 1 ? 0.0f : solid(x, y); }));
  shares.push_back(std::move(edge));
  for (Plane& share : shares)
    if (any_above_0(share)) solids.push_back(std::move(share));
}

/// A colour counts by its mean: it is the shape that lines follow.
void TransportColumns::add_features_of(const Guide& guide, const Task& task) {
  const bool colour = guide.kind == GuideClass::kPredicted || guide.kind == GuideClass::kBackground;
  std::vector<Plane> planes;
  for (const ChannelView& channel : guide.channels) {
    const Plane& p = channel.plane();
    if (!colour || planes.empty())
      planes.push_back(p);
    else
      for_each_row(p.height(), quiet(task), [&](int y) {
        for (int x = 0; x < p.width(); ++x) planes[0](x, y) += p(x, y);
      });
  }
  for (Plane& plane : planes) {
    float largest = 0;
    for (int y = 0; y < plane.height(); ++y)
      for (const float v : plane.pixels(y)) largest = std::max(largest, std::abs(v));
    if (!(largest > 0)) continue;
    for_each_row(plane.height(), quiet(task), [&](int y) {
      for (float& v : plane.pixels(y)) v /= largest;
    });
    features.push_back(std::move(plane));
  }
}

void TransportColumns::scale_like(const TransportColumns& own) {
  predicted.scale_like(own.predicted);
  shape.scale_like(own.shape);
  all.scale_like(own.all);
  medium.scale_like(own.medium);
  few.scale_like(own.few);
}

void TransportColumns::add_surfaces(const Layers& layers, const Plane& opacity, const Task& task) {
  std::vector<const Plane*> normal;
  for (const LayerName& l : {layer::normal, layer::albedo, layer::depth}) {
    if (!layers.has(l)) continue;
    for (const std::string& channel : l.channel_names()) {
      const Plane& plane = layers.at(channel);
      float largest = 1e-30f;
      for (int y = 0; y < plane.height(); ++y)
        for (const float v : plane.pixels(y))
          if (std::isfinite(v)) largest = std::max(largest, std::abs(v));
      seen_through_.push_back(make_plane(plane.width(), plane.height(), quiet(task), [&](int x, int y) {
        const float v = plane(x, y) / largest;
        return std::isfinite(v) ? (1 - opacity(x, y)) * v : 0.0f;
      }));
      const Plane& seen = seen_through_.back();
      names.push_back(channel);
      for (ColourColumns* columns : {&all, &medium, &shape}) columns->add(seen);
      features.push_back(seen);
      if (l == layer::normal) normal.push_back(&seen);
    }
  }
  solid = make_plane(opacity.width(), opacity.height(), quiet(task), [&](int x, int y) {
    return std::min(1.0f, glm::length(vec3((*normal[0])(x, y), (*normal[1])(x, y), (*normal[2])(x, y))));
  });
  part_solids(normal, {}, task);
}

/// Frames of other renderers: what features they have.
void TransportColumns::add_features(const Layers& layers) {
  for (const LayerName& l : {layer::transmittance, layer::gradient, layer::gradient_transmittance_weighted,
                             layer::albedo, layer::normal, layer::depth})
    if (layers.has(l))
      for (const std::string& channel : l.channel_names()) {
        names.push_back(channel);
        all.add(layers.at(channel));
        medium.add(layers.at(channel));
        shape.add(layers.at(channel));
      }
}

}  // namespace brume

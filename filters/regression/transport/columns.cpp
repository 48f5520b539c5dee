#include "filters/regression/transport/columns.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "base/vec.h"
#include "filters/inputs/half_pair.h"

namespace brume {
namespace {

/// The light that is cleaned; the whole where its parts are not apart.
enum Signal { kDirect, kIndirect, kWhole };

/// What is known of a pixel, by what it may say about the signal.
enum Role {
  kOpacity,
  kConstant,         // for light that no guide knows
  kExpected,         // the prediction of the signal itself; of the whole each by a coefficient of its own
  kOtherPrediction,  // of the other light
  kBackground,
  kSingle,
  kMultiple,
  kEmission,
  kSurface,
  kPlace,  // normal and depth, which tell pixels apart as well
  kGeometry,
  kSeenThrough,  // surfaces that the guides do not know, times transmittance
  kFeature,      // of frames without guides
  kMaterial,
};

// P, S, A, M, F: the column is in Fit::kPredicted, kShape, kAll, kMedium, kFew; L: local lines follow it.
constexpr unsigned P = 1, S = 2, A = 4, M = 8, F = 16, L = 32;

struct Use {
  Role role;
  unsigned of_direct, of_indirect, of_whole;
};
// clang-format off
constexpr Use kUses[] = {
    //                 direct                 indirect               whole
    {kOpacity,         P | S | A | M | F | L, P | S | A | M | F | L, P | S | A | M | F | L},
    {kConstant,        P | S | A | M | F,     P | S | A | M | F,     P | S | A | M | F},
    {kExpected,        P | S | L,             P | S | L,             P | S | L},
    {kOtherPrediction, 0,                     S,                     0},
    {kBackground,      A | M | F | L,         S,                     S | A | M | F | L},
    {kSingle,          A | M,                 A | M,                 A | M},
    {kMultiple,        0,                     A,                     A},
    {kEmission,        S | A | M,             S | A | M,             S | A | M},
    {kSurface,         S | A | M,             S | A | M,             S | A | M},
    {kPlace,           S | A | M | L,         S | A | M | L,         S | A | M | L},
    {kGeometry,        S | A | M,             S | A | M,             S | A | M},
    {kSeenThrough,     S | A | M | L,         S | A | M | L,         S | A | M | L},
    {kFeature,         S | A | M,             S | A | M,             S | A | M},
    {kMaterial,        0,                     0,                     0},
};
// clang-format on

unsigned uses(Role role, Signal signal) {
  const Use& use = *std::find_if(std::begin(kUses), std::end(kUses), [&](const Use& u) { return u.role == role; });
  return signal == kDirect ? use.of_direct : signal == kIndirect ? use.of_indirect : use.of_whole;
}

Role role_of(const Guide& guide, Signal signal) {
  switch (guide.kind) {
    case GuideClass::kOpacity:
      return kOpacity;
    case GuideClass::kSingle:
      return kSingle;
    case GuideClass::kMultiple:
      return kMultiple;
    case GuideClass::kEmission:
      return kEmission;
    case GuideClass::kBackground:
      return kBackground;
    case GuideClass::kSurface:
      return kSurface;
    case GuideClass::kMaterial:
      return kMaterial;
    case GuideClass::kPredicted:
      return signal == kWhole || guide.name == (signal == kDirect ? "predicted_direct" : "predicted_indirect")
                 ? kExpected
                 : kOtherPrediction;
    case GuideClass::kGeometry:
      return guide.name == "normal" || guide.name == "depth" ? kPlace : kGeometry;
  }
  return kGeometry;
}

std::vector<const Plane*> planes_of(const std::vector<Guide>& guides, std::string_view name) {
  std::vector<const Plane*> planes;
  for (const Guide& g : guides)
    if (g.name == name)
      for (const ChannelView& channel : g.channels) planes.push_back(&channel.plane());
  return planes;
}

float largest(const Plane& plane) {
  float most = 0;
  for (int y = 0; y < plane.height(); ++y)
    for (const float v : plane.pixels(y))
      if (std::isfinite(v)) most = std::max(most, std::abs(v));
  return most;
}

/// The channels of a guide, each at most 1; of a colour its sum, as it is the shape that lines follow.
void add_features_of(const Guide& guide, std::vector<Plane>& features, const Task& task) {
  std::vector<Plane> planes;
  for (const ChannelView& channel : guide.channels)
    if (planes.empty() || guide.kind == GuideClass::kGeometry || guide.kind == GuideClass::kOpacity)
      planes.push_back(channel.plane());
    else
      add_to(planes[0], 1, channel.plane(), task);
  for (Plane& plane : planes) {
    const float most = largest(plane);
    if (!(most > 0)) continue;
    for_each_row(plane.height(), quiet(task), [&](int y) {
      for (float& v : plane.pixels(y)) v /= most;
    });
    features.push_back(std::move(plane));
  }
}

/// What the guides that predict the light make of it; of guides that predict nothing, their light.
Plane brightness_of(const std::vector<Guide>& guides, Signal signal, const FrameSpace& space, const Task& task,
                    int width, int height) {
  const auto predicts = [&](const Guide& g) { return role_of(g, signal) == kExpected; };
  const bool predicted = std::any_of(guides.begin(), guides.end(), predicts);
  Plane bright(width, height);
  const auto add = [&](const auto& light) {
    for_each_pixel(width, height, quiet(task), [&](int x, int y) { bright(x, y) += light(x, y); });
  };
  for (const Guide& g : guides) {
    if (predicts(g))
      add([&](int x, int y) {
        const auto at = [&](size_t c) { return g.channels[c % g.channels.size()].plane()(x, y); };
        return space.luminance(vec3(at(0), at(1), at(2)));
      });
    if (!predicted &&
        (g.kind == GuideClass::kSingle || g.kind == GuideClass::kEmission || g.kind == GuideClass::kSurface))
      for (const ChannelView& channel : g.channels)
        add([&](int x, int y) { return channel.plane()(x, y) / static_cast<float>(g.channels.size()); });
  }
  return bright;
}

/// What a frame knows of surfaces as far as they are seen through the media, the largest value being 1.
Plane seen_through(const Plane& plane, const Plane& opacity, const Task& task) {
  const float most = std::max(largest(plane), 1e-30f);
  return make_plane(plane.width(), plane.height(), quiet(task), [&](int x, int y) {
    const float v = plane(x, y) / most;
    return std::isfinite(v) ? (1 - opacity(x, y)) * v : 0.0f;
  });
}

}  // namespace

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

TransportColumns::TransportColumns(const FilterFrame& frame, const Plane& one, const Task& task) : space(frame.space) {
  const std::vector<Guide> guides = guides_of(frame.layers);
  const Signal signal = frame.name == layer::direct ? kDirect : frame.name == layer::indirect ? kIndirect : kWhole;
  const auto has = [&](GuideClass kind) {
    return std::any_of(guides.begin(), guides.end(), [&](const Guide& g) { return g.kind == kind; });
  };
  const auto add = [&](Role role, const auto& column) {
    for (size_t fit = 0; fit < kFits; ++fit)
      if (uses(role, signal) >> fit & 1) fits[fit].add(column);
  };
  const CleanedPixels cleaned(guides, frame.layers, frame.half_a, frame.half_b);
  mask =
      make_plane(frame.width(), frame.height(), quiet(task), [&](int x, int y) { return cleaned(x, y) ? 1.0f : 0.0f; });
  guided = cleaned.guided();
  for (const Guide& g : guides) names.push_back(g.name);

  // The base first. Premultiplied guides fall to 0 where there is nothing to see, and so does the light that they
  // explain; a constant is needed for light that no guide knows.
  const auto opacity =
      std::find_if(guides.begin(), guides.end(), [](const Guide& g) { return g.kind == GuideClass::kOpacity; });
  if (guided) add(kOpacity, *opacity);
  if (!guided || has(GuideClass::kSurface) || cleaned.unknown_surfaces() ||
      (signal != kIndirect && !has(GuideClass::kBackground)))
    add(kConstant, one);
  const auto is_early = [&](const Guide& g) {
    return role_of(g, signal) == kExpected || g.kind == GuideClass::kBackground;
  };
  for (const Role role : {kExpected, kBackground})
    for (const Guide& g : guides)
      if (role_of(g, signal) == role) add(role, g);
  base = (*this)[Fit::kAll].size();
  for (const Guide& g : guides)
    if (g.kind != GuideClass::kOpacity && !is_early(g)) add(role_of(g, signal), g);
  for (const Guide& g : guides)
    if (uses(role_of(g, signal), signal) & L) add_features_of(g, features, task);
  for (const Guide& g : guides)
    if (role_of(g, signal) == kExpected)
      for (size_t c = 0; c < 3; ++c) {
        if (expected[c].empty()) expected[c] = Plane(frame.width(), frame.height());
        add_to(expected[c], 1, g.channels[c % g.channels.size()].plane(), task);
      }
  bright = brightness_of(guides, signal, space, task, frame.width(), frame.height());
  if (const auto normal = planes_of(guides, "normal"); !normal.empty())
    surfaces = SurfaceShares(normal, planes_of(guides, "surface_material"), task);

  if (cleaned.unknown_surfaces()) {
    std::vector<const Plane*> normal;
    for (const LayerName& l : {layer::normal, layer::albedo, layer::depth}) {
      if (!frame.layers.has(l)) continue;
      for (const std::string& channel : l.channel_names()) {
        const Plane& seen =
            seen_through_.emplace_back(seen_through(frame.layers.at(channel), opacity->channels[0].plane(), task));
        names.push_back(channel);
        add(kSeenThrough, seen);
        features.push_back(seen);
        if (l == layer::normal) normal.push_back(&seen);
      }
    }
    surfaces = SurfaceShares(normal, {}, task);
  }
  if (!guided)
    for (const LayerName& l : {layer::transmittance, layer::gradient, layer::gradient_transmittance_weighted,
                               layer::albedo, layer::normal, layer::depth})
      if (frame.layers.has(l))
        for (const std::string& channel : l.channel_names()) {
          names.push_back(channel);
          add(kFeature, frame.layers.at(channel));
        }
}

void TransportColumns::scale_like(const TransportColumns& own) {
  for (size_t fit = 0; fit < kFits; ++fit) fits[fit].scale_like(own.fits[fit]);
}

}  // namespace brume

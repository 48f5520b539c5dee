#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "base/vec.h"
#include "filters/guide_layers.h"
#include "filters/lattice_regression.h"
#include "filters/registry.h"
#include "filters/stacking.h"

namespace brume {
namespace {

struct TransportRegression {
  float window = 12;
  float ridge = 4e-3f;
  float ridge_per_pixel = 0.5f;
  float stacking_window = 20;
  float caution = 200;
  float weight_power = 1.5f;
  int only = -1;
  float floor = 0.1f;
};

/// Columns for each colour; the same planes where no guide has colour.
struct Columns {
  std::array<std::vector<const Plane*>, 3> of;
  bool coloured = false;
  void add(const Guide& g) {
    if (g.coloured) {
      coloured = true;
      for (size_t c = 0; c < 3; ++c) of[c].push_back(g.channels[c]);
      return;
    }
    for (const Plane* p : g.channels) add(*p);
  }
  void add(const Plane& p) {
    for (auto& columns : of) columns.push_back(&p);
  }
  void add(const RgbPlanes& p) {
    coloured = true;
    for (size_t c = 0; c < 3; ++c) of[c].push_back(p[c]);
  }
};

/// Half images to be explained: means a and b, or the mean alone.
struct Target {
  RgbPlanes a, b;
};

Rgb minus(const RgbPlanes& x, const RgbPlanes& y, const Task& task) {
  Rgb out;
  for (size_t c = 0; c < 3; ++c)
    out[c] = make_plane(x[0]->width(), x[0]->height(), quiet(task),
                        [&](int i, int j) { return (*x[c])(i, j) - (*y[c])(i, j); });
  return out;
}

void add_to(Rgb& x, const Rgb& y, const Task& task) {
  for (size_t c = 0; c < 3; ++c)
    for_each_row(x[0].height(), quiet(task), [&](int j) {
      for (int i = 0; i < x[0].width(); ++i) x[c](i, j) += y[c](i, j);
    });
}

HalfPair regress(const Columns& columns, size_t free, const Target& target, const Plane& weight,
                 const LatticeWindow& window, const Task& task) {
  HalfPair out;
  const auto solve = [&](const std::vector<size_t>& colours) {
    LatticeProblem problem{standardised(columns.of[colours[0]], weight), free, {}, &weight};
    for (const size_t c : colours) {
      problem.targets.push_back(target.a[c]);
      problem.targets.push_back(target.b[c]);
    }
    std::vector<Plane> found = lattice_regression(problem, window, task);
    for (size_t i = 0; i < colours.size(); ++i) {
      out.a[colours[i]] = std::move(found[2 * i]);
      out.b[colours[i]] = std::move(found[2 * i + 1]);
    }
  };
  if (columns.coloured)
    for (size_t c = 0; c < 3; ++c) solve({c});
  else
    solve({0, 1, 2});
  return out;
}

void run(const TransportRegression& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const int width = frame.width(), height = frame.height();
  const std::vector<Guide> guides = guides_of(frame.layers);
  const bool direct = frame.name == layer::direct;
  const Plane* opacity = nullptr;
  Columns all, medium, few;
  for (const Guide& g : guides)
    if (g.kind == GuideClass::kOpacity) opacity = g.channels[0];
  if (!opacity) throw InputError("no guide.opacity");
  all.add(*opacity);
  medium.add(*opacity);
  few.add(*opacity);
  const Plane one(width, height, 1.0f);
  bool surfaces = false, background = false;
  for (const Guide& g : guides) {
    surfaces |= g.kind == GuideClass::kSurface || g.name == "normal";
    background |= g.kind == GuideClass::kBackground;
  }
  const bool constant = surfaces || (direct && !background);
  if (constant)
    for (Columns* c : {&all, &medium, &few}) c->add(one);
  const size_t free = constant ? 2 : 1;
  for (const Guide& g : guides) {
    if (g.kind == GuideClass::kOpacity) continue;
    if (direct && (g.kind == GuideClass::kMultiple || g.kind == GuideClass::kGeometry)) continue;
    all.add(g);
    if (g.kind != GuideClass::kMultiple) medium.add(g);
  }
  // Noise-free prediction of brightness, for the first weights.
  Plane bright(width, height);
  double mean = 0, count = 0;
  for (const Guide& g : guides)
    if (g.kind == GuideClass::kSingle)
      for (const Plane* c : g.channels)
        for (int y = 0; y < height; ++y)
          for (int x = 0; x < width; ++x) bright(x, y) += (*c)(x, y) / static_cast<float>(g.channels.size());
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if ((*opacity)(x, y) > 1e-3f) mean += bright(x, y), ++count;
  mean /= std::max(1.0, count);
  const auto weights = [&](const auto& level, double typical) {
    return make_plane(width, height, quiet(task), [&](int x, int y) {
      if (!((*opacity)(x, y) > 1e-3f)) return 0.0f;
      const double l = std::max(0.0, static_cast<double>(level(x, y))) / typical + static_cast<double>(p.floor);
      return static_cast<float>(std::pow(l, -static_cast<double>(p.weight_power)));
    });
  };
  const Plane first = weights(bright, mean);
  const Target halves{frame.half_a, frame.half_b};
  std::vector<HalfPair> candidates;
  candidates.push_back(regress(all, free, halves, first, {0, 1e-4, 0}, task));
  // Brightness of the whole fit.
  const Plane level = make_plane(width, height, quiet(task), [&](int x, int y) {
    const auto at = [&](size_t c) { return 0.5f * (candidates[0].a[c](x, y) + candidates[0].b[c](x, y)); };
    return luminance(vec3(at(0), at(1), at(2)));
  });
  double typical = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) typical += std::max(0.0f, level(x, y));
  typical = std::max(1e-12, typical / std::max(1.0, count));
  const Plane weight = weights(level, typical);
  few.add(level);
  medium.add(level);
  const auto deeper = [&](const Columns& columns, double s, size_t parent) {
    const Rgb ra = minus(halves.a, view(candidates[parent].a), task),
              rb = minus(halves.b, view(candidates[parent].b), task);
    HalfPair c = regress(columns, 0, {view(ra), view(rb)}, weight,
                         {s, static_cast<double>(p.ridge), static_cast<double>(p.ridge_per_pixel)}, task);
    add_to(c.a, candidates[parent].a, task);
    add_to(c.b, candidates[parent].b, task);
    candidates.push_back(std::move(c));
  };
  const double s = static_cast<double>(p.window);
  deeper(all, 2 * s, 0);
  deeper(all, s, 1);
  deeper(medium, s / 2, 2);
  deeper(few, s / 4, 3);
  std::vector<Plane> maps;
  if (p.only < 0)
    maps = stacking_weights(candidates, frame.half_a, frame.half_b, weight,
                            {static_cast<double>(p.stacking_window), static_cast<double>(p.caution)}, task);
  else
    for (size_t i = 0; i < candidates.size(); ++i)
      maps.emplace_back(width, height, static_cast<int>(i) == p.only ? 1.0f : 0.0f);
  const HalfPair chosen = blend(candidates, maps, task);
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        (*out[c])(x, y) = first(x, y) > 0 ? 0.5f * (chosen.a[c](x, y) + chosen.b[c](x, y)) : (*frame.signal[c])(x, y);
}

const FilterEntry entry = declare<TransportRegression>("transport_regression", "Local regression on guides.")
                              .source("our own")
                              .statistics(Statistics::kHalves)
                              .guides()
                              .parts()
                              .whole_frame()
                              .seeded()
                              .param("window", &TransportRegression::window, {1, 100}, "px", "w")
                              .param("ridge", &TransportRegression::ridge, {0, 100}, "1", "w")
                              .param("ridge-per-pixel", &TransportRegression::ridge_per_pixel, {0, 100}, "1", "w")
                              .param("stacking-window", &TransportRegression::stacking_window, {1, 100}, "1", "w")
                              .param("caution", &TransportRegression::caution, {0, 1e6}, "1", "w")
                              .param("weight-power", &TransportRegression::weight_power, {0, 4}, "1", "w")
                              .param("floor", &TransportRegression::floor, {0, 4}, "1", "w")
                              .param("only", &TransportRegression::only, {-1, 20}, "1", "w")
                              .scratch(70)
                              .apron([](const TransportRegression&) { return 1 << 20; })
                              .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume

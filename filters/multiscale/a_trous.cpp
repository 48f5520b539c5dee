#include "filters/kernels/a_trous.h"

#include <algorithm>
#include <array>

#include "filters/api/registry.h"
#include "filters/inputs/directions.h"
#include "filters/kernels/lab.h"
#include "filters/patch/neighbourhood.h"
#include "filters/window/lab_window.h"

namespace brume {
namespace {

struct ATrous {
  int levels = 2;
  float sigma_color = 80, sigma_gradient = 1, sigma_depth = 0.1f, sigma_opacity = 0.1f, sigma_other = 0.3f;
};

/// The B3 spline's 25 taps, spaced 2^level.
std::vector<kernels::SparseTap> spline(int level) {
  constexpr float h[] = {1 / 16.f, 4 / 16.f, 6 / 16.f, 4 / 16.f, 1 / 16.f};
  std::vector<kernels::SparseTap> taps;
  for (int j = -2; j <= 2; ++j)
    for (int i = -2; i <= 2; ++i) taps.push_back({i * (1 << level), j * (1 << level), h[i + 2] * h[j + 2]});
  return taps;
}

float sigma_of(const ATrous& p, const Feature& f) {
  if (f.name == "opacity") return p.sigma_opacity;
  if (f.name == "scatter-depth" || f.name == "surface-depth") return p.sigma_depth;
  return p.sigma_other;
}

/// The features in units of their sigmas, behind three channels for the colour; without either: nothing.
WorkImage compared_channels(const ATrous& p, const FilterFrame& frame, int radius, const Task& task) {
  std::vector<std::pair<const Plane*, float>> features;
  for (const Feature& f : *frame.features)
    if (const float sigma = sigma_of(p, f); f.name != "gradient" && sigma > 0)
      for (const Plane& channel : f.mean) features.emplace_back(&channel, 1 / sigma);
  const size_t colors = p.sigma_color > 0 ? 3 : 0;
  if (features.empty() && colors == 0) return {};
  WorkImage image(frame.width(), frame.height(), radius, colors + features.size());
  for_each_row(frame.height(), quiet(task), [&](int y) {
    for (size_t i = 0; i < features.size(); ++i) {
      const auto& [plane, scale] = features[i];
      PaddedPlane& to = image.channels[colors + i];
      for (int x = 0; x < frame.width(); ++x) to.row(y)[x] = scale * (*plane)(x, y);
      to.extend_row(y);
    }
  });
  return image;
}

void run(const ATrous& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const int width = frame.width(), height = frame.height(), radius = 2 << (p.levels - 1);
  std::vector<const Plane*> averaged(frame.signal.begin(), frame.signal.end());
  if (frame.carries()) averaged.insert(averaged.end(), frame.values.begin(), frame.values.end());
  WorkImage values = padded(averaged, radius), smooth(width, height, radius, averaged.size());
  WorkImage compared = compared_channels(p, frame, radius, task), directions;
  if (const std::vector<Plane> unit = unit_directions(frame, task); !unit.empty() && p.sigma_gradient > 0)
    directions = padded(pointers(unit), radius);
  for (int level = 0; level < p.levels; ++level) {
    const float spread = static_cast<float>(1 << level);
    if (p.sigma_color > 0)
      for_each_row(height, quiet(task), [&](int y) {
        std::array<const float*, 3> rgb;
        std::array<float*, 3> lab;
        for (size_t c = 0; c < 3; ++c) {
          rgb[c] = values.channels[c].row(y);
          lab[c] = compared.channels[c].row(y);
        }
        kernels::lab_from_rgb_row(rgb, static_cast<float>(frame.exposure), lab, width, frame.space.xyz_from_rgb());
        for (size_t c = 0; c < 3; ++c) {
          for (int x = 0; x < width; ++x) lab[c][x] *= spread / p.sigma_color;
          compared.channels[c].extend_row(y);
        }
      });
    const std::vector<kernels::SparseTap> taps = spline(level);
    const float turn = p.sigma_gradient * spread;
    const kernels::ATrousLevel what{compared.channels.empty() ? nullptr : &compared,
                                    directions.channels.empty() ? nullptr : &directions, 1 / (turn * turn), &values,
                                    taps};
    // Blocks whose rows are still in the cache when the tap 2^level rows further down comes to them.
    constexpr int kWidth = 256, kHeight = 128;
    for_each_block(width, height, kWidth, kHeight,
                   share(task, level / static_cast<double>(p.levels), (level + 1) / static_cast<double>(p.levels)),
                   [&](const Box& block) {
                     for (int y = block.y0; y < block.y1; ++y)
                       kernels::a_trous_row(what, smooth, block.x0, block.x1, y);
                   });
    for_each_row(height, quiet(task), [&](int y) { smooth.extend_row(y); });
    std::swap(values, smooth);
  }
  const size_t offset = frame.carries() ? 3 : 0;
  for (size_t c = 0; c < 3; ++c)
    for_each_row(height, quiet(task),
                 [&](int y) { std::copy_n(values.channels[c + offset].row(y), width, out[c]->row(y)); });
}

const FilterEntry entry =
    declare<ATrous>("a_trous", "Edge-avoiding a-trous wavelets: a few sparse 5 x 5 passes that stop at edges.")
        .merit(3.6, "for previews of large frames: few taps, wide windows")
        .source("Dammertz, Sewtz, Hanika and Lensch 2010; media features in place of normal and position")
        .notes(
            "Level i spreads its 25 taps 2^i pixels apart; the colour term tightens and the direction term widens by 2 per level, as published. Colours are compared in CIE-Lab, the density gradient's direction stands for the normal, depth and opacity for the position.")
        .paper("levels=5,sigma-color=20,sigma-gradient=0.3")
        .features()
        .carries()
        .param("levels", &ATrous::levels, {1, 8}, "", "passes", {1, 2, 3, 4, 5})
        .param("sigma-color", &ATrous::sigma_color, {0, 1000}, "Lab units",
               "of colour difference at level 0, halved at each level; 0: off", {10, 20, 40, 80})
        .param("sigma-gradient", &ATrous::sigma_gradient, {0, 100}, "1",
               "of 1 - cos of the angle of the density gradient; 0: off", {0, 0.3, 1})
        .param("sigma-depth", &ATrous::sigma_depth, {0, 100}, "1", "of depth, whose range is 1; 0: off")
        .param("sigma-opacity", &ATrous::sigma_opacity, {0, 100}, "1", "of opacity; 0: off", {0, 0.1, 0.3})
        .param("sigma-other", &ATrous::sigma_other, {0, 100}, "1", "of every other feature, whose range is 1; 0: off")
        .scratch(16)
        .apron([](const ATrous& p) { return 2 * ((1 << p.levels) - 1); })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume

#include "filters/patch/picture_noise.h"

#include <algorithm>
#include <cmath>

#include "filters/inputs/half_pair.h"
#include "filters/inputs/noise.h"
#include "filters/patch/neighbourhood.h"
#include "filters/patch/second_differences.h"
#include "filters/patch/texture_share.h"

namespace brume {
namespace {

// Half widths of the squares over which squares are averaged, and over which they are compared [px].
constexpr int kMeanRadius = 4, kLevelRadius = 10;
// Of the least of four means, for normal noise without anything else.
constexpr float kLeastOfFour = 0.83f;
// Squares summed over the masks of differences of order 2, 4 and 6 along each axis.
constexpr float kMaskSquares[] = {6 * 6, 70 * 70, 924 * 924};
// Times what lines say, over the wider squares: masks below hold less detail, and are not less by chance.
constexpr float kClearlyLess = 0.7f;
// Of alike surroundings: how far they are looked for [px], deviations still taken as equal, rounds.
constexpr int kSearchRadius = 5, kRounds = 2;
constexpr float kStrength = 0.35f;
// Shares of all that varies from pixel to pixel: up to the first there is detail in it, from the second on none.
constexpr float kDetail = 0.5f, kNoise = 0.9f;
// Of variances that a file states: half width of the squares over which they are held against the picture [px], and
// how much more than the picture varies by may be stated.
constexpr int kStatedRadius = 16;
constexpr float kMoreThanSeen = 1.2f;

/// The response to the mask [1 -2 1] x [1 -2 1].
Plane second_differences(const Plane& picture, const Task& task) {
  const int width = picture.width(), height = picture.height();
  return make_plane(width, height, quiet(task), [&](int x, int y) {
    const int l = mirrored(x - 1, width), r = mirrored(x + 1, width);
    const int a = mirrored(y - 1, height), b = mirrored(y + 1, height);
    const auto row = [&](int j) { return picture(l, j) - 2 * picture(x, j) + picture(r, j); };
    return row(a) - 2 * row(y) + row(b);
  });
}

/// Two means of squares: of the noise, and with all that varies as fast.
struct FirstEstimate {
  Plane variance, detailed;
};

/// From lines, and from masks of differences along both axes, of order 2, 4 and 6. The mean square of a mask holds the
/// noise, and what the picture has in the mask's frequencies: the higher the order, the fewer these are. Where masks
/// say clearly less than lines, these hold detail, and the mask that says least is taken. Source of the first mask:
/// Immerkaer 1996, Fast noise variance estimation.
FirstEstimate first_estimate(const Plane& picture, const Task& task) {
  const int width = picture.width(), height = picture.height();
  FirstEstimate of{least_product(picture, 1, kWhiteAt1, kMeanRadius, task), {}};
  for_each_pixel(width, height, quiet(task),
                 [&](int x, int y) { of.variance(x, y) = std::max(0.0f, of.variance(x, y) / kLeastOfFour); });
  const Plane lines = box_mean(of.variance, kLevelRadius, task);
  Plane least = lines, differences = picture;
  for (const float squares : kMaskSquares) {
    differences = second_differences(differences, task);
    const Plane square = make_plane(width, height, quiet(task),
                                    [&](int x, int y) { return differences(x, y) * differences(x, y) / squares; });
    const Plane all = box_mean(square, kMeanRadius, task);
    if (of.detailed.empty()) of.detailed = all;
    const Plane mean = mean_without_peaks(square, kMeanRadius, task), level = box_mean(mean, kLevelRadius, task);
    for_each_pixel(width, height, quiet(task), [&](int x, int y) {
      if (!(level(x, y) < least(x, y) && level(x, y) < kClearlyLess * lines(x, y))) return;
      least(x, y) = level(x, y);
      of.variance(x, y) = std::min(of.variance(x, y), mean(x, y));
      of.detailed(x, y) = all(x, y);
    });
  }
  return of;
}

/// From what pixels in alike surroundings say. @param variance  a first estimate, by which likeness is judged
Rgb variance_among_alike(const RgbPlanes& picture, const Rgb& variance, const Task& task) {
  const int width = picture[0]->width(), height = picture[0]->height();
  const Plane one(width, height, 1.0f);
  const Plane total = make_plane(width, height, quiet(task), [&](int x, int y) {
    return variance[0](x, y) + variance[1](x, y) + variance[2](x, y);
  });
  // The mean over 3 x 3 pixels but the middle one: nine eighths of the mean over all, less an eighth of the middle.
  WeightModel model;
  model.join = WeightModel::Join::kPatch;
  Distance d;
  d.kind = Distance::Kind::kRatio;
  d.guide.assign(picture.begin(), picture.end());
  d.variance = {&total};
  d.floor = 1e-20f;
  const float scale = 1 / (2 * kStrength * kStrength);
  d.scale = -scale / 8;
  model.distances.push_back(d);
  d.scale = scale * 9 / 8;
  d.patch = box_patch(1);
  model.distances.push_back(d);
  std::vector<Offset> others = square_window(kSearchRadius);
  std::erase_if(others, [](const Offset& o) { return o.dx == 0 && o.dy == 0; });
  const Variant plain;
  const Averages alike = std::move(weighted_averages(model, others, {&plain, 1}, picture, &one, task)[0]);
  Rgb out;
  for (size_t c = 0; c < 3; ++c)
    out[c] = mean_without_peaks(make_plane(width, height, quiet(task),
                                           [&](int x, int y) {
                                             if (!(alike.weight(x, y) > 1e-8f)) return variance[c](x, y);
                                             const float rest = (*picture[c])(x, y) - alike.values[c](x, y);
                                             return rest * rest / (1 + alike.noise(x, y));
                                           }),
                                kMeanRadius, task);
  return out;
}

}  // namespace

Rgb picture_variance(const RgbPlanes& picture, const Task& task) {
  const int width = picture[0]->width(), height = picture[0]->height();
  Rgb variance;
  Rgb detailed;
  for (size_t c = 0; c < 3; ++c) {
    FirstEstimate first = first_estimate(*picture[c], task);
    variance[c] = std::move(first.variance);
    detailed[c] = std::move(first.detailed);
  }
  for (int round = 0; round < kRounds; ++round) {
    const Rgb alike = variance_among_alike(picture, variance, task);
    for (size_t c = 0; c < 3; ++c)
      for_each_pixel(width, height, quiet(task),
                     [&](int x, int y) { variance[c](x, y) = std::min(variance[c](x, y), alike[c](x, y)); });
  }
  for (size_t c = 0; c < 3; ++c) {
    for_each_pixel(width, height, quiet(task), [&](int x, int y) {
      float& v = variance[c](x, y);
      const float share = detailed[c](x, y) > 0 ? v / detailed[c](x, y) : 1;
      const float noise = std::clamp((share - kDetail) / (kNoise - kDetail), 0.0f, 1.0f);
      v += noise * std::max(0.0f, detailed[c](x, y) - v);
    });
  }
  const Plane share = share_of_noise(variance, picture, task);
  for (size_t c = 0; c < 3; ++c) {
    for_each_pixel(width, height, quiet(task), [&](int x, int y) { variance[c](x, y) *= share(x, y); });
    lift_variance(variance[c], *picture[c], task);
  }
  return variance;
}

void limit_variance(Rgb& variance, const RgbPlanes& picture, const Task& task) {
  const int width = picture[0]->width(), height = picture[0]->height();
  if (std::min(width, height) < 8) return;  // too little to measure
  Plane stated(width, height), around(width, height), next(width, height);
  for (size_t c = 0; c < 3; ++c) {
    const Plane mean = box_mean(*picture[c], kMeanRadius, task);
    const Plane squares = make_plane(width, height, quiet(task), [&](int x, int y) {
      const float rest = (*picture[c])(x, y) - mean(x, y);
      return rest * rest;
    });
    add_to(stated, 1, box_mean(variance[c], kStatedRadius, task), task);
    add_to(around, 1, box_mean(squares, kStatedRadius, task), task);
    add_to(next, 1, box_mean(mask_squares(*picture[c], task), kStatedRadius, task), task);
  }
  // From nothing where the picture varies as much around its pixels as is stated, to 1 where it varies half as much.
  const Plane excess = make_plane(width, height, quiet(task), [&](int x, int y) {
    const float most = kMoreThanSeen * around(x, y);
    return stated(x, y) > most ? (stated(x, y) < 2 * most ? stated(x, y) / most - 1 : 1) : 0.0f;
  });
  if (!any_above_0(excess)) return;
  Rgb seen;
  for (size_t c = 0; c < 3; ++c)
    seen[c] = make_plane(width, height, quiet(task), [&](int x, int y) {
      const float most = kMoreThanSeen * next(x, y);
      return stated(x, y) > most ? variance[c](x, y) * (most / stated(x, y)) : variance[c](x, y);
    });
  const Plane share = share_of_noise(seen, picture, task);
  for (size_t c = 0; c < 3; ++c) {
    for_each_pixel(width, height, quiet(task), [&](int x, int y) {
      float& v = variance[c](x, y);
      v = (1 - excess(x, y)) * v + excess(x, y) * (seen[c](x, y) * share(x, y));
    });
    lift_variance(variance[c], *picture[c], task);
  }
}

}  // namespace brume

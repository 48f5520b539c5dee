#include "filters/inputs/extremes.h"

#include <algorithm>
#include <cmath>

#include "filters/inputs/guide_layers.h"
#include "filters/inputs/half_pair.h"
#include "filters/inputs/noise.h"
#include "image/color.h"

namespace brume {
namespace {

// What is extreme over the level of the surroundings: for one sample per pixel, and at least.
constexpr double kRatioOfOneSample = 100, kLeastRatio = 10;
constexpr int kSurroundings = 10, kArea = 2;  // half widths [px]
constexpr double kTrimmed = 0.05;             // of the surroundings' pixels, the brightest
constexpr double kAreaRatio = 4, kLoneRatio = 2, kAgreement = 3;
constexpr double kMostChance = 0.01;                      // that two single samples meet in a pixel
constexpr double kReturnWindow = 32, kMostReturn = 0.03;  // deviation [px]; share of the light there

double luminance_at(const RgbPlanes& rgb, const FrameSpace& space, int x, int y) {
  return space.luminance(dvec3(color_at(rgb, x, y)));
}

/// Calls visit(x, y) for the pixels of a square around one, without it.
template <class Visit>
void for_each_around(int x, int y, int radius, int width, int height, const Visit& visit) {
  const Box box = Box{x, y, x + 1, y + 1}.grown(radius, width, height);
  for (int qy = box.y0; qy < box.y1; ++qy)
    for (int qx = box.x0; qx < box.x1; ++qx)
      if (qx != x || qy != y) visit(qx, qy);
}

/// Mean of the surroundings without their brightest pixels.
double surrounding_level(const RgbPlanes& mean, const FrameSpace& space, int x, int y, std::vector<double>& values) {
  values.clear();
  for_each_around(x, y, kSurroundings, mean[0]->width(), mean[0]->height(),
                  [&](int qx, int qy) { values.push_back(luminance_at(mean, space, qx, qy)); });
  const size_t count = values.size() - static_cast<size_t>(kTrimmed * static_cast<double>(values.size()));
  if (count == 0) return 0;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(count - 1), values.end());
  double sum = 0;
  for (size_t i = 0; i < count; ++i) sum += values[i];
  return std::max(0.0, sum / static_cast<double>(count));
}

/// Whether both halves show it, and not because each has a bright sample there by chance.
bool both_show(const RgbPlanes& a, const RgbPlanes& b, const FrameSpace& space, double light, int x, int y) {
  const double least = std::min(luminance_at(a, space, x, y), luminance_at(b, space, x, y));
  if (!(kAgreement * least > light)) return false;
  int around = 0, in_one = 0;
  for_each_around(x, y, kSurroundings, a[0]->width(), a[0]->height(), [&](int qx, int qy) {
    const double qa = luminance_at(a, space, qx, qy), qb = luminance_at(b, space, qx, qy);
    ++around;
    in_one += std::max(qa, qb) > least && kAgreement * std::min(qa, qb) < std::max(qa, qb);
  });
  return !meet_by_chance(in_one, around);
}

/// The brightnesses of pixels that are bright in one half alone, in order.
std::vector<double> bright_in_one(const RgbPlanes& a, const RgbPlanes& b, const FrameSpace& space) {
  std::vector<double> found;
  for (int y = 0; y < a[0]->height(); ++y)
    for (int x = 0; x < a[0]->width(); ++x) {
      const double of_a = luminance_at(a, space, x, y), of_b = luminance_at(b, space, x, y);
      if (kAgreement * std::min(of_a, of_b) < std::max(of_a, of_b)) found.push_back(std::max(of_a, of_b));
    }
  std::sort(found.begin(), found.end());
  return found;
}

/// One colour of everything that is known of a signal, and whether it goes with the square of it.
std::vector<std::pair<Plane*, bool>> planes_of(Layers& frame, const LayerName& signal, size_t c) {
  std::vector<std::pair<Plane*, bool>> planes;
  const auto add = [&](std::string_view which) {
    if (Plane* const plane = frame.find(signal.channel_of(which, c)))
      planes.emplace_back(plane, which == statistic::mean_variance);
  };
  for (const auto which : {std::string_view(), statistic::mean_variance, statistic::half_a, statistic::half_b})
    add(which);
  for (const auto which : statistic::buckets) add(which);
  return planes;
}

float scaled(float value, double factor, bool squared) {
  return static_cast<float>(static_cast<double>(value) * (squared ? factor * factor : factor));
}

/// The layers of guides that add up to what is expected of a signal; none where the frame has no guides.
std::vector<LayerName> predictions_of(const Layers& frame, const LayerName& signal) {
  std::vector<LayerName> found;
  for (const auto& [part, guide] : {std::pair(layer::direct, guide_layer::predicted_direct),
                                    std::pair(layer::indirect, guide_layer::predicted_indirect)})
    if ((signal == part || signal == layer::beauty) && frame.has(guide)) found.push_back(guide);
  return found;
}

/// One colour of what is expected of a signal; empty where the frame has no guides.
Plane predicted(const Layers& frame, const LayerName& signal, size_t c, const Task& task) {
  Plane sum;
  for (const LayerName& guide : predictions_of(frame, signal)) {
    if (sum.empty()) sum = Plane(frame.width(), frame.height());
    add_to(sum, 1, frame.at(guide.channel(c)), task);
  }
  return sum;
}

/// Adds to `factor` what returns the light taken from a pixel to its neighbourhood, as a share of the picture: at most
/// kMostReturn, or what is there less than `expected`.
/// @return what is lost
double redistribute(double taken, const Extreme& from, const Plane& picture, const Plane& expected, Plane& factor) {
  const int width = picture.width(), height = picture.height(), radius = static_cast<int>(3 * kReturnWindow);
  std::vector<double> falloff(static_cast<size_t>(radius) + 1);
  for (size_t d = 0; d < falloff.size(); ++d)
    falloff[d] = std::exp(-0.5 * static_cast<double>(d * d) / (kReturnWindow * kReturnWindow));
  const auto weight = [&](int x, int y) {
    return falloff[static_cast<size_t>(std::abs(x - from.x))] * falloff[static_cast<size_t>(std::abs(y - from.y))];
  };
  double light = 0, given = 0, wanted = 0;
  for_each_around(from.x, from.y, radius, width, height, [&](int x, int y) {
    const double here = weight(x, y) * static_cast<double>(std::max(0.0f, picture(x, y)));
    light += here;
    given += here * static_cast<double>(factor(x, y));
    if (!expected.empty()) wanted += weight(x, y) * static_cast<double>(std::max(0.0f, expected(x, y)));
  });
  const double most = std::max(kMostReturn, light > 0 ? (wanted - given) / light : 0.0);
  const double share = light > 0 ? std::min(taken / light, most) : 0.0;
  for_each_around(from.x, from.y, radius, width, height, [&](int x, int y) {
    if (picture(x, y) > 0) factor(x, y) += static_cast<float>(share * weight(x, y));
  });
  return share < most && light > 0 ? 0.0 : taken - share * light;
}

}  // namespace

bool meet_by_chance(int in_one, int pixels) {
  constexpr double kMostChance = 0.01;
  return static_cast<double>(in_one) * in_one > 4 * kMostChance * pixels;
}

std::vector<Extreme> find_extremes(const Layers& frame, const LayerName& signal, const Task& task) {
  const RgbPlanes mean = frame.rgb(signal);
  const FrameSpace space(frame);
  const int width = frame.width(), height = frame.height();
  const double typical = typical_luminance(mean);
  if (!(typical > 0)) return {};
  const Plane* const counts = frame.find(layer::sample_count.channel(0));
  const double samples = frame.number("samplesPerPixel").value_or(1.0);
  RgbPlanes a{}, b{};
  const bool halves = has_halves(frame, signal);
  if (halves) {
    a = frame.rgb(signal, statistic::half_a);
    b = frame.rgb(signal, statistic::half_b);
  }
  const std::vector<LayerName> predictions = predictions_of(frame, signal);
  const auto expected = [&](int x, int y) {
    double sum = 0;
    for (const LayerName& l : predictions) sum += luminance_at(frame.rgb(l), space, x, y);
    return sum;
  };
  // Where guides know of no such point, chance is held against all of the frame, as some of its many pixels may well be
  // bright in both halves.
  const std::vector<double> singles =
      halves && !predictions.empty() ? bright_in_one(a, b, space) : std::vector<double>();
  const auto by_chance = [&](int x, int y) {
    const double least = std::min(luminance_at(a, space, x, y), luminance_at(b, space, x, y));
    const auto brighter = singles.end() - std::upper_bound(singles.begin(), singles.end(), least);
    return meet_by_chance(static_cast<int>(brighter), width * height);
  };
  std::vector<std::vector<Extreme>> rows(static_cast<size_t>(height));
  for_each_row(height, quiet(task), [&](int y) {
    std::vector<double> values;
    for (int x = 0; x < width; ++x) {
      const double light = luminance_at(mean, space, x, y);
      const double n = counts ? static_cast<double>((*counts)(x, y)) : samples;
      const double ratio = std::max(kLeastRatio, kRatioOfOneSample / std::sqrt(std::max(1.0, n)));
      if (!(light > ratio * typical)) continue;
      int around = 0, like_it = 0;
      double brightest = 0;
      for_each_around(x, y, kArea, width, height, [&](int qx, int qy) {
        const double other = luminance_at(mean, space, qx, qy);
        brightest = std::max(brightest, other);
        like_it += kAreaRatio * other > light;
        ++around;
      });
      if (2 * like_it >= around) continue;
      double level = surrounding_level(mean, space, x, y, values);
      if (!(light > ratio * (level + typical))) continue;
      const double known = expected(x, y);
      const bool is_point = predictions.empty() || light < kAgreement * known || !halves || !by_chance(x, y);
      const bool kept = is_point && (halves ? both_show(a, b, space, light, x, y) : kLoneRatio * brightest > light);
      if (!kept) {
        if (!(light > ratio * (known + typical))) continue;
        level = std::max(level, known);
      }
      rows[static_cast<size_t>(y)].push_back({x, y, level / light, kept});
    }
  });
  std::vector<Extreme> found;
  for (const auto& row : rows) found.insert(found.end(), row.begin(), row.end());
  return found;
}

Extremes limit_extremes(Layers& frame, const LayerName& signal, const std::vector<Extreme>& found, const Task& task) {
  const int width = frame.width(), height = frame.height();
  Extremes result;
  result.kept = static_cast<size_t>(std::count_if(found.begin(), found.end(), [](const Extreme& e) { return e.kept; }));
  result.limited = found.size() - result.kept;
  dvec3 taken(0), lost(0);
  for (size_t c = 0; c < 3; ++c) {
    const auto planes = planes_of(frame, signal, c);
    Plane& mean = *planes[0].first;
    if (result.kept > 0) result.aside[c] = Plane(width, height);
    std::vector<std::pair<Extreme, double>> removed;
    for (const Extreme& e : found) {
      const double off = static_cast<double>(mean(e.x, e.y)) * (1 - e.factor);
      if (e.kept)
        result.aside[c](e.x, e.y) = static_cast<float>(off);
      else
        removed.emplace_back(e, std::max(0.0, off));
      for (const auto& [plane, squared] : planes) (*plane)(e.x, e.y) = scaled((*plane)(e.x, e.y), e.factor, squared);
    }
    if (removed.empty()) continue;
    const Plane expected = predicted(frame, signal, c, task);
    Plane factor(width, height, 1.0f);
    for (const auto& [from, light] : removed) {
      taken[static_cast<int>(c)] += light;
      lost[static_cast<int>(c)] += redistribute(light, from, mean, expected, factor);
    }
    for (const auto& [plane, squared] : planes)
      for_each_row(height, quiet(task), [&, plane = plane, squared = squared](int y) {
        for (int x = 0; x < width; ++x)
          (*plane)(x, y) = scaled((*plane)(x, y), static_cast<double>(factor(x, y)), squared);
      });
  }
  const FrameSpace space(frame);
  result.taken = space.luminance(taken);
  result.lost = space.luminance(lost);
  return result;
}

}  // namespace brume

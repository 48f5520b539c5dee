#include "evaluate/metrics/temporal.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace brume {
namespace {

/// Mean over the pixels of a mask of the scalar product of two changes of colour.
template <class First, class Second>
double mean_product(const Plane& size, const Mask& mask, const First& first, const Second& second) {
  double sum = 0, pixels = 0;
  for (int y = 0; y < size.height(); ++y)
    for (int x = 0; x < size.width(); ++x) {
      const size_t i = static_cast<size_t>(y) * static_cast<size_t>(size.width()) + static_cast<size_t>(x);
      if (!mask.empty() && !mask[i]) continue;
      for (size_t c = 0; c < 3; ++c) sum += first(c, x, y) * second(c, x, y);
      ++pixels;
    }
  return pixels > 0 ? sum / pixels : 0;
}

}  // namespace

void TemporalError::add(const RgbPlanes& x, const RgbPlanes& reference, const RgbPlanes* second, const Mask& mask) {
  Frame now{lab_planes(x, policy_), lab_planes(reference, policy_), lab_planes(second ? *second : reference, policy_),
            mask};
  if (last_) {
    const Frame& before = *last_;
    if (before.picture[0].width() != now.picture[0].width() || before.picture[0].height() != now.picture[0].height())
      throw std::logic_error("frames of a sequence have one size");
    Mask either = mask;
    for (size_t i = 0; i < either.size(); ++i) either[i] |= before.mask[i];
    const auto change = [](const auto& from, const auto& to, size_t c, int x_, int y) {
      return static_cast<double>(to[c](x_, y)) - static_cast<double>(from[c](x_, y));
    };
    const auto of_picture = [&](size_t c, int x_, int y) { return change(before.picture, now.picture, c, x_, y); };
    const auto of_first = [&](size_t c, int x_, int y) { return change(before.first, now.first, c, x_, y); };
    const auto of_second = [&](size_t c, int x_, int y) { return change(before.second, now.second, c, x_, y); };
    const Plane& size = now.picture[0];
    errors_ += mean_product(
        size, either, [&](size_t c, int x_, int y) { return of_picture(c, x_, y) - of_first(c, x_, y); },
        [&](size_t c, int x_, int y) { return of_picture(c, x_, y) - of_second(c, x_, y); });
    changes_ += mean_product(size, either, of_picture, of_picture);
    reference_changes_ += mean_product(size, either, of_first, of_second);
    ++pairs_;
    last_change_.emplace(size.width(), size.height());
    for (int y = 0; y < size.height(); ++y)
      for (int x_ = 0; x_ < size.width(); ++x_) {
        double square = 0;
        for (size_t c = 0; c < 3; ++c) {
          const double d = of_picture(c, x_, y) - of_first(c, x_, y);
          square += d * d;
        }
        (*last_change_)(x_, y) = static_cast<float>(std::sqrt(square));
      }
  }
  last_ = std::move(now);
}

std::optional<TemporalError::Result> TemporalError::result() const {
  if (pairs_ == 0) return std::nullopt;
  const auto root = [&](double sum) { return std::sqrt(std::max(0.0, sum / pairs_)); };
  return Result{root(errors_), root(changes_) - root(reference_changes_), root(reference_changes_), pairs_};
}

}  // namespace brume

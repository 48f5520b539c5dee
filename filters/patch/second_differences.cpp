#include "filters/patch/second_differences.h"

#include <algorithm>
#include <cmath>

namespace brume {
namespace {

// Half width of the squares over which single values are compared [px].
constexpr int kLevelRadius = 10;

// Directions of one second difference of each product; the other's are at right angles.
const std::array<ivec2, 4> kDirections = {ivec2(1, 0), ivec2(1, 1), ivec2(2, 1), ivec2(1, 2)};

}  // namespace

Plane mean_without_peaks(const Plane& values, int radius, const Task& task, float far_above) {
  const int width = values.width(), height = values.height();
  const Plane level = box_mean(make_plane(width, height, quiet(task),
                                          [&](int x, int y) { return std::sqrt(std::sqrt(std::abs(values(x, y)))); }),
                               kLevelRadius, task);
  return box_mean(make_plane(width, height, quiet(task),
                             [&](int x, int y) {
                               const float root = level(x, y) * level(x, y), most = far_above * root * root;
                               return std::clamp(values(x, y), -most, most);
                             }),
                  radius, task);
}

int mirrored(int i, int n) {
  i = i < 0 ? -i : i >= n ? 2 * (n - 1) - i : i;
  return std::clamp(i, 0, n - 1);
}

Plane least_product(const Plane& picture, int step, const std::array<float, 4>& white, int radius, const Task& task,
                    float far_above) {
  const int width = picture.width(), height = picture.height();
  const auto at = [&](int x, int y) { return picture(mirrored(x, width), mirrored(y, height)); };
  Plane least;
  for (size_t i = 0; i < kDirections.size(); ++i) {
    const ivec2 along = step * kDirections[i];
    const Plane products = make_plane(width, height, quiet(task), [&](int x, int y) {
      const auto second = [&](int dx, int dy) { return at(x + dx, y + dy) + at(x - dx, y - dy) - 2 * picture(x, y); };
      return second(along.x, along.y) * second(-along.y, along.x) / white[i];
    });
    Plane mean = mean_without_peaks(products, radius, task, far_above);
    if (least.empty())
      least = std::move(mean);
    else
      for_each_pixel(width, height, quiet(task),
                     [&](int x, int y) { least(x, y) = std::min(least(x, y), mean(x, y)); });
  }
  return least;
}

Plane halved_detail(const Plane& picture, int step, const Task& task) {
  const int width = picture.width(), height = picture.height();
  return make_plane(width, height, quiet(task), [&](int x, int y) {
    const int l = mirrored(x - step, width), r = mirrored(x + step, width);
    const int a = mirrored(y - step, height), b = mirrored(y + step, height);
    const auto row = [&](int j) { return picture(l, j) + 2 * picture(x, j) + picture(r, j); };
    return 0.0625f * (row(a) + 2 * row(y) + row(b));
  });
}

Plane mask_squares(const Plane& picture, const Task& task) {
  const int width = picture.width(), height = picture.height();
  return make_plane(width, height, quiet(task), [&](int x, int y) {
    const int l = mirrored(x - 1, width), r = mirrored(x + 1, width);
    const int a = mirrored(y - 1, height), b = mirrored(y + 1, height);
    const auto row = [&](int j) { return picture(l, j) - 2 * picture(x, j) + picture(r, j); };
    const float response = row(a) - 2 * row(y) + row(b);
    return response * response / 36;
  });
}

}  // namespace brume

#include "filters/regression/half_pairs.h"

#include "base/vec.h"
#include "filters/regression/lattice_regression.h"

namespace brume {

void add_to(Plane& x, float factor, const Plane& y, const Task& task) {
  for_each_row(x.height(), quiet(task), [&](int j) {
    for (int i = 0; i < x.width(); ++i) x(i, j) += factor * y(i, j);
  });
}

double sum_of(const Plane& plane) {
  double sum = 0;
  for (int y = 0; y < plane.height(); ++y)
    for (const float v : plane.pixels(y)) sum += static_cast<double>(v);
  return sum;
}

std::vector<Plane> local_ratio(const std::vector<const Plane*>& targets, const Plane& base, const Plane& weight,
                               double window, const Task& task) {
  return lattice_regression({{{{&base}}, targets, &weight}}, {window, 0, 0}, task);
}

Plane brightness(const HalfPair& fit, const Task& task) {
  return make_plane(fit.a[0].width(), fit.a[0].height(), quiet(task), [&](int x, int y) {
    const auto at = [&](size_t c) { return 0.5f * (fit.a[c](x, y) + fit.b[c](x, y)); };
    return luminance(vec3(at(0), at(1), at(2)));
  });
}

Rgb mean(const HalfPair& fit, const Task& task) {
  Rgb m;
  for (size_t c = 0; c < 3; ++c)
    m[c] = make_plane(fit.a[c].width(), fit.a[c].height(), quiet(task),
                      [&](int x, int y) { return 0.5f * (fit.a[c](x, y) + fit.b[c](x, y)); });
  return m;
}

HalfPair cut(const HalfPair& from, const Box& box) {
  HalfPair part;
  for (size_t c = 0; c < 3; ++c) {
    part.a[c] = crop(from.a[c], box);
    part.b[c] = crop(from.b[c], box);
  }
  return part;
}

}  // namespace brume

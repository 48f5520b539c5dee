#include "filters/inputs/half_pair.h"

#include "base/vec.h"

namespace brume {

void add_to(Plane& x, float factor, const Plane& y, const Task& task) {
  for_each_row(x.height(), quiet(task), [&](int j) {
    for (int i = 0; i < x.width(); ++i) x(i, j) += factor * y(i, j);
  });
}

void add_to(HalfPair& x, float factor, const HalfPair& y, const Task& task) {
  for (size_t c = 0; c < 3; ++c) {
    add_to(x.a[c], factor, y.a[c], task);
    add_to(x.b[c], factor, y.b[c], task);
  }
}

Plane brightness(const HalfPair& fit, const FrameSpace& space, const Task& task) {
  return make_plane(fit.a[0].width(), fit.a[0].height(), quiet(task), [&](int x, int y) {
    const auto at = [&](size_t c) { return 0.5f * (fit.a[c](x, y) + fit.b[c](x, y)); };
    return space.luminance(vec3(at(0), at(1), at(2)));
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

Plane blend(std::span<const Plane* const> values, const std::vector<Plane>& maps, const Task& task) {
  return make_plane(values[0]->width(), values[0]->height(), quiet(task), [&](int x, int y) {
    float sum = 0, total = 0;
    for (size_t i = 0; i < values.size(); ++i) {
      sum += maps[i](x, y) * (*values[i])(x, y);
      total += maps[i](x, y);
    }
    return total > 0 ? sum / total : (*values[0])(x, y);
  });
}

HalfPair blend(const std::vector<HalfPair>& candidates, const std::vector<Plane>& maps, const Task& task) {
  HalfPair out;
  for (size_t c = 0; c < 3; ++c) {
    std::vector<const Plane*> a, b;
    for (const HalfPair& candidate : candidates) {
      a.push_back(&candidate.a[c]);
      b.push_back(&candidate.b[c]);
    }
    out.a[c] = blend(a, maps, task);
    out.b[c] = blend(b, maps, task);
  }
  return out;
}

}  // namespace brume

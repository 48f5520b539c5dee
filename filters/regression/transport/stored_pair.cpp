#include "filters/regression/transport/stored_pair.h"

#include <algorithm>

namespace brume {

StoredPair::StoredPair(const HalfPair& pair, const Task& task) {
  for (size_t c = 0; c < 3; ++c) {
    a[c] = StoredPlane(pair.a[c], task);
    b[c] = StoredPlane(pair.b[c], task);
  }
}

void StoredPair::read(const Box& box, HalfPair& out, const Task& task) const {
  for (size_t c = 0; c < 3; ++c) {
    a[c].view(box.x0, box.y0, box.width(), box.height()).read(out.a[c], task);
    b[c].view(box.x0, box.y0, box.width(), box.height()).read(out.b[c], task);
  }
}

HalfPair blend(const std::vector<StoredPair>& candidates, const HalfPair& data, const std::vector<Plane>& maps,
               const Task& task) {
  const size_t n = candidates.size();
  HalfPair out;
  const auto blended = [&](const Plane& last, const auto& stored) {
    const int width = last.width();
    Plane result(width, last.height());
    for_each_row(last.height(), quiet(task), [&](int y) {
      std::vector<float> sum(static_cast<size_t>(width)), total(sum.size()), row(sum.size());
      float* const to = result.row(y);
      for (size_t i = 0; i <= n; ++i) {
        if (i < n) stored(i).read(y, 0, width, row.data());
        const float *const v = i < n ? row.data() : last.row(y), *const m = maps[i].row(y);
        if (i == 0) std::copy_n(v, width, to);
        for (size_t x = 0; x < sum.size(); ++x) {
          sum[x] += m[x] * v[x];
          total[x] += m[x];
        }
      }
      for (size_t x = 0; x < sum.size(); ++x)
        if (total[x] > 0) to[x] = sum[x] / total[x];
    });
    return result;
  };
  for (size_t c = 0; c < 3; ++c) {
    out.a[c] = blended(data.a[c], [&](size_t i) -> const StoredPlane& { return candidates[i].a[c]; });
    out.b[c] = blended(data.b[c], [&](size_t i) -> const StoredPlane& { return candidates[i].b[c]; });
  }
  return out;
}

}  // namespace brume

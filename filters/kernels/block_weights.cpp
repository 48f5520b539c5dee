#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/block_weights.cpp"
#include "filters/kernels/block_weights.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cstring>

// Plain loops over x, compiled for every instruction set: see kernels/rows.h.
HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {

#include "filters/kernels/exp_minus.h"

constexpr float kCap = 1e4f;  // of a distance: weights have long vanished

HWY_INLINE float smaller(float a, float b) {
  return a < b ? a : b;
}
HWY_INLINE float larger(float a, float b) {
  return a > b ? a : b;
}

// Written so that NaN, which infinities may leave, counts as far.
HWY_INLINE float capped(float d) {
  return d < kCap ? d : kCap;
}

HWY_INLINE float noise_distance(float a, float b, float va, float vb, float k2) {
  const float d = a - b;
  return capped((d * d - (va + smaller(va, vb))) / (1e-10f + k2 * (va + vb)));
}

// Rows of p and of q for one run of pixels: pointers to the first.
struct RowPair {
  const Distance& t;
  int y, dx, dy, x;
  const float* p(const Plane* plane) const { return plane->row(y) + x; }
  const float* q(const Plane* plane) const { return plane->row(y + dy) + x + dx; }
  const float* guide_q(size_t c) const { return q((t.guide_there.empty() ? t.guide : t.guide_there)[c]); }
  const float* variance_q(size_t c) const { return q((t.variance_there.empty() ? t.variance : t.variance_there)[c]); }
};

void noise_row(const RowPair& r, float* HWY_RESTRICT out, int n) {
  const Distance& t = r.t;
  const float k2 = t.k * t.k;
  if (t.guide.size() == 3) {
    const float *a0 = r.p(t.guide[0]), *a1 = r.p(t.guide[1]), *a2 = r.p(t.guide[2]);
    const float *b0 = r.guide_q(0), *b1 = r.guide_q(1), *b2 = r.guide_q(2);
    const float *va0 = r.p(t.variance[0]), *va1 = r.p(t.variance[1]), *va2 = r.p(t.variance[2]);
    const float *vb0 = r.variance_q(0), *vb1 = r.variance_q(1), *vb2 = r.variance_q(2);
    for (int x = 0; x < n; ++x)
      out[x] = (1.0f / 3.0f) *
               (noise_distance(a0[x], b0[x], va0[x], vb0[x], k2) + noise_distance(a1[x], b1[x], va1[x], vb1[x], k2) +
                noise_distance(a2[x], b2[x], va2[x], vb2[x], k2));
    return;
  }
  const float share = 1.0f / static_cast<float>(t.guide.size());
  for (size_t c = 0; c < t.guide.size(); ++c) {
    const float *a = r.p(t.guide[c]), *b = r.guide_q(c), *va = r.p(t.variance[c]), *vb = r.variance_q(c);
    for (int x = 0; x < n; ++x)
      out[x] = (c == 0 ? 0.0f : out[x]) + share * noise_distance(a[x], b[x], va[x], vb[x], k2);
  }
}

void own_scale_row(const RowPair& r, float* HWY_RESTRICT out, int n) {
  const Distance& t = r.t;
  const float* own = r.p(t.own);
  for (size_t c = 0; c < t.guide.size(); ++c) {
    const float *a = r.p(t.guide[c]), *b = r.guide_q(c), *va = r.p(t.variance[c]), *vb = r.variance_q(c);
    for (int x = 0; x < n; ++x) {
      const float d = a[x] - b[x];
      out[x] = (c == 0 ? 0.0f : out[x]) + capped((d * d - (va[x] + smaller(va[x], vb[x]))) * own[x]);
    }
  }
}

void ratio_row(const RowPair& r, float* HWY_RESTRICT out, int n) {
  const Distance& t = r.t;
  for (size_t c = 0; c < t.guide.size(); ++c) {
    const float *a = r.p(t.guide[c]), *b = r.guide_q(c);
    for (int x = 0; x < n; ++x) {
      const float d = a[x] - b[x];
      out[x] = (c == 0 ? 0.0f : out[x]) + d * d;
    }
  }
  if (t.variance.empty()) {
    const float unit = 1.0f / t.floor;
    for (int x = 0; x < n; ++x) out[x] = capped(out[x] * unit);
    return;
  }
  const float *va = r.p(t.variance[0]), *vb = r.variance_q(0);
  if (t.own) {
    const float* own = r.p(t.own);
    for (int x = 0; x < n; ++x) out[x] = capped(out[x] / larger(va[x] + vb[x] + own[x], t.floor));
  } else {
    for (int x = 0; x < n; ++x) out[x] = capped(out[x] / larger(va[x] + vb[x], t.floor));
  }
}

void angle_row(const RowPair& r, float* HWY_RESTRICT out, int n) {
  const Distance& t = r.t;
  const float *a0 = r.p(t.guide[0]), *a1 = r.p(t.guide[1]), *a2 = r.p(t.guide[2]), *ad = r.p(t.guide[3]);
  const float *b0 = r.guide_q(0), *b1 = r.guide_q(1), *b2 = r.guide_q(2), *bd = r.guide_q(3);
  for (int x = 0; x < n; ++x) {
    const float apart = 1.0f - smaller(larger(a0[x] * b0[x] + a1[x] * b1[x] + a2[x] * b2[x], -1.0f), 1.0f);
    out[x] = apart * apart * ad[x] * bd[x];
  }
}

void distance_row(const RowPair& r, float* out, int n) {
  switch (r.t.kind) {
    case Distance::Kind::kNoise:
      return noise_row(r, out, n);
    case Distance::Kind::kOwnScale:
      return own_scale_row(r, out, n);
    case Distance::Kind::kRatio:
      return ratio_row(r, out, n);
    case Distance::Kind::kAngle:
      return angle_row(r, out, n);
  }
}

template <Membership::Bound kBound>
void reject_row(const Membership& t, size_t c, int y, int dx, int dy, int x0, float* HWY_RESTRICT w, int n) {
  const float *v = t.value[c]->row(y + dy) + x0 + dx, *m = t.centre[c]->row(y) + x0;
  const float *own = t.squared_bound[c]->row(y) + x0,
              *other =
                  (t.squared_bound_there.empty() ? t.squared_bound : t.squared_bound_there)[c]->row(y + dy) + x0 + dx;
  for (int x = 0; x < n; ++x) {
    const float d = v[x] - m[x];
    const float bound = kBound == Membership::Bound::kOwn   ? own[x]
                        : kBound == Membership::Bound::kSum ? own[x] + other[x]
                                                            : larger(own[x], other[x]);
    w[x] = d * d <= bound ? w[x] : 0.0f;
  }
}

void reject(const Membership& t, int y, int dx, int dy, int x0, float* w, int n) {
  using Bound = Membership::Bound;
  for (size_t c = 0; c < t.value.size(); ++c) {
    switch (t.bound) {
      case Bound::kOwn:
        reject_row<Bound::kOwn>(t, c, y, dx, dy, x0, w, n);
        break;
      case Bound::kSum:
        reject_row<Bound::kSum>(t, c, y, dx, dy, x0, w, n);
        break;
      case Bound::kLarger:
        reject_row<Bound::kLarger>(t, c, y, dx, dy, x0, w, n);
        break;
    }
  }
}

// Sum of the taps that stay inside at both ends, around position i of an image n long.
float valid_taps(const std::vector<float>& taps, int i, int shift, int n) {
  const int f = static_cast<int>(taps.size()) / 2;
  float sum = 0;
  for (int j = -f; j <= f; ++j)
    if (i + j >= 0 && i + j < n && i + j + shift >= 0 && i + j + shift < n) sum += taps[static_cast<size_t>(j + f)];
  return sum;
}

enum class Step { kSum, kLargest, kPatch, kPatchEnd };

template <bool kFirst, Step kStep>
HWY_INLINE void join_row(const float* HWY_RESTRICT d, float scale, float* HWY_RESTRICT out, int n) {
  constexpr bool patch = kStep == Step::kPatch || kStep == Step::kPatchEnd;
  for (int x = 0; x < n; ++x) {
    const float v = patch ? d[x] * scale : larger(d[x] * scale, 0.0f);
    const float joined = kFirst ? v : kStep == Step::kLargest ? larger(out[x], v) : out[x] + v;
    out[x] = kStep == Step::kPatchEnd ? larger(joined, 0.0f) : joined;
  }
}

template <bool kFirst>
void join_row(Step step, const float* d, float scale, float* out, int n) {
  switch (step) {
    case Step::kSum:
      return join_row<kFirst, Step::kSum>(d, scale, out, n);
    case Step::kLargest:
      return join_row<kFirst, Step::kLargest>(d, scale, out, n);
    case Step::kPatch:
      return join_row<kFirst, Step::kPatch>(d, scale, out, n);
    case Step::kPatchEnd:
      return join_row<kFirst, Step::kPatchEnd>(d, scale, out, n);
  }
}

/// Adds the i-th distance of a model to those before.
void join(const WeightModel& model, size_t i, const float* d, float* out, int n) {
  const Step step = model.join == WeightModel::Join::kLargest ? Step::kLargest
                    : model.join == WeightModel::Join::kSum   ? Step::kSum
                    : i + 1 == model.distances.size()         ? Step::kPatchEnd
                                                              : Step::kPatch;
  const float scale = model.distances[i].scale;
  i == 0 ? join_row<true>(step, d, scale, out, n) : join_row<false>(step, d, scale, out, n);
}

/// Weighted sums of a row's neighbours; patches of three and seven pixels are written out.
void sum_along(const std::vector<float>& patch, const float* HWY_RESTRICT in, float* HWY_RESTRICT sum, int width) {
  const int f = static_cast<int>(patch.size()) / 2;
  if (f == 1) {
    const float a = patch[0], b = patch[1], c = patch[2];
    for (int x = 0; x < width; ++x) sum[x] = a * in[x] + b * in[x + 1] + c * in[x + 2];
  } else if (f == 3) {
    const float *p = patch.data(), t0 = p[0], t1 = p[1], t2 = p[2], t3 = p[3], t4 = p[4], t5 = p[5], t6 = p[6];
    for (int x = 0; x < width; ++x)
      sum[x] = (t0 * in[x] + t1 * in[x + 1]) + (t2 * in[x + 2] + t3 * in[x + 3]) +
               (t4 * in[x + 4] + t5 * in[x + 5] + t6 * in[x + 6]);
  } else {
    for (int x = 0; x < width; ++x) sum[x] = patch[0] * in[x];
    for (int j = 1; j <= 2 * f; ++j) {
      const float tap = patch[static_cast<size_t>(j)];
      for (int x = 0; x < width; ++x) sum[x] += tap * in[x + j];
    }
  }
}

/// The same of rows `stride` apart, in units of `unit` and of each column's norm.
void sum_down(const std::vector<float>& patch, float unit, const float* h, size_t stride,
              const float* HWY_RESTRICT norm, float* HWY_RESTRICT sum, int width) {
  const int f = static_cast<int>(patch.size()) / 2;
  if (f == 1) {
    const float a = unit * patch[0], b = unit * patch[1], c = unit * patch[2];
    for (int x = 0; x < width; ++x) {
      const size_t u = static_cast<size_t>(x);
      sum[x] = (a * h[u] + b * h[u + stride] + c * h[u + 2 * stride]) * norm[x];
    }
  } else if (f == 3) {
    float tap[7];
    for (size_t j = 0; j < 7; ++j) tap[j] = unit * patch[j];
    for (int x = 0; x < width; ++x) {
      const float* c = h + x;
      sum[x] = ((tap[0] * c[0] + tap[1] * c[stride]) + (tap[2] * c[2 * stride] + tap[3] * c[3 * stride]) +
                (tap[4] * c[4 * stride] + tap[5] * c[5 * stride] + tap[6] * c[6 * stride])) *
               norm[x];
    }
  } else {
    for (int x = 0; x < width; ++x) sum[x] = unit * patch[0] * h[x];
    for (int j = 1; j <= 2 * f; ++j) {
      const float tap = unit * patch[static_cast<size_t>(j)];
      const float* c = h + stride * static_cast<size_t>(j);
      for (int x = 0; x < width; ++x) sum[x] += tap * c[x];
    }
    for (int x = 0; x < width; ++x) sum[x] *= norm[x];
  }
}

void BlockDistances(const WeightModel& model, const Box& block, int dx, int dy, WeightScratch& s, float* weights,
                    size_t stride) {
  const int width = block.width();
  if (model.distances.empty())
    for (int y = 0; y < block.height(); ++y)
      std::memset(weights + stride * static_cast<size_t>(y), 0, sizeof(float) * static_cast<size_t>(width));
  for (size_t i = 0; i < model.distances.size(); ++i) {
    const Distance& t = model.distances[i];
    const int f = t.patch_radius(), image_width = t.guide[0]->width(), image_height = t.guide[0]->height();
    // Columns and rows where both ends are inside, patch included.
    const int x0 = std::max({block.x0 - f, 0, -dx}), x1 = std::min({block.x1 + f, image_width, image_width - dx});
    const size_t padded = static_cast<size_t>(width + 2 * f);
    s.distance.resize(padded);
    s.horizontal.resize(stride * static_cast<size_t>(block.height() + 2 * f));
    s.norm.resize(stride);
    for (int y = block.y0 - f; y < block.y1 + f; ++y) {
      float* h = s.horizontal.data() + stride * static_cast<size_t>(y - block.y0 + f);
      if (y < 0 || y >= image_height || y + dy < 0 || y + dy >= image_height || x0 >= x1) {
        std::memset(h, 0, sizeof(float) * static_cast<size_t>(width));
        continue;
      }
      float* d = f == 0 ? h : s.distance.data();
      const int lead = x0 - (block.x0 - f), n = x1 - x0;
      std::fill_n(d, lead, 0.0f);
      std::fill(d + lead + n, d + padded, 0.0f);
      distance_row({t, y, dx, dy, x0}, d + lead, n);
      if (f > 0) sum_along(t.patch, d, h, width);
    }
    if (f > 0)
      for (int x = 0; x < width; ++x) {
        const float v = valid_taps(t.patch, block.x0 + x, dx, image_width);
        s.norm[static_cast<size_t>(x)] = v > 0 ? 1.0f / v : 0.0f;
      }
    for (int y = block.y0; y < block.y1; ++y) {
      float* HWY_RESTRICT out = weights + stride * static_cast<size_t>(y - block.y0);
      const float* h = s.horizontal.data() + stride * static_cast<size_t>(y - block.y0);
      if (f == 0) {
        join(model, i, h, out, width);
        continue;
      }
      const float rows = valid_taps(t.patch, y, dy, image_height);
      const float unit = rows > 0 ? 1.0f / rows : 0.0f;
      float* HWY_RESTRICT sum = s.distance.data();
      const float* HWY_RESTRICT norm = s.norm.data();
      sum_down(t.patch, unit, h, stride, norm, sum, width);
      join(model, i, sum, out, width);
    }
  }
}

void BlockWeights(const WeightModel& model, ivec2 size, const Box& block, int dx, int dy, const float* distances,
                  float scale, const Plane* place, float* weights, size_t stride) {
  const int image_width = size.x, image_height = size.y, width = block.width();
  const int first = std::max(0, -dx - block.x0), last = std::min(width, image_width - dx - block.x0);
  const float r2 = static_cast<float>(dx * dx + dy * dy);
  for (int y = block.y0; y < block.y1; ++y) {
    const size_t line = stride * static_cast<size_t>(y - block.y0);
    float* out = weights + line;
    if (y + dy < 0 || y + dy >= image_height || first >= last) {
      std::memset(out, 0, sizeof(float) * static_cast<size_t>(width));
      continue;
    }
    const float* d = distances + line;
    if (place) {
      const float* own = place->row(y) + block.x0;
      for (int x = 0; x < width; ++x) out[x] = exp_minus(scale * d[x] + r2 * own[x]);
    } else if (model.distances.empty()) {
      std::fill_n(out, width, 1.0f);
    } else {
      for (int x = 0; x < width; ++x) out[x] = exp_minus(scale * d[x]);
    }
    std::fill_n(out, first, 0.0f);
    std::fill(out + last, out + width, 0.0f);
    for (const Membership& t : model.memberships) reject(t, y, dx, dy, block.x0 + first, out + first, last - first);
    if (model.trust) {
      const float* trust = model.trust->row(y + dy) + block.x0 + dx;
      for (int x = first; x < last; ++x) out[x] *= trust[x];
    }
  }
}

void AccumulateBlock(const float* weights, size_t stride, float scale, const Box& block, int dx, int dy,
                     std::span<const Plane* const> values, std::span<const Plane* const> there, const Plane* variance,
                     float* sums, size_t plane) {
  const int image_width = values[0]->width(), image_height = values[0]->height();
  const int first = std::max(block.x0, -dx), last = std::min(block.x1, image_width - dx), n = last - first;
  if (n <= 0) return;
  for (int y = std::max(block.y0, -dy); y < std::min(block.y1, image_height - dy); ++y) {
    const size_t at = stride * static_cast<size_t>(y - block.y0) + static_cast<size_t>(first - block.x0);
    const float* HWY_RESTRICT w = weights + at;
    for (size_t c = 0; c < values.size(); ++c) {
      float* HWY_RESTRICT sum = sums + c * plane + at;
      const float *p = values[c]->row(y) + first, *q = there[c]->row(y + dy) + first + dx;
      for (int x = 0; x < n; ++x) sum[x] += scale * w[x] * (q[x] - p[x]);
    }
    float* HWY_RESTRICT total = sums + values.size() * plane + at;
    for (int x = 0; x < n; ++x) total[x] += scale * w[x];
    if (!variance) continue;
    float* HWY_RESTRICT noise = sums + (values.size() + 1) * plane + at;
    const float* v = variance->row(y + dy) + first + dx;
    for (int x = 0; x < n; ++x) noise[x] += (scale * w[x]) * (scale * w[x]) * v[x];
  }
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(BlockDistances);
HWY_EXPORT(BlockWeights);
HWY_EXPORT(AccumulateBlock);

void block_distances(const WeightModel& model, const Box& block, int dx, int dy, WeightScratch& scratch,
                     float* distances, size_t stride) {
  HWY_DYNAMIC_DISPATCH(BlockDistances)(model, block, dx, dy, scratch, distances, stride);
}

void block_weights(const WeightModel& model, ivec2 size, const Box& block, int dx, int dy, const float* distances,
                   float scale, const Plane* place, float* weights, size_t stride) {
  HWY_DYNAMIC_DISPATCH(BlockWeights)(model, size, block, dx, dy, distances, scale, place, weights, stride);
}

void accumulate_block(const float* weights, size_t stride, float scale, const Box& block, int dx, int dy,
                      std::span<const Plane* const> values, std::span<const Plane* const> there, const Plane* variance,
                      float* sums, size_t plane) {
  HWY_DYNAMIC_DISPATCH(AccumulateBlock)(weights, stride, scale, block, dx, dy, values, there, variance, sums, plane);
}

}  // namespace brume::kernels
#endif

#include "filters/patch/neighbourhood.h"

#include <algorithm>
#include <cmath>

#include "base/parallel_for.h"

namespace brume {

std::vector<Offset> square_window(int radius) {
  return gaussian_window(radius, 0);
}

std::vector<Offset> gaussian_window(int radius, double sigma) {
  std::vector<Offset> offsets;
  for (int dy = -radius; dy <= radius; ++dy)
    for (int dx = -radius; dx <= radius; ++dx)
      offsets.push_back(
          {dx, dy, sigma > 0 ? static_cast<float>(std::exp(-(dx * dx + dy * dy) / (2 * sigma * sigma))) : 1.0f});
  return offsets;
}

std::vector<float> box_patch(int radius) {
  return std::vector<float>(static_cast<size_t>(2 * radius + 1), 1.0f);
}

Distance noise_distance(std::span<const Plane* const> guide, std::span<const Plane* const> variance, int patch_radius,
                        float k) {
  Distance d;
  d.guide.assign(guide.begin(), guide.end());
  d.variance.assign(variance.begin(), variance.end());
  d.k = k;
  d.patch = box_patch(patch_radius);
  return d;
}

Distance noise_distance(const Noisy& here, const Noisy& there, int patch_radius, float k) {
  Distance d = noise_distance(here.mean, here.variance, patch_radius, k);
  if (here.mean == there.mean) return d;
  d.guide_there.assign(there.mean.begin(), there.mean.end());
  d.variance_there.assign(there.variance.begin(), there.variance.end());
  return d;
}

Plane sum_of(const std::vector<Plane>& planes) {
  Plane sum = planes[0];
  for (size_t i = 1; i < planes.size(); ++i)
    for (int y = 0; y < sum.height(); ++y)
      for (int x = 0; x < sum.width(); ++x) sum(x, y) += planes[i](x, y);
  return sum;
}

FeatureDistances::FeatureDistances(const std::vector<Feature>& features, float k, float tau, const Task& task) {
  own_.reserve(features.size());
  for (const Feature& f : features) {
    const int width = f.mean[0].width(), height = f.mean[0].height();
    own_.push_back(make_plane(width, height, quiet(task), [&](int x, int y) {
      float variance = 0, slope = 0;
      for (size_t c = 0; c < f.mean.size(); ++c) {
        const Plane& p = f.mean[c];
        const auto half = [&](int ax, int ay) {
          const int qx = std::clamp(x + ax, 0, width - 1), qy = std::clamp(y + ay, 0, height - 1);
          return std::abs(0.5f * (p(qx, qy) - p(x, y)));
        };
        const float gx = std::min(half(-1, 0), half(1, 0)), gy = std::min(half(0, -1), half(0, 1));
        variance += f.variance[c](x, y);
        slope += gx * gx + gy * gy;
      }
      return 1.0f / (k * k * std::max({tau, variance, slope}));
    }));
    Distance d;
    d.kind = Distance::Kind::kOwnScale;
    d.guide = pointers(f.mean);
    d.variance = pointers(f.variance);
    d.own = &own_.back();
    distances_.push_back(std::move(d));
  }
}

void FeatureDistances::add_to(WeightModel& model, const std::vector<Feature>* there) const {
  for (size_t i = 0; i < distances_.size(); ++i) {
    Distance& d = model.distances.emplace_back(distances_[i]);
    if (!there) continue;
    d.guide_there = pointers((*there)[i].mean);
    d.variance_there = pointers((*there)[i].variance);
  }
}

void for_each_block(int width, int height, int block_width, int block_height, const Task& task,
                    const std::function<void(const Box&)>& body) {
  const int across = (width + block_width - 1) / block_width, down = (height + block_height - 1) / block_height;
  parallel_for(across * down, task, [&](int i) {
    const int x0 = i % across * block_width, y0 = i / across * block_height;
    body({x0, y0, std::min(width, x0 + block_width), std::min(height, y0 + block_height)});
  });
}

namespace {

// Blocks wide enough for vectors, small enough for the second-level cache, high enough that a patch's apron costs
// little.
constexpr int kWidth = 128, kHeight = 48;
constexpr size_t kPlane = static_cast<size_t>(kWidth) * kHeight;

}  // namespace

std::vector<Averages> weighted_averages(const WeightModel& model, std::span<const Offset> offsets,
                                        std::span<const Variant> variants, std::span<const Plane* const> values,
                                        const Plane* variance, const Task& task) {
  const int width = values[0]->width(), height = values[0]->height();
  std::vector<Averages> out(variants.size());
  for (Averages& a : out) {
    a.values.assign(values.size(), Plane(width, height));
    a.weight = Plane(width, height);
    if (variance) a.noise = Plane(width, height);
  }
  const size_t planes = values.size() + 1 + (variance ? 1 : 0);
  for_each_block(width, height, kWidth, kHeight, task, [&](const Box& block) {
    std::vector<float> distances(kPlane), weights(kPlane), sums(kPlane * planes * variants.size());
    kernels::WeightScratch scratch;
    for (size_t o = 0; o < offsets.size(); ++o) {
      const auto [dx, dy, own] = offsets[o];
      kernels::block_distances(model, block, dx, dy, scratch, distances.data(), kWidth);
      for (size_t v = 0; v < variants.size(); ++v) {
        const Variant& variant = variants[v];
        const float share = variant.offsets.empty() ? own : variant.offsets[o];
        if (share == 0) continue;
        // Weights that the variant before has computed serve again.
        if (v == 0 || variant.scale != variants[v - 1].scale || variant.place != variants[v - 1].place ||
            (!variants[v - 1].offsets.empty() && variants[v - 1].offsets[o] == 0))
          kernels::block_weights(model, {width, height}, block, dx, dy, distances.data(), variant.scale, variant.place,
                                 weights.data(), kWidth);
        kernels::accumulate_block(weights.data(), kWidth, share, block, dx, dy, values, values, variance,
                                  sums.data() + kPlane * planes * v, kPlane);
      }
    }
    for (size_t v = 0; v < variants.size(); ++v) {
      const float* const sum = sums.data() + kPlane * planes * v;
      for (int y = block.y0; y < block.y1; ++y)
        for (int x = block.x0; x < block.x1; ++x) {
          const size_t at = static_cast<size_t>(y - block.y0) * kWidth + static_cast<size_t>(x - block.x0);
          const float total = sum[values.size() * kPlane + at];
          const bool enough = total > 1e-8f;
          out[v].weight(x, y) = total;
          for (size_t c = 0; c < values.size(); ++c)
            out[v].values[c](x, y) = (*values[c])(x, y) + (enough ? sum[c * kPlane + at] / total : 0.0f);
          if (variance)
            out[v].noise(x, y) = enough ? sum[(values.size() + 1) * kPlane + at] / total / total : (*variance)(x, y);
        }
    }
  });
  return out;
}

Averages weighted_average(const WeightModel& model, std::span<const Offset> offsets,
                          std::span<const Plane* const> values, const Task& task) {
  const Variant plain;
  return std::move(weighted_averages(model, offsets, {&plain, 1}, values, nullptr, task)[0]);
}

std::vector<Plane> average_over_frames(std::span<const Slice> slices, std::span<const Plane* const> values,
                                       const Task& task) {
  const int width = values[0]->width(), height = values[0]->height();
  std::vector<Plane> out(values.size(), Plane(width, height));
  for_each_block(width, height, kWidth, kHeight, task, [&](const Box& block) {
    std::vector<float> weights(kPlane), sums(kPlane * (values.size() + 1));
    kernels::WeightScratch scratch;
    for (const Slice& slice : slices)
      for (const auto& [dx, dy, own] : slice.offsets) {
        kernels::block_distances(slice.model, block, dx, dy, scratch, weights.data(), kWidth);
        kernels::block_weights(slice.model, {width, height}, block, dx, dy, weights.data(), 1, nullptr, weights.data(),
                               kWidth);
        kernels::accumulate_block(weights.data(), kWidth, own, block, dx, dy, values, slice.values, nullptr,
                                  sums.data(), kPlane);
      }
    for (int y = block.y0; y < block.y1; ++y)
      for (int x = block.x0; x < block.x1; ++x) {
        const size_t at = static_cast<size_t>(y - block.y0) * kWidth + static_cast<size_t>(x - block.x0);
        const float total = sums[values.size() * kPlane + at];
        for (size_t c = 0; c < values.size(); ++c)
          out[c](x, y) = (*values[c])(x, y) + (total > 1e-8f ? sums[c * kPlane + at] / total : 0.0f);
      }
  });
  return out;
}

Plane weights_toward(const WeightModel& model, int dx, int dy, int width, int height, const Task& task) {
  Plane out(width, height);
  for_each_block(width, height, kWidth, kHeight, quiet(task), [&](const Box& block) {
    std::vector<float> weights(kPlane);
    kernels::WeightScratch scratch;
    kernels::block_distances(model, block, dx, dy, scratch, weights.data(), kWidth);
    kernels::block_weights(model, {width, height}, block, dx, dy, weights.data(), 1, nullptr, weights.data(), kWidth);
    for (int y = block.y0; y < block.y1; ++y)
      for (int x = block.x0; x < block.x1; ++x)
        out(x, y) = weights[static_cast<size_t>(y - block.y0) * kWidth + static_cast<size_t>(x - block.x0)];
  });
  return out;
}

}  // namespace brume

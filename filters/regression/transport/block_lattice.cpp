#include "filters/regression/transport/block_lattice.h"

#include <algorithm>
#include <cmath>

#include "filters/kernels/rows.h"

namespace brume {
namespace {

constexpr double kBlocksPerDeviation = 1.6;
constexpr double kTruncation = 2.5;  // of the windows, in deviations

}  // namespace

BlockLattice::BlockLattice(int width_, int height_, int block_)
    : width(width_),
      height(height_),
      block(block_),
      across((width + block - 1) / block),
      down((height + block - 1) / block) {}

int BlockLattice::block_for(double deviation) {
  return std::max(1, static_cast<int>(std::lround(deviation / kBlocksPerDeviation)));
}

std::vector<float> lattice_taps(double deviation_in_blocks) {
  const int radius = std::max(1, static_cast<int>(std::ceil(kTruncation * deviation_in_blocks)));
  std::vector<float> taps;
  for (int j = -radius; j <= radius; ++j)
    taps.push_back(static_cast<float>(std::exp(-j * j / (2 * deviation_in_blocks * deviation_in_blocks))));
  return taps;
}

std::vector<float> blurred_along(const std::vector<float>& row, size_t size, const std::vector<float>& taps) {
  const int radius = static_cast<int>(taps.size()) / 2, count = static_cast<int>(row.size() / size);
  std::vector<float> out(row.size());
  std::vector<const float*> nodes;
  for (int i = 0; i < count; ++i) {
    const int first = std::max(0, i - radius), last = std::min(count - 1, i + radius);
    nodes.clear();
    for (int j = first; j <= last; ++j) nodes.push_back(row.data() + static_cast<size_t>(j) * size);
    kernels::weighted_sum_rows(nodes.data(), taps.data() + (first - i + radius), last - first + 1,
                               out.data() + static_cast<size_t>(i) * size, static_cast<int>(size));
  }
  return out;
}

std::vector<float> blurred_down(const LatticeRows& rows, int row, const std::vector<float>& taps) {
  const int radius = static_cast<int>(taps.size()) / 2;
  const int first = std::max(0, row - radius), last = std::min(static_cast<int>(rows.size()) - 1, row + radius);
  std::vector<const float*> sources;
  for (int j = first; j <= last; ++j) sources.push_back(rows[static_cast<size_t>(j)].data());
  std::vector<float> out(rows[0].size());
  kernels::weighted_sum_rows(sources.data(), taps.data() + (first - row + radius), last - first + 1, out.data(),
                             static_cast<int>(out.size()));
  return out;
}

SplinePlaces::SplinePlaces(int pixels, int block, int count) {
  for (int i = 0; i < pixels; ++i) {
    const float at = (static_cast<float>(i) + 0.5f) / static_cast<float>(block) - 0.5f;
    const int nearest = std::clamp(static_cast<int>(std::lround(at)), 0, count - 1);
    const float t = std::clamp(at - static_cast<float>(nearest), -0.5f, 0.5f);
    for (int j = -1; j <= 1; ++j) nodes.push_back(std::clamp(nearest + j, 0, count - 1));
    weights.push_back(0.5f * (0.5f - t) * (0.5f - t));
    weights.push_back(0.75f - t * t);
    weights.push_back(0.5f * (0.5f + t) * (0.5f + t));
  }
}

std::vector<float> SplinePlaces::between(const LatticeRows& rows, int y) const {
  const size_t first = 3 * static_cast<size_t>(y);
  const float* sources[3];
  for (size_t i = 0; i < 3; ++i) sources[i] = rows[static_cast<size_t>(nodes[first + i])].data();
  std::vector<float> row(rows[0].size());
  kernels::weighted_sum_rows(sources, weights.data() + first, 3, row.data(), static_cast<int>(row.size()));
  return row;
}

}  // namespace brume

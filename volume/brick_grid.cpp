#include "volume/brick_grid.h"

#include <algorithm>

#include "volume/voxel_box.h"

namespace brume {

// More levels keep the top one small when a few leaves are scattered over an enormous box.
void BrickGrid::set_depth() {
  const auto count = [&](int depth) {
    const int bits = kNodeBits * depth;
    return (cell_count_ + ((1 << bits) - 1)) >> bits;
  };
  while (depth_ < kMostLevels && product(count(depth_)) > 1 << 21) ++depth_;
  top_count_ = count(depth_);
}

std::vector<uint64_t> BrickGrid::node_uses() const {
  std::vector<uint64_t> of_node(cells_.size() / kNodeCells), of_inner(inner_levels_.size());
  const auto count = [&](int level, const int32_t* entries, size_t number, uint64_t uses) {
    for (size_t i = 0; i < number; ++i)
      if (entries[i] >= 0) (level == 1 ? of_node : of_inner)[static_cast<size_t>(entries[i])] += uses;
  };
  count(depth_, top_.data(), top_.size(), 1);
  for (int level = depth_; level > 1; --level)
    for (size_t i = 0; i < inner_levels_.size(); ++i)
      if (inner_levels_[i] == level) count(level - 1, inner_.data() + i * kNodeCells, kNodeCells, of_inner[i]);
  return of_node;
}

bool BrickGrid::consistent() const {
  if (cell_bits_ < 1 || cell_bits_ > 5 || depth_ < 1 || depth_ > kMostLevels) return false;
  const int64_t width = int64_t{1} << (kNodeBits * depth_);
  constexpr int64_t kMostCells = 1 << 29;
  for (int a = 0; a < 3; ++a) {
    const int64_t count = cell_count_[a];
    if (count < 0 || count > kMostCells || top_count_[a] != (count + width - 1) / width) return false;
    if (!(support_lo_[a] >= 0 && support_hi_[a] <= static_cast<double>(count) * cell_size())) return false;
  }
  if (product(top_count_) != static_cast<double>(top_.size())) return false;
  if (inner_.size() != inner_levels_.size() * kNodeCells) return false;
  if (cells_.size() % kNodeCells != 0 || bricks_.size() % brick_values() != 0) return false;
  const size_t nodes = cells_.size() / kNodeCells;
  const auto leads_on = [&](int level, int32_t entry) {
    const auto at = static_cast<size_t>(entry);
    return entry == -1 ||
           (entry >= 0 && (level == 1 ? at < nodes : at < inner_levels_.size() && inner_levels_[at] == level));
  };
  const auto lead_on = [&](int level, const int32_t* first, size_t number) {
    return std::all_of(first, first + number, [&](int32_t entry) { return leads_on(level, entry); });
  };
  if (!lead_on(depth_, top_.data(), top_.size())) return false;
  for (size_t i = 0; i < inner_levels_.size(); ++i)
    if (inner_levels_[i] < 2 || !lead_on(inner_levels_[i] - 1, inner_.data() + i * kNodeCells, kNodeCells))
      return false;
  const size_t count = brick_count();
  return std::all_of(cells_.begin(), cells_.end(),
                     [&](const Cell& cell) { return cell.brick <= count && cell.majorant <= maximum_; });
}

float BrickGrid::voxel(const ivec3& v) const {
  const ivec3 c = v >> cell_bits_;
  for (int a = 0; a < 3; ++a)
    if (v[a] < 0 || c[a] >= cell_count_[a]) return 0.0f;
  const Cell& found = cell(c);
  if (found.brick == 0) return 0.0f;
  const ivec3 i = v & (cell_size() - 1);
  return brick(found)[(i.x * stored() + i.y) * stored() + i.z];
}

float BrickGrid::lookup(const dvec3& p) const {
  ivec3 c;
  for (int a = 0; a < 3; ++a) {
    if (!(p[a] > support_lo_[a] && p[a] < support_hi_[a])) return 0.0f;
    c[a] = static_cast<int>(p[a]) / cell_size();
  }
  const Cell& found = cell(c);
  return found.brick == 0 ? 0.0f : lookup_in(found, c, p);
}

}  // namespace brume

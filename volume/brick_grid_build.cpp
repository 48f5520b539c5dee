#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <optional>
#include <string>
#include <unordered_map>

#include "base/error.h"
#include "base/parallel_for.h"
#include "base/rng.h"
#include "volume/brick_grid.h"
#include "volume/constant_parts.h"
#include "volume/voxel_box.h"

namespace brume {
namespace {

int floor_to_cell(int v) {
  return static_cast<int>(std::floor(v / static_cast<double>(BrickGrid::kCell))) * BrickGrid::kCell;
}

/// The least and the greatest of values that are no NaN; in sixteen chains, which compilers turn into vectors.
std::pair<float, float> bounds_of(std::span<const float> values) {
  constexpr size_t kChains = 16;
  std::array<float, kChains> low, high;
  low.fill(values[0]);
  high.fill(values[0]);
  size_t i = 0;
  for (; i + kChains <= values.size(); i += kChains)
    for (size_t k = 0; k < kChains; ++k) {
      low[k] = std::min(low[k], values[i + k]);
      high[k] = std::max(high[k], values[i + k]);
    }
  for (; i < values.size(); ++i) {
    low[0] = std::min(low[0], values[i]);
    high[0] = std::max(high[0], values[i]);
  }
  return {*std::min_element(low.begin(), low.end()), *std::max_element(high.begin(), high.end())};
}

/// Whether a brick's values change nowhere but at its far faces, as they do where 8 x 8 x 8 blocks hold one value each:
/// its eight corners then say all of it.
bool of_corners(const float* values, int n) {
  const int stored = n + 1;
  const auto same = [](float a, float b) { return std::bit_cast<uint32_t>(a) == std::bit_cast<uint32_t>(b); };
  for (int x = 0; x <= n; ++x)
    for (int y = 0; y <= n; ++y) {
      const float* const row = values + (x * stored + y) * stored;
      const float* const corner = values + ((x == n ? n : 0) * stored + (y == n ? n : 0)) * stored;
      if (!same(row[n], corner[n])) return false;
      for (int z = 0; z < n; ++z)
        if (!same(row[z], corner[0])) return false;
    }
  return true;
}

using Corners = std::array<uint32_t, 8>;

Corners corners_of(const float* values, int n) {
  const int stored = n + 1;
  Corners corners;
  for (size_t k = 0; k < 8; ++k)
    corners[k] = std::bit_cast<uint32_t>(
        values[(((k >> 2) * stored + (k >> 1 & 1)) * stored + (k & 1)) * static_cast<size_t>(n)]);
  return corners;
}

struct HashOfCorners {
  size_t operator()(const Corners& corners) const {
    uint64_t hash = 0;
    for (const uint32_t c : corners) hash = hash_combine(hash, c);
    return hash;
  }
};

}  // namespace

/// Makes a grid of sampled cells and of constant boxes.
class BrickGrid::Builder {
 public:
  class Recut;

  Builder(BrickGrid& grid, const Task& task, MemoryFile* file)
      : grid_(grid),
        task_(task),
        values_(grid.brick_values()),
        top_(static_cast<size_t>(product(grid.top_count_)), -1),
        known_(static_cast<size_t>(grid.depth_) + 1),
        bricks_(file) {}

  /// Notes that a cell's values are not those of constant boxes. @return whether that is new
  bool touch(const ivec3& c) {
    const int32_t slot = touched_slot(c);
    const size_t bit = in_block(c, 0);
    uint64_t& word = touched_[static_cast<size_t>(slot)][bit / 64];
    const uint64_t mask = uint64_t{1} << (bit % 64);
    if (word & mask) return false;
    word |= mask;
    return true;
  }
  /// The values of a touched cell are asked for, or are those of another one.
  void ask(const ivec3& c) { candidates_.push_back(c); }
  void repeat(const ivec3& c, const ivec3& other) { repeats_.emplace_back(c, other); }

  /// The cells that a block of 8 x 8 x 8 voxels reaches: it lends its lowest faces to the aprons of the seven below it.
  void touch_block(const ivec3& block) {
    for (int corner = 0; corner < 8; ++corner) {
      const ivec3 c = ((block - grid_.origin_) >> grid_.cell_bits_) - ivec3(corner & 1, corner >> 1 & 1, corner >> 2);
      if (glm::any(glm::lessThan(c, ivec3(0))) || glm::any(glm::greaterThanEqual(c, grid_.cell_count_))) continue;
      if (touch(c)) ask(c);
    }
  }

  /// After all that is touched.
  void place(const std::vector<ConstantBox>& boxes) {
    std::vector<ConstantPart> list;
    for (const ConstantBox& b : boxes)
      if (!b.box.empty()) list.push_back({b.box.lo - grid_.origin_, b.box.hi - grid_.origin_, b.value});
    if (list.empty()) return;
    const ivec3& n = grid_.top_count_;
    const int bits = bits_of(grid_.depth_);
    const Distribution distribution(list, n, bits);
    std::vector<ConstantPart> part;
    for (int x = 0; x < n.x; ++x)
      for (int y = 0; y < n.y; ++y)
        for (int z = 0; z < n.z; ++z) {
          const size_t i = (static_cast<size_t>(x) * n.y + y) * n.z + z;
          cut(list, distribution.of(i), ivec3(x, y, z) << bits, bits, part);
          if (!part.empty()) top_[i] = placed(grid_.depth_, top_[i], part);
        }
  }

  /// Asks for the values of the touched cells, in batches, so that they exist once: bricks that turn out empty or equal
  /// to others are not kept.
  void sample(const Sampler& sample) {
    task_.check();
    const int n = grid_.cell_size();
    const size_t batch_cells = std::min((size_t{1} << 21) / values_, candidates_.size());
    std::vector<float> batch(batch_cells * values_);
    struct Found {
      float low, high;
      bool of_corners;
    };
    std::vector<Found> found(batch_cells);
    std::vector<const float*> kept;
    const Task part{task_.threads, {}, task_.cancel};
    for (size_t first = 0; first < candidates_.size(); first += batch_cells) {
      const size_t count = std::min(batch_cells, candidates_.size() - first);
      parallel_for(static_cast<int>(count), part, [&](int i) {
        float* const values = batch.data() + static_cast<size_t>(i) * values_;
        sample(grid_.origin_ + candidates_[first + i] * n, values);
        const auto [low, high] = bounds_of({values, values_});
        found[static_cast<size_t>(i)] = {low, high, of_corners(values, n)};
      });
      kept.clear();
      for (size_t i = 0; i < count; ++i) {
        const Found& f = found[i];
        if (f.high == 0.0f && f.low == 0.0f) continue;
        const float* const values = batch.data() + i * values_;
        uint32_t* const shared = f.of_corners ? &by_corners_[corners_of(values, n)] : nullptr;
        if (!shared || *shared == 0) kept.push_back(values);
        const uint32_t brick = shared && *shared ? *shared : static_cast<uint32_t>(total_ + kept.size());
        if (shared) *shared = brick;
        const ivec3& c = candidates_[first + i];
        set(slot_of(c), in_block(c, 0), {brick, f.high});
      }
      const std::span<float> to = extend(kept.size());
      parallel_for(static_cast<int>(kept.size()), part, [&](int i) {
        std::copy_n(kept[static_cast<size_t>(i)], values_, &to[static_cast<size_t>(i) * values_]);
      });
      task_.report(static_cast<double>(first + count) / static_cast<double>(candidates_.size()));
    }
    for (const auto& [c, other] : repeats_) {
      const int32_t node = node_of_slot_[static_cast<size_t>(slot_of(other))];
      if (node < 0) continue;
      const Cell cell = cells_[static_cast<size_t>(node) * kNodeCells + in_block(other, 0)];
      if (cell.brick) set(slot_of(c), in_block(c, 0), cell);
    }
  }

  void finish() {
    for (size_t i = 0; i < inner_levels_.size(); ++i)
      if (inner_levels_[i] == 2) number_nodes(inner_.data() + i * kNodeCells, kNodeCells);
    if (grid_.depth_ == 1) number_nodes(top_.data(), top_.size());
    grid_.top_ = SharedArray(std::move(top_));
    grid_.inner_ = SharedArray(std::move(inner_));
    grid_.inner_levels_ = SharedArray(std::move(inner_levels_));
    grid_.cells_ = SharedArray(std::move(cells_));
    grid_.bricks_ = bricks_.finish();
  }

 private:
  // While the grid is made, entries of the level 1 are slots of nodes: nodes without a cell are found at the end.

  int bits_of(int level) const { return grid_.cell_bits_ + kNodeBits * level; }

  int32_t new_inner(int level, int32_t entry = -1) {
    inner_.insert(inner_.end(), kNodeCells, entry);
    inner_levels_.push_back(static_cast<uint8_t>(level));
    check_index_size();
    return static_cast<int32_t>(inner_levels_.size() - 1);
  }
  int32_t new_slot() {
    node_of_slot_.push_back(-1);
    return static_cast<int32_t>(node_of_slot_.size() - 1);
  }

  /// The slot of a touched node; makes it, and what leads to it.
  int32_t touched_slot(const ivec3& c) {
    const auto made = [&](int level) {
      if (level > 1) return new_inner(level);
      touched_.emplace_back();
      return new_slot();
    };
    int level = grid_.depth_;
    int32_t entry = top_[grid_.in_top(c)];
    if (entry < 0) {
      entry = made(level);
      top_[grid_.in_top(c)] = entry;
    }
    while (level > 1) {
      --level;
      const size_t at = static_cast<size_t>(entry) * kNodeCells + in_block(c, level);
      entry = inner_[at];
      if (entry < 0) {
        entry = made(level);
        inner_[at] = entry;
      }
    }
    return entry;
  }
  int32_t slot_of(const ivec3& c) const {
    int32_t entry = top_[grid_.in_top(c)];
    for (int level = grid_.depth_ - 1; level > 0; --level)
      entry = inner_[static_cast<size_t>(entry) * kNodeCells + in_block(c, level)];
    return entry;
  }

  void set(int32_t slot, size_t in_node, const Cell& cell) {
    int32_t& node = node_of_slot_[static_cast<size_t>(slot)];
    if (node < 0) {
      node = static_cast<int32_t>(cells_.size() / kNodeCells);
      cells_.resize(cells_.size() + kNodeCells);
      check_index_size();
    }
    cells_[static_cast<size_t>(node) * kNodeCells + in_node] = cell;
    grid_.maximum_ = std::max(grid_.maximum_, cell.majorant);
  }

  /// What the members of a list fill of a part of space. @param lo  of the part   @param bits  of its width
  static void cut(const std::vector<ConstantPart>& list, std::span<const uint32_t> members, const ivec3& lo, int bits,
                  std::vector<ConstantPart>& part) {
    part.clear();
    const int width = 1 << bits;
    for (const uint32_t i : members)
      part.push_back({glm::max(list[i].lo - lo, ivec3(0)), glm::min(list[i].hi - lo, ivec3(width)), list[i].value});
    if (std::all_of(part.begin(), part.end(), [](const ConstantPart& c) { return c.value == 0; })) part.clear();
    normalise(part, width);
  }

  /// The key of a short list, by which equal parts of space are recognised; empty for a long one.
  static std::string key_of(const std::vector<ConstantPart>& list) {
    constexpr size_t kMost = 16;
    if (list.size() > kMost) return {};
    return {reinterpret_cast<const char*>(list.data()), list.size() * sizeof(ConstantPart)};
  }

  /// The entry of a part of space that holds a list, not all of it 0. @param entry  what it is so far
  int32_t placed(int level, int32_t entry, const std::vector<ConstantPart>& list) {
    const bool shared = entry < 0;  // no cell in it is touched: it may stand in for others
    const std::string key = shared ? key_of(list) : std::string();
    if (!key.empty())
      if (const auto known = known_[static_cast<size_t>(level)].find(key);
          known != known_[static_cast<size_t>(level)].end())
        return static_cast<int32_t>(known->second.brick);
    task_.check();
    if (shared) entry = level > 1 ? new_inner(level) : new_slot();
    if (!key.empty()) known_[static_cast<size_t>(level)][key].brick = static_cast<uint32_t>(entry);
    const int bits = bits_of(level - 1);
    const Distribution distribution(list, ivec3(kNodeWidth), bits);
    std::vector<ConstantPart> part;
    for (size_t i = 0; i < kNodeCells; ++i) {
      const ivec3 at(i >> 2 * kNodeBits, i >> kNodeBits & (kNodeWidth - 1), i & (kNodeWidth - 1));
      if (level == 1 && !shared && touched_[static_cast<size_t>(entry)][i / 64] >> (i % 64) & 1) continue;
      cut(list, distribution.of(i), at << bits, bits, part);
      if (part.empty()) continue;
      if (level == 1) {
        set(entry, i, constant_cell(part));
      } else {
        const size_t where = static_cast<size_t>(entry) * kNodeCells + i;
        const int32_t inner = placed(level - 1, inner_[where], part);
        inner_[where] = inner;
      }
    }
    return entry;
  }

  Cell constant_cell(const std::vector<ConstantPart>& list) {
    const std::string key = key_of(list);
    Cell unkept;
    Cell& cell = key.empty() ? unkept : known_[0][key];
    if (cell.brick) return cell;
    const int n = grid_.cell_size(), stored = n + 1;
    painted_.assign(values_, 0.0f);
    for (const ConstantPart& c : list)
      for (int x = c.lo.x; x <= c.hi.x; ++x)
        for (int y = c.lo.y; y <= c.hi.y; ++y)
          std::fill_n(painted_.data() + (x * stored + y) * stored + c.lo.z, c.hi.z - c.lo.z + 1, c.value);
    const auto [low, high] = bounds_of(painted_);
    if (low == 0 && high == 0) return {};
    uint32_t unshared = 0;
    uint32_t& brick = of_corners(painted_.data(), n) ? by_corners_[corners_of(painted_.data(), n)] : unshared;
    if (brick == 0) {
      brick = static_cast<uint32_t>(total_ + 1);
      std::copy(painted_.begin(), painted_.end(), extend(1).begin());
    }
    cell = {brick, high};
    return cell;
  }

  std::span<float> extend(size_t count) {
    total_ += count;
    check_size(static_cast<double>(total_ * values_) * sizeof(float), "its values");
    return bricks_.extend(count * values_);
  }

  void number_nodes(int32_t* entries, size_t count) const {
    for (size_t i = 0; i < count; ++i)
      if (entries[i] >= 0) entries[i] = node_of_slot_[static_cast<size_t>(entries[i])];
  }

  void check_index_size() const {
    check_size(static_cast<double>(inner_.size()) * sizeof(int32_t) + static_cast<double>(cells_.size()) * sizeof(Cell),
               "its index alone");
  }
  void check_size(double bytes, const char* what) const {
    if (!(bytes > 0.9 * most_)) return;
    const ivec3 voxels = ivec3(grid_.support_hi_ - grid_.support_lo_) - 1;
    throw InputError(fmt::format(
        "a grid of {} x {} x {} voxels needs more than {:.1f} GB of memory for {}; this machine has {:.1f} GB",
        voxels.x, voxels.y, voxels.z, bytes / 1e9, what, most_ / 1e9));
  }

  BrickGrid& grid_;
  const Task& task_;
  const size_t values_;  // in a brick
  const double most_ = physical_memory();
  std::vector<int32_t> top_, inner_;
  std::vector<uint8_t> inner_levels_;
  std::vector<int32_t> node_of_slot_;             // -1: it has no cell that is not empty
  std::vector<std::array<uint64_t, 8>> touched_;  // of the first slots, a bit for each cell
  std::vector<std::pair<ivec3, ivec3>> repeats_;
  std::vector<ivec3> candidates_;                             // the touched cells
  std::vector<std::unordered_map<std::string, Cell>> known_;  // entries of each level, in Cell::brick; cells on level 0
  std::vector<Cell> cells_;
  GrowingArray<float> bricks_;
  size_t total_ = 0;  // bricks
  std::unordered_map<Corners, uint32_t, HashOfCorners> by_corners_;
  std::vector<float> painted_;
};

BrickGrid BrickGrid::build(const VoxelBox& box, const Occupancy& occupied, const Sampler& sample, const Task& task,
                           MemoryFile* file) {
  BrickGrid grid;
  if (box.empty()) return grid;
  for (int a = 0; a < 3; ++a) {
    if (box.lo[a] < -(1 << 29) || box.hi[a] > (1 << 29))
      throw InputError(
          fmt::format("voxel coordinates reach {} .. {}; expected them within +-2^29", box.lo[a], box.hi[a]));
    grid.origin_[a] = floor_to_cell(box.lo[a] - 1);
    grid.cell_count_[a] = (box.hi[a] + 1 - grid.origin_[a]) / kCell + 1;
  }
  grid.support_lo_ = dvec3(box.lo - grid.origin_) - 1.0;
  grid.support_hi_ = dvec3(box.hi - grid.origin_) + 1.0;
  grid.set_depth();

  Builder builder(grid, task, file);
  for (const ivec3& block : occupied.blocks) builder.touch_block(block);
  builder.place(occupied.constants);
  builder.sample(sample);
  builder.finish();
  return grid;
}

/// Tells a builder what a grid holds that is cut into cells of another size: constant parts of space stay constant, and
/// bricks that cells share are shared again.
class BrickGrid::Builder::Recut {
 public:
  Recut(const BrickGrid& old, const BrickGrid& grid, Builder& builder)
      : old_(old), grid_(grid), builder_(builder), uses_(old.brick_count() + 1) {
    old.each_distinct_cell([&](const Cell& cell, uint64_t count) { uses_[cell.brick] += count; });
    find_constant_nodes();
  }

  void run() {
    const ivec3& n = old_.top_count_;
    for (int x = 0; x < n.x; ++x)
      for (int y = 0; y < n.y; ++y)
        for (int z = 0; z < n.z; ++z) {
          const ivec3 first = ivec3(x, y, z) << (kNodeBits * old_.depth_);
          visit(old_.depth_, old_.top_[old_.in_top(first)], first);
        }
    builder_.place(constants_);
  }

 private:
  void find_constant_nodes() {
    of_node_.resize(old_.cells_.size() / kNodeCells);
    for (size_t i = 0; i < of_node_.size(); ++i) {
      const Cell* const cells = old_.cells_.data() + i * kNodeCells;
      if (cells->brick == 0) continue;
      const auto [low, high] = bounds_of(std::span<const float>(old_.brick(*cells), old_.brick_values()));
      if (low == high && std::all_of(cells, cells + kNodeCells, [&](const Cell& c) { return c.brick == cells->brick; }))
        of_node_[i] = low;
    }
    of_inner_.resize(old_.inner_levels_.size());
    for (int level = 2; level <= old_.depth_; ++level)
      for (size_t i = 0; i < of_inner_.size(); ++i) {
        if (old_.inner_levels_[i] != level) continue;
        const int32_t* const entries = old_.inner_.data() + i * kNodeCells;
        const std::optional<float> value = value_of(level - 1, entries[0]);
        if (value &&
            std::all_of(entries, entries + kNodeCells, [&](int32_t e) { return value_of(level - 1, e) == value; }))
          of_inner_[i] = value;
      }
  }

  /// Of an entry all of whose cells hold one value.
  std::optional<float> value_of(int level, int32_t entry) const {
    if (entry < 0) return {};
    return (level == 1 ? of_node_ : of_inner_)[static_cast<size_t>(entry)];
  }

  /// @param entry  of the old grid, on a level of its tree   @param first  its lowest cell
  void visit(int level, int32_t entry, const ivec3& first) {
    if (entry < 0) return;
    if (const std::optional<float> value = value_of(level, entry)) {
      const ivec3 lo = old_.origin_ + (first << old_.cell_bits_);
      constants_.push_back({{lo, lo + (1 << (old_.cell_bits_ + kNodeBits * level))}, *value});
      return;
    }
    for (int i = 0; i < kNodeCells; ++i) {
      const ivec3 at(i >> 2 * kNodeBits, i >> kNodeBits & (kNodeWidth - 1), i & (kNodeWidth - 1));
      const ivec3 c = first + (at << (kNodeBits * (level - 1)));
      const size_t where = static_cast<size_t>(entry) * kNodeCells + static_cast<size_t>(i);
      if (level > 1)
        visit(level - 1, old_.inner_[where], c);
      else if (old_.cells_[where].brick != 0)
        touch_covered(c);
    }
  }

  /// Touches the new cells that share space with an old one.
  void touch_covered(const ivec3& old_cell) {
    const ivec3 from = (old_cell << old_.cell_bits_) >> grid_.cell_bits_,
                to = glm::min((((old_cell + 1) << old_.cell_bits_) - 1) >> grid_.cell_bits_, grid_.cell_count_ - 1);
    for (int x = from.x; x <= to.x; ++x)
      for (int y = from.y; y <= to.y; ++y)
        for (int z = from.z; z <= to.z; ++z) touch({x, y, z});
  }

  /// A new cell is sampled; if all old cells that it covers share their bricks with others, once for all new cells that
  /// cover the same bricks in the same places.
  void touch(const ivec3& c) {
    if (!builder_.touch(c)) return;
    const int bits = grid_.cell_bits_;
    const ivec3 lo = (c << bits) >> old_.cell_bits_, hi = (((c + 1) << bits) - 1) >> old_.cell_bits_;
    std::string key;
    bool shared = true;
    const auto add = [&](int32_t number) { key.append(reinterpret_cast<const char*>(&number), sizeof number); };
    for (int x = lo.x; x <= hi.x && shared; ++x)
      for (int y = lo.y; y <= hi.y && shared; ++y)
        for (int z = lo.z; z <= hi.z && shared; ++z) {
          const ivec3 covered(x, y, z);
          const uint32_t brick = glm::all(glm::lessThan(covered, old_.cell_count_)) ? old_.cell(covered).brick : 0;
          shared = brick == 0 || uses_[brick] > 1;
          add(static_cast<int32_t>(brick));
        }
    if (!shared) return builder_.ask(c);
    for (int a = 0; a < 3; ++a) add((c[a] << bits) & (old_.cell_size() - 1));
    const auto [first, fresh] = known_.try_emplace(key, c);
    fresh ? builder_.ask(c) : builder_.repeat(c, first->second);
  }

  const BrickGrid &old_, &grid_;
  Builder& builder_;
  std::vector<uint64_t> uses_;                            // cells that hold each brick
  std::vector<std::optional<float>> of_node_, of_inner_;  // value_of entries on level 1, and above
  std::vector<ConstantBox> constants_;
  std::unordered_map<std::string, ivec3> known_;  // the first new cell that covers these old bricks
};

BrickGrid BrickGrid::recut(int cell_size, const Task& task) const {
  if (empty() || cell_size == this->cell_size()) return *this;
  BrickGrid grid;
  grid.cell_bits_ = std::countr_zero(static_cast<unsigned>(cell_size));
  grid.origin_ = origin_;
  grid.support_lo_ = support_lo_;
  grid.support_hi_ = support_hi_;
  grid.cell_count_ = ((cell_count_ << cell_bits_) + (cell_size - 1)) >> grid.cell_bits_;
  grid.set_depth();

  Builder builder(grid, task, nullptr);
  Builder::Recut(*this, grid, builder).run();
  builder.sample([&](const ivec3& lo, float* values) {
    const ivec3 first = lo - origin_;
    for (int x = 0; x <= cell_size; ++x)
      for (int y = 0; y <= cell_size; ++y)
        for (int z = 0; z <= cell_size; ++z) *values++ = voxel(first + ivec3(x, y, z));
  });
  builder.finish();
  return grid;
}

}  // namespace brume

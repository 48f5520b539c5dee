#include "volume/brick_grid.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <unordered_map>

#include "base/error.h"
#include "base/parallel_for.h"

namespace brume {
namespace {

int floor_to_cell(int v) {
  return static_cast<int>(std::floor(v / static_cast<double>(BrickGrid::kCell))) * BrickGrid::kCell;
}

// The products of cell counts can pass 2^63 for hostile files, so they are taken in double.
double product(const ivec3& v) {
  return static_cast<double>(v.x) * v.y * v.z;
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

}  // namespace

BrickGrid BrickGrid::build(const VoxelBox& box, const std::vector<ivec3>& blocks, const Sampler& sample,
                           const Task& task, MemoryFile* file) {
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

  std::vector<int32_t> nodes = grid.make_nodes();
  grid.fill(std::move(nodes), grid.cells_touched_by(blocks), sample, task, file);
  return grid;
}

BrickGrid BrickGrid::recut(int cell_size, const Task& task) const {
  if (empty() || cell_size == this->cell_size()) return *this;
  BrickGrid grid;
  grid.cell_bits_ = std::countr_zero(static_cast<unsigned>(cell_size));
  grid.origin_ = origin_;
  grid.support_lo_ = support_lo_;
  grid.support_hi_ = support_hi_;
  grid.cell_count_ = ((cell_count_ << cell_bits_) + (cell_size - 1)) >> grid.cell_bits_;
  std::vector<int32_t> nodes = grid.make_nodes();

  // Every new cell that shares space with an old one that is not empty.
  std::vector<ivec3> candidates;
  const ivec3 per_new = glm::max(ivec3(1), ivec3(cell_size >> cell_bits_));
  for (int x = 0; x < grid.cell_count_.x; ++x)
    for (int y = 0; y < grid.cell_count_.y; ++y)
      for (int z = 0; z < grid.cell_count_.z; ++z) {
        const ivec3 c(x, y, z), lo = (c << grid.cell_bits_) >> cell_bits_;
        bool occupied = false;
        for (int k = 0; k < per_new.x * per_new.y * per_new.z && !occupied; ++k) {
          const ivec3 old = lo + ivec3(k / (per_new.y * per_new.z), k / per_new.z % per_new.y, k % per_new.z);
          occupied = glm::all(glm::lessThan(old, cell_count_)) && cell(old).brick != 0;
        }
        if (occupied) candidates.push_back(c);
      }
  grid.fill(
      std::move(nodes), candidates,
      [&](const ivec3& lo, float* values) {
        const ivec3 first = lo - origin_;
        for (int x = 0; x <= cell_size; ++x)
          for (int y = 0; y <= cell_size; ++y)
            for (int z = 0; z <= cell_size; ++z) *values++ = voxel(first + ivec3(x, y, z));
      },
      task, nullptr);
  return grid;
}

void BrickGrid::check_index_size(double bytes) const {
  constexpr double kLimit = 8.0 * (1 << 30);
  if (!(bytes > kLimit)) return;
  const ivec3 voxels = ivec3(support_hi_ - support_lo_) - 1;
  throw InputError(fmt::format("a grid of {} x {} x {} voxels needs {:.1f} GiB for its index alone; the limit is 8 GiB",
                               voxels.x, voxels.y, voxels.z, bytes / (1 << 30)));
}

// Wider nodes keep the top level small when a few leaves are scattered over an enormous box.
std::vector<int32_t> BrickGrid::make_nodes() {
  const auto node_count = [&](int bits) { return (cell_count_ + ((1 << bits) - 1)) / (1 << bits); };
  while (node_bits_ < 7 && product(node_count(node_bits_)) > 1 << 23) ++node_bits_;
  node_count_ = node_count(node_bits_);
  check_index_size(product(node_count_) * sizeof(int32_t));
  return std::vector<int32_t>(static_cast<size_t>(product(node_count_)), -1);
}

// Sampled in batches, so that the values exist once: bricks that turn out empty or uniform are not kept.
void BrickGrid::fill(std::vector<int32_t> nodes, const std::vector<ivec3>& candidates, const Sampler& sample,
                     const Task& task, MemoryFile* file) {
  task.check();
  std::vector<Cell> cells;
  GrowingArray<float> bricks(file);
  const size_t brick_values = this->brick_values(), batch_cells = (size_t{1} << 21) / brick_values;
  std::vector<float> batch(std::min(batch_cells, candidates.size()) * brick_values);
  std::vector<std::pair<float, float>> bounds(std::min(batch_cells, candidates.size()));
  std::vector<const float*> kept;
  std::unordered_map<uint32_t, uint32_t> uniform;  // bits of the value -> brick
  int32_t node_total = 0;
  uint32_t total = 0;
  const Task part{task.threads, {}, task.cancel};
  for (size_t first = 0; first < candidates.size(); first += batch_cells) {
    const size_t count = std::min(batch_cells, candidates.size() - first);
    parallel_for(static_cast<int>(count), part, [&](int i) {
      float* const values = batch.data() + static_cast<size_t>(i) * brick_values;
      sample(origin_ + candidates[first + i] * cell_size(), values);
      bounds[static_cast<size_t>(i)] = bounds_of({values, brick_values});
    });
    kept.clear();
    for (size_t i = 0; i < count; ++i) {
      const auto [low, high] = bounds[i];
      if (high == 0.0f && low == 0.0f) continue;
      int32_t& node = nodes[node_index(candidates[first + i])];
      if (node < 0) {
        node = node_total++;
        const size_t size = static_cast<size_t>(node_total) << (3 * node_bits_);
        check_index_size(static_cast<double>(size) * sizeof(Cell));
        cells.resize(size);
      }
      Cell& cell = cells[(static_cast<size_t>(node) << (3 * node_bits_)) + in_node(candidates[first + i])];
      cell.majorant = high;
      maximum_ = std::max(maximum_, high);
      uint32_t* shared = low == high ? &uniform[std::bit_cast<uint32_t>(low)] : nullptr;
      if (shared && *shared) {
        cell.brick = *shared;
        continue;
      }
      kept.push_back(batch.data() + i * brick_values);
      cell.brick = ++total;
      if (shared) *shared = cell.brick;
    }
    const std::span<float> to = bricks.extend(kept.size() * brick_values);
    parallel_for(static_cast<int>(kept.size()), part, [&](int i) {
      std::copy_n(kept[static_cast<size_t>(i)], brick_values, &to[static_cast<size_t>(i) * brick_values]);
    });
    task.report(static_cast<double>(first + count) / static_cast<double>(candidates.size()));
  }
  nodes_ = SharedArray(std::move(nodes));
  cells_ = SharedArray(std::move(cells));
  bricks_ = bricks.finish();
}

bool BrickGrid::consistent() const {
  if (cell_bits_ < 1 || cell_bits_ > 5 || node_bits_ < 3 || node_bits_ > 7) return false;
  const int node_last = node_cells() - 1;
  constexpr int64_t kMostCells = 1 << 29;
  for (int a = 0; a < 3; ++a) {
    const int64_t count = cell_count_[a];
    if (count < 0 || count > kMostCells || node_count_[a] != (count + node_last) >> node_bits_) return false;
    if (!(support_lo_[a] >= 0 && support_hi_[a] <= static_cast<double>(count) * cell_size())) return false;
  }
  if (product(node_count_) != static_cast<double>(nodes_.size())) return false;
  const size_t in_block = size_t{1} << (3 * node_bits_);
  if (cells_.size() % in_block != 0 || bricks_.size() % brick_values() != 0) return false;
  const auto blocks = static_cast<int64_t>(cells_.size() / in_block);
  const size_t count = brick_count();
  return std::all_of(nodes_.begin(), nodes_.end(), [&](int32_t node) { return node >= -1 && node < blocks; }) &&
         std::all_of(cells_.begin(), cells_.end(),
                     [&](const Cell& cell) { return cell.brick <= count && cell.majorant <= maximum_; });
}

// A block lends its lowest faces to the aprons of the seven cells below it.
std::vector<ivec3> BrickGrid::cells_touched_by(const std::vector<ivec3>& blocks) const {
  std::vector<ivec3> cells;
  cells.reserve(blocks.size() * 2);
  std::vector<uint8_t> seen;  // one bit per cell of a node, made when the node is first touched
  std::vector<int32_t> node_number(static_cast<size_t>(product(node_count_)), -1);
  int32_t node_total = 0;
  const size_t node_bytes = ((size_t{1} << (3 * node_bits_)) + 7) / 8;
  for (const ivec3& block : blocks)
    for (int corner = 0; corner < 8; ++corner) {
      const ivec3 c = ((block - origin_) >> cell_bits_) - ivec3(corner & 1, corner >> 1 & 1, corner >> 2);
      if (glm::any(glm::lessThan(c, ivec3(0))) || glm::any(glm::greaterThanEqual(c, cell_count_))) continue;
      int32_t& node = node_number[node_index(c)];
      if (node < 0) {
        node = node_total++;
        seen.resize(seen.size() + node_bytes);
      }
      const size_t bit = in_node(c);
      uint8_t& byte = seen[static_cast<size_t>(node) * node_bytes + bit / 8];
      const auto mask = static_cast<uint8_t>(1u << (bit % 8));
      if (byte & mask) continue;
      byte |= mask;
      cells.push_back(c);
    }
  return cells;
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

MajorantWalk::MajorantWalk(const BrickGrid& grid, const Ray& ray, double t_min, double t_max)
    : grid_(&grid), ray_(ray), t_(t_min), end_(t_max) {
  if (grid.empty()) {
    end_ = -1;
    t_ = 0;
    return;
  }
  const double across = 1e-20 * max_component(glm::abs(ray.d));
  for (int a = 0; a < 3; ++a) {
    const bool parallel = std::abs(ray.d[a]) <= across;
    inverse_[a] = parallel ? 0.0 : 1.0 / ray.d[a];
    step_[a] = parallel ? 0 : ray.d[a] > 0 ? 1 : -1;
    const double lo = grid.support_lo()[a], hi = grid.support_hi()[a];
    if (parallel) {
      if (ray.o[a] < lo || ray.o[a] > hi) {
        end_ = -1;
        t_ = 0;
      }
    } else {
      const double ta = (lo - ray.o[a]) * inverse_[a], tb = (hi - ray.o[a]) * inverse_[a];
      t_ = std::max(t_, std::min(ta, tb));
      end_ = std::min(end_, std::max(ta, tb));
    }
  }
  if (!(t_ < end_)) return;
  const dvec3 p = ray_.at(t_);
  for (int a = 0; a < 3; ++a) {
    // A start on a face belongs to the cell the ray is about to enter.
    const double q = p[a] / grid_->cell_size(), f = std::floor(q);
    const int c = static_cast<int>(f) - (q == f && step_[a] < 0);
    cell_[a] = std::clamp(c, 0, grid_->cells()[a] - 1);
  }
}

bool MajorantWalk::next(Segment& segment) {
  while (t_ < end_) {
    // Either one cell is crossed or, where it is empty, the whole node.
    const bool skip = grid_->node_empty(cell_);
    const int width = skip ? grid_->node_cells() : 1;
    ivec3 first;
    double exit = end_;
    int exit_axis = -1;
    for (int a = 0; a < 3; ++a) {
      first[a] = cell_[a] & ~(width - 1);
      if (step_[a] == 0) continue;
      const double t = plane_time(a, step_[a] > 0 ? first[a] + width : first[a]);
      if (t < exit) {
        exit = t;
        exit_axis = a;
      }  // equal times: the lowest axis first
    }
    const double start = t_;
    const ivec3 here = cell_;
    const BrickGrid::Cell* cell = skip ? nullptr : &grid_->cell(here);
    if (exit_axis < 0) {
      t_ = end_;
    } else {
      t_ = std::max(t_, exit);
      if (skip) {
        const dvec3 p = ray_.at(t_);
        for (int a = 0; a < 3; ++a)
          if (step_[a] != 0) {
            // Within the node, and never against the direction: rounding cannot make the walk go back.
            const int c =
                std::clamp(static_cast<int>(std::floor(p[a] / grid_->cell_size())), first[a], first[a] + width - 1);
            cell_[a] = step_[a] > 0 ? std::max(c, cell_[a]) : std::min(c, cell_[a]);
          }
        cell_[exit_axis] = step_[exit_axis] > 0 ? first[exit_axis] + width : first[exit_axis] - 1;
      } else {
        cell_[exit_axis] += step_[exit_axis];
      }
      if (cell_[exit_axis] < 0 || cell_[exit_axis] >= grid_->cells()[exit_axis]) end_ = t_;
      for (int a = 0; a < 3; ++a) cell_[a] = std::clamp(cell_[a], 0, grid_->cells()[a] - 1);
    }
    if (cell && cell->brick != 0 && cell->majorant > 0 && t_ > start) {
      segment = {start, t_, cell->majorant, cell, here};
      return true;
    }
  }
  return false;
}

}  // namespace brume

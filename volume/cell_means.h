#pragma once
#include <array>
#include <functional>
#include <optional>
#include <tuple>
#include <unordered_map>
#include <vector>

#include "base/progress.h"
#include "base/rng.h"
#include "volume/brick_grid.h"

namespace brume {

/// Calls do_cell for a cell and the 26 around it.
template <class DoCell>
void each_around(const ivec3& c, const DoCell& do_cell) {
  for (int k = 0; k < 27; ++k) do_cell(c + ivec3(k / 9, k / 3 % 3, k % 3) - 1);
}

/// By x, then y, then z.
inline bool by_coordinates(const ivec3& a, const ivec3& b) {
  return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z);
}

/// Means of a vector field over whole cells, which fill the cells where nothing of it is known.
class CellMeans {
 public:
  /// Means of the cells asked for and of those around them: what `known` says, or else, from those that it knows
  /// outwards, layer by layer, the mean of the neighbours by the inverse squares of their distances.
  /// @throws Interrupted
  void flood(const std::vector<ivec3>& cells, const std::function<std::optional<vec3>(const ivec3&)>& known,
             const Task& task);

  /// One component, in a cell.
  class Around {
   public:
    Around(const CellMeans& means, const ivec3& c, int axis);
    /// At a voxel of the cell, linear between the middles of cells.
    float operator()(const ivec3& v) const;

   private:
    ivec3 first_;
    std::array<std::optional<float>, 27> means_;
  };

 private:
  struct HashOfCell {
    size_t operator()(const ivec3& c) const {
      return hash_combine(hash_combine(static_cast<uint32_t>(c.x), static_cast<uint32_t>(c.y)),
                          static_cast<uint32_t>(c.z));
    }
  };
  std::unordered_map<ivec3, std::optional<vec3>, HashOfCell> means_;
};

}  // namespace brume

#include <algorithm>
#include <cmath>

#include "volume/brick_grid.h"

namespace brume {

MajorantWalk::MajorantWalk(const BrickGrid& grid, const Ray& ray, double t_min, double t_max, double factor)
    : grid_(&grid), ray_(ray), t_(t_min), end_(t_max), factor_(static_cast<float>(factor)) {
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
    const int empty_width = grid_->empty_width(cell_);
    const bool skip = empty_width > 0;
    const int width = skip ? empty_width : 1;
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
      segment = {start, t_, cell->majorant * factor_, cell, here};
      return true;
    }
  }
  return false;
}

}  // namespace brume

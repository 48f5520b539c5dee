#pragma once
#include <array>
#include <functional>
#include <vector>

#include "base/progress.h"
#include "base/vec.h"
#include "filters/kernels/box.h"
#include "image/frame_space.h"
#include "image/layers.h"

namespace brume {

/// Three planes that a filter owns, and a view of them.
using Rgb = std::array<Plane, 3>;

inline RgbPlanes view(const Rgb& planes) {
  return {&planes[0], &planes[1], &planes[2]};
}

/// Views of planes.
inline std::vector<const Plane*> pointers(const std::vector<Plane>& planes) {
  std::vector<const Plane*> result;
  for (const Plane& p : planes) result.push_back(&p);
  return result;
}

/// Rows a task is handed at a time, so that threads share the work evenly and rows stay in cache.
inline constexpr int kRowsPerTask = 8;

/// Calls row(y) for every row, on the task's threads.
void for_each_row(int height, const Task& task, const std::function<void(int)>& row);

/// Calls visit(x, y) for every pixel, on the task's threads.
template <class Visit>
void for_each_pixel(int width, int height, const Task& task, const Visit& visit) {
  for_each_row(height, task, [&](int y) {
    for (int x = 0; x < width; ++x) visit(x, y);
  });
}

/// A plane from a function of the pixel.
template <class Function>
Plane make_plane(int width, int height, const Task& task, const Function& value) {
  Plane out = Plane::unset(width, height);
  for_each_row(height, task, [&](int y) {
    float* row = out.row(y);
    for (int x = 0; x < width; ++x) row[x] = value(x, y);
  });
  return out;
}

inline vec3 color_at(const RgbPlanes& rgb, int x, int y) {
  return {(*rgb[0])(x, y), (*rgb[1])(x, y), (*rgb[2])(x, y)};
}
Plane luminance_of(const RgbPlanes& rgb, const FrameSpace& space, const Task& task);

double sum_of(const Plane& plane);

/// `factor` times the sums of 2 x 2 pixels; odd sizes repeat their last row or column.
Plane halved(const Plane& in, float factor, const Task& task);

/// Mean over the square of half width `radius`, clipped to the image.
Plane box_mean(const Plane& in, int radius, const Task& task);

/// Gaussian of standard deviation `sigma` [px], cut off at 3 sigma, clipped and renormalised.
Plane gaussian_blur(const Plane& in, double sigma, const Task& task);

/// Median of the 3 x 3 pixels around each, edges repeated.
Plane median3x3(const Plane& in, const Task& task);

/// Largest and smallest value in the square of half width `radius`.
Plane window_maximum(const Plane& in, int radius, const Task& task);
Plane window_minimum(const Plane& in, int radius, const Task& task);

/// Whether any value in the box is above 0.
bool any_above_0(const Plane& plane, const Box& box);
inline bool any_above_0(const Plane& plane) {
  return any_above_0(plane, {0, 0, plane.width(), plane.height()});
}

Plane crop(const Plane& in, const Box& box);

}  // namespace brume

#include "image/cube_map.h"

#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "base/parallel_for.h"

namespace brume {
namespace {

/// A place in the faces that lie below each other, in pixels; the first one's middle is (0, 0).
dvec2 place_of(const dvec3& d, int size) {
  const dvec3 a = glm::abs(d);
  const int axis = a.x >= a.y && a.x >= a.z ? 0 : a.y >= a.z ? 1 : 2;
  const dvec3 p = d / a[axis];
  const bool back = d[axis] < 0;
  dvec2 place;  // in the face, from its top left corner on, in [-1, 1]
  switch (axis) {
    case 0:
      place = {back ? -p.z : p.z, -p.y};
      break;
    case 1:
      place = {p.x, back ? p.z : -p.z};
      break;
    default:
      place = {back ? p.x : -p.x, -p.y};
  }
  const dvec2 in_face = glm::clamp(0.5 * (place + 1.0), 0.0, 1.0) * static_cast<double>(size - 1);
  return {in_face.x, in_face.y + (2 * axis + (back ? 1 : 0)) * size};
}

/// The colour at a place in the faces, bilinear between the pixels of one face.
dvec3 color_at_place(const RgbPlanes& faces, const dvec2& place, int size) {
  const ivec2 lo(place), hi = glm::min(lo + 1, ivec2(size - 1, lo.y / size * size + size - 1));
  const dvec2 f = place - dvec2(lo);
  dvec3 color;
  for (int c = 0; c < 3; ++c) {
    const auto texel = [&](int x, int y) { return static_cast<double>((*faces[static_cast<size_t>(c)])(x, y)); };
    color[c] = std::lerp(std::lerp(texel(lo.x, lo.y), texel(hi.x, lo.y), f.x),
                         std::lerp(texel(lo.x, hi.y), texel(hi.x, hi.y), f.x), f.y);
  }
  return color;
}

}  // namespace

bool is_cube_map(const Layers& picture) {
  return picture.text("envmap") == "cube";
}

Layers lat_long_of_cube(const Layers& cube, const std::string& name, const Task& task) {
  const int size = cube.width();
  if (cube.height() != 6 * size)
    throw InputError(fmt::format(
        "{}: its header says envmap = cube, and it has {} x {} pixels; expected six square faces below each other, {} x {}",
        name, cube.width(), cube.height(), size, 6 * size));
  constexpr int kSamples = 4;  // along each side of a pixel
  Layers picture(4 * size, 2 * size);
  const RgbPlanes from = cube.rgb(layer::beauty);
  const auto to = picture.add_rgb(layer::beauty);
  std::vector<dvec2> longitudes(static_cast<size_t>(picture.width()) * kSamples);  // their sines and cosines
  for (size_t i = 0; i < longitudes.size(); ++i) {
    const double angle = kPi * (1 - 2 * (static_cast<double>(i) + 0.5) / static_cast<double>(longitudes.size()));
    longitudes[i] = {std::sin(angle), std::cos(angle)};
  }
  parallel_for(picture.height(), {task.threads, {}, task.cancel}, [&](int y) {
    for (int x = 0; x < picture.width(); ++x) {
      dvec3 sum(0);
      for (int j = 0; j < kSamples; ++j) {
        const double latitude = kPi * (0.5 - (y + (j + 0.5) / kSamples) / picture.height());
        const double up = std::sin(latitude), along = std::cos(latitude);
        for (int i = 0; i < kSamples; ++i) {
          const dvec2& longitude = longitudes[static_cast<size_t>(x) * kSamples + static_cast<size_t>(i)];
          sum += color_at_place(from, place_of({longitude.x * along, up, longitude.y * along}, size), size);
        }
      }
      for (size_t c = 0; c < 3; ++c)
        (*to[c])(x, y) = static_cast<float>(sum[static_cast<int>(c)] / (kSamples * kSamples));
    }
  });
  return picture;
}

}  // namespace brume

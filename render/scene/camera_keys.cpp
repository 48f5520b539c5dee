#include "render/scene/camera_keys.h"

#include <algorithm>

namespace brume {
namespace {

using Keys = std::vector<std::vector<double>>;

/// Three columns of the keys at a time, from `column` on.
dvec3 value_at(const Keys& keys, double time, size_t column) {
  const auto value = [&](size_t i) { return dvec3(keys[i][column], keys[i][column + 1], keys[i][column + 2]); };
  const size_t last = keys.size() - 1;
  if (time <= keys[0][0]) return value(0);
  if (time >= keys[last][0]) return value(last);
  size_t i = 0;
  while (keys[i + 1][0] <= time) ++i;
  const auto slope = [&](size_t k) {
    const size_t before = k > 0 ? k - 1 : 0, after = std::min(k + 1, last);
    return (value(after) - value(before)) / (keys[after][0] - keys[before][0]);
  };
  const double length = keys[i + 1][0] - keys[i][0], t = (time - keys[i][0]) / length, s = 1 - t;
  return s * s * (1 + 2 * t) * value(i) + t * t * (3 - 2 * t) * value(i + 1) +
         length * s * t * (s * slope(i) - t * slope(i + 1));
}

}  // namespace

void take_camera_of_frame(CameraSettings& camera, int frame) {
  if (camera.keys.empty()) return;
  const Keys keys = std::move(camera.keys);
  camera.keys.clear();
  const double open = frame + camera.shutter.x, close = frame + camera.shutter.y;
  camera.position = value_at(keys, open, 1);
  camera.look_at = value_at(keys, open, 4);
  if (close <= open) return;
  const dvec3 position = value_at(keys, close, 1), look_at = value_at(keys, close, 4);
  // A camera at rest is one that does not move: what is known of its rays saves time.
  if (position == camera.position && look_at == camera.look_at) return;
  camera.position_end = {position.x, position.y, position.z};
  camera.look_at_end = {look_at.x, look_at.y, look_at.z};
}

}  // namespace brume

#pragma once
#include <array>
#include <vector>

#include "render/world/camera.h"

namespace brume {

/// What the rays of a camera's film pass, a little more at its edges. Of a camera that moves or has a lens: everything.
class ViewFrustum {
 public:
  explicit ViewFrustum(const Camera& camera) {
    if (camera.moves() || camera.has_lens()) return;
    constexpr double kMargin = 2;  // pixels
    const dvec2 lo(-kMargin), hi = dvec2(camera.film_size()) + kMargin;
    std::array<Ray, 4> corner;
    for (size_t k = 0; k < 4; ++k) corner[k] = camera.ray({k == 1 || k == 2 ? hi.x : lo.x, k < 2 ? lo.y : hi.y});
    const Ray middle = camera.ray(0.5 * (lo + hi));
    for (size_t k = 0; k < 4; ++k) {
      const Ray &one = corner[k], &next = corner[(k + 1) % 4];
      const dvec3 across = glm::normalize(glm::cross(one.d, next.at(1) - one.o));
      sides_.push_back({one.o, glm::dot(across, middle.at(1) - one.o) > 0 ? across : -across});
    }
    sides_.push_back(middle);
  }
  /// Whether it comes as close to a point. @param distance  [world units]
  bool near(const dvec3& p, double distance) const {
    for (const Ray& side : sides_)
      if (glm::dot(side.d, p - side.o) < -distance) return false;
    return true;
  }

 private:
  std::vector<Ray> sides_;  // points of the planes around it, and unit vectors across them, inwards
};

}  // namespace brume

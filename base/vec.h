#pragma once
#ifndef GLM_FORCE_CTOR_INIT
#define GLM_FORCE_CTOR_INIT
#endif
#include <glm/glm.hpp>

namespace brume {

using vec2 = glm::vec2;
using vec3 = glm::vec3;
using ivec2 = glm::ivec2;
using ivec3 = glm::ivec3;
using dvec2 = glm::dvec2;
using dvec3 = glm::dvec3;
using dmat3 = glm::dmat3;
using dmat4 = glm::dmat4;

inline double max_component(const dvec3& v) {
  return glm::max(v.x, glm::max(v.y, v.z));
}
inline float max_component(const vec3& v) {
  return glm::max(v.x, glm::max(v.y, v.z));
}

/// Rec. 709 luminance of linear RGB.
template <class V>
auto luminance(const V& rgb) -> decltype(rgb.x) {
  using T = decltype(rgb.x);
  return T(0.2126729) * rgb.x + T(0.7151522) * rgb.y + T(0.0721750) * rgb.z;
}

/// Orthonormal frame around a unit vector, continuous everywhere but at z = -1.
/// Source: Duff et al. 2017, Building an Orthonormal Basis, Revisited.
struct Frame {
  dvec3 x, y, z;
  explicit Frame(const dvec3& n) : z(n) {
    const double sign = n.z < 0 ? -1.0 : 1.0;
    const double a = -1.0 / (sign + n.z), b = n.x * n.y * a;
    x = {1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x};
    y = {b, sign + n.y * n.y * a, -n.y};
  }
  dvec3 to_world(const dvec3& v) const { return x * v.x + y * v.y + z * v.z; }
};

/// o + t d. The parameter t is a distance where d has unit length in the space of the ray.
struct Ray {
  dvec3 o, d;
  dvec3 at(double t) const { return o + t * d; }
};

}  // namespace brume

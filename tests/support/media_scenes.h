#pragma once
#include "render/scene/scene.h"

namespace brume::test {

inline VolumeSettings solid(const char* shape, double sigma_t, double albedo) {
  VolumeSettings v;
  v.shape = shape;
  v.lo = dvec3(-1);
  v.hi = dvec3(1);
  v.sigma_t = dvec3(sigma_t);
  v.albedo = dvec3(albedo);
  return v;
}

/// Looks along +y through the origin with a narrow view.
inline Scene through_the_middle(int size = 8) {
  Scene s;
  s.film.width = s.film.height = size;
  s.camera.position = dvec3(0, -20, 0);
  s.camera.fov = 0.02;
  return s;
}

/// Looks at a ball of radius 1.2 around the origin.
inline Scene overview(int size = 24) {
  Scene s = through_the_middle(size);
  s.camera.position = dvec3(2, -9, 3);
  s.camera.fov = 15;
  return s;
}

inline LightSettings sun(const dvec3& direction, double irradiance, double diameter = 0) {
  LightSettings l;
  l.type = "sun";
  l.direction = direction;
  l.irradiance = dvec3(irradiance);
  l.angular_diameter = diameter;
  return l;
}

}  // namespace brume::test

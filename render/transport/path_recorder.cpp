#include "render/transport/path_recorder.h"

#include <algorithm>
#include <cmath>

#include "volume/tracking.h"

namespace brume {

void PathRecorder::collide(const SlotList& hits) {
  for (const size_t i : hits) {
    PathRecord* const r = w_.record[i];
    if (!r || p_.events[i] > 1) continue;
    const bool first = p_.events[i] == 0;
    double tau = 0;
    for (const Medium& m : media_at(c_, w_.time[i]))
      m.each_met(w_.ray[i], w_.end[i],
                 [&](const Medium& one, size_t) { tau += optical_depth(one, one.to_local(w_.ray[i]), w_.end[i]); });
    (first ? r->flight_1 : r->flight_2) = static_cast<float>(-std::expm1(-tau));
    (first ? r->position_1 : r->position_2) = vec3(w_.ray[i].at(w_.end[i]) + c_.world_shift);
    r->flags += first ? 1.0f : w_.past[i].first_on_surface ? 0.0f : 2.0f;
  }
}

void PathRecorder::turn(const SlotList& alive) {
  for (const size_t i : alive) {
    PathRecord* const r = w_.record[i];
    if (!r || p_.events[i] > 2) continue;
    (p_.events[i] == 1 ? r->direction_1 : r->direction_2) = p_.d[i];
  }
}

void PathRecorder::sample_lights(const SlotList& shadows) {
  for (const size_t i : shadows) {
    unoccluded_[i] = luminance(dvec3(p_.contribution[i]));
  }
}

void PathRecorder::receive(const SlotList& shadows) {
  for (const size_t i : shadows) {
    PathRecord* const r = w_.record[i];
    if (!r || p_.events[i] != 1) continue;
    dvec3 left = dvec3(p_.contribution[i]) * static_cast<double>(p_.transmittance[i]);
    if (c_.plan.chromatic) left *= dvec3(p_.shadow_colour[i]);
    // Behind straight shadows a light sample counts for more than itself.
    r->light_transmittance_1 = static_cast<float>(std::min(1.0, luminance(left) / unoccluded_[i]));
  }
}

void finish_record(PathRecord& r, const PathSample& s, bool surface_first) {
  r.surface_gradient = vec3(s.gradient);
  r.gradient_1 = vec3(s.gradient_first_scatter);
  r.albedo = vec3(s.albedo);
  r.density_1 = static_cast<float>(s.scatter_density);
  r.normal = vec3(s.normal);
  if (surface_first) {
    r.flags += 4;
    r.position_1 = vec3(s.position);
  }
  if (s.coverage > 0) r.flags += 8;
  r.unscattered = vec3(s.background + s.emission + s.surface);
  r.single = vec3(s.single);
  r.indirect = vec3(s.indirect);
}

}  // namespace brume

#pragma once
#include <string>

#include "render/lights.h"
#include "render/media.h"
#include "render/path_sample.h"

namespace brume {

class Camera;
class Surfaces;

/// What exists in this render, decided once: the inner loop is instantiated for it and models nothing else.
struct Plan {
  enum class Media { kNone, kOneGrey, kManyGrey, kChromatic } media = Media::kNone;
  bool moving_media = false;    ///< some change over the shutter
  bool light_sampling = false;  ///< next-event estimation towards at least one light
  bool finite_lights = false;   ///< analytic lights that rays can end on
  bool near_lights = false;     ///< small lights inside homogeneous media, sampled along flights too
  bool surfaces = false;        ///< triangle meshes
  bool emission = false;        ///< a medium that glows
  bool lens = false, shutter = false;
  bool forced_first = false;  ///< camera rays scatter wherever there is something to scatter at; in lanes only
  bool lanes = false;         ///< the paths run side by side in SIMD lanes (render/wavefront.h)

  // Recorded beyond what the path computes anyway.
  bool medium_surface = false;  ///< looked for once per path
  bool first_event = false;     ///< where and at what the path scatters first
  bool first_scatter_gradient = false;
  bool weighted_gradient = false;  ///< marched once per path
  bool optical_depth = false;      ///< marched once per path
  bool flash = false;

  LayerRequest layers;

  bool marched() const { return weighted_gradient || optical_depth; }
  bool has_media() const { return media != Media::kNone; }
};

Plan make_plan(const SceneMedia& media, const Lights& lights, const Surfaces* surfaces, const Camera& camera,
               const LayerRequest& layers);

/// The plan and what each part costs in memory, for a person.
std::string explain(const Plan& plan, const Scene& scene, const SceneMedia& media, const Lights& lights,
                    const Surfaces* surfaces);

}  // namespace brume

#pragma once
#include <string>

#include "image/layers.h"
#include "render/lights.h"
#include "render/scene.h"

namespace brume {

/// Which layers a render records, and whether each with its variance and half images.
struct LayerRequest {
  bool direct = true, indirect = true, gradient = true, coverage = true, transmittance = true;
  bool statistics = true;

  /// Names as in the EXR: direct, indirect, gradient, coverage, transmittance; the beauty and the counts always come.
  /// @throws InputError for a name brume does not record
  static LayerRequest of(const std::vector<std::string>& names, bool statistics);
};

/// What exists in this render, decided once: the inner loop is instantiated for it and models nothing else.
struct Plan {
  bool medium = false;          ///< a volume with any density in it
  bool light_sampling = false;  ///< next-event estimation towards at least one light
  bool finite_lights = false;   ///< sphere lights, which rays can end on
  bool surface = false;         ///< the medium's surface is looked for, once per path
  LayerRequest layers;

  /// Memory of the recorded layers.
  double film_bytes(int width, int height) const;

  /// The plan and what each part costs in memory, for a person.
  std::string explain(const Scene& scene, const Lights& lights, const Medium* medium) const;
};

Plan make_plan(const Lights& lights, const Medium* medium, const LayerRequest& layers);

}  // namespace brume

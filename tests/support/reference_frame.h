#pragma once
#include <string>

#include "render/session/renderer.h"

namespace brume::test {

/// A render held to the reference tracer (tests/support/reference_tracer.h).
struct Agreement {
  double worst = 0;       ///< largest difference of a picture's or a block's mean [standard errors of it]
  std::string where;      ///< layer, channel and block of it
  int compared = 0;       ///< means
  double detectable = 0;  ///< smallest bias of the beauty's mean over the picture that would be found, relative to it
  std::string text() const;
};

/// Standard errors at which a difference counts as one. Light of paths is skewed, so that large ones are more frequent
/// than a normal distribution has them.
inline constexpr double kSigmas = 5.5;

/// Renders a scene, traces it by the definition, and compares means of all layers of light over the picture and over
/// blocks of 8 x 8 pixels. @param spp  of either
Agreement agreement(const Scene& scene, int spp, int64_t seed);

}  // namespace brume::test

#pragma once
#include "render/transport/integrator.h"

namespace brume::test {

/// The definition of the estimator: follows one path through any scene, in double precision, one event after another.
/// What render/ computes many paths at a time, with tight majorants, forced collisions and points drawn near small
/// lights, has the expectations of this page (docs/methods.md has the formulas).
///
/// Slow: one majorant bounds all media wherever they are.
PathSample reference_path(const PathContext& scene, const PathRequest& request);

}  // namespace brume::test

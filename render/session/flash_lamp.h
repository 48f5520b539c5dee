#pragma once
#include "render/transport/integrator.h"
#include "render/world/camera.h"

namespace brume {

/// The lamp of the virtual flash image. Its strength replaces the indirect light that the image leaves out: estimated
/// once, from a coarse grid of pixels with a seed of their own, so that it is a constant of the scene.
/// @param context  of a plan with media; its own lamp is not looked at
FlashLamp calibrated_flash_lamp(const PathContext& context, const Scene& scene, const Camera& camera,
                                const Medium::Sphere& bounds);

}  // namespace brume

#pragma once
#include "render/scene/scene.h"

namespace brume {

/// Puts the camera where its keys have it at a frame: position and look_at as the shutter opens, position_end and
/// look_at_end as it closes, where it opens at all. The keys are gone then; a camera without is left as it is.
///
/// Cubic Hermite curves through the keys, each tangent the slope from the key before to the key after: Catmull-Rom
/// splines where keys lie evenly. Straight between two keys, at rest before the first and after the last.
/// @param camera  keys of seven numbers, rising in the first, as the parser has checked
void take_camera_of_frame(CameraSettings& camera, int frame);

}  // namespace brume

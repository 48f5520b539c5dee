#pragma once
#include "render/scene/scene.h"

namespace brume {

/// Has places with a time offset show frames of their own of their volume's sequence: places of one frame stand in a
/// volume of their own, behind the others, with the names of the first. Then leaves out volumes that show nothing.
/// @throws InputError: offsets of a volume without a table time; frames that its table time refuses, or too many
void set_instances_in_time(Scene& scene);

}  // namespace brume

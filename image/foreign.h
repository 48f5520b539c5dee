#pragma once
#include <string>

#include "image/layers.h"

namespace brume {

/// Gives the frame of another renderer brume's layer names, where it is recognised:
///
/// - Blender Cycles multilayer ("LAYER.PASS.C", the layer's name being anything): Combined becomes the beauty, the sum
/// of
///   VolumeInd becomes `indirect`, and beauty - indirect becomes `direct`.
///
/// Channels that are brume's already, and all others, are left as they are.
/// @return one line saying what was recognised; empty when nothing was
std::string adopt_foreign_layers(Layers& layers);

}  // namespace brume

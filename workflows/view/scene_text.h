#pragma once
#include <vector>

#include "image/layers.h"
#include "workflows/view/messages.h"
#include "workflows/view/viewed_scene.h"

namespace brume {

/// The guides in a frame that can be looked at: those of one or three channels.
std::vector<ViewSceneText::Layer> guide_layers_in(const Layers& frame);

/// What a page needs to know of the scene that is shown; without what the look decides (id, command, reloaded).
/// @param guides  that a frame of it holds, as far as known
ViewSceneText scene_text_of(ViewedScene& scene, const std::vector<ViewSceneText::Layer>& guides);

}  // namespace brume

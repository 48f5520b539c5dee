#pragma once
// Scenes, and frames rendered from them.

#include "render/frame/render_job.h"
#include "render/frame/render_state.h"
#include "render/frame/renderer.h"
#include "render/scene/scene.h"
#include "render/scene/scene_io.h"
#include "render/scene/scene_reference.h"
#include "render/world/volume_scene.h"

#pragma once
// Scenes, and frames rendered from them.

#include "render/scene/scene.h"
#include "render/scene/scene_io.h"
#include "render/scene/scene_reference.h"
#include "render/session/render_job.h"
#include "render/session/render_state.h"
#include "render/session/renderer.h"
#include "render/world/volume_scene.h"

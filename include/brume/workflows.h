#pragma once
// What the program does with all of these: load a scene, clean while rendering, compare.

#include "workflows/clean.h"
#include "workflows/filters_json.h"
#include "workflows/frame.h"
#include "workflows/scene.h"
#include "workflows/version.h"

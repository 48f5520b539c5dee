#pragma once
// What the program does with all of these: load a scene, clean while rendering, compare.

#include "work/clean.h"
#include "work/filters_json.h"
#include "work/frame.h"
#include "work/scene.h"
#include "work/version.h"

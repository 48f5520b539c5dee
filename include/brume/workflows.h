#pragma once
// What the program does with all of these: render a frame and clean it, denoise a frame or a sequence, compare.

#include "workflows/clean.h"
#include "workflows/comparison.h"
#include "workflows/denoise_frame.h"
#include "workflows/filters_json.h"
#include "workflows/frame.h"
#include "workflows/render_frame.h"
#include "workflows/scene.h"
#include "workflows/version.h"

#pragma once
// Frames of named layers, and their files.

#include "image/color.h"
#include "image/exr_copy.h"
#include "image/exr_io.h"
#include "image/foreign.h"
#include "image/hdr_io.h"
#include "image/layers.h"
#include "image/pfm_io.h"
#include "image/picture_io.h"
#include "image/plane.h"
#include "image/sample_records.h"

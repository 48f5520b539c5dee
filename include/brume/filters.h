#pragma once
// Filters, which of them to take, and cleaning a frame.

#include "filters/api/filter.h"
#include "filters/api/recommend.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/inputs/guide_layers.h"
#include "filters/run/apply.h"
#include "filters/run/clean_picture.h"

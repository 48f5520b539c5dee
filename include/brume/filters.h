#pragma once
// Filters, which of them to take, and cleaning a frame.

#include "filters/apply.h"
#include "filters/clean_picture.h"
#include "filters/filter.h"
#include "filters/guide_layers.h"
#include "filters/recommend.h"
#include "filters/registry.h"
#include "filters/requirements.h"

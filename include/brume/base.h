#pragma once
// Errors, tasks with progress and cancellation, vectors.

#include "base/error.h"
#include "base/parallel_for.h"
#include "base/progress.h"
#include "base/rng.h"
#include "base/text.h"
#include "base/vec.h"

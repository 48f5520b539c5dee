#pragma once
// How far a picture is from a reference.

#include "evaluate/metric.h"
#include "evaluate/protocol.h"
#include "evaluate/report.h"
#include "evaluate/tuning.h"

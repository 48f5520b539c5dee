#pragma once
// How far a picture is from a reference.

#include "evaluate/metrics/metric.h"
#include "evaluate/protocol/command_filter.h"
#include "evaluate/protocol/external_filter.h"
#include "evaluate/protocol/protocol.h"
#include "evaluate/protocol/tuning.h"
#include "evaluate/report/report.h"

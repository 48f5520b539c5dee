#pragma once
// OpenVDB files and media.

#include "volume/medium.h"
#include "volume/vdb_io.h"

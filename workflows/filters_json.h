#pragma once
#include <string>
#include <vector>

#include "filters/api/filter.h"

namespace brume {

/// The declarations of filters as one JSON object: `brume filters --json`.
std::string filters_json(const std::vector<const FilterEntry*>& filters);

}  // namespace brume

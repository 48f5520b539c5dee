#pragma once
#include "filters/api/filter.h"

namespace brume {

/// Every filter, by name in alphabetical order.
const std::vector<const FilterEntry*>& all_filters();

/// The same, what serves best first.
std::vector<const FilterEntry*> filters_by_merit();

/// @throws InputError with the nearest name and the list
const FilterEntry& find_filter(std::string_view name);

/// "NAME" or "NAME:parameter=value,...". @throws InputError
FilterSettings parse_filter(std::string_view text);

/// docs/filters.md: every filter, its source, layers and parameters.
/// @param insertion  what stands before the filters
std::string filters_reference(std::string_view insertion = "");

/// Puts a filter on the list; one static object per filter file.
struct Registration {
  explicit Registration(const FilterEntry& entry);
};

}  // namespace brume

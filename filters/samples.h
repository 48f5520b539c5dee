#pragma once
#include <functional>
#include <span>

#include "filters/filter.h"

namespace brume {

/// Calls visit(x, y, samples) for every pixel of the frame with the colours of what was sampled there: every sample
/// where there are records, otherwise the eight bucket means. Pixels come tile by tile, from one thread.
/// @throws InputError when the records are of another picture
void visit_samples(const FilterFrame& frame,
                   const std::function<void(int x, int y, std::span<const vec3> samples)>& visit);

/// @throws InputError when the records are not of a frame of this size or lack a field
void check_records(const RecordReader& records, ivec2 frame_size);

/// Where a field's numbers begin in a record. @throws InputError when there is none
size_t field_offset(const RecordLayout& layout, std::string_view name);

}  // namespace brume

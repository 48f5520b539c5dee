#pragma once
#include <functional>
#include <set>
#include <span>
#include <vector>

#include "filters/inputs/filter_frame.h"

namespace brume {

/// Pixels of the frame whose records were not all finite.
using RepairedPixels = std::set<std::pair<int, int>>;

/// Calls visit(x, y, samples) for every pixel of the frame with the colours of what was sampled there: every sample
/// where there are records, otherwise the eight bucket means. Pixels come tile by tile, from one thread.
/// @throws InputError when the records are of another picture
void visit_samples(const FilterFrame& frame, RepairedPixels* repaired,
                   const std::function<void(int x, int y, std::span<const vec3> samples)>& visit);

/// Calls visit(x, y, records) for every pixel of the frame with the records of its samples, one after another, tile by
/// tile from one thread. Numbers that are not finite are replaced by the mean of the pixel's other samples, and the
/// pixel is noted in `repaired`, which may be null.
/// @throws InputError when the records are of a picture of another size, or damaged
void visit_records(const FilterFrame& frame, RepairedPixels* repaired,
                   const std::function<void(int x, int y, std::span<const float> records)>& visit);

/// Where the colours begin whose sum is the signal. @throws InputError when the records lack them
std::vector<size_t> signal_offsets(const RecordLayout& layout, const LayerName& signal);

/// Where a field's numbers begin in a record. @throws InputError when there is none
size_t field_offset(const RecordLayout& layout, std::string_view name);

}  // namespace brume

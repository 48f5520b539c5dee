#include "filters/inputs/samples.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/error.h"

namespace brume {
namespace {

/// Replaces numbers of a pixel's records that are not finite by the mean of the same number in its other samples, or by
/// 0 where none is finite.
/// @return  whether there were any
bool repair(std::span<float> records, size_t width) {
  if (std::all_of(records.begin(), records.end(), [](float v) { return std::isfinite(v); })) return false;
  for (size_t k = 0; k < width; ++k) {
    double sum = 0;
    size_t finite = 0;
    for (size_t i = k; i < records.size(); i += width) {
      if (!std::isfinite(records[i])) continue;
      sum += records[i];
      ++finite;
    }
    const float mean = finite > 0 ? static_cast<float>(sum / static_cast<double>(finite)) : 0.0f;
    for (size_t i = k; i < records.size(); i += width)
      if (!std::isfinite(records[i])) records[i] = mean;
  }
  return true;
}

}  // namespace

size_t field_offset(const RecordLayout& layout, std::string_view name) {
  size_t offset = 0;
  for (const RecordLayout::Field& f : layout.fields) {
    if (f.name == name) return offset;
    offset += static_cast<size_t>(f.components);
  }
  throw InputError(fmt::format("the records lack the field '{}'", name));
}

std::vector<size_t> signal_offsets(const RecordLayout& layout, const LayerName& signal) {
  std::vector<size_t> parts;
  if (!(signal == layer::indirect)) parts = {field_offset(layout, "unscattered"), field_offset(layout, "single")};
  if (!(signal == layer::direct)) parts.push_back(field_offset(layout, "indirect"));
  return parts;
}

void visit_records(const FilterFrame& frame, RepairedPixels* repaired,
                   const std::function<void(int x, int y, std::span<const float> records)>& visit) {
  const RecordLayout& layout = frame.records->layout();
  if (layout.width != frame.frame_size.x || layout.height != frame.frame_size.y)
    throw InputError(fmt::format("the records are of a picture of {} x {} pixels, the frame has {} x {}", layout.width,
                                 layout.height, frame.frame_size.x, frame.frame_size.y));
  const size_t length = static_cast<size_t>(layout.components()) * static_cast<size_t>(layout.samples);
  for (int tile = 0; tile < layout.tile_count(); ++tile) {
    const RecordLayout::Bounds b = layout.bounds(tile);
    const int x0 = std::max(b.x0, frame.origin.x), x1 = std::min(b.x1, frame.origin.x + frame.width());
    const int y0 = std::max(b.y0, frame.origin.y), y1 = std::min(b.y1, frame.origin.y + frame.height());
    if (x0 >= x1 || y0 >= y1) continue;
    std::vector<float> block = frame.records->read(tile);
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x) {
        const size_t pixel =
            static_cast<size_t>(y - b.y0) * static_cast<size_t>(b.x1 - b.x0) + static_cast<size_t>(x - b.x0);
        const std::span<float> records(block.data() + pixel * length, length);
        if (repair(records, static_cast<size_t>(layout.components())) && repaired) repaired->insert({x, y});
        visit(x - frame.origin.x, y - frame.origin.y, records);
      }
  }
}

void visit_samples(const FilterFrame& frame, RepairedPixels* repaired,
                   const std::function<void(int x, int y, std::span<const vec3> samples)>& visit) {
  std::vector<vec3> samples;
  if (!frame.records) {
    samples.resize(frame.buckets.size());
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        for (size_t k = 0; k < samples.size(); ++k) {
          const RgbPlanes& b = frame.buckets[k];
          samples[k] = color_at(b, x, y);
        }
        visit(x, y, samples);
      }
    return;
  }
  const RecordLayout& layout = frame.records->layout();
  const std::vector<size_t> parts = signal_offsets(layout, frame.name);
  const size_t width = static_cast<size_t>(layout.components());
  samples.resize(static_cast<size_t>(layout.samples));
  visit_records(frame, repaired, [&](int x, int y, std::span<const float> records) {
    for (size_t s = 0; s < samples.size(); ++s) {
      const float* record = records.data() + s * width;
      samples[s] = vec3(0);
      for (const size_t part : parts) samples[s] += vec3(record[part], record[part + 1], record[part + 2]);
    }
    visit(x, y, samples);
  });
}

}  // namespace brume

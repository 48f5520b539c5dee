#include "filters/samples.h"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "base/error.h"

namespace brume {

size_t field_offset(const RecordLayout& layout, std::string_view name) {
  size_t offset = 0;
  for (const RecordLayout::Field& f : layout.fields) {
    if (f.name == name) return offset;
    offset += static_cast<size_t>(f.components);
  }
  throw InputError(fmt::format("the records lack the field '{}'", name));
}

void check_records(const RecordReader& records, ivec2 frame_size) {
  const RecordLayout& layout = records.layout();
  if (layout.width != frame_size.x || layout.height != frame_size.y)
    throw InputError(fmt::format("the records are of a picture of {} x {} pixels, the frame has {} x {}", layout.width,
                                 layout.height, frame_size.x, frame_size.y));
}

void visit_samples(const FilterFrame& frame,
                   const std::function<void(int x, int y, std::span<const vec3> samples)>& visit) {
  if (!frame.records) {
    std::vector<vec3> samples(frame.buckets.size());
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        for (size_t k = 0; k < samples.size(); ++k) {
          const RgbPlanes& b = frame.buckets[k];
          samples[k] = vec3((*b[0])(x, y), (*b[1])(x, y), (*b[2])(x, y));
        }
        visit(x, y, samples);
      }
    return;
  }
  check_records(*frame.records, frame.frame_size);
  const RecordLayout& layout = frame.records->layout();
  // The signal as a sum of the recorded parts.
  std::vector<size_t> parts;
  if (frame.name == layer::beauty || frame.name == layer::direct)
    parts = {field_offset(layout, "unscattered"), field_offset(layout, "single")};
  if (frame.name == layer::beauty || frame.name == layer::indirect) parts.push_back(field_offset(layout, "indirect"));
  const size_t width = static_cast<size_t>(layout.components()), count = static_cast<size_t>(layout.samples);
  std::vector<vec3> samples(count);
  for (int tile = 0; tile < layout.tile_count(); ++tile) {
    const RecordLayout::Bounds b = layout.bounds(tile);
    const int x0 = std::max(b.x0, frame.origin.x), x1 = std::min(b.x1, frame.origin.x + frame.width());
    const int y0 = std::max(b.y0, frame.origin.y), y1 = std::min(b.y1, frame.origin.y + frame.height());
    if (x0 >= x1 || y0 >= y1) continue;
    const std::vector<float> block = frame.records->read(tile);
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x) {
        const size_t pixel =
            static_cast<size_t>(y - b.y0) * static_cast<size_t>(b.x1 - b.x0) + static_cast<size_t>(x - b.x0);
        for (size_t s = 0; s < count; ++s) {
          const float* record = block.data() + (pixel * count + s) * width;
          samples[s] = vec3(0);
          for (const size_t part : parts) samples[s] += vec3(record[part], record[part + 1], record[part + 2]);
        }
        visit(x - frame.origin.x, y - frame.origin.y, samples);
      }
  }
}

}  // namespace brume

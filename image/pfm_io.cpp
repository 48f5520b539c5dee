#include "image/pfm_io.h"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <fstream>

#include "base/error.h"
#include "base/missing_file.h"
#include "base/output_file.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr int kLongestSide = 1 << 16;

float swapped(float value) {
  return std::bit_cast<float>(__builtin_bswap32(std::bit_cast<uint32_t>(value)));
}

}  // namespace

void write_pfm(const fs::path& path, std::span<const Plane* const> planes) {
  static_assert(std::endian::native == std::endian::little);
  OutputFile output(path);
  std::ofstream stream(output.part(), std::ios::binary);
  const int width = planes[0]->width(), height = planes[0]->height();
  stream << fmt::format("{}\n{} {}\n-1.0\n", planes.size() == 3 ? "PF" : "Pf", width, height);
  std::vector<float> row(planes.size() * static_cast<size_t>(width));
  for (int y = height - 1; y >= 0; --y) {
    for (int x = 0; x < width; ++x)
      for (size_t c = 0; c < planes.size(); ++c) row[static_cast<size_t>(x) * planes.size() + c] = (*planes[c])(x, y);
    stream.write(reinterpret_cast<const char*>(row.data()), static_cast<std::streamsize>(row.size() * sizeof(float)));
  }
  stream.close();
  if (!stream) throw InputError(fmt::format("{}: cannot be written; is the disk full?", path.string()));
  output.commit();
}

Layers read_pfm(const fs::path& path) try {
  const auto fail = [&](const std::string& what) { throw InputError(fmt::format("{}: {}", path.string(), what)); };
  std::error_code ignored;
  check_exists(path);
  if (!fs::is_regular_file(path, ignored)) fail("is no regular file, expected a portable float map");
  std::ifstream stream(path, std::ios::binary);
  std::string kind;
  int width = 0, height = 0;
  double scale = 0;
  stream >> std::ws;
  for (int c = 0; kind.size() < 2 && (c = stream.get()) != std::char_traits<char>::eof();) kind += static_cast<char>(c);
  if (kind != "PF" && kind != "Pf") fail("no portable float map: expected it to begin with PF or Pf");
  stream >> width >> height >> scale;
  if (!stream || !(std::abs(scale) > 0) || !std::isfinite(scale) || stream.get() == std::char_traits<char>::eof())
    fail("damaged: expected width, height and a scale that is not 0 after PF");
  if (width < 1 || height < 1 || width > kLongestSide || height > kLongestSide)
    fail(fmt::format("is {} x {} pixels; expected 1 .. {} on a side", width, height, kLongestSide));
  const bool colour = kind == "PF";
  const size_t channels = colour ? 3 : 1, row_values = channels * static_cast<size_t>(width);
  const uint64_t expected = static_cast<uint64_t>(height) * row_values * sizeof(float),
                 left = fs::file_size(path) - static_cast<uint64_t>(stream.tellg());
  if (left < expected)
    fail(fmt::format("truncated: {} bytes of pixels, expected {} for {} x {}", left, expected, width, height));
  Layers layers(width, height);
  std::vector<Plane*> planes;
  if (colour)
    for (Plane* plane : layers.add_rgb(layer::beauty)) planes.push_back(plane);
  else
    planes.push_back(&layers.add("Y"));
  const bool swap = scale > 0;
  const auto factor = static_cast<float>(std::abs(scale));
  std::vector<float> row(row_values);
  for (int y = height - 1; y >= 0; --y) {
    stream.read(reinterpret_cast<char*>(row.data()), static_cast<std::streamsize>(row.size() * sizeof(float)));
    if (!stream) fail("cannot be read to its end");
    for (size_t i = 0; i < row.size(); ++i)
      (*planes[i % channels])(static_cast<int>(i / channels), y) = factor * (swap ? swapped(row[i]) : row[i]);
  }
  return layers;
} catch (const std::bad_alloc& error) {
  fail_reading(path.string(), error);
}

}  // namespace brume

#include "image/picture_io.h"

#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <memory>

#include "base/error.h"
#include "base/missing_file.h"
#include "base/output_file.h"
#include "image/color.h"
#include "image/exr_io.h"
#include "image/hdr_io.h"
#include "image/png_color.h"
#include "image/usable_colors.h"

#define STB_IMAGE_IMPLEMENTATION
#define STB_IMAGE_STATIC
#define STBI_NO_HDR
#define STBI_NO_LINEAR
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STB_IMAGE_WRITE_STATIC
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#include <stb_image.h>
#include <stb_image_write.h>
#pragma GCC diagnostic pop

namespace brume {
namespace fs = std::filesystem;

namespace {

template <class T, class Decode>
Layers from_interleaved(const T* rgb, int width, int height, const Decode& decode) {
  Layers layers(width, height);
  const auto planes = layers.add_rgb(layer::beauty);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (size_t c = 0; c < 3; ++c) (*planes[c])(x, y) = decode(rgb[(static_cast<size_t>(y) * width + x) * 3 + c]);
  return layers;
}

}  // namespace

Picture::Picture(int w, int h, std::array<uint8_t, 3> colour)
    : width(w), height(h), rgb(static_cast<size_t>(w) * h * 3) {
  for (size_t i = 0; i < rgb.size(); ++i) rgb[i] = colour[i % 3];
}

void Picture::set(int x, int y, std::array<uint8_t, 3> colour) {
  if (x < 0 || y < 0 || x >= width || y >= height) return;
  std::copy(colour.begin(), colour.end(), rgb.begin() + (static_cast<std::ptrdiff_t>(y) * width + x) * 3);
}

void Picture::paste(const Picture& other, int x0, int y0) {
  for (int y = 0; y < other.height; ++y)
    for (int x = 0; x < other.width; ++x) {
      const uint8_t* p = &other.rgb[(static_cast<size_t>(y) * other.width + x) * 3];
      set(x0 + x, y0 + y, {p[0], p[1], p[2]});
    }
}

Picture to_picture(const std::array<const Plane*, 3>& rgb, double exposure, Tone tone) {
  Picture picture(rgb[0]->width(), rgb[0]->height());
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) {
      std::array<uint8_t, 3> colour;
      bool finite = true;
      for (size_t c = 0; c < 3; ++c) {
        const double v = (*rgb[c])(x, y) * exposure;
        finite = finite && std::isfinite(v);
        const double shown = srgb_encode(tone == Tone::kFilmic ? filmic_shoulder(v) : v);
        colour[c] = finite ? static_cast<uint8_t>(255.0 * shown + 0.5) : uint8_t{0};
      }
      picture.set(x, y, finite ? colour : std::array<uint8_t, 3>{255, 0, 255});
    }
  return picture;
}

Picture to_picture(const std::array<const Plane*, 3>& rgb, double exposure, const Display& display) {
  Picture picture(rgb[0]->width(), rgb[0]->height());
  std::vector<float> row(3 * static_cast<size_t>(picture.width));
  for (int y = 0; y < picture.height; ++y) {
    std::vector<bool> finite(static_cast<size_t>(picture.width), true);
    for (size_t i = 0; i < row.size(); ++i) {
      const double v = (*rgb[i % 3])(static_cast<int>(i / 3), y) * exposure;
      row[i] = static_cast<float>(v);
      if (!std::isfinite(row[i])) {
        row[i] = 0;
        finite[i / 3] = false;
      }
    }
    display.apply(row);
    for (size_t x = 0; x < finite.size(); ++x) {
      const auto code = [&](size_t c) { return static_cast<uint8_t>(255.0f * row[3 * x + c] + 0.5f); };
      picture.set(static_cast<int>(x), y,
                  finite[x] ? std::array{code(0), code(1), code(2)} : std::array<uint8_t, 3>{255, 0, 255});
    }
  }
  return picture;
}

void write_png(const fs::path& path, const Picture& picture) {
  std::string bytes;
  const auto append = [](void* to, void* data, int size) {
    static_cast<std::string*>(to)->append(static_cast<const char*>(data), static_cast<size_t>(size));
  };
  stbi_write_png_to_func(append, &bytes, picture.width, picture.height, 3, picture.rgb.data(), picture.width * 3);
  write_text(path, bytes);
}

namespace {

bool is_exr(const fs::path& path) {
  std::array<char, 4> begin{};
  std::ifstream(path, std::ios::binary).read(begin.data(), begin.size());
  return std::string_view(begin.data(), begin.size()) == "\x76\x2f\x31\x01" || path.extension() == ".exr";
}

/// R, G, B, or Y as grey. @throws InputError
Layers read_exr_colors(const fs::path& path) {
  Layers picture = read_exr(path, [](const std::string& c) { return c == "R" || c == "G" || c == "B" || c == "Y"; });
  if (const Plane* const grey = picture.find("Y"); grey && !picture.has(layer::beauty))
    for (Plane* plane : picture.add_rgb(layer::beauty)) *plane = *grey;
  if (!picture.has(layer::beauty))
    throw InputError(fmt::format("{}: has no channels R, G, B; expected a colour picture", path.string()));
  return over_display_window(std::move(picture));
}

/// PNG, JPEG and the like: 8 or 16 bits, encoded as sRGB or as a PNG says.
Layers read_encoded(const fs::path& path, std::vector<std::string>& notes) {
  const PngColor color = read_png_color(path);
  int width = 0, height = 0, channels = 0;
  const auto decode = [&](double v) {
    return static_cast<float>(color.gamma ? std::pow(v, 1 / *color.gamma) : srgb_decode(v));
  };
  const auto check = [&](const void* data) {
    if (!data && std::string_view(stbi_failure_reason()) == "outofmem") throw OutOfMemory(path.string(), "read it");
    if (!data)
      throw InputError(fmt::format("{}: not a readable picture: {}; expected EXR, Radiance HDR, PNG or JPEG",
                                   path.string(), stbi_failure_reason()));
  };
  Layers picture;
  if (stbi_is_16_bit(path.c_str())) {
    const std::unique_ptr<uint16_t, void (*)(void*)> data(stbi_load_16(path.c_str(), &width, &height, &channels, 3),
                                                          stbi_image_free);
    check(data.get());
    picture = from_interleaved(data.get(), width, height, [&](uint16_t v) { return decode(v / 65535.0); });
  } else {
    const std::unique_ptr<uint8_t, void (*)(void*)> data(stbi_load(path.c_str(), &width, &height, &channels, 3),
                                                         stbi_image_free);
    check(data.get());
    std::array<float, 256> decoded;
    for (size_t i = 0; i < decoded.size(); ++i) decoded[i] = decode(static_cast<double>(i) / 255.0);
    picture = from_interleaved(data.get(), width, height, [&](uint8_t v) { return decoded[v]; });
  }
  if (color.chromaticities) picture.header["chromaticities"] = *color.chromaticities;
  if (color.gamma)
    notes.push_back(fmt::format("{}: is encoded with a gamma of {:g}: undone", path.string(), *color.gamma));
  if (!color.profile.empty())
    notes.push_back(
        fmt::format("{}: has a colour profile ({}), which is not read: taken as sRGB", path.string(), color.profile));
  return picture;
}

Layers read_colors(const fs::path& path, const Task& task, std::vector<std::string>& notes) try {
  check_exists(path);
  if (is_hdr(path) || path.extension() == ".hdr") return read_hdr(path, task, &notes);
  return is_exr(path) ? read_exr_colors(path) : read_encoded(path, notes);
} catch (const std::bad_alloc& error) {
  fail_reading(path.string(), error);
}

}  // namespace

Layers read_any_picture(const fs::path& path) {
  std::vector<std::string> ignored;
  return read_colors(path, {}, ignored);
}

UsablePicture read_usable_picture(const fs::path& path, const WorkingSpace& space, const Task& task) {
  UsablePicture picture;
  picture.layers = read_colors(path, task, picture.notes);
  const std::vector<std::string> repaired = repair_colors(picture.layers, path.string(), space);
  picture.notes.insert(picture.notes.end(), repaired.begin(), repaired.end());
  return picture;
}

}  // namespace brume

#include "workflows/deep_frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "base/error.h"
#include "base/output_file.h"
#include "base/parallel_for.h"
#include "image/exr_deep.h"
#include "render/world/camera.h"

namespace brume {
namespace {

using Type = DeepPicture::Channel::Type;

constexpr double kCovers = 1e-3, kNothing = 1e-6;  // of a pixel

/// A pixel's samples as they are stored.
struct Sample {
  float z, z_back, alpha;
  vec3 colour;
};

/// Light of each part: the pixel's, shared as the predicted light of each colour is; where none was predicted, as that
/// of all colours, or as what covers the pixel. Parts of which no light is known get what the others leave.
std::vector<dvec3> shared_light(std::span<const DeepPart> parts, const dvec3& light) {
  std::vector<dvec3> shares(parts.size());
  dvec3 all(0);
  double covered = 0, left = 1;
  double unknown = 0;  // part of what is covered
  std::vector<double> cover(parts.size());
  for (size_t i = 0; i < parts.size(); ++i) {
    all += glm::max(dvec3(parts[i].light), 0.0);
    cover[i] = left - static_cast<double>(parts[i].left);
    covered += cover[i];
    if (parts[i].light == vec3(0)) unknown += cover[i];
    left = parts[i].left;
  }
  const double grey = all.x + all.y + all.z;
  for (size_t i = 0; i < parts.size(); ++i) {
    const dvec3 own = glm::max(dvec3(parts[i].light), 0.0);
    if (unknown > kCovers) {
      const dvec3 known = glm::min(all, glm::max(light, 0.0));
      for (int c = 0; c < 3; ++c)
        shares[i][c] = own == dvec3(0) ? (light[c] - known[c]) * cover[i] / unknown
                       : all[c] > 0    ? known[c] * own[c] / all[c]
                                       : 0;
      continue;
    }
    for (int c = 0; c < 3; ++c)
      shares[i][c] = light[c] * (all[c] > 0    ? own[c] / all[c]
                                 : grey > 0    ? (own.x + own.y + own.z) / grey
                                 : covered > 0 ? cover[i] / covered
                                               : (i == 0 ? 1.0 : 0.0));
  }
  return shares;
}

/// The nearest multiple of the power of two at or below a step.
double rounded(double value, double step) {
  const double power = std::exp2(std::floor(std::log2(step)));
  return std::round(value / power) * power;
}

/// Nothing of light is then too much, which samples behind could not take back.
double rounded_down(double value, double step) {
  const double power = std::exp2(std::floor(std::log2(step)));
  return std::floor(value / power) * power;
}

/// The nearest half, which the file keeps as it is.
double as_half(double value) {
  constexpr double kLargest = 65504, kLeastNormal = 0x1p-14;
  const double power = std::exp2(std::floor(std::log2(std::max(std::abs(value), kLeastNormal))) - 10);
  return std::clamp(std::round(value / power) * power, -kLargest, kLargest);
}

/// Makes a pixel's samples of its parts. Each has the colour and alpha that those before it, as they are rounded, leave
/// to it, so that roundings do not add up. Those of halves are rounded to fewer digits, which pack well, but for the
/// last ones', and a sample of which nothing is left is none.
class PixelSamples {
 public:
  PixelSamples(std::span<const DeepPart> parts, const dvec3& light, Type type)
      : parts_(parts), light_(light), half_(type == Type::kHalf) {}

  void store(std::vector<Sample>& samples) {
    const std::vector<dvec3> shares = shared_light(parts_, light_);
    size_t last_cover = 0;
    for (size_t i = 0; i < parts_.size(); ++i)
      if (parts_[i].left < (i == 0 ? 1 : parts_[i - 1].left)) last_cover = i;
    for (size_t i = 0; i < parts_.size(); ++i) {
      if (left_ <= 0) {  // nothing is seen behind: its light goes to what hides it
        vec3& colour = samples.back().colour;
        for (int c = 0; c < 3; ++c) {
          const double whole = static_cast<double>(colour[c]) + shares[i][c] / left_before_;
          colour[c] = static_cast<float>(half_ ? as_half(whole) : whole);
        }
        continue;
      }
      const DeepPart& part = parts_[i];
      const bool last = i + 1 == parts_.size() || part.left < kStep;
      const double alpha = alpha_of(part, i == last_cover);
      due_ += shares[i];
      const vec3 colour = colour_of(last);
      if (!last && alpha == 0 && colour == vec3(0)) continue;
      samples.push_back({part.z, part.z_back, static_cast<float>(alpha), colour});
      due_ -= left_ * dvec3(colour);
      left_before_ = left_;
      left_ *= 1 - alpha;
    }
  }

 private:
  static constexpr double kStep = 1.0 / 2048;          // of what an alpha takes of the pixel
  static constexpr double kLightStep = 1.0 / 512;      // of the pixel's light
  static constexpr double kThickest = 1 - 1.0 / 2048;  // the largest half below 1

  double alpha_of(const DeepPart& part, bool last) const {
    const double alpha = std::clamp(1 - static_cast<double>(part.left) / left_, 0.0, 1.0);
    if (!half_) return static_cast<float>(alpha);
    if (part.left <= 0) return 1;
    const double few = last || part.z == part.z_back ? alpha : rounded(alpha, std::min(kStep / left_, 1.0 / 64));
    return std::min(as_half(few), kThickest);
  }

  vec3 colour_of(bool last) const {
    dvec3 colour = due_ / left_;
    for (int c = 0; c < 3 && half_; ++c) {
      if (!last && light_[c] > 0) colour[c] = rounded_down(colour[c], kLightStep * light_[c] / left_);
      if (light_[c] >= 0) colour[c] = std::max(colour[c], 0.0);
      colour[c] = as_half(colour[c]);
    }
    return vec3(colour);
  }

  const std::span<const DeepPart> parts_;
  const dvec3 light_;
  const bool half_;
  double left_ = 1, left_before_ = 1;  // behind the last sample, and before it
  dvec3 due_{0};                       // light that the samples have to show yet
};

Layers flattened_file(const DeepPicture& picture, const std::filesystem::path& path, float before) {
  try {
    return flattened(picture, before);
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", path.string(), error.what()));
  }
}

}  // namespace

DeepPicture deep_frame(const DeepRecord& record, Layers& frame, Type type) {
  const int width = frame.width(), height = frame.height();
  const RgbPlanes rgb = frame.rgb(layer::beauty);
  Plane& alpha = frame.add(layer::alpha.channel(0));
  std::vector<std::vector<Sample>> rows(static_cast<size_t>(height));
  std::vector<uint32_t> counts(static_cast<size_t>(width) * height);
  parallel_for(height, {}, [&](int y) {
    std::vector<Sample>& row = rows[static_cast<size_t>(y)];
    for (int x = 0; x < width; ++x) {
      std::vector<DeepPart> parts = record.parts({x, y});
      const dvec3 light((*rgb[0])(x, y), (*rgb[1])(x, y), (*rgb[2])(x, y));
      if (parts.empty() && light != dvec3(0)) parts.push_back({kDeepBackground, kDeepBackground, 1, vec3(1)});
      const size_t before = row.size();
      PixelSamples(parts, light, type).store(row);
      counts[static_cast<size_t>(y) * width + x] = static_cast<uint32_t>(row.size() - before);
      double left = 1;
      for (size_t i = before; i < row.size(); ++i) left *= 1 - static_cast<double>(row[i].alpha);
      alpha(x, y) = static_cast<float>(1 - left);
    }
  });
  DeepPicture picture(frame.data_window(), frame.display_window(), counts);
  picture.header = frame.header;
  const std::pair<const char*, float (*)(const Sample&)> channels[] = {
      {"Z", [](const Sample& s) { return s.z; }},        {"ZBack", [](const Sample& s) { return s.z_back; }},
      {"A", [](const Sample& s) { return s.alpha; }},    {"R", [](const Sample& s) { return s.colour.x; }},
      {"G", [](const Sample& s) { return s.colour.y; }}, {"B", [](const Sample& s) { return s.colour.z; }}};
  for (const auto& [name, value] : channels) {
    const bool depth = *name == 'Z';
    float* to = picture.add(name, depth ? Type::kFloat : type).values.data();
    for (const std::vector<Sample>& row : rows)
      for (const Sample& s : row) *to++ = value(s);
  }
  return picture;
}

void add_depths(const DeepRecord& record, const Scene& scene, Layers& frame) {
  const RenderSettings& settings = scene.render;
  const Camera camera(scene.camera, scene.film.width, scene.film.height);
  const auto plane = [&](const LayerName& l) -> Plane& { return frame.add(l.channel(0)); };
  Plane &mean = plane(layer::depth_mean), &half = plane(layer::depth_half), &first = plane(layer::depth_first),
        &mist = plane(layer::mist);
  const auto mist_at = [&](double distance) {
    const double share = std::clamp((distance - settings.mist_start) / settings.mist_depth, 0.0, 1.0);
    return settings.mist_falloff == "linear"      ? share
           : settings.mist_falloff == "quadratic" ? share * share
                                                  : std::sqrt(share);
  };
  const ivec2 corner = frame.data_window().lo;
  parallel_for(frame.height(), {}, [&](int y) {
    for (int x = 0; x < frame.width(); ++x) {
      const Ray ray = camera.ray(dvec2(corner + ivec2(x, y)) + 0.5, Camera::kLensMiddle, 0);
      const double per_depth = 1 / (camera.depth(ray.o + ray.d, 0) - camera.depth(ray.o, 0));
      std::vector<DeepPart> parts = record.parts({x, y});
      // Light from infinitely far covers nothing: what its rounding says would outweigh all depths.
      while (!parts.empty() && parts.back().z_back >= kDeepBackground) parts.pop_back();
      const double covered = parts.empty() ? 0 : 1 - static_cast<double>(parts.back().left);
      mean(x, y) = half(x, y) = first(x, y) = kDeepBackground;
      mist(x, y) = 1;
      if (!(covered > kNothing)) continue;
      double sum = 0, all_mist = 1 - covered, left = 1;
      for (const DeepPart& part : parts) {
        const double cover = left - static_cast<double>(part.left), length = part.z_back - part.z;
        if (!(cover > 0)) continue;
        const double share = cover / left, depth = -std::log1p(-std::min(share, 1 - 1e-9));
        const auto z_at = [&](double of_cover) {  // in front of which a share of the pixel lies
          return part.z + length * std::clamp(-std::log1p(-std::min(of_cover / left, 1 - 1e-9)) / depth, 0.0, 1.0);
        };
        // The mean of an exponential that ends.
        const double middle = part.z + length * (share < 1e-4 ? 0.5 : 1 / depth - (1 - share) / share);
        sum += cover * middle;
        all_mist += cover * mist_at(middle * per_depth);
        const double before = 1 - left, behind = before + cover;
        for (const auto& [at, to] : {std::pair(0.5, &half), {0.01, &first}})
          if (at * covered >= before && at * covered < behind)
            (*to)(x, y) = static_cast<float>(z_at(at * covered - before));
        left = part.left;
      }
      mean(x, y) = static_cast<float>(sum / covered);
      mist(x, y) = static_cast<float>(all_mist);
    }
  });
}

void denoise_deep(const FrameFiles& files, const DenoiseOptions& options, const Host& host) {
  const std::string path = files.frame.string();
  if (options.file.asked() || !files.records.empty() || !files.second.empty() || options.filters.size() > 1)
    throw InputError(fmt::format(
        "{}: holds deep pixels, which one filter cleans through their flat picture; expected no map, suffix, "
        "records or second half",
        path));
  std::vector<std::filesystem::path> inputs = {files.frame, files.guides};
  check_writable(files.output, inputs, ".exr");
  if (!files.preview.empty()) {
    check_writable(files.preview, inputs, ".png");
    options.picture.check();
  }
  DeepPicture deep = read_deep_exr(files.frame, host.silent());
  for (const char* const colour : {"R", "G", "B"})
    if (!deep.find(colour))
      throw InputError(fmt::format("{}: its deep pixels have no channel {}; expected R, G and B", path, colour));
  const Layers all = flattened_file(deep, files.frame, std::numeric_limits<float>::infinity());
  const Layers flat = part_of(all, {"R", "G", "B", "A"});
  std::optional<NamedFrame> guides;
  if (!files.guides.empty()) guides = read_guides(files.guides.string());
  const Layers clean = denoise_frame(flat, guides ? &*guides : nullptr, options, host);
  recolour(deep, all, clean);
  for (const auto& [name, value] : clean.header)
    if (!deep.header.contains(name)) deep.header[name] = value;
  write_deep_exr(files.output, deep, host.silent());
  if (!files.preview.empty()) options.picture.write(files.preview, clean);
}

Layers flattened_file(const std::filesystem::path& deep, float before, const Host& host) {
  return flattened_file(read_deep_exr(deep, host.silent()), deep, before);
}

}  // namespace brume

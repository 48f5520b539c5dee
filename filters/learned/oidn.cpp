// Open Image Denoise: networks learnt from pairs of noisy and clean pictures, evaluated here from their published
// weights. The layers, the transfer function, the exposure and the padding are those of the library
// (https://www.openimagedenoise.org, version 2.3).

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "base/error.h"
#include "base/text.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/learned/oidn_library.h"
#include "filters/learned/unet.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

enum class Mode { kAuto, kColor, kAlbedo, kAlbedoNormal, kPrefilter };
enum class Quality { kHigh, kBalanced, kFast };

struct Oidn {
  Mode mode = Mode::kAuto;
  Quality quality = Quality::kHigh;
  std::string weights;
};

const std::vector<std::string> kModes = {"auto", "color", "albedo", "albedo-normal", "prefilter"};

/// Radiance on a scale on which an error is about as visible everywhere, from 0 to 1 for what a half float holds: a
/// line, a power and a logarithm. Source: Mantiuk, Myszkowski and Seidel 2004, Lossy compression of high dynamic range
/// images.
namespace perceptual {
constexpr float a = 1.41283765e+03f, b = 1.64593172f, c = 4.31384981e-01f, d = -2.94139609e-03f, e = 1.92653254e-01f,
                f = 6.26026094e-03f, g = 9.98620152e-01f, y0 = 1.57945760e-06f, y1 = 3.22087631e-02f,
                x0 = 2.23151711e-03f, x1 = 3.70974749e-01f;
constexpr float kMost = 65504;

float forward(float y) {
  return y <= y0 ? a * y : y <= y1 ? b * std::pow(y, c) + d : e * std::log(y + f) + g;
}
float inverse(float x) {
  return x <= x0 ? x / a : x <= x1 ? std::pow((x - d) / b, 1 / c) : std::exp((x - g) / e) - f;
}
const float kScale = 1 / forward(kMost);
}  // namespace perceptual

float srgb(float y) {
  return y <= 0.0031308f ? 12.92f * y : 1.055f * std::pow(y, 1 / 2.4f) - 0.055f;
}
float from_srgb(float x) {
  return x <= 0.04045f ? x / 12.92f : std::pow((x + 0.055f) / 1.055f, 2.4f);
}
float within_1(float v) {
  return std::clamp(v, 0.0f, 1.0f);
}

template <class Function>
Rgb each(const RgbPlanes& in, const Task& task, const Function& function) {
  Rgb out;
  for (size_t c = 0; c < 3; ++c)
    out[c] = make_plane(in[c]->width(), in[c]->height(), quiet(task),
                        [&](int x, int y) { return function((*in[c])(x, y)); });
  return out;
}

/// What brings the geometric mean of the luminance, over cells of about 16 x 16 pixels, to a photographer's grey.
float exposure_of(const RgbPlanes& color, const Task& task) {
  constexpr int kCell = 16;
  constexpr double kGrey = 0.18, kBlack = 1e-8;
  const Plane luminance = make_plane(color[0]->width(), color[0]->height(), quiet(task), [&](int x, int y) {
    const vec3 v = glm::max(color_at(color, x, y), vec3(0));
    return glm::dot(v, vec3(0.212671f, 0.715160f, 0.072169f));
  });
  const int across = (luminance.width() + kCell - 1) / kCell, down = (luminance.height() + kCell - 1) / kCell;
  double sum = 0, cells = 0;
  for (int j = 0; j < down; ++j)
    for (int i = 0; i < across; ++i) {
      const Box cell{i * luminance.width() / across, j * luminance.height() / down,
                     (i + 1) * luminance.width() / across, (j + 1) * luminance.height() / down};
      double mean = 0;
      for (int y = cell.y0; y < cell.y1; ++y)
        for (int x = cell.x0; x < cell.x1; ++x) mean += static_cast<double>(luminance(x, y));
      mean /= cell.width() * cell.height();
      if (mean > kBlack) sum += std::log2(mean), ++cells;
    }
  return cells > 0 ? static_cast<float>(kGrey / std::exp2(sum / cells)) : 1.0f;
}

/// The folder that was named; empty: none was.
fs::path named_folder(const Oidn& p) {
  if (!p.weights.empty()) return p.weights;
  const char* const named = std::getenv("BRUME_OIDN_WEIGHTS");
  return named ? named : "";
}

fs::path folder_of(const Oidn& p) {
  const fs::path named = named_folder(p);
  return named.empty() ? BRUME_OIDN_FOLDER : named;  // where ./run oidn leaves them
}

/// Where brume is built with the library, that evaluates the networks that it brings.
bool uses_library(const Oidn& p) {
  return !oidn_library_version().empty() && named_folder(p).empty();
}

/// Names of files, sizes and times: another set of weights is another filter.
std::string weights_in_use(const Oidn& p) {
  if (uses_library(p)) return "of the library " + oidn_library_version();
  const fs::path folder = folder_of(p);
  std::vector<std::string> files;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
    if (it->path().extension() == ".tza")
      files.push_back(fmt::format("{} {} {}", it->path().filename().string(), it->file_size(error),
                                  it->last_write_time(error).time_since_epoch().count()));
  if (files.empty())
    throw InputError(fmt::format(
        "filter oidn needs the weights of Open Image Denoise's networks, and {} has no *.tza: ./run oidn fetches them; --weights or BRUME_OIDN_WEIGHTS names another folder",
        folder.string()));
  std::sort(files.begin(), files.end());
  return join(files);
}

/// Planes that a network reads, and the network.
Rgb evaluate(const fs::path& folder, const std::string& name, const std::vector<RgbPlanes>& groups, const Task& task) {
  std::vector<const Plane*> in;
  for (const RgbPlanes& group : groups) in.insert(in.end(), group.begin(), group.end());
  return Unet(folder / (name + ".tza"), static_cast<int>(in.size())).evaluate(in, task);
}

/// Layers that a mode reads beside the colour.
std::vector<LayerName> layers_of(Mode mode) {
  switch (mode) {
    case Mode::kAlbedo:
      return {layer::albedo};
    case Mode::kAlbedoNormal:
    case Mode::kPrefilter:
      return {layer::albedo, layer::normal};
    default:
      return {};
  }
}

/// The mode, which for `auto` is the best that the frame allows.
Mode mode_for(Mode asked, const Layers& layers) {
  if (asked == Mode::kAuto)
    return !layers.has(layer::albedo) ? Mode::kColor : layers.has(layer::normal) ? Mode::kPrefilter : Mode::kAlbedo;
  std::vector<std::string> missing;
  for (const LayerName& l : layers_of(asked))
    if (!layers.has(l)) missing.push_back(std::string(l.name));
  if (missing.empty()) return asked;
  throw InputError(
      fmt::format("filter oidn: mode={} needs the layer{} '{}', which the frame does not have. {}",
                  kModes[static_cast<size_t>(asked)], missing.size() > 1 ? "s" : "", join(missing, "', '"),
                  way_to(fmt::format("Record it with: brume render SCENE -o OUT.exr --layers {}; mode=color needs none",
                                     join(missing, ",")),
                         layers, "mode=color needs none, or ")));
}

void run_library(const Oidn& p, Mode mode, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  OidnPicture picture{frame.signal, {}, {}, mode == Mode::kPrefilter, static_cast<int>(p.quality)};
  for (const LayerName& l : layers_of(mode))
    (l == layer::albedo ? picture.albedo : picture.normal) = frame.layers.rgb(l);
  Rgb clean = denoise_by_library(picture, task);
  for (size_t c = 0; c < 3; ++c) *out[c] = std::move(clean[c]);
}

void run(const Oidn& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const Mode mode = mode_for(p.mode, frame.layers);
  if (uses_library(p)) return run_library(p, mode, frame, out, task);
  const fs::path folder = folder_of(p);
  const float scale = exposure_of(frame.signal, task);
  const std::string size = p.quality == Quality::kFast ? "_small" : "",
                    large = p.quality == Quality::kHigh ? "_large" : "";
  const Rgb color = each(frame.signal, task, [&](float v) {
    return std::min(perceptual::kScale * perceptual::forward(scale * std::max(v, 0.0f)), 1.0f);
  });
  Rgb albedo, normal;
  if (!layers_of(mode).empty()) albedo = each(frame.layers.rgb(layer::albedo), task, within_1);
  if (layers_of(mode).size() > 1)
    normal =
        each(frame.layers.rgb(layer::normal), task, [](float v) { return 0.5f + 0.5f * std::clamp(v, -1.0f, 1.0f); });
  Rgb clean;
  switch (mode) {
    case Mode::kAlbedo:
      clean = evaluate(folder, "rt_hdr_alb" + size, {view(color), view(albedo)}, task);
      break;
    case Mode::kAlbedoNormal:
      clean = evaluate(folder, "rt_hdr_alb_nrm" + size, {view(color), view(albedo), view(normal)}, task);
      break;
    case Mode::kPrefilter: {
      const Rgb encoded = each(view(albedo), task, srgb);
      albedo = each(view(evaluate(folder, "rt_alb" + large, {view(encoded)}, share(task, 0, 0.33))), task,
                    [](float v) { return from_srgb(within_1(v)); });
      normal = each(view(evaluate(folder, "rt_nrm" + large, {view(normal)}, share(task, 0.33, 0.66))), task, within_1);
      clean = evaluate(folder, "rt_hdr_calb_cnrm" + (large.empty() ? size : large),
                       {view(color), view(albedo), view(normal)}, share(task, 0.66, 1));
      break;
    }
    default:
      clean = evaluate(folder, "rt_hdr" + size, {view(color)}, task);
  }
  for (size_t c = 0; c < 3; ++c)
    *out[c] = make_plane(frame.width(), frame.height(), quiet(task), [&](int x, int y) {
      return std::max(perceptual::inverse(within_1(clean[c](x, y)) / perceptual::kScale), 0.0f) / scale;
    });
}

const FilterEntry entry =
    declare<Oidn>("oidn", "Open Image Denoise: a network that has learnt from pairs of noisy and clean pictures.")
        .merit(5.5,
               "for frames of other renderers and others without guides, where `./run oidn` has fetched its weights")
        .source("Intel Open Image Denoise 2.3 (Afra 2019 to 2024); Ronneberger, Fischer and Brox 2015, U-Net")
        .notes(
            "`./run oidn` fetches the published weights (Apache 2.0; no part of brume) into build/oidn; `weights` or the variable BRUME_OIDN_WEIGHTS names another folder of them. Layers, transfer function, exposure and padding are the library's; the convolutions are brume's own, and agree with another evaluation to 1e-5 (tests/filters/oidn_test.cpp). Where brume was built with the library itself (CMake finds OpenImageDenoise 2), that is run with the weights that it brings, unless a folder is named. It reads neither statistics nor guides. No frame gets it unasked: what is recommended does not depend on files elsewhere.")
        .can_use(layer::albedo, layer::normal)
        .within([](const Layers& layers, const LayerName&) {
          return Box{0, 0, layers.width(), layers.height()};
        })
        .learned(weights_in_use)
        .paper("")
        .param(
            "mode", &Oidn::mode, kModes,
            "what it reads beside the colour: nothing, the albedo, albedo and normal, both cleaned first by networks of their own; auto: as much of it as the frame has")
        .param("quality", &Oidn::quality, {"high", "balanced", "fast"},
               "the largest networks there are, middle or small ones")
        .param("weights", &Oidn::weights,
               "folder with the networks (*.tza); empty: BRUME_OIDN_WEIGHTS, else where `./run oidn` left them")
        .scratch(24)
        .apron([](const Oidn&) { return 0; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume

#include "workflows/frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "base/error.h"
#include "filters/inputs/guide_layers.h"
#include "filters/regression/transport/guide_check.h"
#include "image/exr_io.h"
#include "image/foreign.h"
#include "image/frame_space.h"
#include "image/picture_io.h"
#include "image/usable_colors.h"
#include "render/session/render_state.h"

namespace brume {
namespace {

/// Refuses guides that another camera saw, as far as both headers tell.
void check_same_camera(const std::string& guides_path, const Layers& guides, const std::string& frame_path,
                       const Layers& frame) {
  constexpr float kTolerance = 1e-3f;  // of the largest number in a matrix
  for (const char* key : {"worldToCamera", "worldToNDC"}) {
    const auto matrix = [&](const Layers& layers) {
      const auto found = layers.header.find(key);
      return found == layers.header.end() ? nullptr : std::get_if<std::array<float, 16>>(&found->second);
    };
    const std::array<float, 16>*const a = matrix(guides), *const b = matrix(frame);
    if (!a || !b) continue;
    float largest = 0, difference = 0;
    for (size_t i = 0; i < 16; ++i) {
      largest = std::max(largest, std::abs((*b)[i]));
      difference = std::max(difference, std::abs((*a)[i] - (*b)[i]));
    }
    if (difference > kTolerance * largest)
      throw InputError(fmt::format(
          "{}: another camera saw these guides: {} differs from that of {}; make them with brume guides --like {}",
          guides_path, key, frame_path, frame_path));
  }
}

void check_has_guides(const std::string& path, const Layers& guides) {
  if (guides.channels().empty())
    throw InputError(fmt::format(
        "{}: no channel guide.*; expected a file by brume guides, or by brume render with --layers guides", path));
}

}  // namespace

Layers read_frame(const ExrFile& file, const Host& host, const std::set<std::string>& wanted) {
  Layers frame = file.read([&](const std::string& name) { return wanted.empty() || wanted.contains(name); });
  if (frame.has(layer::beauty)) return frame;
  if (wanted.contains("R")) frame = file.read();
  if (const std::string recognised = adopt_foreign_layers(frame, &file.info()); !recognised.empty())
    host.say(Host::Word::kRemark, recognised);
  return frame;
}

std::string note_of_colors(const std::string& path, const std::map<std::string, Attribute>& header, bool guides) {
  const std::optional<Chromaticities> space = chromaticities_of(header);
  if (!space || name_of(*space) == name_of(kRec709)) return "";
  try {
    rec709_from(*space, path);
  } catch (const InputError& none) {
    return fmt::format("{}; filters take its colours for Rec. 709", none.what());
  }
  return fmt::format("{}: its colours are {}: they stay so{}", path, name_of(*space),
                     guides ? "; guides are brought to them" : "");
}

Layers part_of(const Layers& frame, const std::set<std::string>& channels) {
  Layers part = frame.without_channels();
  for (const std::string& name : channels)
    if (const Plane* const plane = frame.find(name)) part.set(name, *plane);
  return part;
}

Layers outline_of(const ExrInfo& info) {
  Layers outline(1, 1);
  outline.header = info.header;
  for (const ExrInfo::Channel& channel : info.channels) outline.add(channel.name);
  adopt_foreign_layers(outline, &info);
  return outline;
}

void PictureOptions::write(const std::filesystem::path& path, const Layers& frame, const RgbPlanes& rgb,
                           double exposure_factor, bool radiance) const {
  Layers colours(frame.width(), frame.height());
  colours.lie_like(frame);
  for (size_t c = 0; c < 3; ++c) colours.set(layer::beauty.channel(c), *rgb[c]);
  if (radiance) {
    colours.header = frame.header;
    try {
      convert_to_rec709(colours, path.string());
    } catch (const InputError&) {
      // Chromaticities that are none: shown as the numbers are, beside a file that is right.
    }
  }
  const PixelWindow shown = frame.data_window().common(frame.display_window());
  if (!shown.empty() && shown != frame.data_window()) colours = colours.cut(shown);
  const std::optional<Display> screen = radiance ? chosen_display() : std::nullopt;
  const RgbPlanes drawn = std::as_const(colours).rgb(layer::beauty);
  write_png(path, screen ? to_picture(drawn, exposure_factor, *screen)
                         : to_picture(drawn, exposure_factor, tone == "filmic" ? Tone::kFilmic : Tone::kClip));
}

std::optional<Display> PictureOptions::chosen_display() const {
  DisplaySetting setting = display;
  const char* const named = std::getenv("OCIO");
  if (setting.config.empty() && tone.empty() && named) setting.config = named;
  if (!setting.config.empty() && setting.config != "none") {
    if (!tone.empty())
      throw InputError(
          fmt::format("--tone {}: a view of {} has its own; expected one of --tone and --ocio", tone, setting.config));
    return Display(setting);
  }
  for (const auto& [option, value] : {std::pair("--display", &setting.display),
                                      {"--view", &setting.view},
                                      {"--look", &setting.look},
                                      {"--ocio-space", &setting.space}})
    if (!value->empty())
      throw InputError(fmt::format("{} {}: belongs to an OpenColorIO configuration, and none is named (--ocio, $OCIO)",
                                   option, *value));
  return std::nullopt;
}

Layers read_guide_outline(const std::string& path) {
  Layers outline(1, 1);
  if (path.empty()) return outline;
  const ExrInfo info = read_exr_info(path);
  outline.header = info.header;
  for (const ExrInfo::Channel& channel : info.channels)
    if (is_guide(channel.name)) outline.add(channel.name);
  check_has_guides(path, outline);
  return outline;
}

void add_guides(const std::string& path, const std::string& frame_path, Layers& frame) {
  if (!path.empty()) add_guides(read_guides(path).frame, {path, frame_path}, frame);
}

void add_guides(Layers guides, const std::array<std::string, 2>& names, Layers& frame) {
  const auto& [path, frame_path] = names;
  if (guides.display_window() != frame.display_window())
    throw InputError(fmt::format("{}: guides of a picture of {}, {} is one of {}", path, guides.display_window().text(),
                                 frame_path, frame.display_window().text()));
  const PixelWindow data = frame.data_window();
  if (guides.data_window().common(data) != data)
    throw InputError(fmt::format("{}: guides of the pixels {}, {} holds {}", path, guides.data_window().text(),
                                 frame_path, data.text()));
  check_same_camera(path, guides, frame_path, frame);
  if (const std::string ours = frame.text("sceneHash"), theirs = guides.text("sceneHash");
      !ours.empty() && !theirs.empty() && ours != theirs)
    throw InputError(fmt::format("{}: guides of another scene than {}", path, frame_path));
  if (guides.data_window() != data) guides = guides.cut(data);
  convert_to_rec709(guides, path);
  if (const std::optional<Chromaticities> space = frame.chromaticities())
    if (const std::optional<dmat3> matrix = rec709_from(*space, frame_path))
      convert_colors(guides, glm::inverse(*matrix),
                     [](const std::string& layer) { return layer != guide_layer::surface_material.name; });
  for (const auto& [name, plane] : guides.channels())
    if (is_guide(name)) frame.set(name, plane);
}

NamedFrame read_guides(const std::string& path) {
  NamedFrame guides{path, read_exr(path, is_guide)};
  check_has_guides(path, guides.frame);
  return guides;
}

bool of_one_scene(const Layers& guides, const Layers& frame) {
  const std::string ours = frame.text("sceneHash");
  return !ours.empty() && ours == guides.text("sceneHash");
}

std::string what_speaks_against_guides(const Layers& frame, const std::string& path, const Task& task) {
  const GuideCheck check = check_guides(frame, task);
  if (!check.misleads()) return "";
  return fmt::format(
      "{} explains the frame worse than its own features do (mean squared error at pixels left out {:.3g} and {:.3g}): are these guides of its scene, its camera, its frame? It is cleaned without them",
      path, check.guides, check.features);
}

double choose_exposure(const std::string& option, const Layers& frame) {
  if (option == "header") return frame.number("exposure").value_or(1.0);
  if (option == "auto") {
    if (!frame.has(layer::beauty)) throw InputError("--exposure auto needs the channels R, G, B");
    const auto rgb = frame.rgb(layer::beauty);
    const FrameSpace space(frame);
    std::vector<float> values;
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        const float v = space.luminance(vec3((*rgb[0])(x, y), (*rgb[1])(x, y), (*rgb[2])(x, y)));
        if (std::isfinite(v)) values.push_back(v);
      }
    if (values.empty()) return 1.0;
    const auto nth = values.begin() + static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), nth, values.end());
    return *nth > 0 ? 1.0 / *nth : 1.0;
  }
  return std::strtod(option.c_str(), nullptr);
}

}  // namespace brume

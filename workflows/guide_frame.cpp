#include "workflows/guide_frame.h"

#include <fmt/format.h>

#include "base/error.h"
#include "base/toml_text.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "render/world/volume_scene.h"
#include "workflows/version.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr int kUnknownSamples = 16;

const std::array<float, 16>* matrix(const GuidedFrame& like, const char* key) {
  const auto found = like.header.find(key);
  return found == like.header.end() ? nullptr : std::get_if<std::array<float, 16>>(&found->second);
}

/// The camera of the frame's header; null where it has none.
std::shared_ptr<const CameraMatrices> camera_of(const GuidedFrame& like) {
  const auto *const to_camera = matrix(like, "worldToCamera"), *const to_ndc = matrix(like, "worldToNDC");
  if (!to_camera || !to_ndc) return nullptr;
  return std::make_shared<const CameraMatrices>(
      CameraMatrices{like.name, like.display.width(), like.display.height(), *to_camera, *to_ndc});
}

/// What the frame and the caller say of the scene.
std::vector<std::string> overrides_for(const GuideOptions& o) {
  std::vector<std::string> overrides = {fmt::format("film.width={}", o.like.display.width()),
                                        fmt::format("film.height={}", o.like.display.height())};
  if (o.scene && !o.volume.empty())
    overrides.push_back("volumes.0.file=" + toml_string(fs::absolute(o.volume).string()));
  overrides.insert(overrides.end(), o.overrides.begin(), o.overrides.end());
  return overrides;
}

/// The fingerprint that a render of the scene has, seen by its own camera; empty where it has none.
std::string own_hash(const GuideOptions& o) {
  if (!o.scene) return "";
  try {
    return o.scenes ? o.scene->scene(overrides_for(o), *o.scenes).hash : o.scene->scene(overrides_for(o)).hash;
  } catch (const InputError&) {
    return "";  // a scene of lights and media alone
  }
}

int samples_of(const GuideOptions& o) {
  int samples = o.samples;
  if (const auto found = o.like.header.find("samplesPerPixel"); samples == 0 && found != o.like.header.end())
    if (const int* const n = std::get_if<int>(&found->second)) samples = *n;
  return samples > 0 ? samples : kUnknownSamples;
}

}  // namespace

GuidedFrame GuidedFrame::of_file(const fs::path& path) {
  read_exr(path, [](const std::string&) { return false; });  // refuses deep pixels, whose headers alone can be read
  ExrInfo info = read_exr_info(path);
  return {path.string(), info.data, info.display, std::move(info.header)};
}

GuidedFrame GuidedFrame::of(const Layers& frame, std::string name) {
  return {std::move(name), frame.data_window(), frame.display_window(), frame.header};
}

Scene guided_scene(const GuideOptions& o, const Host& host) {
  const std::string& name = o.like.name;
  const std::shared_ptr<const CameraMatrices> camera = camera_of(o.like);
  if (camera) host.log(fmt::format("camera: of {}'s header", name));
  if (o.scene) {
    if (!camera) host.log(fmt::format("camera: of {}, since {}'s header has none", o.scene->path.string(), name));
    SceneSource source = *o.scene;
    source.arrays.camera = camera;
    return o.scenes ? source.scene(overrides_for(o), *o.scenes) : source.scene(overrides_for(o));
  }
  if (o.volume.empty())
    throw InputError("neither a volume nor a scene: guides need what the frame shows, and what lights it");
  if (!camera)
    throw InputError(fmt::format(
        "{}: no camera in its header (worldToCamera and worldToNDC); write it into the [camera] of a scene and give that",
        name));
  const VolumeScene made = scene_for_volume(o.volume, overrides_for(o), host.silent());
  for (const std::string& line : made.assumptions) host.log("assumed " + line);
  host.note("what lights the volume is assumed: guides of the frame's own lights, in a scene, know more");
  SceneArrays arrays;
  arrays.camera = camera;
  return parse_scene(made.text(fs::absolute(o.volume).string()), o.volume, overrides_for(o), arrays);
}

GuideFrame guide_frame(const Scene& scene, const GuideOptions& o, const Host& host) {
  LayerRequest layers;
  layers.names = {};
  layers.guides = true;
  std::optional<PreparedScene> own;
  const PreparedScene& prepared =
      o.scenes ? o.scenes->prepare(scene, layers, host.silent()) : own.emplace(scene, layers, host.silent());
  for (const std::string& text : prepared.notes()) host.note(text);
  const int samples = samples_of(o);
  GuideFrame result;
  if (o.explain) result.explanation = prepared.explain(samples, host.silent());

  const Camera camera = prepared.camera();
  const PixelWindow &data = o.like.data, &display = o.like.display;
  Layers& frame = result.layers;
  frame = Layers(data.width(), data.height());
  if (data != display || display.lo != ivec2(0)) {
    frame.origin = data.lo;
    frame.display_origin = display.lo;
    frame.display = display.hi - display.lo;
  }
  prepared.guides(samples, host.task("light of " + scene.name))
      ->record(camera, data.lo - display.lo, frame, host.task("guides of " + scene.name));
  if (frame.channels().empty())
    throw InputError(
        fmt::format("{}: nothing in it scatters or glows", o.scene ? o.scene->path.string() : o.volume.string()));
  frame.header["scene"] = scene.name;
  describe_colors(frame, scene.film);
  frame.header["guidesOf"] = fs::path(o.like.name).filename().string();
  frame.header["guidesFingerprint"] = scene.hash;
  if (const std::string hash = own_hash(o); !hash.empty()) frame.header["sceneHash"] = hash;
  frame.header["worldToCamera"] = camera.world_to_camera();
  frame.header["worldToNDC"] = camera.world_to_ndc();
  stamp(frame);
  return result;
}

}  // namespace brume

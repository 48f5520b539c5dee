#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "image/exr_io.h"
#include "workflows/host.h"
#include "workflows/scene_source.h"

namespace brume {

/// What guides are made for: where its pixels lie, and what its header says.
struct GuidedFrame {
  std::string name;
  PixelWindow data, display;
  std::map<std::string, Attribute> header;

  /// Of any renderer. @throws InputError: missing, not an EXR, deep
  static GuidedFrame of_file(const std::filesystem::path& path);
  static GuidedFrame of(const Layers& frame, std::string name);
};

struct GuideOptions {
  GuidedFrame like;
  std::optional<SceneSource> scene;    ///< lights, media and, where the frame's header has none, the camera
  std::filesystem::path volume;        ///< instead of the scene's first one, or with assumed coefficients and lights
  std::vector<std::string> overrides;  ///< of the scene
  int samples = 0;                     ///< per pixel of the frame; 0: what its header says
  SceneCache* scenes = nullptr;        ///< keeps what is prepared, the light in it solved; null: it is dropped
  bool explain = false;                ///< fills in GuideFrame::explanation
};

struct GuideFrame {
  Layers layers;
  std::string explanation;
};

/// The scene that is solved; what of it is read. @throws InputError
Scene guided_scene(const GuideOptions& options, const Host& host);

/// Guides for a frame of any renderer: its header's camera, or the scene's, looks at the scene's media and lights.
/// @param scene  of guided_scene   @throws InputError, Interrupted
GuideFrame guide_frame(const Scene& scene, const GuideOptions& options, const Host& host);

}  // namespace brume

#pragma once
#include <set>
#include <string>

#include "app/command.h"
#include "image/layers.h"
#include "image/picture_io.h"
#include "workflows/frame.h"

namespace brume::app {

/// An EXR with brume's layer names, whoever wrote it. Says so, unless --quiet, when another renderer's are recognised.
/// @param wanted  channels to load; empty: all. Another renderer's frame is loaded whole
/// @throws InputError
Layers read_frame(const Common& common, const std::string& path, const std::set<std::string>& wanted = {});

/// The same frame with one pixel, from the file's header alone: what layers it has. @throws InputError
Layers read_outline(const std::string& path);

/// Accepts "header", "auto" or a number above 0.
CLI::Validator exposure_validator();

/// How a PNG is made of a frame: --exposure and --tone.
struct PictureOptions {
  std::string exposure = "header", tone = "clip";

  void add_to(CLI::App& command, const std::string& exposure_help);
  /// What lies inside the display window, or everything where nothing does. @throws InputError
  void write(const std::string& path, const Layers& frame, const RgbPlanes& rgb, double exposure_factor) const;
};

}  // namespace brume::app

#pragma once
#include <array>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "base/progress.h"
#include "image/display.h"
#include "image/exr_io.h"
#include "image/layers.h"
#include "workflows/host.h"

namespace brume {

/// An EXR with brume's layer names, whoever wrote it. Says so when another renderer's are recognised.
/// @param wanted  channels to load; empty: all. Another renderer's frame is loaded whole
/// @throws InputError
Layers read_frame(const ExrFile& file, const Host& host, const std::set<std::string>& wanted = {});

/// What is to be said of a frame that is cleaned and whose colours are not Rec. 709: that they stay as they are. Empty
/// for others.
/// @param guides  whether guides are given, which are brought to its colours
std::string note_of_colors(const std::string& path, const std::map<std::string, Attribute>& header, bool guides);

/// Some channels of a frame, copied; those that it does not have are left out.
Layers part_of(const Layers& frame, const std::set<std::string>& channels);

/// The same frame with one pixel, from the file's header alone: what layers it has.
Layers outline_of(const ExrInfo& info);

/// The same of a file of guides, of which nothing else is kept; nothing for an empty path.
/// @throws InputError where it has none
Layers read_guide_outline(const std::string& path);

/// Gives a frame the guides of a file, as brume guides writes it; nothing for an empty path.
/// @throws InputError where they are not guides of this frame: another size, camera or scene
void add_guides(const std::string& path, const std::string& frame_path, Layers& frame);
/// The same of guides in memory. Their colours become those that the frame's header names. @param names  by which
/// errors call the guides and the frame
void add_guides(Layers guides, const std::array<std::string, 2>& names, Layers& frame);

/// A frame, and the name by which errors call it.
struct NamedFrame {
  std::string name;
  Layers frame;
};

/// The guides of a file, under its name. @throws InputError where it has none
NamedFrame read_guides(const std::string& path);

/// Whether two headers name one scene and camera, so that nothing needs to be measured.
bool of_one_scene(const Layers& guides, const Layers& frame);

/// Whether guides explain a frame worse than its own features do, as those of another scene or camera; in one sentence,
/// empty where they do not (filters/regression/transport/guide_check.h).
/// @param frame  with R, G, B, features and guides   @param path  of the guides
std::string what_speaks_against_guides(const Layers& frame, const std::string& path, const Task& task);

/// The number that an exposure's text stands for: "header" is 1 where the header has none.
/// @throws InputError when auto has no picture to measure
double choose_exposure(const std::string& option, const Layers& frame);

/// How a PNG is made of a frame.
struct PictureOptions {
  std::string exposure = "header";  ///< as choose_exposure takes it
  std::string tone;                 ///< clip or filmic; empty: clip, unless $OCIO names a configuration
  DisplaySetting display;           ///< a configuration "none" stands for none, whatever $OCIO says

  /// For before anything is computed. @throws InputError where the display is none; a tone beside it
  void check() const { chosen_display(); }
  /// The display that shows pictures, if any. @throws InputError
  std::optional<Display> chosen_display() const;
  /// What lies inside the display window, or everything where nothing does. @throws InputError
  void write(const std::filesystem::path& path, const Layers& frame) const {
    write(path, frame, frame.rgb(layer::beauty), choose_exposure(exposure, frame));
  }
  /// @param radiance  whether rgb are colours of the space that the frame's header names
  void write(const std::filesystem::path& path, const Layers& frame, const RgbPlanes& rgb, double exposure_factor,
             bool radiance = true) const;
};

}  // namespace brume

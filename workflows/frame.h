#pragma once
#include <array>
#include <string>
#include <vector>

#include "base/progress.h"
#include "image/layers.h"

namespace brume {

/// The channels of a file of guides. @throws InputError where it has none
std::vector<std::string> guide_channels(const std::string& path);

/// Gives a frame the guides of a file, as brume guides writes it; nothing for an empty path.
/// @throws InputError where they are not guides of this frame: another size, camera or scene
void add_guides(const std::string& path, const std::string& frame_path, Layers& frame);
/// The same of guides in memory. @param names  by which errors call the guides and the frame
void add_guides(Layers guides, const std::array<std::string, 2>& names, Layers& frame);

/// Whether two headers name one scene and camera, so that nothing needs to be measured.
bool of_one_scene(const Layers& guides, const Layers& frame);

/// Whether guides explain a frame worse than its own features do, as those of another scene or camera; in one sentence,
/// empty where they do not (filters/inputs/guide_check.h).
/// @param frame  with R, G, B, features and guides   @param path  of the guides
std::string what_speaks_against_guides(const Layers& frame, const std::string& path, const Task& task);

/// The number that an exposure's text stands for: "header" is 1 where the header has none.
/// @throws InputError when auto has no picture to measure
double choose_exposure(const std::string& option, const Layers& frame);

/// A picture to compare, under the name by which errors call it.
struct NamedFrame {
  std::string name;
  Layers frame;

  /// The colours of a layer; the beauty for an empty name. @throws InputError with the layers there are
  RgbPlanes colours(const std::string& layer) const;
};

/// What is to be said where two frames were rendered from scenes that differ, so that their difference is no error
/// alone; empty: nothing, as where another renderer made one of them.
std::string remark_on_scenes(const NamedFrame& picture, const NamedFrame& reference);

/// The pixels that all pictures have: what lies outside a data window is absent, not black. Pictures are cut to them.
/// @param pictures  the reference first
/// @throws InputError for unequal display windows, and when no pixel is common
PixelWindow cut_to_common_window(const std::vector<NamedFrame*>& pictures);

}  // namespace brume

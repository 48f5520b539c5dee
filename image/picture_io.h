#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "base/progress.h"
#include "image/color_space.h"
#include "image/display.h"
#include "image/layers.h"

namespace brume {

/// An 8-bit RGB picture, for people to look at.
struct Picture {
  int width = 0, height = 0;
  std::vector<uint8_t> rgb;

  Picture(int w, int h, std::array<uint8_t, 3> colour = {255, 255, 255});
  void set(int x, int y, std::array<uint8_t, 3> colour);
  /// Copies `other` with its top left corner at (x, y); what falls outside is cut.
  void paste(const Picture& other, int x, int y);
};

/// What becomes of values above 1.
enum class Tone {
  kClip,    ///< they are 1
  kFilmic,  ///< filmic_shoulder (image/color.h) of each channel: bright colours turn white softly
};

/// Linear RGB times `exposure`, its tone, sRGB-encoded. Non-finite pixels become magenta: visible, not hidden.
Picture to_picture(const std::array<const Plane*, 3>& rgb, double exposure = 1.0, Tone tone = Tone::kClip);

/// Linear Rec. 709 times `exposure` on a display. Non-finite pixels become magenta.
Picture to_picture(const std::array<const Plane*, 3>& rgb, double exposure, const Display& display);

/// @throws InputError
void write_png(const std::filesystem::path& path, const Picture& picture);

/// Any picture a texture can be, in its own colours: EXR and Radiance HDR as linear RGB, PNG, JPEG and the like decoded
/// from sRGB, or as a PNG says (gAMA).
/// @throws InputError
Layers read_any_picture(const std::filesystem::path& path);

/// A picture that lights or colours a scene, and what had to be done to it.
struct UsablePicture {
  Layers layers;  ///< layer::beauty in the scene's space, every value finite and not negative (repair_colors)
  std::vector<std::string> notes;
};

/// @throws InputError; Interrupted
UsablePicture read_usable_picture(const std::filesystem::path& path, const WorkingSpace& space = {},
                                  const Task& task = {});

}  // namespace brume

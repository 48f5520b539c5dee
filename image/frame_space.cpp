#include "image/frame_space.h"

#include "base/error.h"
#include "image/color.h"

namespace brume {

FrameSpace::FrameSpace() : xyz_from_rgb_(xyz_from_rec709()) {}

FrameSpace::FrameSpace(const Layers& frame) : FrameSpace() {
  try {
    if (const auto space = frame.chromaticities())
      if (const auto to_rec709 = rec709_from(*space, "frame")) xyz_from_rgb_ = xyz_from_rec709() * *to_rec709;
  } catch (const InputError&) {
  }
}

}  // namespace brume

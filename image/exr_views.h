#pragma once
#include <string>
#include <vector>

#include "image/exr_io.h"

namespace brume {

/// One view (eye) of a file, or all of a file that has none: its channels by layer, whichever part they lie in.
struct ExrView {
  struct Channel {
    std::string name;     ///< "albedo.R": without the names of view and beauty part
    std::string in_file;  ///< "albedo_left.R": as read_exr names it
    std::string type;
  };
  std::string name;  ///< "left"; empty where the file has one view, and for what belongs to none
  std::vector<Channel> channels;
};

/// The views of a file in its order, at least one. A view is told by the attribute `view` of a part, by `multiView` and
/// a channel named LAYER.VIEW.CHANNEL, or by a part's name that ends or begins with left or right: `rgba_left`. A
/// channel's layer is what its name says, and where that has none the name of its part without the view; the part
/// `rgba`, `rgb` or `main` is the layer on top. Source: OpenEXR, Storing Multi-View Images.
std::vector<ExrView> views_of(const ExrInfo& file);

}  // namespace brume

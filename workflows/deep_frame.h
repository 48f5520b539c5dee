#pragma once
#include <filesystem>

#include "image/deep_picture.h"
#include "render/guides/deep_pixels.h"
#include "workflows/host.h"

namespace brume {

/// A frame's picture at the depths of its parts: each has the share of the picture's light that it has of the predicted
/// light, so that the deep picture flattened is the frame's. The frame's alpha becomes that of the parts, which has no
/// noise. Samples are tidy, colours multiplied by their alpha, depths are along the camera's axis.
/// @param type  of colours and alpha; depths are floats
DeepPicture deep_frame(const DeepRecord& parts, Layers& frame, DeepPicture::Channel::Type type);

/// Flattens a deep EXR, of whichever program. @throws InputError
Layers flattened_file(const std::filesystem::path& deep, const Host& host);

}  // namespace brume

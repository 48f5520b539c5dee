#pragma once
#include <filesystem>

#include "image/deep_picture.h"
#include "render/guides/deep_pixels.h"
#include "render/scene/scene.h"
#include "workflows/denoise_frame.h"
#include "workflows/host.h"

namespace brume {

/// A frame's picture at the depths of its parts: each has the share of the picture's light that it has of the predicted
/// light, so that the deep picture flattened is the frame's. The frame's alpha becomes that of the parts, which has no
/// noise. Samples are tidy, colours multiplied by their alpha, depths are along the camera's axis.
/// @param type  of colours and alpha; depths are floats. A half's largest alpha below 1 is 1 - 1/2048
DeepPicture deep_frame(const DeepRecord& parts, Layers& frame, DeepPicture::Channel::Type type);

/// Adds the layers depth_mean, depth_half, depth_first and mist (image/deep_picture.h) to a frame. Depths are along the
/// camera's axis; mist grows with the distance from a perspective camera, as in Blender.
void add_depths(const DeepRecord& parts, const Scene& scene, Layers& frame);

/// Cleans a deep EXR of whichever program: its flat picture is cleaned as a frame in memory is, its samples keep depth
/// and alpha and take the clean picture's colours (recolour).
/// @throws InputError also for options that deep files do not have
void denoise_deep(const FrameFiles& files, const DenoiseOptions& options, const Host& host);

/// Flattens a deep EXR, of whichever program. @param before  only what is in front of this depth   @throws InputError
Layers flattened_file(const std::filesystem::path& deep, float before, const Host& host);

}  // namespace brume

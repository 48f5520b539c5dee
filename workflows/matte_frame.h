#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "image/cryptomatte.h"
#include "image/picture_io.h"
#include "render/guides/matte_pixels.h"
#include "render/transport/path_sample.h"
#include "workflows/host.h"

namespace brume {

/// Adds the layers CryptoObject and CryptoMaterial to a frame, as far as they are asked for. The frame's alpha becomes
/// what the mattes add up to, which has no noise.
/// @param keep_alpha  it has none already, as that of a deep picture: the mattes add up to it
void add_mattes(const MatteRecord& record, const LayerRequest& layers, const RenderSettings& settings, bool keep_alpha,
                Layers& frame);

/// A matte as a mask of 8 bits, not as light: 255 is all of a pixel.
Picture mask_of(const Layers& matte);

/// The matte of some things in a frame of whichever program, with R, G, B and A all alike.
/// @param layer  that has them; empty: any   @throws InputError
Layers matte_of_file(const std::filesystem::path& frame, const std::vector<std::string>& names,
                     const std::string& layer);

}  // namespace brume

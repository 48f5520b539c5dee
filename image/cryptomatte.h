#pragma once
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "image/layers.h"

// Cryptomatte: layers that tell for each pixel which things cover it, and how much of it each does, by the hashes of
// their names. Source: Psyop, Cryptomatte Specification 1.2.0.

namespace brume {

/// The hash of a name, UTF-8: MurmurHash3_x86_32 with seed 0.
uint32_t matte_hash(std::string_view name);
/// The number that stands for a name in the pixels: the hash's bits, but that it is neither subnormal nor infinite nor
/// no number.
float matte_id(std::string_view name);
/// The same in eight hexadecimal digits, as manifests have it; and back. @return 0 for what is no such number
std::string matte_hex(float id);
float matte_of_hex(std::string_view hex);

/// What covers a pixel: a name's number, and its share.
struct MatteShare {
  float id, coverage;
};

/// A Cryptomatte layer of a frame: "CryptoObject", or "ViewLayer.CryptoObject".
struct MatteLayer {
  std::string name;
  std::string key;                             ///< of its attributes, "cryptomatte/KEY/name"
  std::map<std::string, float> manifest = {};  ///< numbers by name; empty where the file has none
  std::string manifest_file = {};              ///< beside the picture, where the manifest is not in its header
  std::string problem = {};                    ///< why it cannot be read; empty: it can
  /// Full names of channels: a number, and the coverage that belongs to it.
  std::vector<std::pair<std::string, std::string>> ranks = {};
};

/// The layers that a header names, in the order of their names, with the channels that hold their ranks.
std::vector<MatteLayer> matte_layers(const std::map<std::string, Attribute>& header,
                                     const std::vector<std::string>& channels);
/// The channels of their ranks among those of a frame.
std::vector<std::string> matte_channels(const Layers& frame);
/// Reads the manifests that lie beside a picture. Where one cannot be read `problem` says so, and none is there.
void read_manifests(std::vector<MatteLayer>& layers, const std::filesystem::path& picture);

/// Adds a layer to a frame. @param levels  shares that a pixel keeps at most, the largest
/// @param shares  of each pixel, row by row; of one name once
void add_matte_layer(const std::string& name, int levels, const std::vector<std::string>& names,
                     const std::vector<std::vector<MatteShare>>& shares, Layers& frame);

/// What some things cover of each pixel. @param frame  with the layer's channels
Plane matte(const Layers& frame, const MatteLayer& layer, const std::vector<float>& ids);

/// The numbers of things by their names; `*` in a name stands for anything. Of a layer without manifest, hashes.
/// @throws InputError for one that the manifest has not
std::vector<float> matte_ids(const MatteLayer& layer, const std::vector<std::string>& names);

/// The same of a frame: the layer that has all of the names, or of several that have them, the one that is named.
/// @param layer  its name, or what stands behind its last dot; empty: any
/// @throws InputError: no such layer, no such name, several layers
Plane matte_of(const Layers& frame, const std::vector<MatteLayer>& layers, const std::vector<std::string>& names,
               const std::string& layer);

}  // namespace brume

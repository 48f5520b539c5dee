#include "workflows/matte_frame.h"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.h"
#include "image/exr_io.h"

namespace brume {
namespace {

/// The shares of a pixel's things under their names. @param names  by thing
std::vector<MatteShare> shares_of(const std::vector<MatteRecord::Share>& pixel, const std::vector<float>& ids,
                                  double scale) {
  std::vector<MatteShare> shares;
  for (const MatteRecord::Share& share : pixel) {
    const auto own = static_cast<float>(share.coverage * scale);
    const float id = ids[share.thing];
    const auto same = std::find_if(shares.begin(), shares.end(), [&](const MatteShare& s) { return s.id == id; });
    if (same == shares.end())
      shares.push_back({id, own});
    else
      same->coverage += own;
  }
  return shares;
}

}  // namespace

void add_mattes(const MatteRecord& record, const LayerRequest& layers, const RenderSettings& settings, bool keep_alpha,
                Layers& frame) {
  Plane& alpha = frame.add(layer::alpha.channel(0));
  std::vector<double> scales(record.pixels.size(), 1.0);
  for (size_t i = 0; i < record.pixels.size(); ++i) {
    double sum = 0;
    for (const MatteRecord::Share& share : record.pixels[i]) sum += static_cast<double>(share.coverage);
    float& own = alpha(static_cast<int>(i) % frame.width(), static_cast<int>(i) / frame.width());
    if (!keep_alpha)
      own = static_cast<float>(std::min(sum, 1.0));
    else if (sum > 0)
      scales[i] = static_cast<double>(own) / sum;
  }
  const auto add = [&](const char* name, std::string MatteRecord::Thing::*called) {
    std::vector<float> ids;
    std::vector<std::string> names;
    for (const MatteRecord::Thing& thing : record.things) {
      names.push_back(thing.*called);
      ids.push_back(matte_id(thing.*called));
    }
    std::vector<std::vector<MatteShare>> shares;
    for (size_t i = 0; i < record.pixels.size(); ++i) shares.push_back(shares_of(record.pixels[i], ids, scales[i]));
    add_matte_layer(name, settings.cryptomatte_levels, names, shares, frame);
  };
  if (layers.matte_objects) add("CryptoObject", &MatteRecord::Thing::object);
  if (layers.matte_materials) add("CryptoMaterial", &MatteRecord::Thing::material);
}

Picture mask_of(const Layers& matte) {
  Picture picture(matte.width(), matte.height());
  const Plane& share = matte.at(layer::alpha.channel(0));
  for (int y = 0; y < matte.height(); ++y)
    for (int x = 0; x < matte.width(); ++x) {
      const auto value = static_cast<uint8_t>(255 * std::clamp(share(x, y), 0.0f, 1.0f) + 0.5f);
      picture.set(x, y, {value, value, value});
    }
  return picture;
}

Layers matte_of_file(const std::filesystem::path& path, const std::vector<std::string>& names,
                     const std::string& layer) {
  const ExrFile file(path);
  std::vector<std::string> channels;
  for (const ExrInfo::Channel& channel : file.info().channels) channels.push_back(channel.name);
  std::vector<MatteLayer> layers = matte_layers(file.info().header, channels);
  read_manifests(layers, path);
  const Layers frame = file.read([&](const std::string& channel) {
    return std::any_of(layers.begin(), layers.end(), [&](const MatteLayer& l) { return channel.starts_with(l.name); });
  });
  try {
    const Plane sum = matte_of(frame, layers, names, layer);
    Layers result = frame.without_channels();
    result.header.clear();
    for (const char* channel : {"R", "G", "B", "A"}) result.set(channel, sum);
    result.header["brume.matte"] = fmt::format("{}", fmt::join(names, ", "));
    return result;
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", path.string(), error.what()));
  }
}

}  // namespace brume

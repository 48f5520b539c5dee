#include "image/recognise/channels.h"

namespace brume::recognition {
namespace {

/// The second moment of a layer: of its colours, or of its CIE XYZ.
std::optional<ForeignVariance> mitsuba_moment(const Channels& file, const std::string& prefix) {
  const auto squares = file.colour("m2_" + prefix);
  if (squares && !prefix.empty())
    return ForeignVariance{.channels = listed(*squares), .meaning = VarianceMeaning::kSecondMoment};
  // Beside colours on top stands the moment of the integrator inside, of one name that the user chose.
  std::vector<std::string> inside;
  for (const std::string& name : file.before("X"))
    if (name.starts_with("m2_") && (prefix.empty() || name == "m2_" + prefix)) inside.push_back(name.substr(3));
  for (const std::string& layer : inside) {
    const auto xyz = file.vector(layer), moment = file.vector("m2_" + layer);
    // An integrator's name stands alone; those of its layers follow it.
    if (xyz && moment && std::count(layer.begin(), layer.end(), '.') == 1)
      return ForeignVariance{.channels = listed(*moment), .meaning = VarianceMeaning::kSecondMoment, .xyz = xyz};
  }
  return std::nullopt;
}

}  // namespace

std::vector<ForeignFrame> mitsuba(const Channels& file, const ExrInfo& info) {
  const bool moments = file.any([](const std::string& name) { return name.starts_with("m2_"); });
  const std::vector<std::string> distances = file.before("T");
  if (!moments && distances.empty()) return {};
  std::vector<std::string> prefixes;
  if (file.colour("")) prefixes.push_back("");
  for (const std::string& prefix : file.before("A"))
    if (!prefix.empty() && !prefix.starts_with("m2_") && file.colour(prefix)) prefixes.push_back(prefix);
  std::vector<ForeignFrame> pictures;
  for (const std::string& prefix : prefixes) {
    ForeignFrame p{.renderer = "Mitsuba 3", .view = without_dot(prefix), .target = *file.colour(prefix)};
    p.color = {.name = prefix.empty() ? "RGB" : without_dot(prefix), .channels = p.target};
    p.color.variance = mitsuba_moment(file, prefix);
    add_alpha(file, p, prefix);
    if (distances.size() == 1) add_depth(p, distances[0] + "T");
    for (const char* name : {"samplesPerPixel", "spp", "sample_count"})
      if (p.samples <= 0) p.samples = header_number(info, name);
    pictures.push_back(std::move(p));
  }
  return pictures;
}

}  // namespace brume::recognition

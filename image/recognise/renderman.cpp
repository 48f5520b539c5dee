#include "image/recognise/channels.h"

namespace brume::recognition {
namespace {

std::optional<ForeignVariance> renderman_variance(const Channels& file, const std::string& layer, bool vector) {
  const auto channels = [&](const std::string& name) {
    return vector ? file.vector(name + ".") : file.colour(name + ".");
  };
  const bool beauty = layer == "Ci";
  for (const std::string& name : beauty ? std::vector<std::string>{"Ci_mse", "mse"} : std::vector{layer + "_mse"})
    if (const auto mse = channels(name))
      return ForeignVariance{.channels = listed(*mse), .meaning = VarianceMeaning::kOfMean};
  for (const std::string& name : beauty ? std::vector<std::string>{"Ci_var", "variance"} : std::vector{layer + "_var"})
    if (const auto var = channels(name))
      return ForeignVariance{.channels = listed(*var), .meaning = VarianceMeaning::kOfSamples};
  return std::nullopt;
}

void add_renderman_statistics(const Channels& file, const std::string& layer, ForeignSignal& signal) {
  signal.variance = renderman_variance(file, layer, false);
  const auto even = file.colour(layer + "_even."), odd = file.colour(layer + "_odd.");
  if (even && odd) signal.halves = {*even, *odd};
}

}  // namespace

std::vector<ForeignFrame> renderman(const Channels& file, const ExrInfo& info) {
  const bool typical = file.any([](const std::string& name) {
    const std::string layer = name.substr(0, name.rfind('.'));
    return layer == "mse" || layer == "sampleCount" || layer.ends_with("_mse") || layer.ends_with("_var") ||
           layer.ends_with("_even");
  });
  const auto ci = file.colour("Ci."), top = file.colour("");
  if (!(ci || top) || !(ci || typical)) return {};
  ForeignFrame p{.renderer = "RenderMan", .target = ci ? *ci : *top};
  if (ci && top) p.alike.push_back(*top);
  p.color = {.name = ci ? "Ci" : "RGB", .channels = p.target};
  add_renderman_statistics(file, "Ci", p.color);
  for (const char* name : {"diffuse", "specular"})
    if (const auto channels = file.colour(name + std::string("."))) {
      ForeignSignal& pass = p.passes.emplace_back(ForeignSignal{.name = name, .channels = *channels});
      add_renderman_statistics(file, name, pass);
    }
  add_alpha(file, p, ci ? "Ci." : "");
  if (p.alpha.empty()) p.alpha = file.single("a");
  if (const auto albedo = file.colour("albedo."))
    p.features.push_back({layer::albedo, listed(*albedo), renderman_variance(file, "albedo", false)});
  if (const auto normal = file.vector("normal."))
    p.features.push_back({layer::normal, listed(*normal), renderman_variance(file, "normal", true)});
  add_depth(p, file.single("zfiltered"));
  p.sample_count = file.single("sampleCount");
  p.samples = header_number(info, "samplesPerPixel");
  return {p};
}

}  // namespace brume::recognition

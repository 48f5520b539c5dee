#include "evaluate/protocol/results.h"

#include <algorithm>
#include <cctype>

#include "image/light_layers.h"

namespace brume {

const char* tuning_name(Tuning tuning) {
  constexpr const char* kNames[] = {"-", "paper", "default", "searched", "transfer"};
  return kNames[static_cast<size_t>(tuning)];
}

const char* region_name(Region region) {
  return region == Region::kFrame ? "frame" : "medium";
}

std::string MethodResult::id() const {
  std::string text = filter.empty() ? "noisy" : filter + "_" + tuning_name(tuning);
  for (char& c : text)
    if (!std::isalnum(static_cast<unsigned char>(c)) && std::string("-._").find(c) == std::string::npos) c = '_';
  return text;
}

std::vector<double> MethodResult::values(Region region, double Errors::*metric) const {
  std::vector<double> list;
  for (const Errors& e : errors[static_cast<size_t>(region)]) list.push_back(e.*metric);
  return list;
}

std::vector<double> MethodResult::passes(Region region) const {
  std::vector<double> sums;
  size_t groups = 0;
  for (const auto& [light, by_region] : lights) {
    if (!light.starts_with(kLightPrefix)) continue;
    const std::vector<double> group = values_of(by_region[static_cast<size_t>(region)], kLabRms);
    sums.resize(group.size());
    for (size_t seed = 0; seed < group.size(); ++seed) sums[seed] += group[seed];
    ++groups;
  }
  for (double& sum : sums) sum /= static_cast<double>(groups);
  return sums;
}

const MethodResult* SceneResult::find(const std::string& filter, Tuning tuning, int spp) const {
  for (const MethodResult& m : methods)
    if (m.filter == filter && m.tuning == tuning && m.spp == spp) return &m;
  return nullptr;
}

bool SceneResult::repeats_default(const MethodResult& method) const {
  if (method.tuning != Tuning::kPaper) return false;
  const MethodResult* ours = find(method.filter, Tuning::kDefault, method.spp);
  return ours && ours->parameters == method.parameters;
}

std::optional<double> SceneResult::reference_error(const Judgement& by) const {
  const auto region = static_cast<size_t>(by.region);
  if (region >= reference_errors.size() || reference_errors[region].pixels == 0 || by.info().noise_power == 0)
    return std::nullopt;
  return values_of({reference_errors[region]}, by.metric)[0];
}

std::vector<int> spp_of(const SceneResult& scene) {
  std::vector<int> list;
  for (const MethodResult& m : scene.methods)
    if (std::find(list.begin(), list.end(), m.spp) == list.end()) list.push_back(m.spp);
  return list;
}

}  // namespace brume

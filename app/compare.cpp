#include <fmt/format.h>

#include <cstdlib>

#include "app/command.h"
#include "app/frame.h"
#include "base/error.h"
#include "base/text.h"
#include "evaluate/metric.h"

namespace brume::app {
namespace {

struct Options {
  std::string picture, reference, second, layer, exposure = "header";
  bool no_clip = false;
  std::vector<std::string> limits;
} o;

RgbPlanes planes(const Layers& frame, const std::string& path) {
  const LayerName name{o.layer, "RGB", ""};
  if (!frame.has(name))
    throw InputError(fmt::format("{}: has no layer '{}'; it has: {}", path, name.label(), join(layer_names(frame))));
  return frame.rgb(name);
}

nlohmann::json to_json(const Errors& e) {
  nlohmann::json j;
  for (const auto& [name, value] : listed(e)) j[name] = value;
  j["pixels"] = e.pixels;
  return j;
}

/// "lab_rms=0.5" over the whole frame: the metrics that are above their limit.
std::vector<std::string> exceeded(const Errors& e) {
  std::vector<std::string> names, failures;
  const auto values = listed(e);
  for (const auto& [name, value] : values) names.push_back(name);
  for (const std::string& limit : o.limits) {
    const size_t equals = limit.find('=');
    char* end = nullptr;
    const double bound = equals == std::string::npos ? 0 : std::strtod(limit.c_str() + equals + 1, &end);
    if (!end || *end || end == limit.c_str() + equals + 1)
      throw InputError(fmt::format("--max {}: expected METRIC=NUMBER", limit));
    const std::string name = limit.substr(0, equals);
    const auto it = std::find(names.begin(), names.end(), name);
    if (it == names.end())
      throw InputError(fmt::format("--max {}: no metric '{}'{}", limit, name, suggestion(name, names)));
    const double value = values[static_cast<size_t>(it - names.begin())].second;
    if (!(std::abs(value) <= bound)) failures.push_back(fmt::format("{} is {:.6g}, above {:.6g}", name, value, bound));
  }
  return failures;
}

int run(const Common& common) {
  const Layers picture = read_frame(o.picture), reference = read_frame(o.reference);
  if (picture.width() != reference.width() || picture.height() != reference.height())
    throw InputError(fmt::format("{} is {} x {}, {} is {} x {}; expected one size", o.picture, picture.width(),
                                 picture.height(), o.reference, reference.width(), reference.height()));
  Layers second;
  RgbPlanes second_planes{};
  if (!o.second.empty()) {
    second = read_frame(o.second);
    if (second.width() != reference.width() || second.height() != reference.height())
      throw InputError(fmt::format("{} is {} x {}, {} is {} x {}; expected one size", o.second, second.width(),
                                   second.height(), o.reference, reference.width(), reference.height()));
    second_planes = planes(second, o.second);
  }
  LabPolicy policy{choose_exposure(o.exposure, reference), !o.no_clip};
  const RgbPlanes x = planes(picture, o.picture), r = planes(reference, o.reference);
  const RgbPlanes* r2 = o.second.empty() ? nullptr : &second_planes;
  const Errors whole = compare(x, r, policy, {}, r2);
  const Mask mask = medium_mask(reference);
  const Errors medium = mask.empty() ? Errors{} : compare(x, r, policy, mask, r2);

  if (common.json) {
    nlohmann::json j = {{"picture", o.picture},
                        {"reference", o.reference},
                        {"policy", policy.text()},
                        {"reference_noise_removed", r2 != nullptr},
                        {"metrics", to_json(whole)}};
    if (!mask.empty()) j["medium"] = to_json(medium);
    print(j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
  } else {
    std::string text =
        fmt::format("{:<20}{:>14}{}\n", "", "whole frame", mask.empty() ? "" : fmt::format("{:>14}", "medium"));
    const auto a = listed(whole), b = listed(medium);
    for (size_t i = 0; i < a.size(); ++i)
      text += fmt::format("{:<20}{:>14.6g}{}\n", a[i].first, a[i].second,
                          mask.empty() ? "" : fmt::format("{:>14.6g}", b[i].second));
    text += fmt::format("{:<20}{:>14}{}\nLab: {}{}\n", "pixels", whole.pixels,
                        mask.empty() ? "" : fmt::format("{:>14}", medium.pixels), policy.text(),
                        r2 ? "; reference noise removed by two references" : "");
    print(text);
  }
  const std::vector<std::string> failures = exceeded(whole);
  for (const std::string& failure : failures) warn(failure);
  return failures.empty() ? kDone : kThresholdFailed;
}

}  // namespace

void add_compare(CLI::App& app, Common& common, Commands& commands) {
  CLI::App* command = add_command(app, common, "compare", "error measures of a picture against a reference");
  command->add_option("picture", o.picture, "EXR to judge")->required();
  command->add_option("reference", o.reference, "EXR it should equal")->required();
  command->add_option("--second-reference", o.second, "an independent reference, to take the references' noise off");
  command->add_option("--layer", o.layer, "layer to compare; the beauty without it");
  command
      ->add_option("--exposure", o.exposure,
                   "number, header, or auto: the reference's 99th luminance percentile becomes 1")
      ->capture_default_str();
  command->add_flag("--no-clip", o.no_clip, "do not clip to [0, 1] before CIE-Lab");
  command->add_option("--max", o.limits, "fail with exit status 1 above a limit: --max lab_rms=0.5")
      ->allow_extra_args(false);
  command->add_flag("--json", common.json, "as one JSON object");
  commands[command] = [&common] { return run(common); };
}

}  // namespace brume::app

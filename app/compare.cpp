#include <fmt/format.h>

#include <cstdlib>
#include <optional>

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
  const auto read = [&](const std::string& path) { return NamedFrame{path, read_frame(common, path)}; };
  NamedFrame picture = read(o.picture), reference = read(o.reference);
  std::optional<NamedFrame> second;
  if (!o.second.empty()) second = read(o.second);
  std::vector<NamedFrame*> pictures = {&reference, &picture};
  if (second) pictures.push_back(&*second);
  const PixelWindow window = cut_to_common_window(pictures);
  const PixelWindow display = reference.frame.display_window();
  const LabPolicy policy{choose_exposure(o.exposure, reference.frame), !o.no_clip};
  const RgbPlanes x = picture.colours(o.layer), r = reference.colours(o.layer);
  const RgbPlanes second_planes = second ? second->colours(o.layer) : RgbPlanes{};
  const RgbPlanes* r2 = second ? &second_planes : nullptr;
  const Errors whole = compare(x, r, policy, {}, r2);
  const Mask mask = medium_mask(reference.frame);
  const Errors medium = mask.empty() ? Errors{} : compare(x, r, policy, mask, r2);

  if (common.json) {
    nlohmann::json j = {{"picture", o.picture},
                        {"reference", o.reference},
                        {"policy", policy.text()},
                        {"window", {window.lo.x, window.lo.y, window.hi.x, window.hi.y}},
                        {"reference_noise_removed", r2 != nullptr},
                        {"metrics", to_json(whole)}};
    if (!mask.empty()) j["medium"] = to_json(medium);
    print(j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
  } else {
    std::string text = fmt::format("{:<20}{:>14}{}\n", "", window == display ? "whole frame" : "data window",
                                   mask.empty() ? "" : fmt::format("{:>14}", "medium"));
    const auto a = listed(whole), b = listed(medium);
    for (size_t i = 0; i < a.size(); ++i)
      text += fmt::format("{:<20}{:>14.6g}{}\n", a[i].first, a[i].second,
                          mask.empty() ? "" : fmt::format("{:>14.6g}", b[i].second));
    text += fmt::format("{:<20}{:>14}{}\nLab: {}{}\n", "pixels", whole.pixels,
                        mask.empty() ? "" : fmt::format("{:>14}", medium.pixels), policy.text(),
                        r2 ? "; reference noise removed by two references" : "");
    if (window != display)
      text += fmt::format("over the common data window {}; the display window is {}\n", window.text(), display.text());
    print(text);
  }
  const std::vector<std::string> failures = exceeded(whole);
  for (const std::string& failure : failures) warn(failure);
  return failures.empty() ? kDone : kThresholdFailed;
}

}  // namespace

void add_compare(CLI::App& app, Common& common, Commands& commands) {
  CLI::App* command = add_command(app, common, "compare",
                                  "error measures of a picture against a reference, over the pixels that both have");
  command->add_option("picture", o.picture, "EXR to judge")->required();
  command->add_option("reference", o.reference, "EXR it should equal")->required();
  command->add_option("--second-reference", o.second, "an independent reference, to take the references' noise off");
  command->add_option("--layer", o.layer, "layer to compare; the beauty without it");
  command
      ->add_option("--exposure", o.exposure,
                   "number, header, or auto: the reference's 99th luminance percentile becomes 1")
      ->check(exposure_validator())
      ->capture_default_str();
  command->add_flag("--no-clip", o.no_clip, "do not clip to [0, 1] before CIE-Lab");
  command->add_option("--max", o.limits, "fail with exit status 1 above a limit: --max lab_rms=0.5")
      ->allow_extra_args(false);
  command->add_flag("--json", common.json, "as one JSON object");
  commands[command] = [&common] { return run(common); };
}

}  // namespace brume::app

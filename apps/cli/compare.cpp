#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <optional>

#include "apps/cli/command.h"
#include "apps/cli/frame.h"
#include "base/error.h"
#include "base/output_file.h"
#include "base/sequence.h"
#include "base/text.h"
#include "evaluate/metrics/temporal.h"
#include "evaluate/report/contact_sheet.h"
#include "workflows/comparison.h"

namespace brume::app {
namespace {

struct Options {
  std::string picture, reference, second, layer, exposure = "header";
  bool no_clip = false, each_layer = false;
  std::vector<std::string> limits, floors;
  std::string frames, contact_sheet;
};

nlohmann::json to_json(const Errors& e) {
  nlohmann::json j;
  for (const auto& [name, value] : listed(e)) j[name] = value;
  j["pixels"] = e.pixels;
  return j;
}

/// "lab_rms=0.5" over the whole frame: what is said of the metrics beyond their limits.
std::vector<std::string> beyond(const Errors& e, const std::vector<std::string>& limits, bool above) {
  const char* option = above ? "--max" : "--min";
  std::vector<std::string> names, failures;
  const auto values = listed(e);
  for (const auto& [name, value] : values) names.push_back(name);
  for (const std::string& limit : limits) {
    const size_t equals = limit.find('=');
    char* end = nullptr;
    const double bound = equals == std::string::npos ? 0 : std::strtod(limit.c_str() + equals + 1, &end);
    if (!end || *end || end == limit.c_str() + equals + 1)
      throw InputError(fmt::format("{} {}: expected METRIC=NUMBER", option, limit));
    const std::string name = limit.substr(0, equals);
    const auto it = std::find(names.begin(), names.end(), name);
    if (it == names.end())
      throw InputError(fmt::format("{} {}: no metric '{}'{}", option, limit, name, suggestion(name, names)));
    const auto index = static_cast<size_t>(it - names.begin());
    const double value = values[index].second;
    if ((all_metrics()[index].better == Better::kHigher) == above)
      throw InputError(fmt::format("{} {}: {} values of {} are better; use {} {}", option, limit,
                                   above ? "higher" : "lower", name, above ? "--min" : "--max", limit));
    if (above ? !(std::abs(value) <= bound) : !(value >= bound))
      failures.push_back(fmt::format("{} is {:.6g}, {} {:.6g}", name, value, above ? "above" : "below", bound));
  }
  return failures;
}

/// What was compared, over the whole picture and, where it is known, the medium.
struct Compared {
  std::string layer;
  std::vector<Errors> regions;
};

std::string table_of(const Compared& compared, bool named, const char* first_region) {
  const bool medium = compared.regions.size() > 1;
  const auto cell = [&](double value) { return fmt::format("{:>14.6g}", value); };
  std::string text = fmt::format("{:<20}{:>14}{}\n", named ? LayerName{compared.layer, "RGB", ""}.label() : "",
                                 first_region, medium ? fmt::format("{:>14}", "medium") : "");
  const auto a = listed(compared.regions[0]), b = listed(compared.regions.back());
  for (size_t i = 0; i < a.size(); ++i)
    text += fmt::format("{:<20}{}{}\n", a[i].first, cell(a[i].second), medium ? cell(b[i].second) : "");
  return text + fmt::format("{:<20}{:>14}{}\n", "pixels", compared.regions[0].pixels,
                            medium ? fmt::format("{:>14}", compared.regions[1].pixels) : "");
}

/// The pictures that the command line names. @param frame  of sequences; nothing: names are files
Comparison read_pictures(const Options& o, std::optional<int> frame, const Host& host) {
  const auto read = [&](const std::string& name) {
    const std::string path = frame ? file_of_frame(name, *frame).string() : name;
    return NamedFrame{path, read_frame(path, host)};
  };
  NamedFrame picture = read(o.picture), reference = read(o.reference);
  std::optional<NamedFrame> second;
  if (!o.second.empty()) second = read(o.second);
  return Comparison(std::move(picture), std::move(reference), std::move(second), host);
}

int run(const Options& o, const Common& common) {
  const Host host = make_host(common);
  const Comparison pictures = read_pictures(o, std::nullopt, host);
  const LabPolicy policy = pictures.policy(o.exposure, !o.no_clip);
  const PixelWindow& window = pictures.window();
  std::vector<Compared> all;
  const auto add = [&](const std::string& layer) {
    all.push_back({layer, pictures.errors(layer, policy, ErrorScope::kAll, host.silent())});
  };
  add(o.layer);
  if (o.each_layer)
    for (const std::string& name : pictures.common_layers())
      if (name != o.layer) add(name);
  const bool medium = !pictures.medium().empty(), two = !o.second.empty();

  const Errors& whole = all.front().regions.front();
  if (common.json) {
    nlohmann::json j = {
        {"picture", o.picture},           {"reference", o.reference},
        {"policy", policy.text()},        {"window", {window.lo.x, window.lo.y, window.hi.x, window.hi.y}},
        {"reference_noise_removed", two}, {"metrics", to_json(whole)}};
    if (medium) j["medium"] = to_json(all.front().regions[1]);
    for (size_t i = 1; i < all.size(); ++i) {
      j["layers"][all[i].layer]["metrics"] = to_json(all[i].regions[0]);
      if (medium) j["layers"][all[i].layer]["medium"] = to_json(all[i].regions[1]);
    }
    print(j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
  } else {
    std::string text;
    for (const Compared& compared : all)
      text += table_of(compared, all.size() > 1, pictures.is_whole() ? "whole frame" : "data window");
    text += fmt::format("Lab: {}{}\n", policy.text(), two ? "; reference noise removed by two references" : "");
    if (!pictures.is_whole())
      text += fmt::format("over the common data window {}; the display window is {}\n", window.text(),
                          pictures.display().text());
    print(text);
  }
  std::vector<std::string> failures = beyond(whole, o.limits, /*above=*/true);
  for (std::string& failure : beyond(whole, o.floors, /*above=*/false)) failures.push_back(std::move(failure));
  for (const std::string& failure : failures) warn(failure);
  return failures.empty() ? kDone : kThresholdFailed;
}

/// Root of the mean of squares: of errors that are roots themselves.
double root_mean_square(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return std::sqrt(sum / static_cast<double>(values.size()));
}

/// How a picture errs over a sequence, and how much it flickers.
struct SequenceErrors {
  std::vector<double> lab_rms;  // of each frame
  TemporalError temporal;

  explicit SequenceErrors(const LabPolicy& policy) : temporal(policy) {}
  nlohmann::json json() const {
    nlohmann::json j = {{"lab_rms", root_mean_square(lab_rms)}, {"lab_rms_of_frames", lab_rms}};
    if (const auto t = temporal.result())
      j.update({{"temporal_error", t->temporal_error}, {"flicker", t->flicker}, {"reference_change", t->reference}});
    return j;
  }
};

int run_sequence(const Options& o, const Common& common) {
  if (!o.layer.empty() || o.each_layer)
    throw InputError("--frames compares the beauty of a sequence; leave out layers");
  const std::vector<int> frames = parse_frames(o.frames);
  const Host host = make_host(common);
  if (!o.contact_sheet.empty()) check_writable(o.contact_sheet, {}, ".png");
  std::optional<ContactSheet> sheet;
  std::optional<LabPolicy> policy;
  std::optional<SequenceErrors> whole, medium;
  std::vector<std::string> failures;
  for (const int number : frames) {
    const Comparison pictures = read_pictures(o, number, host);
    if (!policy) policy = pictures.policy(o.exposure, !o.no_clip);
    const RgbPlanes x = pictures.picture(), r = pictures.reference(), second = pictures.second();
    const RgbPlanes* r2 = o.second.empty() ? nullptr : &second;
    const Mask& mask = pictures.medium();
    const std::vector<Errors> errors = pictures.errors("", *policy, ErrorScope::kPixels, host.silent());
    if (!whole) whole.emplace(*policy);
    whole->lab_rms.push_back(errors[0].lab_rms);
    whole->temporal.add(x, r, r2, {});
    if (!o.contact_sheet.empty()) {
      if (!sheet) sheet.emplace(*policy, static_cast<int>(frames.size()));
      sheet->add(number, x, r, errors[0].lab_rms, whole->temporal.last_change());
    }
    if (!mask.empty()) {
      if (!medium) medium.emplace(*policy);
      medium->lab_rms.push_back(errors[1].lab_rms);
      medium->temporal.add(x, r, r2, mask);
    }
    for (const auto& [list, above] : {std::pair(&o.limits, true), {&o.floors, false}})
      for (const std::string& failure : beyond(errors[0], *list, above))
        failures.push_back(fmt::format("frame {}: {}", number, failure));
  }
  if (medium && medium->lab_rms.size() != whole->lab_rms.size()) medium.reset();
  if (sheet) write_png(o.contact_sheet, sheet->draw());
  if (common.json) {
    nlohmann::json j = {{"picture", o.picture},     {"reference", o.reference},
                        {"policy", policy->text()}, {"frames", frames},
                        {"metrics", whole->json()}, {"reference_noise_removed", !o.second.empty()}};
    if (medium) j["medium"] = medium->json();
    print(j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
  } else {
    const nlohmann::json a = whole->json(), b = medium ? medium->json() : nlohmann::json();
    const auto line = [&](const std::string& name, double first, std::optional<double> other) {
      return fmt::format("{:<20}{:>14.6g}{}\n", name, first, other ? fmt::format("{:>14.6g}", *other) : "");
    };
    std::string text =
        fmt::format("{:<20}{:>14}{}\n", "lab_rms", "whole frame", medium ? fmt::format("{:>14}", "medium") : "");
    for (size_t i = 0; i < frames.size(); ++i)
      text += line(fmt::format("frame {}", frames[i]), whole->lab_rms[i],
                   medium ? std::optional(medium->lab_rms[i]) : std::nullopt);
    for (const char* name : {"lab_rms", "temporal_error", "flicker", "reference_change"})
      if (a.contains(name))
        text += line(name, a[name].get<double>(),
                     medium && b.contains(name) ? std::optional(b[name].get<double>()) : std::nullopt);
    print(text + fmt::format("Lab: {}{}\n", policy->text(),
                             o.second.empty() ? "" : "; reference noise removed by two references"));
  }
  for (const std::string& failure : failures) warn(failure);
  return failures.empty() ? kDone : kThresholdFailed;
}

}  // namespace

void add_compare(CLI::App& app, Common& common, Commands& commands) {
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  CLI::App* command = add_command(
      app, common, "compare",
      "error measures of a picture against a reference (docs/experiment.md defines them), over the pixels that both have");
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
  command
      ->add_option("--min", o.floors, "the same below one, of metrics whose higher values are better: --min ssim=0.9")
      ->allow_extra_args(false);
  command->add_flag("--each-layer", o.each_layer, "also every layer of three colours that both have: direct, indirect");
  command->add_flag("--json", common.json, "as one JSON object");
  command->add_option(
      "--frames", o.frames,
      "compare these frames of sequences, whose names have ####, $F4 or %04d: the error of each, and how much the picture flickers beyond its reference");
  command
      ->add_option(
          "--contact-sheet", o.contact_sheet,
          "with --frames: a PNG of up to twelve of them side by side, with their errors and how wrongly they change in false colour")
      ->needs("--frames");
  commands[command] = [options, &common] {
    return options->frames.empty() ? run(*options, common) : run_sequence(*options, common);
  };
}

}  // namespace brume::app

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <optional>

#include "apps/cli/command.h"
#include "apps/cli/frame.h"
#include "base/error.h"
#include "base/sequence.h"
#include "base/text.h"
#include "workflows/compare_frames.h"

namespace brume::app {
namespace {

struct Options {
  std::string picture, reference, second;
  CompareOptions how;
  bool no_clip = false;
  std::vector<std::string> limits, floors;
  std::string frames, contact_sheet;
};

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

std::string table_of(const ComparisonReport::Layer& compared, bool named, const char* first_region) {
  const bool medium = compared.regions.size() > 1;
  const auto cell = [&](double value) { return fmt::format("{:>14.6g}", value); };
  std::string text = fmt::format("{:<20}{:>14}{}\n", named ? LayerName{compared.name, "RGB", ""}.label() : "",
                                 first_region, medium ? fmt::format("{:>14}", "medium") : "");
  const auto a = listed(compared.regions[0]), b = listed(compared.regions.back());
  for (size_t i = 0; i < a.size(); ++i)
    text += fmt::format("{:<20}{}{}\n", a[i].first, cell(a[i].second), medium ? cell(b[i].second) : "");
  return text + fmt::format("{:<20}{:>14}{}\n", "pixels", compared.regions[0].pixels,
                            medium ? fmt::format("{:>14}", compared.regions[1].pixels) : "");
}

/// The line below a table that says how its errors were measured.
std::string policy_line(const std::string& policy, bool two_references) {
  return fmt::format("Lab: {}{}\n", policy, two_references ? "; reference noise removed by two references" : "");
}

/// The pictures that the command line names.
struct Pictures {
  NamedFrame picture, reference;
  std::optional<NamedFrame> second;

  /// @param frame  of sequences; nothing: names are files
  Pictures(const Options& o, std::optional<int> frame, const Host& host) {
    const auto read = [&](const std::string& name) {
      const std::string path = frame ? file_of_frame(name, *frame).string() : name;
      return NamedFrame{path, read_frame(ExrFile(path), host)};
    };
    picture = read(o.picture);
    reference = read(o.reference);
    if (!o.second.empty()) second = read(o.second);
  }
};

/// Says what lies beyond its limits.
int status_of(const std::vector<std::string>& failures) {
  for (const std::string& failure : failures) warn(failure);
  return failures.empty() ? kDone : kThresholdFailed;
}

std::vector<std::string> beyond_limits(const Errors& errors, const Options& o) {
  std::vector<std::string> failures = beyond(errors, o.limits, /*above=*/true);
  for (std::string& failure : beyond(errors, o.floors, /*above=*/false)) failures.push_back(std::move(failure));
  return failures;
}

int run(const Options& o, const Common& common) {
  const Host host = make_host(common);
  Pictures p(o, std::nullopt, host);
  const ComparisonReport report =
      compare_frames(std::move(p.picture), std::move(p.reference), std::move(p.second), o.how, host);
  if (common.json) {
    print(report.json());
  } else {
    const bool whole = report.window == report.display;
    std::string text;
    for (const ComparisonReport::Layer& layer : report.layers)
      text += table_of(layer, report.layers.size() > 1, whole ? "whole frame" : "data window");
    text += policy_line(report.policy, report.two_references);
    if (!whole)
      text += fmt::format("over the common data window {}; the display window is {}\n", report.window.text(),
                          report.display.text());
    print(text);
  }
  return status_of(beyond_limits(report.layers.front().regions.front(), o));
}

std::string table_of(const SequenceComparison& sequence) {
  using Region = SequenceComparison::Region;
  const Region whole = sequence.whole();
  const std::optional<Region> medium = sequence.medium();
  std::string text =
      fmt::format("{:<20}{:>14}{}\n", "lab_rms", "whole frame", medium ? fmt::format("{:>14}", "medium") : "");
  const auto line = [&](const std::string& name, const auto& value_of, bool of_medium = true) {
    text += fmt::format("{:<20}{:>14.6g}{}\n", name, value_of(whole),
                        medium && of_medium ? fmt::format("{:>14.6g}", value_of(*medium)) : "");
  };
  for (size_t i = 0; i < sequence.frames().size(); ++i)
    line(fmt::format("frame {}", sequence.frames()[i]), [&](const Region& r) { return r.lab_rms[i]; });
  line("lab_rms", [](const Region& r) { return r.mean_lab_rms; });
  if (whole.temporal) {
    const bool both = medium && medium->temporal;
    line(
        "temporal_error", [](const Region& r) { return r.temporal->temporal_error; }, both);
    line(
        "flicker", [](const Region& r) { return r.temporal->flicker; }, both);
    line(
        "reference_change", [](const Region& r) { return r.temporal->reference; }, both);
  }
  return text + policy_line(sequence.policy(), sequence.two_references());
}

int run_sequence(const Options& o, std::vector<int> frames, const Common& common) {
  const Host host = make_host(common);
  SequenceComparison sequence(o.how, o.contact_sheet, std::move(frames));
  std::vector<std::string> failures;
  for (const int number : sequence.frames()) {
    Pictures p(o, number, host);
    const Errors& errors = sequence.add(std::move(p.picture), std::move(p.reference), std::move(p.second), host);
    for (const std::string& failure : beyond_limits(errors, o))
      failures.push_back(fmt::format("frame {}: {}", number, failure));
  }
  sequence.finish();
  print(common.json ? sequence.json(o.picture, o.reference) : table_of(sequence));
  return status_of(failures);
}

}  // namespace

void add_compare(CLI::App& app, Common& common, Commands& commands) {
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  const Verb command = add_command(
      app, common, "compare",
      "error measures of a picture against a reference (docs/experiment.md defines them), over the pixels that both have");
  command("picture", o.picture, "EXR to judge")->required();
  command("reference", o.reference, "EXR it should equal")->required();
  command("--second-reference", o.second, "an independent reference, to take the references' noise off");
  command("--layer", o.how.layer, "layer to compare; the beauty without it");
  command("--exposure", o.how.exposure, "number, header, or auto: the reference's 99th luminance percentile becomes 1")
      ->check(exposure_validator())
      ->capture_default_str();
  command("--no-clip", o.no_clip, "do not clip to [0, 1] before CIE-Lab");
  command("--max", o.limits, "fail with exit status 1 above a limit: --max lab_rms=0.5")->allow_extra_args(false);
  command("--min", o.floors, "the same below one, of metrics whose higher values are better: --min ssim=0.9")
      ->allow_extra_args(false);
  command("--each-layer", o.how.each_layer, "also every layer of three colours that both have: direct, indirect");
  command("--json", common.json, "as one JSON object");
  command(
      "--frames", o.frames,
      "compare these frames of sequences, whose names have ####, $F4 or %04d; without this option all frames of such a name that are there: the error of each, and how much the picture flickers beyond its reference");
  command(
      "--contact-sheet", o.contact_sheet,
      "of a sequence: a PNG of up to twelve frames side by side, with their errors and how wrongly they change in false colour");
  commands[command] = [options, &common] {
    options->how.clip = !options->no_clip;
    std::vector<int> frames = frames_or_all_of(options->picture, options->frames);
    if (frames.empty() && !options->contact_sheet.empty())
      throw InputError("--contact-sheet shows the frames of a sequence; expected --frames");
    return frames.empty() ? run(*options, common) : run_sequence(*options, std::move(frames), common);
  };
}

}  // namespace brume::app

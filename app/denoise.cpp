#include <fmt/format.h>

#include <filesystem>
#include <list>
#include <map>
#include <optional>
#include <set>

#include "app/command.h"
#include "app/filter_options.h"
#include "app/frame.h"
#include "app/kept_file.h"
#include "base/error.h"
#include "base/output_file.h"
#include "base/text.h"
#include "filters/apply.h"
#include "filters/recommend.h"
#include "filters/registry.h"
#include "filters/requirements.h"
#include "image/exr_io.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string input, output, preview;
  std::string noise = "layers", outliers = "keep", features, carry, records;
  int tile = 0, extra_frames = 0;
  std::vector<std::string> filters;
  FilterOptions common{.component = "all"};
  KeepOptions keep;
  PictureOptions picture;
} o;

/// OUT.exr for one filter, OUT.FILTER.exr for several, OUT.FILTER.2.exr for the second of one name.
fs::path output_for(const std::string& path, const std::vector<FilterSettings>& filters, size_t i) {
  const fs::path p(path);
  if (filters.size() == 1) return p;
  const std::string& name = filters[i].entry().name;
  size_t same = 1;
  for (size_t k = 0; k < i; ++k) same += filters[k].entry().name == name;
  return p.parent_path() /
         (p.stem().string() + "." + name + (same > 1 ? "." + std::to_string(same) : "") + p.extension().string());
}

/// "shot.0007.exr" for "shot.0005.exr" and 2: the last number of a file's name counts its frame. Empty for a number
/// below zero.
/// @throws InputError for a name without a number
fs::path file_of_frame(const fs::path& path, int distance) {
  const std::string stem = path.stem().string();
  const size_t last = stem.find_last_of("0123456789");
  if (last == std::string::npos)
    throw InputError(fmt::format("{}: --extra-frames needs the frame's number in the file's name, as in shot.0005{}",
                                 path.string(), path.extension().string()));
  const size_t before = stem.find_last_not_of("0123456789", last), first = before == std::string::npos ? 0 : before + 1;
  const std::string digits = stem.substr(first, last + 1 - first);
  if (digits.size() > 9) throw InputError(fmt::format("{}: {} is no frame's number", path.string(), digits));
  const int number = std::stoi(digits) + distance;
  if (number < 0) return {};
  return path.parent_path() / fmt::format("{}{:0{}}{}{}", stem.substr(0, first), number, digits.size(),
                                          stem.substr(last + 1), path.extension().string());
}

/// The frames before and after that there are, by their distance.
/// @throws InputError when some are asked for and none is there
std::map<int, fs::path> extra_files() {
  std::map<int, fs::path> files;
  std::vector<std::string> missing;
  for (int d = -o.extra_frames; d <= o.extra_frames; ++d) {
    if (d == 0) continue;
    const fs::path file = file_of_frame(o.input, d);
    if (!file.empty() && fs::exists(file))
      files[d] = file;
    else
      missing.push_back(file.empty() ? fmt::format("{:+}", d) : file.filename().string());
  }
  if (o.extra_frames > 0 && files.empty())
    throw InputError(fmt::format("{}: --extra-frames {}: none of {} is there", o.input, o.extra_frames, join(missing)));
  if (!missing.empty()) note("the sequence has no " + join(missing));
  return files;
}

/// What is read of them.
struct Sequence {
  std::list<Layers> layers;
  std::list<RecordReader> records;
  std::vector<SequenceFrame> frames;

  Sequence(const std::map<int, fs::path>& files, const std::set<std::string>& channels, const Common& common) {
    for (const auto& [distance, file] : files) {
      SequenceFrame& frame =
          frames.emplace_back(SequenceFrame{distance, &layers.emplace_back(read_frame(common, file, channels))});
      if (!o.records.empty()) frame.records = &records.emplace_back(file_of_frame(o.records, distance));
    }
  }
};

/// @throws InputError for a name that is no layer of colours
LayerName colour_layer(const std::string& name) {
  std::vector<std::string> names;
  for (const LayerName& l : {layer::direct, layer::indirect, layer::background, layer::emission, layer::single,
                             layer::surface, layer::catcher, layer::catcher_unshadowed}) {
    if (l.name == name) return l;
    names.push_back(std::string(l.name));
  }
  throw InputError(fmt::format("--carry: no layer of colours '{}'{}", name, suggestion(name, names)));
}

ApplyOptions apply_options() {
  ApplyOptions options;
  options.component = o.common.chosen_component();
  options.background = o.common.chosen_background();
  options.noise = o.noise == "spatial" ? NoiseSource::kSpatial : NoiseSource::kLayers;
  options.outliers = o.outliers == "clamp"          ? Outliers::kClamp
                     : o.outliers == "redistribute" ? Outliers::kRedistribute
                                                    : Outliers::kKeep;
  options.tile = o.tile;
  if (!o.features.empty()) options.features = split(o.features, ',');
  if (!o.carry.empty())
    for (const std::string& name : split(o.carry, ',')) options.carried.push_back(colour_layer(name));
  return options;
}

/// Runs `work`; its errors begin with the name of the frame.
template <class Work>
auto about_the_frame(const Work& work) {
  try {
    return work();
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", o.input, error.what()));
  }
}

/// The filters that are asked for, or else the best that the frame's layers allow.
/// @param ours  whether more of brume render could allow a better one, which is told
std::vector<FilterSettings> choose_filters(const Common& common, const Layers& outline, const ApplyOptions& options,
                                           bool ours) {
  std::vector<FilterSettings> filters;
  for (const std::string& text : o.filters) filters.push_back(parse_filter(text));
  if (!filters.empty()) return filters;
  const Recommendation best =
      about_the_frame([&] { return recommend_filter(outline, options, /*sequence=*/o.extra_frames > 0); });
  log(common, ours ? best.reason : split(best.reason, ';')[0]);
  return {best.filter};
}

/// @throws InputError before anything is computed
void check_outputs(const std::vector<FilterSettings>& filters, const std::map<int, fs::path>& others) {
  std::vector<fs::path> inputs = {o.input};
  if (!o.keep.map.empty()) inputs.push_back(o.keep.map);
  if (!o.keep.guides.empty()) inputs.push_back(o.keep.guides);
  for (const auto& [distance, file] : others) inputs.push_back(file);
  for (size_t i = 0; i < filters.size(); ++i) {
    check_writable(output_for(o.output, filters, i), inputs, ".exr");
    if (!o.preview.empty()) check_writable(output_for(o.preview, filters, i), inputs, ".png");
  }
}

/// Gives the file back as it came, but for what is cleaned.
int run_keeping(const Common& common, const KeptFile& file, ApplyOptions options) {
  if (!options.carried.empty())
    throw InputError(
        "--carry: the passes of this frame are cleaned by themselves, and add up; it is for frames by brume");
  const Layers outline = file.outline();
  options.exposure =
      choose_exposure(o.picture.exposure, o.picture.exposure == "auto" ? read_frame(common, o.input) : outline);
  ApplyOptions for_choice = options;
  for_choice.component = Component::kAll;
  if (!outline.has(layer::beauty, statistic::mean_variance) && !has_halves(outline, layer::beauty))
    for_choice.noise = NoiseSource::kSpatial;
  const std::vector<FilterSettings> filters = choose_filters(common, outline, for_choice, /*ours=*/false);
  const std::map<int, fs::path> others = extra_files();
  check_outputs(filters, others);
  std::map<int, std::string> paths;
  std::list<RecordReader> readers;
  std::map<int, RecordReader*> records;
  for (const auto& [distance, path] : others) {
    paths[distance] = path.string();
    records[distance] = o.records.empty() ? nullptr : &readers.emplace_back(file_of_frame(o.records, distance));
  }
  for (size_t i = 0; i < filters.size(); ++i) {
    const fs::path path = output_for(o.output, filters, i);
    Layers clean;
    file.clean(common, filters[i], options, paths, records, path.string(), o.preview.empty() ? nullptr : &clean);
    if (!o.preview.empty())
      o.picture.write(output_for(o.preview, filters, i), clean, clean.rgb(layer::beauty), options.exposure);
    print(path.string() + "\n");
  }
  return kDone;
}

int run(const Common& common) {
  ApplyOptions options = apply_options();
  std::optional<RecordReader> records;
  if (!o.records.empty()) options.records = &records.emplace(o.records);
  if (const std::optional<KeptFile> kept = KeptFile::open(o.input, o.keep)) return run_keeping(common, *kept, options);
  Layers outline = read_outline(o.input);
  if (!o.keep.guides.empty())
    for (const std::string& name : guide_channels(o.keep.guides)) outline.add(name);
  const std::vector<FilterSettings> filters = choose_filters(common, outline, options, /*ours=*/true);
  const std::map<int, fs::path> others = extra_files();
  check_outputs(filters, others);
  std::set<std::string> channels = {"R", "G", "B"};
  for (const FilterSettings& filter : filters) channels.merge(readable_channels(filter, options, outline));
  for (const std::string& name : layer::noisy.channel_names()) channels.insert(name);
  Layers frame = read_frame(common, o.input, channels);
  add_guides(o.keep.guides, o.input, frame);
  if (frame.has(layer::noisy)) {
    note("the frame is clean already: what it was made from, its layer noisy, is cleaned");
    for (size_t c = 0; c < 3; ++c) frame.set(layer::beauty.channel(c), frame.at(layer::noisy.channel(c)));
  }
  options.exposure = choose_exposure(o.picture.exposure, frame);
  const Sequence sequence(others, channels, common);
  options.sequence = sequence.frames;
  for (size_t i = 0; i < filters.size(); ++i) {
    ApplyReport report;
    Layers clean = about_the_frame(
        [&] { return apply_filter(filters[i], frame, options, make_task(common, filters[i].entry().name), &report); });
    for (const std::string& line : report.notes) note(line);
    stamp(clean);
    const auto path = output_for(o.output, filters, i);
    write_exr(path, clean);
    if (!o.preview.empty())
      o.picture.write(output_for(o.preview, filters, i), clean, clean.rgb(layer::beauty), options.exposure);
    log(common, fmt::format("{} ({}): {:.1f} ms", filters[i].entry().name, filters[i].text(), 1e3 * report.seconds));
    print(path.string() + "\n");
  }
  return kDone;
}

std::string filter_help() {
  std::string text = "Filters, what serves best first, and their parameters:\n";
  for (const FilterEntry* e : filters_by_merit()) {
    text += fmt::format("  {}: {}\n", e->name, e->summary);
    const FilterSettings settings(*e);
    for (const Parameter& p : e->parameters)
      text += fmt::format("    --{:<20} {} ({}; default {})\n", p.name, p.help, p.range(),
                          Parameter::text(settings.get(p)));
  }
  return text;
}

}  // namespace

void add_denoise(CLI::App& app, Common& common, Commands& commands) {
  CLI::App* command =
      add_command(app, common, "denoise", "clean a frame, with the best filter for it or with those named");
  command->add_option("frame", o.input, "EXR with layers, by brume or another renderer")->required();
  command
      ->add_option("-f,--filter", o.filters,
                   "filter NAME instead of the best that the frame's layers allow; its parameters follow as NAME "
                   "--PARAMETER VALUE or in NAME:parameter=value,...; repeat for several")
      ->allow_extra_args(false);
  command->add_option("-o,--output", o.output, "EXR to write; with several filters OUT.FILTER.exr each")->required();
  command->add_option("--png", o.preview, "also write a PNG");
  o.keep.add_to(*command);
  command->add_option("--guides", o.keep.guides,
                      "EXR with guides of this frame, by brume guides: what is known of the light without noise");
  o.common.add_to(*command);
  command->add_option("--features", o.features,
                      "of those that the frame has, use these: " + join(FeaturePlan::names(), ",") + ", or none");
  command
      ->add_option("--noise", o.noise,
                   "where variance comes from: the frame's layers, or the picture's own second differences")
      ->check(CLI::IsMember({"layers", "spatial"}))
      ->capture_default_str();
  command
      ->add_option("--outliers", o.outliers,
                   "fireflies before the filter: keep; clamp, their energy being lost; or redistribute it")
      ->check(CLI::IsMember({"keep", "clamp", "redistribute"}))
      ->capture_default_str();
  command->add_option(
      "--carry", o.carry,
      "layers to filter with the same weights, so that passes still add up: direct,indirect,emission,...");
  command->add_option("--records", o.records, "record of every sample, for filters that read it");
  command
      ->add_option("--extra-frames", o.extra_frames,
                   "frames before and after to look into, found by the number in the file's name, for filters that "
                   "clean sequences; records are found likewise")
      ->check(CLI::Range(0, 100))
      ->capture_default_str();
  command->add_option("--tile", o.tile, "side of the squares that are filtered one after another [px]; 0: by memory")
      ->check(CLI::Range(0, 1 << 20));
  o.picture.add_to(*command,
                   "from radiance to display, for the PNG and filters that compare colours as seen: a number, "
                   "header, or auto");
  command->footer(filter_help);
  commands[command] = [&common] { return run(common); };
}

}  // namespace brume::app

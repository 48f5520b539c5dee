#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <list>
#include <map>
#include <optional>
#include <set>

#include "app/command.h"
#include "app/filter_options.h"
#include "app/frame.h"
#include "app/kept_file.h"
#include "app/sequence.h"
#include "app/video.h"
#include "base/error.h"
#include "base/output_file.h"
#include "base/rng.h"
#include "base/sequence.h"
#include "base/text.h"
#include "filters/api/recommend.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/run/apply.h"
#include "image/exr_io.h"
#include "workflows/finished_frame.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

constexpr int kAsTheFilter = -1;  // --extra-frames is not given

struct Options {
  std::string input, output, preview;
  std::string noise = "layers", features, carry, records, frames, video;
  int tile = 0, extra_frames = kAsTheFilter;
  double frame_rate = 24;
  bool resume = false;
  std::vector<std::string> filters;
  FilterOptions common{.component = "all"};
  OutlierOption outliers;
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
fs::path file_beside(const fs::path& path, int distance) {
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

/// The files of a frame to clean, or of one beside it.
struct Files {
  fs::path frame, output, preview, records, guides;
};

/// A frame to clean, and where those beside it lie.
struct Shot {
  Files own;
  std::function<Files(int distance)> beside;
  bool sequence = false;  ///< one of many: a frame beside it that cannot be used is named and left out
};

/// The frame that the command line names.
Shot single_shot() {
  const auto beside = [](int distance) {
    Files files{file_beside(o.input, distance), {}, {}, {}, {}};
    if (!o.records.empty()) files.records = file_beside(o.records, distance);
    if (!o.keep.guides.empty()) files.guides = file_beside(o.keep.guides, distance);
    return files;
  };
  return {{o.input, o.output, o.preview, o.records, o.keep.guides}, beside, /*sequence=*/false};
}

/// A frame of a sequence whose names are patterns.
Shot shot_of_frame(int frame) {
  const auto files = [frame](int distance) {
    const int number = frame + distance;
    if (number < 0) return Files{};
    const auto named = [&](const std::string& name) { return name.empty() ? fs::path() : file_of_frame(name, number); };
    return Files{named(o.input), named(o.output), named(o.preview), named(o.records), named(o.keep.guides)};
  };
  return {files(0), files, /*sequence=*/true};
}

/// The frames before and after that there are, with all that is read of them, by their distance.
/// @throws InputError when some are asked for and none is there
std::map<int, Files> extra_files(const Shot& shot, int reach) {
  std::map<int, Files> files;
  std::vector<std::string> missing;
  for (int d = -reach; d <= reach; ++d) {
    if (d == 0) continue;
    const Files there = shot.beside(d);
    if (there.frame.empty()) continue;  // before frame 0
    const auto absent = [](const fs::path& path) { return !path.empty() && !fs::exists(path); };
    if (absent(there.frame))
      missing.push_back(there.frame.filename().string());
    else if (absent(there.guides) || absent(there.records))
      missing.push_back(fmt::format("{} for {}",
                                    (absent(there.guides) ? there.guides : there.records).filename().string(),
                                    there.frame.filename().string()));
    else
      files[d] = there;
  }
  if (reach > 0 && files.empty() && !shot.sequence)
    throw InputError(fmt::format("{}: --extra-frames {}: no frame beside it can be used{}", shot.own.frame.string(),
                                 reach, missing.empty() ? "" : "; not there: " + join(missing)));
  if (!missing.empty())
    note(fmt::format("{}: of the frames beside it, {} {} not there", shot.own.frame.filename().string(), join(missing),
                     missing.size() == 1 ? "is" : "are"));
  return files;
}

/// How far a filter looks: as it declares in a sequence, or as the command line says.
int reach_of(const FilterSettings& filter, const Shot& shot) {
  if (o.extra_frames != kAsTheFilter) return o.extra_frames;
  return shot.sequence ? filter.entry().reach : 0;
}

/// What a frame that was filtered before, and has no noisy layer to go back to, is told to be.
void tell_clean(const std::string& filter) {
  if (!filter.empty())
    note(
        fmt::format("the frame is clean already, by {}: what is cleaned is that picture, and filtering it again loses "
                    "detail; expected the frame that it was made from",
                    filter));
}

/// A frame as filters get it: with its guides, and raw where it is clean already.
Layers load(const Common& common, const Files& files, const std::set<std::string>& channels) {
  Layers frame = read_frame(common, files.frame, channels);
  if (!files.guides.empty()) add_guides(files.guides, files.frame, frame);
  if (frame.has(layer::noisy)) {
    note("the frame is clean already: what it was made from, its layer noisy, is cleaned");
    for (size_t c = 0; c < 3; ++c) frame.set(layer::beauty.channel(c), frame.at(layer::noisy.channel(c)));
  } else {
    tell_clean(frame.text("filter"));
  }
  return frame;
}

/// The frames that are in use, so that each is read once while a sequence goes by.
class Window {
 public:
  const Layers& get(const Common& common, const Files& files, const std::set<std::string>& channels) {
    Entry& entry = frames_[files.frame];
    if (!entry.layers || entry.channels != channels) entry = {channels, load(common, files, channels)};
    return *entry.layers;
  }
  /// Lets go of all frames but these.
  void keep(const Files& own, const std::map<int, Files>& others) {
    std::set<fs::path> used = {own.frame};
    for (const auto& [distance, files] : others) used.insert(files.frame);
    std::erase_if(frames_, [&](const auto& item) { return !used.contains(item.first); });
  }

 private:
  struct Entry {
    std::set<std::string> channels;
    std::optional<Layers> layers;
  };
  std::map<fs::path, Entry> frames_;
};

/// What is read of the frames beside one.
struct Sequence {
  std::list<RecordReader> records;
  std::vector<SequenceFrame> frames;

  Sequence(const Common& common, const Shot& shot, const std::map<int, Files>& others, const Layers& own,
           const std::set<std::string>& channels, Window& window) {
    for (const auto& [distance, files] : others) {
      try {
        const Layers& layers = window.get(common, files, channels);
        if (shot.sequence && layers.data_window() != own.data_window())
          throw InputError(fmt::format("{}: it has the pixels {}, {} has {}", files.frame.string(),
                                       layers.data_window().text(), shot.own.frame.string(), own.data_window().text()));
        frames.push_back({distance, &layers});
        if (!files.records.empty()) frames.back().records = &records.emplace_back(files.records);
      } catch (const InputError& error) {
        if (!shot.sequence) throw;
        warn(fmt::format("left out beside {}: {}", shot.own.frame.filename().string(), error.what()));
      }
    }
  }
  /// Those within a filter's reach.
  std::vector<SequenceFrame> within(int reach) const {
    std::vector<SequenceFrame> near;
    for (const SequenceFrame& f : frames)
      if (std::abs(f.distance) <= reach) near.push_back(f);
    return near;
  }
};

/// What a clean frame is made from, as a number: filter, parameters, and every byte of the files that are read.
std::string made_from(const std::vector<FilterSettings>& filters, const Files& own,
                      const std::map<int, Files>& others) {
  uint64_t hash = 0;
  const auto add_text = [&](const std::string& text) {
    for (const char c : text) hash = hash_combine(hash, static_cast<uint64_t>(static_cast<unsigned char>(c)));
  };
  std::vector<char> bytes(1 << 20);
  const auto add_file = [&](const fs::path& path) {
    if (path.empty()) return;
    std::ifstream file(path, std::ios::binary);
    while (file) {
      file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
      const size_t count = static_cast<size_t>(file.gcount()), words = count / 8;
      for (size_t i = 0; i < words; ++i) {
        uint64_t word;
        std::memcpy(&word, bytes.data() + 8 * i, 8);
        hash = hash_combine(hash, word);
      }
      for (size_t i = 8 * words; i < count; ++i) hash = hash_combine(hash, static_cast<uint64_t>(bytes[i]));
    }
  };
  add_text(version_text());
  for (const FilterSettings& filter : filters) add_text(filter.entry().name + filter.text());
  for (const std::string& text : {o.noise, o.outliers.text, o.features, o.carry, o.common.component,
                                  o.common.background, o.picture.exposure, o.keep.suffix, o.keep.map})
    add_text(text + ";");
  add_text(fmt::format("{} {} {}", o.tile, o.extra_frames, o.keep.samples));
  for (const fs::path& path : {own.frame, own.records, own.guides}) add_file(path);
  for (const auto& [distance, files] : others) {
    add_text(std::to_string(distance));
    for (const fs::path& path : {files.frame, files.records, files.guides}) add_file(path);
  }
  return fmt::format("{:016x}", hash);
}

constexpr const char* kMadeFrom = "filterInputs";

/// Whether every output is there, whole, and made from this.
bool is_complete(const std::vector<FilterSettings>& filters, const Files& own, const std::string& inputs) {
  for (size_t i = 0; i < filters.size(); ++i) {
    const fs::path path = output_for(own.output, filters, i);
    if (!fs::exists(path)) return false;
    try {
      const Layers frame = read_exr(path);
      if (frame.text(kMadeFrom, frame.text(std::string("brume.") + kMadeFrom)) != inputs) return false;
    } catch (const InputError& error) {
      warn(fmt::format("{} is cleaned again: {}", path.string(), error.what()));
      return false;
    }
  }
  return true;
}

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
  options.outliers = o.outliers.chosen();
  options.tile = o.tile;
  if (!o.features.empty()) options.features = split(o.features, ',');
  if (!o.carry.empty())
    for (const std::string& name : split(o.carry, ',')) options.carried.push_back(colour_layer(name));
  return options;
}

/// Runs `work`; its errors begin with the name of the frame.
template <class Work>
auto about_the_frame(const Shot& shot, const Work& work) {
  try {
    return work();
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", shot.own.frame.string(), error.what()));
  }
}

/// The filters that are asked for, or else the best that the frame's layers allow.
/// @param ours  whether more of brume render could allow a better one, which is told
std::vector<FilterSettings> choose_filters(const Common& common, const Shot& shot, const Layers& outline,
                                           const ApplyOptions& options, bool ours) {
  std::vector<FilterSettings> filters;
  for (const std::string& text : o.filters) filters.push_back(parse_filter(text));
  if (!filters.empty()) return filters;
  const Recommendation best =
      about_the_frame(shot, [&] { return recommend_filter(outline, options, /*sequence=*/o.extra_frames > 0); });
  static std::string told;  // not for every frame of a sequence
  const std::string reason = ours ? best.reason : split(best.reason, ';')[0];
  if (reason != told) log(common, reason);
  if (reason != told && !ours && !best.filter.entry().guides)
    log(common,
        fmt::format(
            "of smoke and clouds in it, guides from their volume leave a quarter of the error: brume guides "
            "--like {0} --scene SCENE.toml -o GUIDES.exr (or --volume FILE.vdb), then brume denoise {0} --guides "
            "GUIDES.exr",
            shot.own.frame.string()));
  told = reason;
  return {best.filter};
}

/// @throws InputError before anything is computed
void check_outputs(const std::vector<FilterSettings>& filters, const Shot& shot, const std::map<int, Files>& others) {
  std::vector<fs::path> inputs = {shot.own.frame};
  if (!o.keep.map.empty()) inputs.push_back(o.keep.map);
  if (!shot.own.guides.empty()) inputs.push_back(shot.own.guides);
  for (const auto& [distance, files] : others) inputs.push_back(files.frame);
  for (size_t i = 0; i < filters.size(); ++i) {
    check_writable(output_for(shot.own.output, filters, i), inputs, ".exr");
    if (!shot.own.preview.empty()) check_writable(output_for(shot.own.preview, filters, i), inputs, ".png");
  }
}

/// The frames beside one within the reach of the filter that looks farthest.
std::map<int, Files> others_for(const std::vector<FilterSettings>& filters, const Shot& shot) {
  int reach = 0;
  for (const FilterSettings& filter : filters) reach = std::max(reach, reach_of(filter, shot));
  return extra_files(shot, reach);
}

/// Gives the file back as it came, but for what is cleaned.
FrameEnd run_keeping(const Common& common, const Shot& shot, const KeptFile& file, ApplyOptions options) {
  if (!options.carried.empty())
    throw InputError(
        "--carry: the passes of this frame are cleaned by themselves, and add up; it is for frames by brume");
  const Layers outline = file.outline();
  tell_clean(outline.text("brume.filter"));
  options.exposure =
      choose_exposure(o.picture.exposure, o.picture.exposure == "auto" ? read_frame(common, shot.own.frame) : outline);
  ApplyOptions for_choice = options;
  for_choice.component = Component::kAll;
  if (!outline.has(layer::beauty, statistic::mean_variance) && !has_halves(outline, layer::beauty))
    for_choice.noise = NoiseSource::kSpatial;
  const std::vector<FilterSettings> filters = choose_filters(common, shot, outline, for_choice, /*ours=*/false);
  const std::map<int, Files> others = others_for(filters, shot);
  check_outputs(filters, shot, others);
  const std::string inputs = shot.sequence ? made_from(filters, shot.own, others) : "";
  if (o.resume && is_complete(filters, shot.own, inputs)) return FrameEnd::kSkipped;
  std::list<RecordReader> readers;
  std::vector<KeptNeighbour> neighbours;
  for (const auto& [distance, files] : others)
    neighbours.push_back({distance, files.frame.string(), files.guides.string(),
                          files.records.empty() ? nullptr : &readers.emplace_back(files.records), shot.sequence});
  for (size_t i = 0; i < filters.size(); ++i) {
    const fs::path path = output_for(shot.own.output, filters, i);
    std::vector<KeptNeighbour> near;
    for (const KeptNeighbour& n : neighbours)
      if (std::abs(n.distance) <= reach_of(filters[i], shot)) near.push_back(n);
    Layers clean;
    std::map<std::string, Attribute> attributes;
    if (shot.sequence) attributes[std::string("brume.") + kMadeFrom] = inputs;
    file.clean(common, filters[i], options, near, attributes, path.string(),
               shot.own.preview.empty() ? nullptr : &clean);
    if (!shot.own.preview.empty())
      o.picture.write(output_for(shot.own.preview, filters, i), clean, clean.rgb(layer::beauty), options.exposure);
    print(path.string() + "\n");
  }
  return FrameEnd::kDone;
}

/// What forbids the use of the guides that the command line names, measured where their header does not tell.
std::string what_speaks_against_guides(const Common& common, const Files& files) {
  const Task task{common.threads, {}, &interrupted};
  KeepOptions keep = o.keep;
  keep.guides = files.guides.string();
  const std::vector<std::string> guides = guide_channels(keep.guides);
  if (of_one_scene(read_header(files.guides), read_header(files.frame))) return "";
  if (const std::optional<KeptFile> kept = KeptFile::open(files.frame, keep))
    return kept->what_speaks_against_guides(task);
  std::set<std::string> channels(guides.begin(), guides.end());
  for (const std::string_view which : {std::string_view(), statistic::half_a, statistic::half_b})
    for (const std::string& name : layer::beauty.channel_names(which)) channels.insert(name);
  for (const LayerName& l : find_filter("transport_regression").can_use)
    for (const std::string& name : l.channel_names()) channels.insert(name);
  return brume::what_speaks_against_guides(load(common, files, channels), keep.guides, task);
}

Shot without_guides(const Shot& shot) {
  Shot bare = shot;
  bare.own.guides.clear();
  bare.beside = [beside = shot.beside](int distance) {
    Files files = beside(distance);
    files.guides.clear();
    return files;
  };
  return bare;
}

/// @param window  frames that are read already
FrameEnd run_shot(const Common& common, const Shot& asked, Window& window) {
  const std::string wrong = asked.own.guides.empty() ? "" : what_speaks_against_guides(common, asked.own);
  if (!wrong.empty()) warn("warning: " + wrong);
  const Shot& shot = wrong.empty() ? asked : without_guides(asked);
  ApplyOptions options = apply_options();
  std::optional<RecordReader> records;
  if (!shot.own.records.empty()) options.records = &records.emplace(shot.own.records);
  KeepOptions keep = o.keep;
  keep.guides = shot.own.guides.string();
  if (const std::optional<KeptFile> kept = KeptFile::open(shot.own.frame, keep))
    return run_keeping(common, shot, *kept, options);
  Layers outline = read_outline(shot.own.frame);
  if (!keep.guides.empty())
    for (const std::string& name : guide_channels(keep.guides)) outline.add(name);
  const std::vector<FilterSettings> filters = choose_filters(common, shot, outline, options, /*ours=*/true);
  const std::map<int, Files> others = others_for(filters, shot);
  check_outputs(filters, shot, others);
  const std::string inputs = shot.sequence ? made_from(filters, shot.own, others) : "";
  if (o.resume && is_complete(filters, shot.own, inputs)) return FrameEnd::kSkipped;
  std::set<std::string> channels;
  if (o.picture.exposure == "auto") channels = {"R", "G", "B"};
  for (const FilterSettings& filter : filters) channels.merge(readable_channels(filter, options, outline));
  for (const std::string& name : layer::noisy.channel_names()) channels.insert(name);
  window.keep(shot.own, others);
  const Layers& frame = window.get(common, shot.own, channels);
  options.exposure = choose_exposure(o.picture.exposure, frame);
  const Sequence sequence(common, shot, others, frame, channels, window);
  for (size_t i = 0; i < filters.size(); ++i) {
    options.sequence = sequence.within(reach_of(filters[i], shot));
    ApplyReport report;
    Layers clean = about_the_frame(shot, [&] {
      return apply_filter(filters[i], frame, options, make_task(common, filters[i].entry().name), &report);
    });
    for (const std::string& line : report.notes) note(line);
    stamp(clean);
    if (shot.sequence) clean.header[kMadeFrom] = inputs;
    const auto path = output_for(shot.own.output, filters, i);
    write_exr(path, clean);
    if (!shot.own.preview.empty())
      o.picture.write(output_for(shot.own.preview, filters, i), clean, clean.rgb(layer::beauty), options.exposure);
    log(common, fmt::format("{} ({}): {:.1f} ms", filters[i].entry().name, filters[i].text(), 1e3 * report.seconds));
    print(path.string() + "\n");
  }
  return FrameEnd::kDone;
}

int run_sequence(const Common& common) {
  const std::vector<int> frames = parse_frames(o.frames);
  for (const auto& [option, name] : {std::pair("FRAME", &o.input), {"-o", &o.output}, {"--png", &o.preview}})
    check_pattern(option, *name, frames);
  if (!o.video.empty()) {
    if (o.preview.empty())
      throw InputError("--video is made from the PNGs; expected --png with a name such as clean.####.png");
    if (o.filters.size() > 1) throw InputError("--video shows one filter's frames; name one with -f");
    check_writable(o.video, {}, "");
  }
  Window window;
  const int end = each_frame(common, frames, [&](int frame) { return run_shot(common, shot_of_frame(frame), window); });
  if (o.video.empty()) return end;
  std::vector<fs::path> pictures;
  for (const int frame : frames)
    if (const fs::path picture = file_of_frame(o.preview, frame); fs::exists(picture)) pictures.push_back(picture);
  if (write_video(o.video, pictures, o.frame_rate)) print(o.video + "\n");
  return end;
}

int run(const Common& common) {
  if (!o.frames.empty()) return run_sequence(common);
  if (o.resume) throw InputError("--resume leaves out the complete frames of a sequence; expected --frames");
  if (!o.video.empty()) throw InputError("--video shows the frames of a sequence; expected --frames");
  Window window;
  run_shot(common, single_shot(), window);
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
  o.outliers.add_to(*command);
  command->add_option(
      "--carry", o.carry,
      "layers to filter with the same weights, so that passes still add up: direct,indirect,emission,...");
  command->add_option("--records", o.records, "record of every sample, for filters that read it");
  command
      ->add_option(
          "--extra-frames", o.extra_frames,
          "frames before and after to look into, found by the number in the file's name, for filters that "
          "clean sequences; records and guides are found likewise. With --frames, unless given: as many as the "
          "filter declares (docs/filters.md)")
      ->check(CLI::Range(0, 100));
  command->add_option("--frames", o.frames,
                      "clean these: 7, 1-240, 1-240x2, or several with commas between; names with ####, $F4 or %04d "
                      "stand for the files of each. A frame that fails is named, and the others go on");
  command->add_flag("--resume", o.resume, "with --frames: leave out those that are there, whole, made from the same");
  command->add_option("--video", o.video, "with --frames and --png: also a film of the PNGs, where ffmpeg is there");
  command->add_option("--frame-rate", o.frame_rate, "of the film [1/s]")
      ->check(CLI::Range(1.0, 1000.0))
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

#include "app/kept_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <list>
#include <set>

#include "app/frame.h"
#include "base/error.h"
#include "base/text.h"
#include "filters/api/requirements.h"
#include "image/exr_copy.h"
#include "image/exr_io.h"

namespace brume::app {
namespace {

/// The pictures of a file, by the user's map or by themselves. @throws InputError
std::vector<ForeignFrame> pictures_of(const std::string& path, const ExrInfo& info, const KeepOptions& options) {
  std::vector<ForeignFrame> pictures = options.map.empty() ? recognise(info) : read_map(options.map, info);
  for (ForeignFrame& picture : pictures) {
    if (!picture.conflicts.empty()) throw InputError(fmt::format("{}: {}", path, join(picture.conflicts, "; ")));
    if (options.samples > 0) picture.samples = options.samples;
  }
  return pictures;
}

std::set<std::string> read_channels(const ForeignFrame& picture, const std::set<std::string>& extra) {
  std::set<std::string> names = extra;
  for (const std::string& name : picture.channels()) names.insert(name);
  return names;
}

Layers read_picture(const std::string& path, const std::set<std::string>& channels) {
  return read_exr(path, [&](const std::string& name) { return channels.contains(name); });
}

/// What its colours and passes cover: features may lie in parts of other sizes.
Layers cut_to_light(Layers frame, const ForeignFrame& picture, const ExrInfo& info) {
  std::set<std::string> light(picture.target.begin(), picture.target.end());
  for (const ForeignSignal& signal : cleaned_signals(picture))
    light.insert(signal.channels.begin(), signal.channels.end());
  std::optional<PixelWindow> window;
  for (const ExrInfo::Channel& c : info.channels) {
    if (!light.contains(c.name)) continue;
    if (!window) window = c.data;
    window = {glm::min(window->lo, c.data.lo), glm::max(window->hi, c.data.hi)};
  }
  return !window || *window == frame.data_window() ? std::move(frame) : frame.cut(*window);
}

/// The picture of another frame of the sequence that is the same view.
const ForeignFrame& same_view(const std::vector<ForeignFrame>& pictures, const ForeignFrame& view,
                              const std::string& path) {
  for (const ForeignFrame& picture : pictures)
    if (picture.view == view.view && picture.target == view.target) return picture;
  throw InputError(fmt::format("{}: has no picture {} as the frame to clean has", path, view.label()));
}

}  // namespace

void KeepOptions::add_to(CLI::App& command) {
  command.add_flag(
      "--keep-file", keep,
      "give the file back as it is but for what was cleaned: done by itself for frames of other renderers");
  command.add_option("--suffix", suffix,
                     "add clean layers beside the noisy ones, under their names with this behind: _clean");
  command.add_option("--map", map, "TOML file that says which layer of another renderer's frame plays which part");
  command
      .add_option("--samples", samples,
                  "samples per pixel of another renderer's frame that does not say it in its header")
      ->check(CLI::Range(1, 1 << 30));
}

std::optional<KeptFile> KeptFile::open(const std::string& path, const KeepOptions& options) {
  ExrInfo info = read_exr_info(path);
  if (is_brume_frame(info) && !options.asked()) return std::nullopt;
  if (!options.suffix.empty() &&
      std::none_of(options.suffix.begin(), options.suffix.end(), [](unsigned char c) { return std::isalnum(c); }))
    throw InputError(fmt::format("--suffix {}: expected letters or digits in it, as in _clean", options.suffix));
  std::vector<ForeignFrame> pictures = pictures_of(path, info, options);
  if (pictures.empty()) return std::nullopt;
  return KeptFile(path, std::move(info), options, std::move(pictures));
}

Layers KeptFile::channel_names() const {
  Layers file(1, 1);
  file.header = info_.header;
  if (!options_.guides.empty())
    for (const std::string& name : guide_channels(options_.guides)) file.add(name);
  for (const ExrInfo::Channel& c : info_.channels) file.add(c.name);
  for (const ForeignFrame& picture : pictures_)
    for (const std::string& name : picture.channels()) file.add(name);
  return file;
}

Layers KeptFile::outline() const {
  const Layers file = channel_names();
  const std::vector<std::string> names = file.names();
  const std::set<std::string> extra(names.begin(), names.end());
  std::optional<Layers> least;
  for (const ForeignFrame& picture : pictures_)
    for (const ForeignSignal& signal : cleaned_signals(picture)) {
      Layers frame = frame_of_signal(picture, signal, file, extra);
      if (!least || frame.channels().size() < least->channels().size()) least = std::move(frame);
    }
  return std::move(*least);
}

std::string KeptFile::what_speaks_against_guides(const Task& task) const {
  if (options_.guides.empty()) return "";
  const std::vector<std::string> guides = guide_channels(options_.guides);
  const std::set<std::string> extra(guides.begin(), guides.end());
  for (const ForeignFrame& picture : pictures_) {
    Layers file = cut_to_light(read_picture(path_, read_channels(picture, {})), picture, info_);
    add_guides(options_.guides, path_, file);
    const std::string wrong =
        brume::what_speaks_against_guides(frame_of_signal(picture, picture.color, file, extra), options_.guides, task);
    if (!wrong.empty()) return wrong;
  }
  return "";
}

void KeptFile::clean(const Common& common, const FilterSettings& filter, const ApplyOptions& options,
                     const std::vector<KeptNeighbour>& others, const std::map<std::string, Attribute>& more_attributes,
                     const std::string& output, Layers* preview) const {
  const std::set<std::string> extra = readable_channels(filter, options, channel_names());
  std::list<CleanPicture> cleaned;
  std::vector<ExrEdit> edits;
  std::map<std::string, Attribute> attributes = more_attributes;
  attributes["brume.version"] = version_text();
  for (ForeignFrame picture : pictures_) {
    if (!filter.uses_features() && !filter.entry().guides) picture.features.clear();
    Layers file = cut_to_light(read_picture(path_, read_channels(picture, extra)), picture, info_);
    if (filter.entry().guides || filter.uses_features()) add_guides(options_.guides, path_, file);
    std::list<Layers> nearby;
    std::list<std::vector<ForeignFrame>> nearby_pictures;
    std::vector<PictureInFile> sequence;
    for (const KeptNeighbour& other : others) {
      try {
        const ExrInfo info = read_exr_info(other.path);
        const auto& theirs = nearby_pictures.emplace_back(pictures_of(other.path, info, options_));
        const ForeignFrame& same = same_view(theirs, picture, other.path);
        Layers& layers =
            nearby.emplace_back(cut_to_light(read_picture(other.path, read_channels(same, extra)), same, info));
        if (filter.entry().guides || filter.uses_features()) add_guides(other.guides, other.path, layers);
        if (other.optional && layers.data_window() != file.data_window())
          throw InputError(fmt::format("{}: it has the pixels {}, {} has {}", other.path, layers.data_window().text(),
                                       path_, file.data_window().text()));
        sequence.push_back({other.distance, &same, &layers, other.records});
      } catch (const InputError& error) {
        if (!other.optional) throw;
        warn(fmt::format("left out beside {}: {}", path_, error.what()));
      }
    }
    // Several pictures may lie in parts of their own, each with its data window.
    const PixelWindow window = file.data_window();
    const bool shown = preview && cleaned.empty();
    if (shown) {
      *preview = Layers(file.width(), file.height());
      preview->lie_like(file);
      preview->header = file.header;
    }
    CleanPicture& result = cleaned.emplace_back();
    try {
      result = clean_picture(filter, picture, std::move(file), info_, sequence, options,
                             make_task(common, filter.entry().name), options_.suffix);
    } catch (const InputError& error) {
      throw InputError(fmt::format("{}: {}", path_, error.what()));
    }
    for (const std::string& line : result.notes) note(line);
    for (const CleanPicture::Channel& channel : result.channels) {
      edits.push_back({channel.name, &channel.values, window,
                       options_.suffix.empty() ? "" : channel_beside(channel.name, options_.suffix)});
      for (size_t c = 0; c < 3; ++c)
        if (shown && channel.name == picture.target[c]) preview->set(layer::beauty.channel(c), channel.values);
    }
    for (const auto& [key, value] : result.header) attributes["brume." + key] = value;
    if (!result.sum.empty()) attributes["brume.sum"] = result.sum;
    log(common, told(picture, filter, result));
  }
  const ExrCopyReport report = copy_exr(path_, output, edits, attributes, {common.threads, {}, &interrupted});
  for (const std::string& part : report.rounded)
    note(fmt::format("{} is stored as PXR24, which keeps 24 bits of a float: sums are right to those", part));
  for (const std::string& part : report.recoded)
    note(
        fmt::format("{} is stored with a compression that loses some of every value: it was packed anew, so that its "
                    "other channels changed a little, too, and sums are right to that loss only",
                    part));
}

std::string KeptFile::told(const ForeignFrame& picture, const FilterSettings& filter,
                           const CleanPicture& result) const {
  const bool beside = !options_.suffix.empty();
  const size_t made = result.channels.size(), kept = info_.channels.size() - (beside ? 0 : made);
  return fmt::format("{}: cleaned {} with {}{}; {} channels {}, {} as they were ({:.1f} ms)", picture.label(),
                     join(result.cleaned), filter.entry().name, result.sum.empty() ? "" : ", " + result.sum, made,
                     beside ? "new" : "replaced", kept, 1e3 * result.seconds);
}

}  // namespace brume::app

// A file that is cleaned where it stands: everything in it is kept, what is cleaned is replaced or stands beside.

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <list>
#include <set>

#include "base/error.h"
#include "base/text.h"
#include "filters/api/requirements.h"
#include "filters/run/clean_picture.h"
#include "image/exr_copy.h"
#include "image/exr_io.h"
#include "workflows/open_frame.h"
#include "workflows/second_frame.h"
#include "workflows/version.h"

namespace brume {
namespace {

/// The pictures of a file, by the user's map or by themselves. @param second  whether another file holds their halves
/// @throws InputError
std::vector<ForeignFrame> pictures_of(const std::string& path, const ExrInfo& info, const FileOptions& options,
                                      bool second) {
  std::vector<ForeignFrame> pictures = options.map.empty() ? recognise(info) : read_map(options.map, info);
  for (ForeignFrame& picture : pictures) {
    if (!picture.conflicts.empty()) throw InputError(fmt::format("{}: {}", path, join(picture.conflicts, "; ")));
    if (options.samples > 0) picture.samples = options.samples;
    if (second) give_halves(picture);
  }
  return pictures;
}

/// The name by which a map calls the layer of a picture's channels, in quotes.
std::string name_in_map(const ChannelTriple& channels) {
  const size_t dot = channels[0].rfind('.');
  return fmt::format("\"{}\"", dot == std::string::npos ? "" : channels[0].substr(0, dot));
}

/// What a map could say of a file in which nothing is known: a layer of colours, or a channel as a grey picture.
std::string example_for_map(const ExrInfo& info) {
  const auto has = [&](const std::string& name) {
    return std::any_of(info.channels.begin(), info.channels.end(), [&](const auto& c) { return c.name == name; });
  };
  for (const ExrInfo::Channel& c : info.channels)
    if (const std::string prefix = c.name.substr(0, c.name.rfind('.') + 1);
        prefix.size() > 1 && has(prefix + "R") && has(prefix + "G") && has(prefix + "B"))
      return fmt::format("\"{}\"", prefix.substr(0, prefix.size() - 1));
  if (info.channels.empty()) return "\"LAYER\"";
  return fmt::format("[\"{0}\", \"{0}\", \"{0}\"], which is grey,", info.channels.front().name);
}

/// Where two pictures differ, of which a half one may be the other's rounded; nothing where they do not.
std::optional<ivec2> first_difference(const Layers& frame, const ChannelTriple& a, const ChannelTriple& b, bool half) {
  for (size_t c = 0; c < 3; ++c) {
    Plane one = frame.at(a[c]), other = frame.at(b[c]);
    if (half) round_to_half(one), round_to_half(other);
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x)
        if (one(x, y) != other(x, y) && !(std::isnan(one(x, y)) && std::isnan(other(x, y))))
          return frame.origin + ivec2(x, y);
  }
  return std::nullopt;
}

/// Refuses a file that has a picture under several names, unless they hold the same pixels. @throws InputError
void check_alike(const ExrFile& file, const ForeignFrame& picture) {
  if (picture.alike.empty()) return;
  std::set<std::string> wanted(picture.target.begin(), picture.target.end());
  std::string names = name_in_map(picture.target);
  for (const ChannelTriple& other : picture.alike) {
    wanted.insert(other.begin(), other.end());
    names += ", " + name_in_map(other);
  }
  bool half = false, one_window = true;
  const ExrInfo::Channel* first = nullptr;
  for (const ExrInfo::Channel& c : file.info().channels) {
    if (!wanted.contains(c.name)) continue;
    if (!first) first = &c;
    half |= c.type == "half";
    one_window &= c.data == first->data;
  }
  const auto fail = [&](const ChannelTriple& other, const std::string& how) {
    throw InputError(fmt::format(
        "{}: the picture could be any of its layers {}: {} and {} {}; say which in a mapping file: color = {} (--map, docs/frames.md)",
        file.path().string(), names, name_in_map(picture.target), name_in_map(other), how,
        name_in_map(picture.target)));
  };
  if (!one_window) fail(picture.alike[0], "cover different pixels");
  const Layers frame = file.read([&](const std::string& name) { return wanted.contains(name); });
  for (const ChannelTriple& other : picture.alike)
    if (const auto at = first_difference(frame, picture.target, other, half))
      fail(other, fmt::format("differ, first at pixel {},{}", at->x, at->y));
}

std::array<Plane*, 3> planes_of(Layers& frame, const ChannelTriple& channels) {
  return {frame.find(channels[0]), frame.find(channels[1]), frame.find(channels[2])};
}

/// Refuses X Y Z that are no CIE XYZ, whose components are not negative but for a filter's rounding. @throws InputError
void check_xyz(const ExrFile& file, const ForeignFrame& picture) {
  if (!picture.cie_xyz) return;
  constexpr double kMost = 0.01;     // of the pixels
  constexpr float kClearly = 1e-3f;  // below 0, over the largest component
  const std::set<std::string> wanted(picture.target.begin(), picture.target.end());
  Layers frame = file.read([&](const std::string& name) { return wanted.contains(name); });
  const std::array<Plane*, 3> planes = planes_of(frame, picture.target);
  size_t below = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x) {
      const auto [least, most] = std::minmax({(*planes[0])(x, y), (*planes[1])(x, y), (*planes[2])(x, y)});
      if (least < -kClearly * std::max(std::abs(least), std::abs(most))) ++below;
    }
  const double share = static_cast<double>(below) / (static_cast<double>(frame.width()) * frame.height());
  if (share > kMost)
    throw InputError(fmt::format(
        "{}: X Y Z are negative in {:.0f} % of the pixels, as positions and normals are and CIE XYZ is not, and nothing else in it is known to be a picture; it has {}. Say which one to clean in a mapping file: color = \"LAYER\" (--map, docs/frames.md)",
        file.path().string(), 100 * share, channels_text(file.info())));
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

/// A frame of the sequence as the same picture sees it: what its layers mean, and what they hold.
struct NearbyPicture {
  std::vector<ForeignFrame> pictures;
  Layers layers{1, 1};
};

/// One line on the layers that were given the same clean pixels.
std::string told_alike(const ForeignFrame& picture) {
  std::vector<std::string> names;
  for (const ChannelTriple& other : picture.alike) names.push_back(name_in_map(other));
  return fmt::format("{} {} the picture's very pixels and {} the clean ones, too", join(names),
                     names.size() == 1 ? "holds" : "hold", names.size() == 1 ? "gets" : "get");
}

class KeptFile : public OpenFrame {
 public:
  KeptFile(const FrameFiles& files, ExrFile file, const DenoiseOptions& options, std::vector<ForeignFrame> pictures,
           const Host& host)
      : OpenFrame(files, std::move(file), options, host), path_(files.frame.string()), pictures_(std::move(pictures)) {}

  bool ours() const override { return false; }
  Layers outline() const override;
  void read(const DenoisePlan& plan) override;
  void clean(const FilterSettings& filter, const std::vector<FrameFiles>& near, const std::filesystem::path& output,
             const std::filesystem::path& preview) override;

 private:
  std::string what_speaks_against_guides() const override;
  /// A frame of one pixel with the file's channels.
  Layers channel_names() const;
  /// What of a file is read to clean a picture. @param extra  channels under brume's names
  Layers read_picture(const FrameFiles& files, const ExrFile& file, const ForeignFrame& picture,
                      const std::set<std::string>& extra, bool guides) const;
  /// The same picture in the frames beside this one.
  std::list<NearbyPicture> read_nearby(const std::vector<FrameFiles>& near, const ForeignFrame& picture,
                                       const PixelWindow& window, const std::set<std::string>& extra, bool guides,
                                       std::vector<SequenceFrame>& sequence, std::list<RecordReader>& records) const;
  /// One line on what was done with a picture.
  std::string told(const ForeignFrame& picture, const FilterSettings& filter, const CleanPicture& result) const;

  const std::string path_;
  const std::vector<ForeignFrame> pictures_;
  const DenoisePlan* plan_ = nullptr;
  double exposure_ = 1;
};

Layers KeptFile::channel_names() const {
  Layers file(1, 1);
  file.header = file_.info().header;
  for (const std::string& name : guide_names()) file.add(name);
  for (const ExrInfo::Channel& c : file_.info().channels) file.add(c.name);
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

std::string KeptFile::what_speaks_against_guides() const {
  const std::set<std::string> extra = guide_names();
  for (const ForeignFrame& picture : pictures_) {
    const Layers file = read_picture(files_, file_, picture, {}, /*guides=*/true);
    const std::string wrong = brume::what_speaks_against_guides(frame_of_signal(picture, picture.color, file, extra),
                                                                files_.guides, host_.silent());
    if (!wrong.empty()) return wrong;
  }
  return "";
}

Layers KeptFile::read_picture(const FrameFiles& files, const ExrFile& file, const ForeignFrame& picture,
                              const std::set<std::string>& extra, bool guides) const {
  std::set<std::string> channels = extra;
  for (const std::string& name : picture.channels()) channels.insert(name);
  const auto read = [&](const ExrFile& from) {
    Layers frame = from.read([&](const std::string& name) { return channels.contains(name); });
    frame = cut_to_light(std::move(frame), picture, from.info());
    if (picture.cie_xyz) rgb_from_xyz(planes_of(frame, picture.target));
    return frame;
  };
  Layers frame = read(file);
  if (!files.second.empty())
    join_second(frame, read(ExrFile(files.second)), halves_of_signals(picture), {path_, files.second.string()});
  if (guides) add_guides(files.guides, files.frame, frame);
  return frame;
}

void KeptFile::read(const DenoisePlan& plan) {
  plan_ = &plan;
  // Pixels are read picture by picture, as several of a large frame would not fit.
  const std::string& exposure = options_.picture.exposure;
  exposure_ = choose_exposure(exposure, exposure == "auto" ? read_frame(file_, host_) : channel_names());
}

std::list<NearbyPicture> KeptFile::read_nearby(const std::vector<FrameFiles>& near, const ForeignFrame& picture,
                                               const PixelWindow& window, const std::set<std::string>& extra,
                                               bool guides, std::vector<SequenceFrame>& sequence,
                                               std::list<RecordReader>& records) const {
  std::list<NearbyPicture> nearby;
  for (const FrameFiles& other : near) {
    const std::string path = other.frame.string();
    try {
      const ExrFile file(other.frame);
      NearbyPicture& there = nearby.emplace_back();
      there.pictures = pictures_of(path, file.info(), options_.file, !other.second.empty());
      const ForeignFrame& same = same_view(there.pictures, picture, path);
      there.layers = read_picture(other, file, same, extra, guides);
      if (plan_->sequence && there.layers.data_window() != window)
        throw InputError(fmt::format("{}: it has the pixels {}, {} has {}", path, there.layers.data_window().text(),
                                     path_, window.text()));
      RecordReader* const recorded = other.records.empty() ? nullptr : &records.emplace_back(other.records);
      sequence.push_back({other.distance, &there.layers, recorded, &same});
    } catch (const InputError& error) {
      if (!plan_->sequence) throw;
      host_.message(fmt::format("left out beside {}: {}", path_, error.what()));
    }
  }
  return nearby;
}

void KeptFile::clean(const FilterSettings& filter, const std::vector<FrameFiles>& near,
                     const std::filesystem::path& output, const std::filesystem::path& preview) {
  const std::string& suffix = options_.file.suffix;
  ApplyOptions how = plan_->how;
  how.exposure = exposure_;
  how.records = records_ ? &*records_ : nullptr;
  const std::set<std::string> extra = readable_channels(filter, how, channel_names());
  std::list<CleanPicture> cleaned;
  std::vector<ExrEdit> edits;
  std::optional<Layers> shown;  // the first picture, clean
  if (const std::string line = note_of_colors(path_, file_.info().header, !files_.guides.empty()); !line.empty())
    host_.note(line);
  std::map<std::string, Attribute> attributes = {{"brume.version", version_text()}};
  if (!plan_->inputs.empty()) attributes[std::string("brume.") + kMadeFrom] = plan_->inputs;
  for (ForeignFrame picture : pictures_) {
    const auto is_read = [&](const ForeignFeature& feature) { return extra.contains(feature.layer.channel(0)); };
    const bool features = filter.uses_features() || filter.entry().guides ||
                          std::any_of(picture.features.begin(), picture.features.end(), is_read);
    if (!features) picture.features.clear();
    Layers file = read_picture(files_, file_, picture, extra, features);
    // Several pictures may lie in parts of their own, each with its data window.
    const PixelWindow window = file.data_window();
    std::list<RecordReader> records;
    how.sequence.clear();
    const std::list<NearbyPicture> nearby = read_nearby(near, picture, window, extra, features, how.sequence, records);
    const bool first = !preview.empty() && cleaned.empty();
    if (first) shown = file.without_channels();
    CleanPicture& result = cleaned.emplace_back();
    try {
      result =
          clean_picture(filter, picture, std::move(file), file_.info(), how, host_.task(filter.entry().name), suffix);
    } catch (const InputError& error) {
      throw InputError(fmt::format("{}: {}", path_, error.what()));
    }
    for (const std::string& line : result.notes) host_.note(line);
    if (first)
      for (const CleanPicture::Channel& channel : result.channels)
        for (size_t c = 0; c < 3; ++c)
          if (channel.name == picture.target[c]) shown->set(layer::beauty.channel(c), channel.values);
    if (picture.cie_xyz)
      xyz_from_rgb({&result.channels[0].values, &result.channels[1].values, &result.channels[2].values});
    for (const CleanPicture::Channel& channel : result.channels) {
      edits.push_back(
          {channel.name, &channel.values, window, suffix.empty() ? "" : channel_beside(channel.name, suffix)});
      for (const ChannelTriple& other : picture.alike)
        for (size_t c = 0; c < 3; ++c)
          if (channel.name == picture.target[c])
            edits.push_back(
                {other[c], &channel.values, window, suffix.empty() ? "" : channel_beside(other[c], suffix)});
    }
    if (!picture.alike.empty()) host_.note(told_alike(picture));
    for (const auto& [key, value] : result.header) attributes["brume." + key] = value;
    if (!result.sum.empty()) attributes["brume.sum"] = result.sum;
    host_.log(told(picture, filter, result));
  }
  const ExrCopyReport report = copy_exr(file_.exr(), output, edits, attributes, host_.silent());
  for (const std::string& part : report.rounded)
    host_.note(fmt::format("{} is stored as PXR24, which keeps 24 bits of a float: sums are right to those", part));
  for (const std::string& part : report.recoded)
    host_.note(fmt::format(
        "{} is stored with a compression that loses some of every value: it was packed anew, so that its other channels changed a little, too, and sums are right to that loss only",
        part));
  if (shown) options_.picture.write(preview, *shown, shown->rgb(layer::beauty), exposure_);
}

std::string KeptFile::told(const ForeignFrame& picture, const FilterSettings& filter,
                           const CleanPicture& result) const {
  const bool beside = !options_.file.suffix.empty();
  const size_t made = result.channels.size() + 3 * picture.alike.size(),
               kept = file_.info().channels.size() - (beside ? 0 : made);
  return fmt::format("{}: cleaned {} with {}{}; {} channels {}, {} as they were ({:.1f} ms)", picture.label(),
                     join(result.cleaned), filter.entry().name, result.sum.empty() ? "" : ", " + result.sum, made,
                     beside ? "new" : "replaced", kept, 1e3 * result.seconds);
}

}  // namespace

std::unique_ptr<OpenFrame> open_kept_file(const FrameFiles& files, ExrFile& file, const DenoiseOptions& options,
                                          const Host& host) {
  const FileOptions& how = options.file;
  const ExrInfo& info = file.info();
  if (is_brume_frame(info) && !how.asked()) return nullptr;
  if (!how.suffix.empty() &&
      std::none_of(how.suffix.begin(), how.suffix.end(), [](unsigned char c) { return std::isalnum(c); }))
    throw InputError(fmt::format("--suffix {}: expected letters or digits in it, as in _clean", how.suffix));
  const std::string path = files.frame.string();
  std::vector<ForeignFrame> pictures = pictures_of(path, info, how, !files.second.empty());
  const auto is_indirect = [](const ExrInfo::Channel& c) { return c.name == layer::indirect.channel(0); };
  if (pictures.empty() &&
      (is_brume_frame(info) || std::any_of(info.channels.begin(), info.channels.end(), is_indirect)))
    return nullptr;
  if (pictures.empty())
    throw InputError(fmt::format(
        "{}: none of its channels is known to be a picture, as R G B or a layer named rgba or beauty would be; it has {}. Say which one to clean in a mapping file: color = {} (--map, docs/frames.md)",
        path, channels_text(info), example_for_map(info)));
  for (const ForeignFrame& picture : pictures) {
    check_alike(file, picture);
    check_xyz(file, picture);
  }
  return std::make_unique<KeptFile>(files, std::move(file), options, std::move(pictures), host);
}

}  // namespace brume

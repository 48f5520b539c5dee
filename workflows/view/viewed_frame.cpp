#include "workflows/view/viewed_frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/error.h"
#include "base/text.h"
#include "image/guide_names.h"
#include "image/light_layers.h"
#include "image/packed_half.h"
#include "image/usable_colors.h"
#include "workflows/view/scene_text.h"
#include "workflows/view/viewed_layers.h"

namespace brume {
namespace {

constexpr float kNothingThere = 1e9f;  // from this depth on
const char* const kRadianceUnit = "W/(m^2 sr)";

bool is_statistic(const std::string& layer) {
  return layer.find(statistic::mean_variance) != std::string::npos || layer.find("half_") != std::string::npos ||
         layer.find("bucket_") != std::string::npos;
}

/// Under which a layer by its name is listed.
std::string list_of(const std::string& name) {
  if (is_statistic(name)) return "statistics";
  if (is_predicted_light(name + ".R")) return "guides of light groups";
  return name.starts_with("clean_") ? "clean" : "layers";
}

/// Whether a layer of these channels is a depth, which is then not to be mixed with its neighbour's.
bool is_depth(const std::vector<std::string>& channels) {
  if (channels.size() != 1) return false;
  const std::string& channel = channels[0];
  return channel == "Z" || channel.ends_with(".Z") || channel.ends_with(".z") || channel.ends_with("Depth.V");
}

/// The first channels of `of` that make up a colour or vector; empty: none do.
std::vector<std::string> triple_in(const std::string& prefix, const std::vector<std::string>& of) {
  for (const ChannelTriple& letters :
       {ChannelTriple{"R", "G", "B"}, {"r", "g", "b"}, {"red", "green", "blue"}, {"X", "Y", "Z"}, {"x", "y", "z"}}) {
    std::vector<std::string> channels;
    for (const std::string& letter : letters)
      if (std::find(of.begin(), of.end(), prefix + letter) != of.end()) channels.push_back(prefix + letter);
    if (channels.size() == 3) return channels;
  }
  return {};
}

/// A plane as small as it is shown: means of step x step pixels, of depths the pixel in the middle.
Plane reduced(const Plane& plane, int step, bool depth) {
  if (step == 1 && !depth) return plane;
  Plane small((plane.width() + step - 1) / step, (plane.height() + step - 1) / step);
  for (int y = 0; y < small.height(); ++y)
    for (int x = 0; x < small.width(); ++x) {
      const ivec2 lo = step * ivec2(x, y), hi = glm::min(lo + step, ivec2(plane.width(), plane.height()));
      if (depth) {
        const float z = plane((lo.x + hi.x - 1) / 2, (lo.y + hi.y - 1) / 2);
        small(x, y) = z < kNothingThere ? z : std::numeric_limits<float>::quiet_NaN();
        continue;
      }
      double sum = 0;
      for (int v = lo.y; v < hi.y; ++v)
        for (int u = lo.x; u < hi.x; ++u) sum += static_cast<double>(plane(u, v));
      small(x, y) = static_cast<float>(sum / ((hi.x - lo.x) * (hi.y - lo.y)));
    }
  return small;
}

Plane times(Plane plane, double factor) {
  for (int y = 0; y < plane.height(); ++y)
    for (float& value : plane.pixels(y)) value = static_cast<float>(factor * static_cast<double>(value));
  return plane;
}

}  // namespace

ViewedFrame::ViewedFrame(const std::filesystem::path& path, const std::filesystem::path& map) : file_(path) {
  const ExrInfo& info = file_.info();
  if (info.deep())
    throw InputError(fmt::format("{}: is deep; expected a flat frame, as brume flatten {} -o FLAT.exr makes it",
                                 path.string(), path.filename().string()));
  foreign_ = picture_in(info, map);
  lights_ = lights_in(info, foreign_);
  list_picture();
  list_lights();
  list_mattes();
  list_channels();
  if (told_.empty())
    throw InputError(
        fmt::format("{}: nothing in it can be shown: expected layers of one or three numbers a pixel, found {}",
                    path.string(), channels_text(info)));
}

void ViewedFrame::list(Entry entry) {
  for (const std::string& channel : entry.channels)
    if (!entry.matte) listed_.insert(channel);
  entry.told.channels = entry.matte ? 1 : static_cast<int>(entry.channels.size());
  if (!entries_.emplace(entry.told.name, entry).second) return;
  told_.push_back(entry.told);
}

void ViewedFrame::list_picture() {
  const ExrInfo& info = file_.info();
  const auto has = [&](const std::string& name) {
    return std::any_of(info.channels.begin(), info.channels.end(), [&](const auto& c) { return c.name == name; });
  };
  std::vector<std::string> picture;
  std::string alpha = "A";
  if (foreign_) {
    picture.assign(foreign_->target.begin(), foreign_->target.end());
    if (!has(picture[0])) listed_.insert({"Y", "RY", "BY"});  // which are read as R, G and B
    alpha = foreign_->alpha;
    notes_.push_back(fmt::format("read as {}: {}", foreign_->label(), foreign_->color.name));
    notes_.insert(notes_.end(), foreign_->conflicts.begin(), foreign_->conflicts.end());
  } else if (has("R") && has("G") && has("B")) {
    picture = {"R", "G", "B"};
  }
  if (picture.empty())
    notes_.push_back("there is no picture in it that is known as one (--map names it): its layers are shown");
  else
    list({.told = {kViewedPicture, "picture", 3, "", kRadianceUnit}, .channels = picture, .light = true});
  if (!foreign_ && has("noisy.R") && has("noisy.G") && has("noisy.B"))
    list({.told = {"noisy", "noisy", 3, "", kRadianceUnit},
          .channels = {"noisy.R", "noisy.G", "noisy.B"},
          .light = true});
  if (has(alpha)) list({.told = {kViewedAlpha, "alpha", 1, "", "1"}, .channels = {alpha}});
  const PixelWindow shown = info.display;
  notes_.push_back(fmt::format("{}: {} x {} pixels", file_.path().filename().string(), shown.width(), shown.height()));
  const auto said = [&](const char* key) {
    const auto found = info.header.find(key);
    const auto* const text = found == info.header.end() ? nullptr : std::get_if<std::string>(&found->second);
    return text ? *text : std::string();
  };
  if (const std::string filter = said("filter"); !filter.empty()) notes_.push_back("clean, by " + filter);
  if (const std::string mix = said("lightMix"); !mix.empty()) notes_.push_back("lights were mixed before: " + mix);
}

void ViewedFrame::list_lights() {
  for (size_t i = 0; i < lights_.size(); ++i)
    for (const FrameLights::Group& group : lights_[i].groups)
      list({.told = {i == 0 ? light_layer(group.name) : light_layer(group.name) + ".noisy",
                     i == 0 ? group.name : group.name + ", noisy", 3, "light groups", kRadianceUnit},
            .channels = {group.channels.begin(), group.channels.end()}});
}

void ViewedFrame::list_mattes() {
  const ExrInfo& info = file_.info();
  std::vector<std::string> channels;
  for (const ExrInfo::Channel& channel : info.channels) channels.push_back(channel.name);
  mattes_ = matte_layers(info.header, channels);
  read_manifests(mattes_, file_.path());
  for (const MatteLayer& matte : mattes_) {
    Entry entry{.matte = &matte};
    for (const auto& [id, coverage] : matte.ranks) {
      entry.channels.insert(entry.channels.end(), {id, coverage});
      listed_.insert({id, coverage});
    }
    if (!matte.problem.empty()) notes_.push_back(matte.name + ": " + matte.problem);
    for (const auto& [name, id] : matte.manifest) {
      entry.told = {"matte." + matte.name + "." + name, name, 1, "mattes of " + matte.name, "1"};
      entry.id = id;
      list(entry);
    }
  }
}

void ViewedFrame::list_channels() {
  const ExrInfo& info = file_.info();
  std::map<std::string, std::vector<std::string>> by_layer;  // channels, by what stands before their last dot
  Layers guides(1, 1);
  for (const ExrInfo::Channel& channel : info.channels) {
    if (channel.type == "uint" || listed_.contains(channel.name)) continue;
    if (is_guide(channel.name))
      guides.add(channel.name);
    else
      by_layer[channel.name.substr(0, channel.name.rfind('.') + 1)].push_back(channel.name);
  }
  std::vector<Entry> entries;
  for (auto& [prefix, channels] : by_layer) {
    const std::string layer = prefix.empty() ? "" : prefix.substr(0, prefix.size() - 1);
    const std::vector<std::string> triple = triple_in(prefix, channels);
    for (const std::string& name : triple) std::erase(channels, name);
    if (!triple.empty())
      entries.push_back({.told = {layer.empty() ? "RGB" : layer, layer.empty() ? "RGB" : layer, 3, list_of(layer)},
                         .channels = triple,
                         .light = !foreign_ && is_light_of_all_groups(triple[0])});
    for (const std::string& channel : channels) {
      const bool alone = channels.size() == 1 && triple.empty() && !layer.empty();
      entries.push_back({.told = {channel, alone ? layer : channel, 1, list_of(layer)}, .channels = {channel}});
    }
  }
  if (foreign_)
    for (Entry& entry : entries)
      for (const ForeignSignal& pass : foreign_->passes)
        entry.light = entry.light || std::equal(entry.channels.begin(), entry.channels.end(), pass.channels.begin(),
                                                pass.channels.end());
  const std::vector<std::string> order = {"clean", "layers", "guides of light groups", "statistics"};
  const auto rank = [&](const Entry& e) { return std::find(order.begin(), order.end(), e.told.group) - order.begin(); };
  std::stable_sort(entries.begin(), entries.end(), [&](const Entry& a, const Entry& b) { return rank(a) < rank(b); });
  for (Entry& entry : entries) list(std::move(entry));
  for (const ViewSceneText::Layer& guide : guide_layers_in(guides)) {
    Entry entry{.told = guide, .light = true};
    for (const auto& [channel, plane] : guides.channels())
      if (channel.substr(0, channel.rfind('.')) == guide.name) entry.channels.push_back(channel);
    if (entry.channels.size() == 3 && entry.channels[0].ends_with(".B"))
      std::reverse(entry.channels.begin(), entry.channels.end());
    list(std::move(entry));
  }
}

std::vector<std::string> ViewedFrame::light_groups() const {
  return lights_.empty() ? std::vector<std::string>() : lights_[0].names();
}

void ViewedFrame::read(const std::set<std::string>& channels, bool depth) {
  std::set<std::string> missing;
  for (const std::string& channel : channels)
    if (!planes_.contains(channel)) missing.insert(channel);
  if (missing.empty()) return;
  // Parts may lie anywhere; what is shown is what the display window shows.
  Layers frame = over_display_window(file_.read([&](const std::string& name) { return missing.contains(name); }));
  for (const std::string& channel : missing) planes_[channel] = reduced(frame.at(channel), step_, depth);
  if (foreign_ && foreign_->cie_xyz && missing.contains(foreign_->target[0]))
    rgb_from_xyz({&planes_[foreign_->target[0]], &planes_[foreign_->target[1]], &planes_[foreign_->target[2]]});
}

std::vector<Plane> ViewedFrame::planes_of(const Entry& entry, const LightMix& mix, bool& misses_mix) const {
  std::vector<Plane> planes;
  const auto is = [&](const ChannelTriple& channels) {
    return std::equal(channels.begin(), channels.end(), entry.channels.begin(), entry.channels.end());
  };
  const auto plane_of = [&](const std::string& channel) -> const Plane& { return plane(channel); };
  for (const FrameLights& lights : lights_) {
    if (!mix.empty() && is(lights.picture)) {
      for (size_t c = 0; c < 3; ++c) planes.push_back(lights.mixed(mix, c, plane_of));
      return planes;
    }
    for (const FrameLights::Group& group : lights.groups)
      if (const auto factor = mix.find(group.name); is(group.channels) && factor != mix.end()) {
        for (size_t c = 0; c < 3; ++c)
          planes.push_back(times(plane(group.channels[c]), factor->second[static_cast<int>(c)]));
        return planes;
      }
  }
  misses_mix = entry.light && !mix.empty();
  for (const std::string& channel : entry.channels) planes.push_back(plane(channel));
  return planes;
}

std::optional<ViewPicture> ViewedFrame::picture(const std::string& layer, const LightMix& mix, const ivec2& room) {
  const auto found = entries_.find(layer);
  if (found == entries_.end()) return std::nullopt;
  const Entry& entry = found->second;
  const PixelWindow display = file_.info().display;
  const int step = std::max({1, display.width() / room.x, display.height() / room.y});
  if (std::exchange(step_, step) != step) planes_.clear();
  ViewPicture picture;
  std::vector<Plane> planes;
  if (entry.matte) {
    if (!planes_.contains(layer)) {
      const Layers ranks = over_display_window(file_.read([&](const std::string& name) {
        return std::find(entry.channels.begin(), entry.channels.end(), name) != entry.channels.end();
      }));
      planes_[layer] = reduced(matte(ranks, *entry.matte, {entry.id}), step_, false);
    }
    planes.push_back(plane(layer));
  } else {
    std::set<std::string> needed(entry.channels.begin(), entry.channels.end());
    for (const FrameLights& lights : lights_)
      if (!mix.empty() &&
          std::equal(lights.picture.begin(), lights.picture.end(), entry.channels.begin(), entry.channels.end()))
        for (const FrameLights::Group& group : lights.groups)
          needed.insert(group.channels.begin(), group.channels.end());
    read(needed, is_depth(entry.channels));
    planes = planes_of(entry, mix, picture.misses_mix);
  }
  Layers shown(planes[0].width(), planes[0].height());
  shown.header = file_.info().header;
  for (size_t c = 0; c < planes.size(); ++c) shown.set(entry.channels[c], std::move(planes[c]));
  convert_to_rec709(shown, file_.path().string());
  picture.layer = layer;
  picture.width = shown.width();
  picture.height = shown.height();
  picture.channels = entry.told.channels;
  picture.exposure = shown.number("exposure").value_or(1.0);
  for (int c = 0; c < picture.channels; ++c) {
    const std::vector<uint16_t> halves = half_bits(shown.at(entry.channels[static_cast<size_t>(c)]));
    picture.halves.insert(picture.halves.end(), halves.begin(), halves.end());
  }
  return picture;
}

}  // namespace brume

#include "workflows/open_frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <list>

#include "base/error.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/run/clean_lights.h"
#include "image/cryptomatte.h"
#include "image/exr_io.h"
#include "image/light_layers.h"
#include "workflows/second_frame.h"
#include "workflows/version.h"

namespace brume {
namespace {

/// A frame whose layers have brume's names, and which is written as brume writes its own.
class OwnFrame : public OpenFrame {
 public:
  OwnFrame(const FrameFiles& files, ExrFile file, const DenoiseOptions& options, FrameWindow& window, const Host& host)
      : OpenFrame(files, std::move(file), options, host), window_(window) {}

  bool ours() const override { return true; }
  Layers outline() const override {
    Layers outline = outline_of(file_.info());
    if (!files_.second.empty())
      for (const auto& [channel, halves] : halves_of_layers(outline))
        for (const std::string& half : halves) outline.add(half);
    for (const std::string& name : guide_names()) outline.add(name);
    return outline;
  }
  void read(const DenoisePlan& plan) override;
  void clean(const FilterSettings& filter, const std::vector<FrameFiles>& near, const std::filesystem::path& output,
             const std::filesystem::path& preview) override;

 private:
  std::string what_speaks_against_guides() const override;
  void read_others(const DenoisePlan& plan, const std::set<std::string>& channels);

  FrameWindow& window_;
  const Layers* frame_ = nullptr;  // in the window
  ApplyOptions how_;
  std::vector<SequenceFrame> others_;
  std::list<RecordReader> records_of_others_;
  std::string inputs_;
};

std::string OwnFrame::what_speaks_against_guides() const {
  std::set<std::string> channels = guide_names();
  for (const std::string_view which : {std::string_view(), statistic::half_a, statistic::half_b})
    for (const std::string& name : layer::beauty.channel_names(which)) channels.insert(name);
  for (const LayerName& l : find_filter("transport_regression").can_use)
    for (const std::string& name : l.channel_names()) channels.insert(name);
  return brume::what_speaks_against_guides(window_.get(files_, channels, host_, &file_), files_.guides, host_.silent());
}

void OwnFrame::read(const DenoisePlan& plan) {
  const Layers known = outline();
  std::set<std::string> channels;
  if (options_.picture.exposure == "auto") channels = {"R", "G", "B"};
  for (const FilterSettings& filter : plan.filters) channels.merge(readable_channels(filter, plan.how, known));
  for (const std::string& name : layer::noisy.channel_names()) channels.insert(name);
  for (const std::string& name : known.names())
    if (name.starts_with(kLightPrefix)) channels.insert(name);
  for (const std::string& name : matte_channels(known)) channels.insert(name);
  window_.keep(files_, plan.others);
  frame_ = &window_.get(files_, channels, host_, &file_);
  if (const std::string line = note_of_colors(files_.frame.string(), frame_->header, !files_.guides.empty());
      !line.empty())
    host_.note(line);
  how_ = plan.how;
  how_.exposure = choose_exposure(options_.picture.exposure, *frame_);
  how_.records = records_ ? &*records_ : nullptr;
  inputs_ = plan.inputs;
  read_others(plan, channels);
}

void OwnFrame::read_others(const DenoisePlan& plan, const std::set<std::string>& channels) {
  for (const FrameFiles& files : plan.others) {
    try {
      const Layers& layers = window_.get(files, channels, host_);
      if (plan.sequence && layers.data_window() != frame_->data_window())
        throw InputError(fmt::format("{}: it has the pixels {}, {} has {}", files.frame.string(),
                                     layers.data_window().text(), files_.frame.string(), frame_->data_window().text()));
      others_.push_back({files.distance, &layers});
      if (!files.records.empty()) others_.back().records = &records_of_others_.emplace_back(files.records);
    } catch (const InputError& error) {
      if (!plan.sequence) throw;
      host_.message(fmt::format("left out beside {}: {}", files_.frame.filename().string(), error.what()));
    }
  }
}

void OwnFrame::clean(const FilterSettings& filter, const std::vector<FrameFiles>& near,
                     const std::filesystem::path& output, const std::filesystem::path& preview) {
  how_.sequence.clear();
  for (const SequenceFrame& other : others_)
    if (std::any_of(near.begin(), near.end(), [&](const FrameFiles& f) { return f.distance == other.distance; }))
      how_.sequence.push_back(other);
  CleanLayers clean;
  try {
    clean = run_filter(filter, *frame_, how_, host_);
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", files_.frame.string(), error.what()));
  }
  if (!inputs_.empty()) clean.layers.header[kMadeFrom] = inputs_;
  write_exr(output, clean.layers);
  if (!preview.empty()) options_.picture.write(preview, clean.layers, clean.layers.rgb(layer::beauty), how_.exposure);
  host_.log(fmt::format("{} ({}): {:.1f} ms", filter.entry().name, filter.text(), 1e3 * clean.seconds));
}

}  // namespace

void tell_clean(const std::string& filter, const Host& host) {
  if (!filter.empty())
    host.note(fmt::format(
        "the frame is clean already, by {}: what is cleaned is that picture, and filtering it again loses detail; expected the frame that it was made from",
        filter));
}

ApplyOptions as_recommended(const ApplyOptions& how, const Layers& outline, const Host& host) {
  ApplyOptions options = how;
  const LayerName signal = signals_of(how).front();
  if (how.noise != NoiseSource::kLayers || outline.has(signal, statistic::mean_variance) || has_halves(outline, signal))
    return options;
  options.noise = NoiseSource::kSpatial;
  host.note("the frame has no statistics: its noise is estimated from the picture (--noise spatial)");
  return options;
}

void take_noisy(Layers& frame, const Host& host) {
  host.note("the frame is clean already: what it was made from, its layer noisy, is cleaned");
  for (size_t c = 0; c < 3; ++c) frame.set(layer::beauty.channel(c), frame.at(layer::noisy.channel(c)));
}

CleanLayers run_filter(const FilterSettings& filter, const Layers& frame, const ApplyOptions& how, const Host& host) {
  ApplyReport report;
  Layers clean = apply_filter(filter, frame, how, host.task(filter.entry().name), &report);
  for (const std::string& line : report.notes) host.note(line);
  const Stopwatch watch;
  clean_lights(filter, how, frame, clean, host.silent());
  for (const std::string& channel : matte_channels(frame)) clean.set(channel, frame.at(channel));
  stamp(clean);
  return {std::move(clean), report.seconds + watch.seconds()};
}

OpenFrame::OpenFrame(const FrameFiles& files, ExrFile file, const DenoiseOptions& options, const Host& host)
    : files_(files), file_(std::move(file)), guides_(read_guide_outline(files.guides)), options_(options), host_(host) {
  if (!files.records.empty()) records_.emplace(files.records);
}

std::string OpenFrame::what_forbids_guides() const {
  if (files_.guides.empty()) return "";
  Layers frame(1, 1);
  frame.header = file_.info().header;
  return of_one_scene(guides_, frame) ? "" : what_speaks_against_guides();
}

void OpenFrame::leave_guides() {
  files_.guides.clear();
  guides_ = Layers(1, 1);
}

std::set<std::string> OpenFrame::guide_names() const {
  const std::vector<std::string> names = guides_.names();
  return {names.begin(), names.end()};
}

const Layers& FrameWindow::get(const FrameFiles& files, const std::set<std::string>& channels, const Host& host,
                               const ExrFile* file) {
  Entry& entry = frames_[files.frame];
  if (entry.layers && entry.channels == channels) return *entry.layers;
  Layers frame = file ? read_frame(*file, host, channels) : read_frame(ExrFile(files.frame), host, channels);
  if (!files.second.empty())
    join_second(frame, read_frame(ExrFile(files.second), host, channels), halves_of_layers(frame),
                {files.frame.string(), files.second.string()});
  if (!files.guides.empty()) add_guides(files.guides, files.frame, frame);
  if (frame.has(layer::noisy))
    take_noisy(frame, host);
  else
    tell_clean(frame.text("filter"), host);
  entry = {channels, std::move(frame)};
  return *entry.layers;
}

void FrameWindow::keep(const FrameFiles& own, const std::vector<FrameFiles>& others) {
  std::set<std::filesystem::path> used = {own.frame};
  for (const FrameFiles& files : others) used.insert(files.frame);
  std::erase_if(frames_, [&](const auto& item) { return !used.contains(item.first); });
}

std::unique_ptr<OpenFrame> open_frame(const FrameFiles& files, const DenoiseOptions& options, FrameWindow& window,
                                      const Host& host) {
  ExrFile file(files.frame);
  if (std::unique_ptr<OpenFrame> kept = open_kept_file(files, file, options, host)) return kept;
  return std::make_unique<OwnFrame>(files, std::move(file), options, window, host);
}

}  // namespace brume

// Frames that are cleaned in memory.

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "base/error.h"
#include "filters/api/recommend.h"
#include "filters/api/requirements.h"
#include "image/cryptomatte.h"
#include "image/foreign.h"
#include "image/light_layers.h"
#include "workflows/denoise_frame.h"
#include "workflows/open_frame.h"

namespace brume {
namespace {

/// The channels of a frame with one pixel, and those of the guides.
Layers outline_of(const Layers& frame, const NamedFrame* guides) {
  Layers outline(1, 1);
  outline.header = frame.header;
  for (const auto& [name, plane] : frame.channels()) outline.add(name);
  if (guides)
    for (const std::string& name : guides->frame.names()) outline.add(name);
  adopt_foreign_layers(outline);
  return outline;
}

/// Whether guides serve a frame; says why not.
bool serve(const NamedFrame& guides, const MemoryFrame& of, const Host& host) {
  if (of_one_scene(guides.frame, *of.frame)) return true;
  Layers both = *of.frame;
  adopt_foreign_layers(both);
  add_guides(guides.frame, {guides.name, of.name}, both);
  const std::string wrong = what_speaks_against_guides(both, guides.name, host.silent());
  if (!wrong.empty()) host.say(Host::Word::kWarning, wrong);
  return wrong.empty();
}

/// A frame as a filter is given it: with its guides, under brume's names, and raw where it is clean already.
class GivenFrame {
 public:
  GivenFrame(const FilterSettings& filter, const ApplyOptions& how, const MemoryFrame& of, const Host& host)
      : frame_(of.frame) {
    const Layers& frame = *of.frame;
    if (const std::string line = note_of_colors(of.name, frame.header, of.guides != nullptr); !line.empty())
      host.note(line);
    const bool again = frame.has(layer::noisy), whole = !frame.has(layer::beauty);
    if (!again && !of.guides && !whole) return;
    std::set<std::string> channels = readable_channels(filter, how, outline_of(frame, of.guides));
    for (const std::string& name : frame.names())
      if (whole || name.starts_with(kLightPrefix)) channels.insert(name);
    channels.insert({"R", "G", "B"});
    for (const std::string& name : matte_channels(frame)) channels.insert(name);
    changed_ = part_of(frame, channels);
    adopt_foreign_layers(*changed_);
    if (again) {
      for (size_t c = 0; c < 3; ++c) changed_->set(layer::noisy.channel(c), frame.at(layer::noisy.channel(c)));
      take_noisy(*changed_, host);
    }
    if (of.guides) add_guides(of.guides->frame, {of.guides->name, of.name}, *changed_);
  }
  const Layers& layers() const { return changed_ ? *changed_ : *frame_; }

 private:
  const Layers* frame_;
  std::optional<Layers> changed_;
};

/// How a frame is cleaned, decided before those beside it are looked at.
struct Choice {
  bool guides;  ///< whether they are used, its own and the others'
  FilterSettings filter;
  ApplyOptions how;
  int window;  ///< frames before and after
};

/// Cleans frames that lie side by side in memory.
class MemoryDenoiser {
 public:
  /// @param told  why the filter is the best one, when it was said last
  MemoryDenoiser(const DenoiseOptions& options, const Host& host, bool sequence, std::string& told)
      : options_(options), host_(host), sequence_(sequence), told_(told) {
    if (options.filters.size() > 1) throw InputError("one filter at a time cleans a frame in memory");
  }

  Choice choose(const MemoryFrame& own) {
    const bool guides = own.guides && serve(*own.guides, own, host_);
    ApplyOptions how = options_.how;
    const FilterSettings filter = filter_for(*own.frame, guides ? own.guides : nullptr, how);
    return {guides, filter, how, options_.extra_frames.value_or(sequence_ ? filter.entry().frame_window : 0)};
  }

  /// @param frames  by their distances from the one at 0
  Layers clean(const Choice& choice, std::map<int, MemoryFrame> frames) {
    ApplyOptions how = choice.how;
    std::map<int, GivenFrame> given;
    for (auto& [distance, frame] : frames) {
      if (!choice.guides) frame.guides = nullptr;
      const Host silent{host_.threads, host_.cancel};
      given.emplace(std::piecewise_construct, std::forward_as_tuple(distance),
                    std::forward_as_tuple(choice.filter, how, frame, distance == 0 ? host_ : silent));
    }
    const Layers& layers = given.at(0).layers();
    how.exposure = choose_exposure(options_.picture.exposure, layers);
    for (const auto& [distance, other] : given) {
      if (distance == 0) continue;
      if (other.layers().data_window() == layers.data_window())
        how.sequence.push_back({distance, &other.layers()});
      else
        host_.message(fmt::format("left out beside {}: {} has the pixels {}, not {}", frames[0].name,
                                  frames[distance].name, other.layers().data_window().text(),
                                  layers.data_window().text()));
    }
    return run_filter(choice.filter, layers, how, host_).layers;
  }

 private:
  /// @param how  as asked; then with what the filter needs
  FilterSettings filter_for(const Layers& frame, const NamedFrame* guides, ApplyOptions& how) {
    if (!options_.filters.empty()) return options_.filters[0];
    const Layers outline = outline_of(frame, guides);
    how = as_recommended(how, outline, host_);
    const Recommendation best = recommend_filter(outline, how,
                                                 /*sequence=*/options_.extra_frames.value_or(0) > 0);
    if (best.reason != told_) host_.log(best.reason);
    told_ = best.reason;
    return best.filter;
  }

  const DenoiseOptions& options_;
  const Host& host_;
  const bool sequence_;
  std::string& told_;
};

/// A host that is told the progress of piece i of so many.
Host of_piece(const Host& host, size_t i, size_t count) {
  Host own{host.threads, host.cancel, host.tell};
  if (host.progress)
    own.progress = [&host, i, count](const std::string& stage) -> std::function<void(double)> {
      const std::function<void(double)> told = host.progress(stage);
      if (!told) return {};
      return [told, i, count](double f) { told((static_cast<double>(i) + f) / static_cast<double>(count)); };
    };
  return own;
}

}  // namespace

Layers denoise_frame(const Layers& frame, const NamedFrame* guides, const DenoiseOptions& options, const Host& host) {
  const MemoryFrame own{"the frame", &frame, guides};
  std::string told;
  MemoryDenoiser denoiser(options, host, /*sequence=*/false, told);
  return denoiser.clean(denoiser.choose(own), {{0, own}});
}

std::vector<Layers> denoise_frames(size_t count, const std::function<MemoryFrame(size_t i)>& get,
                                   const std::function<void(size_t i)>& let_go, const DenoiseOptions& options,
                                   const Host& host) {
  std::vector<Layers> clean;
  std::string told;
  size_t oldest = 0;
  for (size_t i = 0; i < count; ++i) {
    const Host own_host = of_piece(host, i, count);
    MemoryDenoiser denoiser(options, own_host, /*sequence=*/true, told);
    const Choice choice = denoiser.choose(get(i));
    const auto window = static_cast<size_t>(choice.window);
    const size_t first = i > window ? i - window : 0, last = std::min(count - 1, i + window);
    for (; oldest < first; ++oldest) let_go(oldest);
    std::map<int, MemoryFrame> frames;
    for (size_t k = first; k <= last; ++k) frames[static_cast<int>(k) - static_cast<int>(i)] = get(k);
    clean.push_back(denoiser.clean(choice, std::move(frames)));
  }
  return clean;
}

}  // namespace brume

#include "workflows/comparison.h"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.h"
#include "base/text.h"
#include "filters/api/requirements.h"
#include "image/usable_colors.h"
#include "render/session/render_state.h"

namespace brume {
namespace {

/// What is to be said where two frames were rendered from scenes that differ; empty: nothing, as where another renderer
/// made one of them.
std::string remark_on_scenes(const NamedFrame& picture, const NamedFrame& reference) {
  const Layers &a = picture.frame, &b = reference.frame;
  const std::string ours = a.text("sceneHash"), theirs = b.text("sceneHash");
  if (ours.empty() || theirs.empty() || ours == theirs) return "";
  const bool renamed = a.text("scene") != b.text("scene");
  return fmt::format("{} and {} were rendered from scenes that differ: {}", picture.name, reference.name,
                     renamed ? fmt::format("{} and {}", a.text("scene"), b.text("scene"))
                             : differing_render(a, b, "in the one", "in the other"));
}

/// @param pictures  the reference first
PixelWindow cut_to_common_window(const std::vector<NamedFrame*>& pictures) {
  const NamedFrame& reference = *pictures[0];
  const PixelWindow display = reference.frame.display_window();
  PixelWindow common = reference.frame.data_window();
  for (const NamedFrame* other : pictures) {
    const PixelWindow shown = other->frame.display_window();
    if (shown.width() != display.width() || shown.height() != display.height())
      throw InputError(fmt::format("{} is {} x {}, {} is {} x {}; expected one size", other->name, shown.width(),
                                   shown.height(), reference.name, display.width(), display.height()));
    if (shown != display)
      throw InputError(fmt::format("{} is shown in the window {}, {} in {}; expected one display window", other->name,
                                   shown.text(), reference.name, display.text()));
    common = common.common(other->frame.data_window());
    if (common.empty())
      throw InputError(fmt::format("{} has pixels in {}, {} in {}: none is in both", other->name,
                                   other->frame.data_window().text(), reference.name,
                                   reference.frame.data_window().text()));
  }
  for (NamedFrame* picture : pictures)
    if (picture->frame.data_window() != common) picture->frame = picture->frame.cut(common);
  return common;
}

}  // namespace

Comparison::Comparison(NamedFrame picture, NamedFrame reference, std::optional<NamedFrame> second, const Host& host)
    : picture_(std::move(picture)), reference_(std::move(reference)), second_(std::move(second)) {
  std::vector<NamedFrame*> pictures = {&reference_, &picture_};
  if (second_) pictures.push_back(&*second_);
  for (size_t i = 1; i < pictures.size(); ++i)
    if (const std::string remark = remark_on_scenes(*pictures[i], reference_); !remark.empty()) host.note(remark);
  for (NamedFrame* each : pictures)
    if (const std::string space = convert_to_rec709(each->frame, each->name); !space.empty())
      host.note(fmt::format("{}: its colours are {}: compared in linear Rec. 709", each->name, space));
  display_ = reference_.frame.display_window();
  window_ = cut_to_common_window(pictures);
  medium_ = medium_mask(reference_.frame);
}

RgbPlanes Comparison::colours(const NamedFrame& frame, const std::string& layer) {
  const LayerName wanted{layer, "RGB", ""};
  if (!frame.frame.has(wanted))
    throw InputError(
        fmt::format("{}: has no layer '{}'; it has: {}", frame.name, wanted.label(), join(layer_names(frame.frame))));
  return frame.frame.rgb(wanted);
}

std::vector<std::string> Comparison::common_layers() const {
  std::vector<std::string> names;
  for (const std::string& channel : picture_.frame.names()) {
    if (!channel.ends_with(".R") || std::count(channel.begin(), channel.end(), '.') != 1) continue;
    const std::string name = channel.substr(0, channel.size() - 2);
    const LayerName layer{name, "RGB", ""};
    const bool statistic =
        name == statistic::mean_variance || name == statistic::half_a || name == statistic::half_b ||
        std::find(statistic::buckets.begin(), statistic::buckets.end(), name) != statistic::buckets.end();
    if (!statistic && picture_.frame.has(layer) && reference_.frame.has(layer)) names.push_back(name);
  }
  return names;
}

std::vector<Errors> Comparison::errors(const std::string& layer, const LabPolicy& policy, ErrorScope scope,
                                       const Task& task) const {
  std::vector<Mask> regions = {{}};
  if (!medium_.empty()) regions.push_back(medium_);
  const RgbPlanes other = second(layer);
  return compare_regions(picture(layer), reference(layer), policy, regions, second_ ? &other : nullptr, scope, task);
}

}  // namespace brume

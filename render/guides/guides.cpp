#include "render/guides/guides.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "render/guides/guide_march.h"

namespace brume {
namespace {

// Times of the shutter that are marched where anything moves; the light is solved for the one in the middle.
constexpr int kTimes = 4;
constexpr double kMostDetail = 2;

}  // namespace

double Guides::detail(int samples) {
  double detail = 1;
  for (int more = 8; more <= samples && detail < kMostDetail; more *= 4) detail *= std::cbrt(2.0);
  return std::min(detail, kMostDetail);
}

Guides::Guides(const PathContext& context, int samples, double pixels, const Task& task, double step)
    : context_(context), step_(step) {
  const Stopwatch watch;
  const auto moves = [](const auto& field) { return field.moves(); };
  const bool moving = std::any_of(context.media.begin(), context.media.end(), moves) ||
                      std::any_of(context.emissions.begin(), context.emissions.end(), moves);
  const int times = moving ? kTimes : 1;
  for (int i = 0; i < times; ++i) media_.emplace_back(context.media, context.emissions, (i + 0.5) / times, quiet(task));
  if (media_[0].empty()) return;
  colours_ = media_[0].coloured() ? std::vector<GuideColour>{0, 1, 2} : std::vector<GuideColour>{kGrey};
  const GuideMedia& middle = media_[static_cast<size_t>(times / 2)];
  for (const GuideColour colour : colours_)
    fields_.emplace_back(middle, *context.lights, context.surfaces, colour, detail(samples), pixels, task);
  seconds_ = watch.seconds();
}

void Guides::record(const Camera& camera, const ivec2& corner, Layers& frame, const Task& task) const {
  if (media_[0].empty()) return;
  for (size_t i = 0; i < colours_.size(); ++i)
    GuideMarch(context_, media_, fields_[i], colours_[i], camera, step_).record(corner, frame, task);
}

size_t Guides::bytes() const {
  size_t sum = 0;
  for (const LightFields& f : fields_) sum += f.bytes();
  return sum;
}

std::string Guides::explain() const {
  if (media_[0].empty()) return "none: nothing scatters or glows";
  const LightFields& f = fields_[0];
  const ivec3 n = f.lattice().n;
  std::string names;
  for (const GroupLight& g : f.groups()) names += (names.empty() ? "" : ", ") + g.group.name;
  return fmt::format("light of {} on {} x {} x {} nodes, {:.3g} voxels apart{}: {:.1f} MB, solved in {:.2f} s",
                     names.empty() ? "nothing" : names, n.x, n.y, n.z, f.lattice().spacing / media_[0].voxel(),
                     colours_.size() > 1 ? ", for red, green and blue" : "", static_cast<double>(bytes()) / 1e6,
                     seconds_);
}

}  // namespace brume

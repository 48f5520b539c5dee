#include "render/guides/guide_march.h"

#include <algorithm>
#include <atomic>
#include <mutex>
#include <utility>

#include "base/parallel_for.h"
#include "render/guides/guide_layers.h"
#include "render/guides/guide_tile.h"

namespace brume {
namespace {

constexpr double kSketchStride = 2;  // of all steps

bool any_mirrors(const Surfaces* surfaces) {
  for (uint32_t i = 0; surfaces && i < surfaces->count(); ++i)
    if (surfaces->settings(i).material != "diffuse") return true;
  return false;
}

/// Steps through detail are as short as it is fine, or as pixels are where these are larger.
double step_through_detail(const GuideMedia& media, const Camera& camera, double step_voxels) {
  const double grain = media.grain();
  if (!(grain < step_voxels)) return step_voxels;
  const dvec2 middle = 0.5 * dvec2(camera.film_size());
  const Ray a = camera.ray(middle), b = camera.ray(middle + dvec2(1, 0));
  const double distance = glm::distance(a.o, 0.5 * (media.lo() + media.hi()));
  return std::clamp(glm::distance(a.at(distance), b.at(distance)) / media.voxel(), grain, step_voxels);
}

}  // namespace

GuideMarch::GuideMarch(const PathContext& context, const std::vector<GuideMedia>& media, const LightFields& fields,
                       GuideColour colour, const Camera& camera, double step_voxels, bool sketch, const Task& task)
    : context_(context),
      media_(media),
      fields_(fields),
      colour_(colour),
      sketch_(sketch),
      rays_(context, camera, media[0], media.size() > 1, sketch),
      surfaces_{fields.lights(),
                *context.lights,
                fields.scaled_extinction(),
                fields.sky_parts(),
                context.surfaces,
                fields.ambient_light(),
                fields.surface_light(),
                sketch ? nullptr : &media[media.size() / 2],
                colour},
      reference_depth_(glm::distance(camera.ray(dvec2(0)).o, 0.5 * (media[0].lo() + media[0].hi()))),
      node_fields_(fields, media[0], colour, camera, media.size() > 1, task) {
  if (colour == kGrey && !media[0].media().empty()) tint_ = OrderTint(media[0].tint(0));
  if (any_mirrors(context.surfaces)) node_light_ = any_direction(fields, media[0], colour, task);
  const double step = sketch ? kSketchStride * step_voxels : step_through_detail(media[0], camera, step_voxels);
  const MarchSteps steps(media[0], fields, colour, step);
  for (size_t time = 0; time < media.size(); ++time) scenes_.emplace_back(media, time, fields, colour, steps);
}

void GuideMarch::record(const std::vector<const GuideMarch*>& colours, const ivec2& corner, Layers& frame,
                        const Task& task, const Marched& done, DeepRecord* deep) {
  const Lights& lights = *colours[0]->context_.lights;
  const std::optional<size_t> background = lights.group_of_background();
  std::vector<GuideLayers> layers;
  for (const GuideMarch* const march : colours) {
    if (deep) deep->prepare(march->colour_);
    layers.emplace_back(frame, march->fields_.lights(), march->colour_,
                        GuideLayers::Contents{.emission = !march->media_[0].emissions().empty(),
                                              .surfaces = march->context_.surfaces != nullptr,
                                              .mirrors = !march->node_light_.values.empty(),
                                              .mixed_tints = march->media_[0].mixed_tints(),
                                              .tint = march->tint_,
                                              .light_groups = lights.groups(),
                                              .group_of_background = background ? lights.group_name(*background) : ""});
  }
  const ivec2 size(frame.width(), frame.height()), count = (size + GuideTile::kSide - 1) / GuideTile::kSide;
  // By the distance of their middles from the window's, where somebody watches; else row by row.
  std::vector<std::pair<int, int>> order;
  for (int i = 0; i < count.x * count.y; ++i) {
    const ivec2 off = 2 * GuideTile::kSide * ivec2(i % count.x, i / count.x) + GuideTile::kSide - size;
    order.emplace_back(done ? off.x * off.x + off.y * off.y : i, i);
  }
  std::sort(order.begin(), order.end());
  std::mutex mutex, watching;
  std::vector<std::vector<std::unique_ptr<GuideTile>>> idle(colours.size());
  std::atomic<size_t> next{0};
  parallel_for(count.x * count.y, task, [&](int) {
    const int i = order[next++].second;
    const ivec2 from = GuideTile::kSide * ivec2(i % count.x, i / count.x), to = glm::min(from + GuideTile::kSide, size);
    for (size_t c = 0; c < colours.size(); ++c) {
      std::unique_ptr<GuideTile> tile;
      {
        const std::lock_guard lock(mutex);
        if (!idle[c].empty()) {
          tile = std::move(idle[c].back());
          idle[c].pop_back();
        }
      }
      if (!tile) tile = std::make_unique<GuideTile>(*colours[c], deep);
      tile->record(corner, from, to, layers[c]);
      const std::lock_guard lock(mutex);
      idle[c].push_back(std::move(tile));
    }
    if (!done) return;
    const std::lock_guard lock(watching);
    done(from, to);
  });
}

}  // namespace brume

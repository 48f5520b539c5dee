#include "render/guides/guide_march.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <mutex>
#include <utility>

#include "base/parallel_for.h"
#include "render/guides/guide_layers.h"
#include "render/guides/guide_tile.h"

namespace brume {
namespace {

// Of the largest density in a voxel: gradients below it count less, because their direction means little.
constexpr double kGentleGradient = 0.03;
// Of a step where a pixel has several rays, as far as the medium is thin.
constexpr double kManyRaysStride = 1.5;
constexpr double kSketchStride = 2;  // of all steps
// The same at most, where all media are homogeneous and no lamp is near, as far as such a step is as thin as this.
constexpr double kEvenStride = 4, kEvenThickness = 0.02;
constexpr double kNodesPerLook = 0.5;  // of the spacing of nodes, between two look-ups of their fields
constexpr double kFar = 1e30;
constexpr double kEdgeCosine = 0.9;  // between the normals at a pixel's corners
constexpr int kMostUnseen = 8;       // surfaces that a camera ray goes through

}  // namespace

GuideMarch::GuideMarch(const PathContext& context, const std::vector<GuideMedia>& media, const LightFields& fields,
                       GuideColour colour, const Camera& camera, double step_voxels, bool sketch, const Task& task)
    : context_(context),
      media_(media),
      fields_(fields),
      colour_(colour),
      camera_(camera),
      sketch_(sketch),
      step_((sketch ? kSketchStride : 1) * step_voxels * media[0].voxel()),
      node_fields_(fields, media[0], colour) {
  const dvec3 middle = 0.5 * (media[0].lo() + media[0].hi());
  reference_depth_ = glm::distance(camera.ray(dvec2(0)).o, middle);
  double densest = 0;
  for (const Medium& m : media[0].media())
    densest = std::max(densest, m.maximum_density() * in_colour(m.coefficients().sigma_t, colour));
  // Steps are the march's unit of length.
  gentle_gradient_ = std::max(kGentleGradient * densest * step_ * step_ / media[0].voxel(), 1e-30);
  double even = 0;
  for (const Medium& m : media[0].media())
    if (m.homogeneous()) even += in_colour(m.coefficients().sigma_t, colour);
  if (even > 0) even_stride_ = std::clamp(kEvenThickness / (even * step_), 1.0, kEvenStride);
  for (const SolvedLight& g : fields.lights())
    if (g.group.kind == LightGroup::Kind::kLocal) even_stride_ = 1;
  if (colour == kGrey && !media[0].media().empty()) tint_ = OrderTint(media[0].tint(0));
  // Of light of many tints, that of suns and of nodes are coloured together.
  if (!media[0].mixed_tints()) look_apart_ = kNodesPerLook * fields.lattice().spacing / step_;
  node_fields_.fill(camera_, task);
  gather_light(task);
  for (size_t time = 0; time < media_.size(); ++time) marched_.push_back(marched(time));
}

// Media that are not looked up side by side are asked for point by point.
GuideMarch::MarchedMedia GuideMarch::marched(size_t time) const {
  const GuideMedia& media = media_[time];
  MarchedMedia result;
  const auto side_by_side = [&](const Medium& m) {
    return !m.homogeneous() && !m.displacement() && !m.coloured() && !m.bricks().empty() && LaneGrid::fits(m.bricks());
  };
  const std::vector<Medium>& all = media.media();
  if (all.size() <= kMostMarchedGrids && std::all_of(all.begin(), all.end(), side_by_side))
    for (size_t i = 0; i < all.size(); ++i) {
      MarchedGrid& grid = result.grids.emplace_back(media.marched(i, colour_, step_));
      set_cells(grid.cells, result.cells.emplace_back(LaneGrid::of_values(all[i].bricks())));
    }
  bool other_lights = false, one_medium = all.size() == 1;
  for (const SolvedLight& light : fields_.lights()) {
    if (!light.group.sharp()) continue;
    if (!light.group.sun || !one_medium) {
      other_lights = true;
      continue;
    }
    const SunDepth& depth = light.sun[time];
    const ivec3& n = depth.nodes();
    result.suns.push_back({depth.roots(),
                           {n.x, n.y, n.z},
                           SunDepth::kRootStep,
                           static_cast<float>(in_colour(light.group.sun->irradiance(), colour_)),
                           !light.visible.empty()});
  }
  // Light of many tints, and light that moves with what scatters it, is looked up point by point.
  MarchedFields fields;
  if (!media.mixed_tints() && media_.size() == 1) {
    fields = node_fields_.marched();
    for (size_t k = 0; k < fields_.lights().size(); ++k) {
      const NodeFields::Slots& s = node_fields_.of(k);
      MarchedFields::Group& group = result.groups.emplace_back();
      group.tail = static_cast<int32_t>(s.orders + SolvedLight::kFirstOrder.size() - 1);
      if (!fields_.lights()[k].group.sky()) continue;
      group.single = static_cast<int32_t>(s.single);
      group.forward = static_cast<int32_t>(s.forward);
    }
    fields.groups = result.groups;
  }
  result.scene = {result.grids,
                  result.suns,
                  fields,
                  other_lights,
                  !media.emissions().empty(),
                  media.mixed_tints(),
                  even_stride_ > 1,
                  static_cast<float>(fields_.scaled_extinction()),
                  static_cast<float>(gentle_gradient_),
                  static_cast<float>(look_apart_)};
  return result;
}

bool GuideMarch::blurred() const {
  return camera_.has_lens() || camera_.moves() || media_.size() > 1;
}

int GuideMarch::rays_across() const {
  if (blurred()) return 2;
  const dvec3 middle = 0.5 * (media_[0].lo() + media_[0].hi());
  const dvec2 pixel = 0.5 * dvec2(camera_.film_size());
  const Ray a = camera_.ray(pixel), b = camera_.ray(pixel + 1.0);
  const double distance = glm::distance(a.o, middle);
  return glm::distance(a.at(distance), b.at(distance)) > 0.75 * std::sqrt(2.0) * media_[0].voxel() ? 2 : 1;
}

void GuideMarch::record(const std::vector<const GuideMarch*>& colours, const ivec2& corner, Layers& frame,
                        const Task& task, const Marched& done) {
  std::vector<GuideLayers> layers;
  for (const GuideMarch* const march : colours)
    layers.emplace_back(frame, march->fields_.lights(), march->colour_,
                        GuideLayers::Contents{.emission = !march->media_[0].emissions().empty(),
                                              .surfaces = march->context_.surfaces != nullptr,
                                              .mirrors = !march->node_light_.empty()});
  const ivec2 size(frame.width(), frame.height()), count = (size + Tile::kSide - 1) / Tile::kSide;
  // By the distance of their middles from the window's, where somebody watches; else row by row.
  std::vector<std::pair<int, int>> order;
  for (int i = 0; i < count.x * count.y; ++i) {
    const ivec2 off = 2 * Tile::kSide * ivec2(i % count.x, i / count.x) + Tile::kSide - size;
    order.emplace_back(done ? off.x * off.x + off.y * off.y : i, i);
  }
  std::sort(order.begin(), order.end());
  std::mutex mutex, watching;
  std::vector<std::vector<std::unique_ptr<Tile>>> idle(colours.size());
  std::atomic<size_t> next{0};
  parallel_for(count.x * count.y, task, [&](int) {
    const int i = order[next++].second;
    const ivec2 from = Tile::kSide * ivec2(i % count.x, i / count.x), to = glm::min(from + Tile::kSide, size);
    for (size_t c = 0; c < colours.size(); ++c) {
      std::unique_ptr<Tile> tile;
      {
        const std::lock_guard lock(mutex);
        if (!idle[c].empty()) {
          tile = std::move(idle[c].back());
          idle[c].pop_back();
        }
      }
      if (!tile) tile = std::make_unique<Tile>(*colours[c]);
      tile->record(corner, from, to, colours[c]->sketch_ ? 1 : colours[c]->rays_across(), layers[c]);
      const std::lock_guard lock(mutex);
      idle[c].push_back(std::move(tile));
    }
    if (!done) return;
    const std::lock_guard lock(watching);
    done(from, to);
  });
}

GuideMarch::Eye GuideMarch::eye(const ivec2& pixel, int ray, int across) const {
  Eye eye;
  eye.cell = 1.0 / across;
  eye.film = dvec2(pixel) + eye.cell * (dvec2(ray % across, ray / across) + 0.5);
  if (sketch_) eye.time = 0.5;
  if (across == 1) return eye;
  eye.stride = kManyRaysStride;
  if (!blurred()) {
    eye.offset = ray % 4 / 4.0;
  } else if (across == 2) {
    // Opposite sides of the lens, as far from its middle as its points are on average.
    eye.lens = dvec2(0.5) + 0.35 * (dvec2(ray * 2 / 4, ray % 2) * 2.0 - 1.0);
    eye.time = ((ray * 3 + 1) % 4 + 0.5) / 4;
    eye.offset = ray / 4.0;
  } else {
    // Sixteen points of the lens and as many times, in an order unlike the rays'.
    eye.lens = (dvec2(ray * 7 % 16, ray * 11 % 16) + 0.5) / 16.0;
    eye.time = ((ray * 5 + 3) % 16 + 0.5) / 16;
    eye.offset = ray * 3 % 16 / 16.0;
  }
  return eye;
}

bool GuideMarch::shows_edge(const ivec2& pixel) const {
  std::optional<SurfaceHit> first;
  const FiniteLight* first_light = nullptr;
  // Through the rim of a lens, and at both ends of the shutter.
  for (int corner = 0; corner < 4; ++corner) {
    const dvec2 square(corner % 2, corner / 2);
    const Ray ray = camera_.ray(dvec2(pixel) + square, square, corner == 0 || corner == 3 ? 0.0 : 1.0);
    const std::optional<SurfaceHit> hit = first_seen(ray);
    const FiniteLight* const light = context_.lights->nearest(ray, hit ? hit->t : kFar, /*seen=*/true).first;
    if (corner == 0) {
      first = hit;
      first_light = light;
    } else if (light != first_light || hit.has_value() != first.has_value() ||
               (hit && (hit->surface != first->surface || glm::dot(hit->shading, first->shading) < kEdgeCosine))) {
      return true;
    }
  }
  return false;
}

std::optional<SurfaceHit> GuideMarch::first_seen(const Ray& ray) const {
  if (!context_.surfaces) return std::nullopt;
  double from = 0;
  for (int unseen = 0; unseen < kMostUnseen; ++unseen) {
    std::optional<SurfaceHit> hit =
        context_.surfaces->intersect({ray.at(from), ray.d}, kFar, Surfaces::kMiddle, /*camera=*/true);
    if (!hit) break;
    hit->t += from;
    if (context_.surfaces->settings(hit->surface).role != "shadow_catcher") return hit;
    from = hit->t + 2 * hit->margin;
  }
  return std::nullopt;
}

}  // namespace brume

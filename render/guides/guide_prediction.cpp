// The whole of direct and of indirect light as guides have it: a filter starts from them.

#include "render/guides/guide_march.h"
#include "render/guides/guide_pixel.h"

namespace brume {
namespace {

constexpr size_t kOrders = SolvedLight::kFirstOrder.size();

vec3 tinted(const dvec3& colour, double value) {
  return vec3(colour * value);
}

}  // namespace

void GuideMarch::add_tinted(const Piece& piece, const float* fields, Pixel& pixel) const {
  if (!(piece.albedo > 0)) return;
  // In steps, so that it seldom changes.
  constexpr double kSteps = 4096;
  const dvec3 tint = glm::round(piece.tint * kSteps) / kSteps;
  if (tint != pixel.tint.once()) pixel.tint = OrderTint(tint);
  GuideSums& sums = pixel.sums;
  for (size_t k = 0; k < pixel.views.size(); ++k) {
    const SolvedLight& light = fields_.lights()[k];
    const dvec3 colour = colour_of(light), once = pixel.views[k].single * pixel.tint.once();
    dvec3 more = pixel.views[k].forward * pixel.tint.forward();
    for (size_t order = 0; order < kOrders; ++order)
      more += piece.scaled * fields[node_fields_.of(k).orders + order] * pixel.tint.of_guide(order);
    (light.group.from_surfaces() ? sums.tinted_indirect : sums.tinted_direct) += colour * once;
    sums.tinted_indirect += colour * more;
  }
}

vec3 GuideMarch::predicted_direct(const GuideSums& sums) const {
  vec3 light = sums.background + sums.emission + sums.emission_once + sums.mirrored + vec3(sums.tinted_direct);
  const bool mixed = media_[0].mixed_tints();
  for (size_t k = 0; k < sums.groups.size(); ++k) {
    const SolvedLight& g = fields_.lights()[k];
    if (g.group.from_surfaces()) continue;
    light += sums.surface[k];
    if (!mixed) light += tinted(tint_.once() * colour_of(g), sums.groups[k].single);
  }
  return light;
}

vec3 GuideMarch::predicted_indirect(const GuideSums& sums) const {
  vec3 light = sums.indirect + sums.mirrored_indirect + sums.behind + vec3(sums.tinted_indirect);
  if (media_[0].mixed_tints()) return light;
  for (size_t k = 0; k < sums.groups.size(); ++k) {
    const SolvedLight& g = fields_.lights()[k];
    const GroupSums& own = sums.groups[k];
    light += tinted(tint_.forward() * colour_of(g), own.forward);
    if (g.group.from_surfaces()) light += tinted(tint_.once() * colour_of(g), own.single);
    for (size_t order = 0; order < kOrders; ++order)
      light += tinted(tint_.of_guide(order) * colour_of(g), own.orders[order]);
  }
  return light;
}

}  // namespace brume

#include "render/guides/guide_sums.h"

#include <cmath>

namespace brume {

// What is a field times a weight has been summed for all fields at once.
void GuideSums::collect(const LightFields& lights, const NodeFields& nodes) {
  if (opacity > 0) {
    const double mean = depth / opacity;
    spread = opacity * std::sqrt(std::max(0.0, depth2 / opacity - mean * mean));
  }
  for (size_t k = 0; k < groups.size(); ++k) {
    const GuideLight& group = *lights.lights()[k];
    const NodeFields::Slots& s = nodes.slots()[k];
    GroupSums& out = groups[k];
    const FieldSums& own = fields[k];
    std::copy(own.tail, own.tail + 3, out.tail.begin());
    for (size_t order = 0; order < out.orders.size(); ++order) out.orders[order] = scaled[s.orders + order];
    out.flux = scaled[s.flux];
    if (group.sharp()) continue;
    out.single = own.single;
    out.forward = own.forward - own.single;
    if (!group.sky()) continue;
    out.soft[0] = plain[s.root];
    out.soft[1] = plain[s.fourth_root];
  }
}

}  // namespace brume

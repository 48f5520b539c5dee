#include "render/guides/node_fields.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "base/math.h"
#include "base/parallel_for.h"
#include "render/guides/forward_peak.h"
#include "volume/phase_function.h"

namespace brume {
namespace {

constexpr double kCapMeanCosine = 0.96;  // of a cap of a 24th of the sphere
constexpr size_t kOrders = SolvedLight::kFirstOrder.size();

/// Four numbers at once, which compilers do not find by themselves here.
using Four = float __attribute__((vector_size(16)));
Four four_at(const float* values) {
  Four four;
  std::memcpy(&four, values, sizeof four);
  return four;
}

/// Of one medium, for cosines from -1 to 1.
std::vector<ForwardPeak> tabulated_peaks(double g) {
  constexpr int kSteps = 4096;
  std::vector<ForwardPeak> peaks;
  for (int i = 0; i <= kSteps; ++i) peaks.emplace_back(g, 2.0 * i / kSteps - 1);
  return peaks;
}

}  // namespace

NodeFields::NodeFields(const LightFields& fields, const GuideMedia& media, GuideColour colour)
    : fields_(fields), media_(media), colour_(colour) {
  if (media.media().size() == 1)
    cap_phase_ = CapPhase(media.media()[0].phase(), 1.0 / static_cast<double>(ScatteringSolver::directions().size()));
  const auto next = [&](size_t fields_wanted) {
    const size_t first = count_;
    count_ += fields_wanted;
    return first;
  };
  for (const SolvedLight& g : fields.lights()) {
    Slots s;
    s.orders = next(kOrders);
    s.flux = next(1);
    if (g.group.sky()) {
      s.single = next(1), s.root = next(1), s.fourth_root = next(1);
      s.forward = next(1);
    } else if (!g.group.sharp()) {
      s.single = next(1);
    }
    slots_.push_back(s);
  }
  count_ = (count_ + 3) / 4 * 4;
  if (count_ > kMost) throw std::logic_error("more lights have guides of their own than the march holds");
}

/// What the sky's light from each direction of travel adds at a node, for radiance 1 outside.
struct NodeFields::Sky {
  static constexpr size_t kMostDirections = 32;
  struct AtNode {
    std::array<double, kMostDirections> single{}, forward{}, root{}, fourth_root{};
  };

  Sky(const NodeFields& of, const LightFields& lit, const GuideMedia& scattering)
      : nodes(of), fields(lit), media(scattering) {
    if (fields.sky().empty()) return;
    for (size_t m = 0; m < media.media().size(); ++m) peaks.push_back(tabulated_peaks(media.mean_cosine(m)));
    for (const SolvedLight& g : fields.lights()) {
      std::vector<double>& own = roots.emplace_back();
      for (const double light : g.incoming) own.push_back(std::sqrt(light));
    }
  }

  ForwardPeak peak(double g, double cosine) const {
    for (size_t m = 0; m < peaks.size(); ++m) {
      if (peaks.size() > 1 && std::abs(g - media.mean_cosine(m)) > 1e-6) continue;
      const double last = static_cast<double>(peaks[m].size()) - 1;
      return peaks[m][static_cast<size_t>(std::clamp(0.5 * (cosine + 1), 0.0, 1.0) * last + 0.5)];
    }
    return ForwardPeak(g, cosine);
  }

  AtNode at(size_t node, const dvec3& p, const dvec3& view) const {
    AtNode result;
    if (fields.sky().empty()) return result;
    const auto& directions = ScatteringSolver::directions();
    const auto count = static_cast<double>(directions.size());
    const bool one = peaks.size() == 1;
    const double g = one ? 0 : media.at(p, nodes.colour_).g;
    double weights = 0;
    for (size_t d = 0; d < directions.size(); ++d) {
      const double c = glm::dot(directions[d], -view), share = fields.sky()(node, d);
      const double weight = one ? nodes.cap_phase_.value(c) : HenyeyGreenstein{kCapMeanCosine * g}.value(c);
      weights += weight;
      if (!(share > 0)) continue;
      result.single[d] = weight * share;
      const double depth = (1 - fields.scaled_extinction()) * std::max(0.0, -portable_log(share));
      if (depth > 0) result.forward[d] = 4 * kPi / count * share * peak(g, c).repeated(depth);
      result.root[d] = std::sqrt(share) / count;
      result.fourth_root[d] = std::sqrt(std::sqrt(share)) / count;
    }
    for (size_t d = 0; d < directions.size(); ++d) {
      result.single[d] /= weights;
      result.forward[d] += result.single[d];
    }
    return result;
  }

  const NodeFields& nodes;
  const LightFields& fields;
  const GuideMedia& media;
  std::vector<std::vector<ForwardPeak>> peaks;  // of each medium
  std::vector<std::vector<double>> roots;       // of each group's incoming light
};

void NodeFields::fill(const Camera& camera, const Task& task) {
  const ivec3 n = fields_.lattice().n;
  // Vectors of fields are read beyond those of the last node.
  values_ = NodeValues(static_cast<size_t>(n.x) * n.y * n.z * count_ + Lattice::kVector);
  const Sky sky(*this, fields_, media_);
  parallel_for(n.x, quiet(task), [&](int x) {
    for (int y = 0; y < n.y; ++y)
      for (int z = 0; z < n.z; ++z)
        if (fields_.near()[fields_.lattice().index(x, y, z)]) fill_node({x, y, z}, camera, sky);
  });
}

MarchedFields NodeFields::marched() const {
  const ivec3& n = fields_.lattice().n;
  return {values_.data(), {n.x, n.y, n.z}, static_cast<int32_t>(count_), {}};
}

void NodeFields::fill_node(const ivec3& node, const Camera& camera, const Sky& sky) {
  const Lattice& lattice = fields_.lattice();
  const Lattice& coarse = fields_.coarse_lattice();
  const size_t i = lattice.index(node.x, node.y, node.z);
  float* const out =
      values_.data() + ((static_cast<size_t>(node.x) * lattice.n.y + node.y) * lattice.n.z + node.z) * count_;
  const dvec3 p = lattice.node(node.x, node.y, node.z), view = camera.view_direction(p);
  const dvec3 step = 0.75 * coarse.spacing * view;
  const NodeWeights here(coarse, p), before(coarse, p - step), behind(coarse, p + step);
  const Sky::AtNode sky_here = sky.at(i, p, view);
  const auto towards_eye = [&](const Moments& light, const auto& at) {
    const double flux = view.x * at(light[1]) + view.y * at(light[2]) + view.z * at(light[3]);
    return static_cast<float>(std::max(0.0, at(light[0]) - flux));
  };
  const auto at_node = [&](const NodeValues& values) { return static_cast<double>(values[i]); };
  const auto coarsely = [&](const NodeValues& values) { return static_cast<double>(here(values)); };
  for (size_t k = 0; k < slots_.size(); ++k) {
    const SolvedLight& g = fields_.lights()[k];
    const Slots& s = slots_[k];
    for (size_t order = 0; order < kOrders; ++order)
      out[s.orders + order] = order < SolvedLight::kFineGuides ? towards_eye(g.orders[order], at_node)
                                                               : towards_eye(g.orders[order], coarsely);
    const NodeValues& tail = g.orders.back()[0];
    out[s.flux] = behind(tail) - before(tail);
    if (g.group.sky()) {
      double single = 0, forward = 0, root = 0, fourth_root = 0;
      for (size_t d = 0; d < g.incoming.size(); ++d) {
        single += g.incoming[d] * sky_here.single[d];
        forward += g.incoming[d] * sky_here.forward[d];
        root += sky.roots[k][d] * sky_here.root[d];
        fourth_root += std::sqrt(sky.roots[k][d]) * sky_here.fourth_root[d];
      }
      out[s.single] = static_cast<float>(single);
      out[s.forward] = static_cast<float>(forward);
      out[s.root] = static_cast<float>(root);
      out[s.fourth_root] = static_cast<float>(fourth_root);
    } else if (!g.group.sharp()) {
      out[s.single] = towards_eye(g.once, at_node);
    }
  }
}

void NodeFields::interpolate(const dvec3& world, float* values) const {
  const ivec3 n = fields_.lattice().n;
  const dvec3 p = glm::clamp(fields_.lattice().to_lattice(world), dvec3(0), dvec3(n - 1));
  const ivec3 i = glm::min(ivec3(p), n - 2);
  const vec3 f(p - dvec3(i)), e = 1.0f - f;
  const size_t z = count_, y = z * static_cast<size_t>(n.z), x = y * static_cast<size_t>(n.y);
  const float* const node = values_.data() + i.x * x + i.y * y + i.z * z;
  const float weight[8] = {e.x * e.y * e.z, e.x * e.y * f.z, e.x * f.y * e.z, e.x * f.y * f.z,
                           f.x * e.y * e.z, f.x * e.y * f.z, f.x * f.y * e.z, f.x * f.y * f.z};
  const size_t offset[8] = {0, z, y, y + z, x, x + z, x + y, x + y + z};
  for (size_t m = 0; m < count_; m += 4) {
    Four sum = weight[0] * four_at(node + m);
    for (size_t c = 1; c < 8; ++c) sum += weight[c] * four_at(node + offset[c] + m);
    std::memcpy(values + m, &sum, sizeof sum);
  }
}

}  // namespace brume

#include "render/guides/node_fields.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/math.h"
#include "base/parallel_for.h"
#include "render/guides/forward_peak.h"
#include "render/guides/sky_light.h"
#include "render/guides/view_frustum.h"
#include "volume/phase_function.h"

namespace brume {
namespace {

constexpr double kCapMeanCosine = 0.96;  // of a cap of a 24th of the sphere
constexpr size_t kOrders = GuideLight::kFirstOrder.size();

/// Of one medium, for cosines from -1 to 1.
std::vector<ForwardPeak> tabulated_peaks(double g) {
  constexpr int kSteps = 4096;
  std::vector<ForwardPeak> peaks;
  for (int i = 0; i <= kSteps; ++i) peaks.emplace_back(g, 2.0 * i / kSteps - 1);
  return peaks;
}

}  // namespace

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
    for (const auto& light : fields.lights()) {
      const GuideLight& g = *light;
      std::vector<double>& own = roots.emplace_back();
      if (!g.sky()) continue;
      for (const double radiance : g.sky()->incoming()) own.push_back(std::sqrt(radiance));
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
    const GuideMedia::Point here = one ? GuideMedia::Point{} : media.at(p, nodes.colour_);
    const double g = here.g;
    const double left = here.sigma_t > 0 ? 1 - here.albedo * peak_weight(g) : fields.scaled_extinction();
    double weights = 0;
    for (size_t d = 0; d < directions.size(); ++d) {
      const double c = glm::dot(directions[d], -view), root = fields.sky().root(node, d), share = root * root;
      const double weight = one ? nodes.cap_phase_.value(c) : HenyeyGreenstein{kCapMeanCosine * g}.value(c);
      weights += weight;
      if (!(share > 0)) continue;
      result.single[d] = weight * share;
      const double depth = (1 - left) * std::max(0.0, -portable_log(share));
      if (depth > 0) result.forward[d] = 4 * kPi / count * share * peak(g, c).repeated(depth);
      result.root[d] = root / count;
      result.fourth_root[d] = std::sqrt(root) / count;
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

NodeFields::NodeFields(const LightFields& fields, const GuideMedia& media, GuideColour colour, const Camera& camera,
                       bool moving, const Task& task)
    : fields_(fields), media_(media), colour_(colour) {
  if (media.media().size() == 1)
    cap_phase_ = CapPhase(media.media()[0].phase(), 1.0 / static_cast<double>(ScatteringSolver::directions().size()));
  for (const Medium& medium : media.media()) phases_.emplace_back(medium.phase());
  size_t count = 0;
  for (const auto& light : fields.lights()) {
    const GuideLight& g = *light;
    Slots& s = slots_.emplace_back();
    s.orders = count;
    s.flux = count += kOrders;
    ++count;
    if (g.sharp()) continue;
    s.single = count++;
    s.forward = count++;
    if (!g.sky()) continue;
    s.root = count++;
    s.fourth_root = count++;
  }
  count = (count + 3) / 4 * 4;
  if (count > NodeTable::kMost) throw std::logic_error("more lights have guides of their own than the march holds");
  table_ = NodeTable(fields.lattice(), count);
  const ivec3& n = table_.lattice.n;
  const Sky sky(*this, fields_, media_);
  const ViewFrustum frustum(camera);
  const Lattice& lattice = table_.lattice;
  parallel_for(n.x, quiet(task), [&](int x) {
    for (int y = 0; y < n.y; ++y)
      for (int z = 0; z < n.z; ++z)
        if (fields_.near()[lattice.index(x, y, z)] &&
            // Rays are lit by the nodes around them.
            (moving || frustum.near(lattice.node(x, y, z), lattice.reach(x, y, z))))
          fill_node({x, y, z}, camera, sky);
  });
}

void NodeFields::fill_node(const ivec3& node, const Camera& camera, const Sky& sky) {
  const Lattice& lattice = fields_.lattice();
  const Lattice& coarse = fields_.coarse_lattice();
  const size_t i = lattice.index(node.x, node.y, node.z);
  float* const out = table_.node(node.x, node.y, node.z);
  const dvec3 p = lattice.node(node.x, node.y, node.z), view = camera.view_direction(p);
  const dvec3 step = 0.75 * coarse.spacing * view;
  const NodeWeights here(coarse, p), before(coarse, p - step), behind(coarse, p + step);
  const Sky::AtNode sky_here = sky.at(i, p, view);
  const std::array<float, kMostMoments> factors = moments_of(-view);
  const auto towards_eye = [&](const Source& light, const auto& at) {
    double sum = at(light[0]) - (view.x * at(light[1]) + view.y * at(light[2]) + view.z * at(light[3]));
    for (size_t a = 4; a < light.known(); ++a) sum += static_cast<double>(factors[a]) * at(light[a]);
    return static_cast<float>(std::max(0.0, sum));
  };
  const auto at_node = [&](const NodeValues& values) { return static_cast<double>(values[i]); };
  const auto coarsely = [&](const NodeValues& values) { return static_cast<double>(here(values)); };
  for (size_t k = 0; k < slots_.size(); ++k) {
    const GuideLight& g = *fields_.lights()[k];
    const Slots& s = slots_[k];
    for (size_t order = 0; order < kOrders; ++order)
      out[s.orders + order] = order < GuideLight::kFineGuides ? towards_eye(g.orders[order], at_node)
                                                              : towards_eye(g.orders[order], coarsely);
    const NodeValues& tail = g.orders.back()[0];
    out[s.flux] = behind(tail) - before(tail);
    if (g.sky()) {
      double single = 0, forward = 0, root = 0, fourth_root = 0;
      const std::vector<double>& incoming = g.sky()->incoming();
      for (size_t d = 0; d < incoming.size(); ++d) {
        single += incoming[d] * sky_here.single[d];
        forward += incoming[d] * sky_here.forward[d];
        root += sky.roots[k][d] * sky_here.root[d];
        fourth_root += std::sqrt(sky.roots[k][d]) * sky_here.fourth_root[d];
      }
      out[s.single] = static_cast<float>(single);
      out[s.forward] = static_cast<float>(forward);
      out[s.root] = static_cast<float>(root);
      out[s.fourth_root] = static_cast<float>(fourth_root);
    } else if (!g.sharp()) {
      out[s.single] = out[s.forward] = static_cast<float>(scattered_once(g, i, p, view));
    }
  }
}

/// Per albedo. The light is taken to come evenly from a cap whose mean and flux are its own.
double NodeFields::scattered_once(const GuideLight& light, size_t node, const dvec3& p, const dvec3& view) const {
  const auto at = [&](size_t moment) { return static_cast<double>(light.unscattered[moment][node]); };
  const double mean = at(0);
  if (!(mean > 0)) return 0;
  const dvec3 flux(at(1), at(2), at(3));
  const double length = glm::length(flux), cosine = length > 0 ? glm::dot(flux, -view) / length : 0;
  const auto phase = [&](size_t medium) { return phases_[medium].value(cosine, std::min(1.0, length / mean)); };
  double sum = 0, all = 0, even = 0;
  for (size_t m = 0; m < phases_.size(); ++m) {
    const double own = phases_.size() == 1 ? 1 : media_.scattering(m, p, colour_);
    sum += own * phase(m);
    all += own;
    even += phase(m) / static_cast<double>(phases_.size());
  }
  return 4 * kPi * mean * (all > 0 ? sum / all : even);
}

namespace {

/// What has to be known at a node for the light of all groups there.
struct NodeLight {
  const LightFields& fields;
  const GuideMedia& media;
  const GuideColour colour;
  const OrderTint tint;
  float* out;
  ivec3 node;  // of the coarse lattice

  void add(size_t first, double mean, const dvec3& flux, const dvec3& rgb) const {
    for (size_t moment = 0; moment < 4; ++moment)
      for (int c = 0; c < 3; ++c)
        out[first + 3 * moment + static_cast<size_t>(c)] +=
            static_cast<float>(rgb[c] * (moment == 0 ? mean : flux[static_cast<int>(moment) - 1]));
  }
  template <class At>
  void add(size_t first, const At& at, const dvec3& rgb, double linear = 1) const {
    add(first, at(0), linear * dvec3(at(1), at(2), at(3)), rgb);
  }
  void add_all() const {
    const auto& directions = ScatteringSolver::directions();
    const Lattice& coarse = fields.coarse_lattice();
    const size_t own_node = coarse.index(node.x, node.y, node.z);
    const dvec3 p = coarse.node(node.x, node.y, node.z);
    const NodeWeights around(fields.lattice(), p);
    const auto between = [&](const auto& light) {
      return [&](size_t moment) { return static_cast<double>(around(light[moment])); };
    };
    const auto here = [&](const auto& light) {
      return [&](size_t moment) { return static_cast<double>(light[moment][own_node]); };
    };
    const GuideMedia::Point point = media.at(p, colour);
    const OrderTint tints = media.mixed_tints() ? OrderTint(point.tint) : tint;
    std::vector<double> arriving;  // share of the sky's light, by its direction
    if (!fields.sky().empty()) {
      for (size_t d = 0; d < directions.size(); ++d)
        arriving.push_back(around.mean([&](size_t fine_node) { return fields.sky()(fine_node, d); }));
    }
    for (const auto& light : fields.lights()) {
      const GuideLight& g = *light;
      const dvec3 own = g.colour_in(colour);
      for (size_t order = 0; order < g.orders.size(); ++order) {
        const dvec3 tinted = own * tints.of_guide(order);
        if (order < GuideLight::kFineGuides)
          add(kOften, between(g.orders[order]), tinted);
        else
          add(kOften, here(g.orders[order]), tinted);
      }
      if (!g.unscattered[0].empty()) add(kOnce, between(g.unscattered), point.albedo * own * tints.once(), 3 * point.g);
      if (!g.sky()) continue;
      double mean = 0;
      dvec3 flux(0);
      for (size_t d = 0; d < directions.size(); ++d) {
        const double radiance = g.sky()->incoming()[d] * arriving[d];
        mean += radiance;
        flux += radiance * directions[d];
      }
      const double share = point.albedo / static_cast<double>(directions.size());
      add(kOnce, share * mean, 3 * point.g * share * flux, own * tints.once());
    }
  }
};

}  // namespace

NodeTable any_direction(const LightFields& fields, const GuideMedia& media, GuideColour colour, const Task& task) {
  const Lattice& coarse = fields.coarse_lattice();
  NodeTable table(coarse, 24);
  const OrderTint tint = colour == kGrey && !media.media().empty() ? OrderTint(media.tint(0)) : OrderTint();
  parallel_for(coarse.n.x, quiet(task), [&](int x) {
    for (int y = 0; y < coarse.n.y; ++y)
      for (int z = 0; z < coarse.n.z; ++z)
        NodeLight{fields, media, colour, tint, table.node(x, y, z), {x, y, z}}.add_all();
  });
  return table;
}

dvec3 backwards(const std::array<float, NodeTable::kMost>& fields, size_t first, const dvec3& direction) {
  dvec3 sum;
  for (size_t c = 0; c < 3; ++c) {
    const float* const m = fields.data() + first + c;
    sum[static_cast<int>(c)] = std::max(0.0, m[0] - (direction.x * m[3] + direction.y * m[6] + direction.z * m[9]));
  }
  return sum;
}

}  // namespace brume

#include "render/guides/light_fields.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/math.h"
#include "base/parallel_for.h"
#include "render/guides/sweep.h"

namespace brume {
namespace {

constexpr int kDirections = 24, kLastOrder = 12;
constexpr double kVoxelsPerNode = 2;
constexpr size_t kMostNodes = 1000000, kMostSunNodes = 16000000;
constexpr double kLargestRatio = 0.97;  // of an order to the one before, in the tail
constexpr double kUnseen = 1e30;        // world units

std::vector<dvec3> spiral(int count) {
  std::vector<dvec3> directions;
  for (int i = 0; i < count; ++i) {
    const double z = 1 - 2 * (i + 0.5) / count, r = std::sqrt(1 - z * z);
    const double turn = kPi * (1 + std::sqrt(5.0)) * (i + 0.5);
    directions.emplace_back(r * std::cos(turn), r * std::sin(turn), z);
  }
  return directions;
}

/// Averages of the sky over the directions nearest to each of directions(), where light travels from it.
std::vector<double> sky_radiance(const Environment& sky, GuideColour colour) {
  const std::vector<dvec3>& directions = LightFields::directions();
  std::vector<double> sum(directions.size(), 0.0), count(directions.size(), 0.0);
  for (const dvec3& d : spiral(sky.constant() ? kDirections : 4096)) {
    size_t nearest = 0;
    for (size_t k = 1; k < directions.size(); ++k)
      if (glm::dot(directions[k], d) > glm::dot(directions[nearest], d)) nearest = k;
    sum[nearest] += in_colour(sky.radiance(-d), colour);
    ++count[nearest];
  }
  for (size_t k = 0; k < sum.size(); ++k) sum[k] /= std::max(1.0, count[k]);
  return sum;
}

}  // namespace

const std::vector<dvec3>& LightFields::directions() {
  static const std::vector<dvec3> all = spiral(kDirections);
  return all;
}

/// The lattice's media and the arrays that one solution after another uses.
class LightFields::Solver {
 public:
  Solver(const Lattice& lattice, const GuideMedia& media, GuideColour colour, const Task& task)
      : lattice_(lattice), task_(quiet(task)) {
    const ivec3 n = lattice.n;
    standing_ = {{n.x, n.y, n.z}, lattice.row()};
    const int lying_row = (n.y + Lattice::kVector - 1) / Lattice::kVector * Lattice::kVector;
    lying_ = {{n.z, n.x, n.y}, lying_row};
    for (NodeValues* field : {&extinction_, &scaled_, &albedo_, &linear_}) field->assign(lattice.size(), 0.0f);
    sample_media(media, colour);
    for (NodeValues& q : source_) q.assign(lattice.size(), 0.0f);
    for (NodeValues& q : lying_source_) q.assign(lying_.size(), 0.0f);
    for (NodeValues& m : lying_moment_) m.assign(lying_.size(), 0.0f);
    lying_extinction_.assign(lying_.size(), 0.0f);
    lying_scaled_.assign(lying_.size(), 0.0f);
    lay_down(extinction_, lying_extinction_);
    lay_down(scaled_, lying_scaled_);
    for (const dvec3& d : directions()) radiance_.emplace_back(lies(d) ? lying_.size() : standing_.size(), 0.0f);
  }

  double mean_scale() const { return mean_scale_; }

  /// Radiance of the sky that arrives unscattered, by direction, through the true extinction.
  std::vector<NodeValues> sky_arriving(const std::vector<double>& incoming) {
    sweep_all(nullptr, 0, incoming, /*true_extinction=*/true);
    std::vector<NodeValues> arriving;
    for (size_t k = 0; k < directions().size(); ++k) {
      arriving.emplace_back(lattice_.size(), 0.0f);
      if (lies(directions()[k]))
        stand_up(radiance_[k], arriving.back());
      else
        arriving.back() = radiance_[k];
    }
    return arriving;
  }

  /// Moments of unscattered light: mean radiance and mean flux, here to be scattered for the first time.
  using Moments = std::array<NodeValues, 4>;
  Moments no_light() const {
    return {NodeValues(lattice_.size(), 0.0f), NodeValues(lattice_.size(), 0.0f), NodeValues(lattice_.size(), 0.0f),
            NodeValues(lattice_.size(), 0.0f)};
  }
  Moments of_sky(const std::vector<double>& incoming) {
    sweep_all(nullptr, 0, incoming, false);
    return moments();
  }
  /// @param glow  emission per spacing at the nodes
  Moments of_glow(const NodeValues& glow) {
    source_[0] = glow;
    sweep_all(&source_, 1, std::vector<double>(directions().size(), 0.0), false);
    return moments();
  }

  /// Scatters light once: what leaves towards each direction, per extinction.
  ScatteredLight scatter(const Moments& light) const {
    ScatteredLight out = light;
    each_plane([&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        out[0][i] = albedo_[i] * light[0][i];
        for (size_t a = 1; a < 4; ++a) out[a][i] = albedo_[i] * linear_[i] * light[a][i];
      }
    });
    return out;
  }

  /// The orders from the second on, of light that has just been scattered for the first time.
  std::vector<ScatteredLight> orders_after(ScatteredLight light) {
    constexpr auto& first = GroupLight::kFirstOrder;
    std::vector<ScatteredLight> groups(first.size());
    for (ScatteredLight& g : groups)
      for (NodeValues& v : g) v.assign(lattice_.size(), 0.0f);
    const std::vector<double> dark(directions().size(), 0.0);
    NodeValues before;
    for (int order = 2; order <= kLastOrder; ++order) {
      if (order == kLastOrder) before = light[0];
      each_plane([&](size_t begin, size_t end) {
        for (size_t a = 0; a < 4; ++a)
          for (size_t i = begin; i < end; ++i) source_[a][i] = scaled_[i] * light[a][i];
      });
      sweep_all(&source_, 4, dark, false);
      light = scatter(moments());
      size_t g = 0;
      while (order >= first[g + 1]) ++g;
      each_plane([&](size_t begin, size_t end) {
        for (size_t a = 0; a < 4; ++a)
          for (size_t i = begin; i < end; ++i) groups[g][a][i] += light[a][i];
      });
    }
    each_plane([&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        const float ratio = std::clamp(light[0][i] / (before[i] + 1e-20f), 0.0f, static_cast<float>(kLargestRatio));
        for (size_t a = 0; a < 4; ++a) groups.back()[a][i] = light[a][i] * ratio / (1 - ratio);
      }
    });
    return groups;
  }

  const NodeValues& extinction() const { return extinction_; }

  /// Calls visit(x, y, z, index) for the inner nodes.
  template <class Visit>
  void each_node(const Visit& visit) const {
    parallel_for(lattice_.n.x - 2, task_, [&](int i) {
      for (int y = 1; y < lattice_.n.y - 1; ++y)
        for (int z = 1; z < lattice_.n.z - 1; ++z) visit(i + 1, y, z, lattice_.index(i + 1, y, z));
    });
  }

 private:
  void sample_media(const GuideMedia& media, GuideColour colour) {
    // Means over cubes around the nodes.
    const double cube = lattice_.spacing;
    const int inner = std::clamp(static_cast<int>(std::lround(cube / media.voxel())), 1, 4);
    std::vector<double> true_sum(static_cast<size_t>(lattice_.n.x), 0.0), scaled_sum = true_sum;
    each_node([&](int x, int y, int z, size_t i) {
      double sigma = 0, scattered = 0, forward = 0;
      const dvec3 corner = lattice_.node(x, y, z) - 0.5 * cube;
      for (int k = 0; k < inner * inner * inner; ++k) {
        const dvec3 offset = (dvec3(k % inner, k / inner % inner, k / (inner * inner)) + 0.5) / static_cast<double>(inner);
        const GuideMedia::Point point = media.at(corner + cube * offset, colour);
        sigma += point.sigma_t;
        scattered += point.sigma_t * point.albedo;
        forward += point.sigma_t * point.albedo * point.g;
      }
      if (!(sigma > 0)) return;
      const double albedo = scattered / sigma, g = scattered > 0 ? forward / scattered : 0;
      const double peak = g > 0 ? g * g : 0, left = 1 - albedo * peak;
      const double per_spacing = sigma / (inner * inner * inner) * lattice_.spacing;
      extinction_[i] = static_cast<float>(per_spacing);
      scaled_[i] = static_cast<float>(per_spacing * left);
      albedo_[i] = static_cast<float>(albedo * (1 - peak) / left);
      linear_[i] = static_cast<float>(3 * (g - peak) / (1 - peak));
      true_sum[static_cast<size_t>(x)] += per_spacing;
      scaled_sum[static_cast<size_t>(x)] += per_spacing * left;
    });
    double all = 0, scaled = 0;
    for (size_t x = 0; x < true_sum.size(); ++x) {
      all += true_sum[x];
      scaled += scaled_sum[x];
    }
    if (all > 0) mean_scale_ = scaled / all;
  }

  /// Whether a direction is swept along z, in arrays that have it slowest.
  static bool lies(const dvec3& d) { return std::abs(d.z) > std::max(std::abs(d.x), std::abs(d.y)); }

  template <class Body>
  void each_plane(const Body& body) const {
    const size_t plane = static_cast<size_t>(lattice_.n.y) * lattice_.row();
    parallel_for(lattice_.n.x, task_, [&](int x) { body(x * plane, (x + 1) * plane); });
  }
  template <class Move>
  void each_pair(const Move& move) const {
    const ivec3 n = lattice_.n;
    constexpr int kBlock = 16;
    parallel_for(n.x, task_, [&](int x) {
      for (int z0 = 0; z0 < n.z; z0 += kBlock)
        for (int y = 0; y < n.y; ++y)
          for (int z = z0; z < std::min(n.z, z0 + kBlock); ++z)
            move(lattice_.index(x, y, z), (static_cast<size_t>(z) * n.x + x) * lying_.row + y);
    });
  }
  void lay_down(const NodeValues& standing, NodeValues& lying) const {
    each_pair([&](size_t s, size_t l) { lying[l] = standing[s]; });
  }
  void stand_up(const NodeValues& lying, NodeValues& standing) const {
    each_pair([&](size_t s, size_t l) { standing[s] = lying[l]; });
  }

  void sweep_all(const std::array<NodeValues, 4>* source, size_t count, const std::vector<double>& incoming,
                 bool true_extinction) {
    for (size_t a = 0; a < count; ++a) lay_down((*source)[a], lying_source_[a]);
    const auto& all = directions();
    parallel_for(static_cast<int>(all.size()), task_, [&](int i) {
      const auto k = static_cast<size_t>(i);
      const dvec3 d = all[k];
      SweepSource gained;
      gained.count = count;
      gained.factor = {1, static_cast<float>(d.x), static_cast<float>(d.y), static_cast<float>(d.z)};
      const bool lying = lies(d);
      for (size_t a = 0; a < count; ++a) gained.values[a] = lying ? lying_source_[a].data() : (*source)[a].data();
      const NodeValues& extinction = lying ? (true_extinction ? lying_extinction_ : lying_scaled_)
                                           : (true_extinction ? extinction_ : scaled_);
      const std::array<double, 3> axes = lying ? std::array{d.z, d.x, d.y} : std::array{d.x, d.y, d.z};
      sweep(lying ? lying_ : standing_, extinction.data(), gained, axes, static_cast<float>(incoming[k]),
            radiance_[k].data());
    });
  }

  /// Mean radiance and mean flux of what was swept.
  Moments moments() {
    Moments out = no_light();
    const auto sum = [&](bool lying, std::array<NodeValues, 4>& to, const SweepDomain& domain) {
      const size_t plane = static_cast<size_t>(domain.n[1]) * domain.row;
      parallel_for(domain.n[0], task_, [&](int p) {
        for (NodeValues& v : to) std::fill_n(v.data() + p * plane, plane, 0.0f);
        for (size_t k = 0; k < directions().size(); ++k) {
          const dvec3 d = directions()[k];
          if (lies(d) != lying) continue;
          const float* const light = radiance_[k].data() + p * plane;
          const float factor[4] = {1.0f / kDirections, static_cast<float>(d.x / kDirections),
                                   static_cast<float>(d.y / kDirections), static_cast<float>(d.z / kDirections)};
          for (size_t a = 0; a < 4; ++a) {
            float* const moment = to[a].data() + p * plane;
            for (size_t i = 0; i < plane; ++i) moment[i] += factor[a] * light[i];
          }
        }
      });
    };
    sum(false, out, standing_);
    sum(true, lying_moment_, lying_);
    for (size_t a = 0; a < 4; ++a) each_pair([&](size_t s, size_t l) { out[a][s] += lying_moment_[a][l]; });
    return out;
  }

  const Lattice& lattice_;
  Task task_;
  SweepDomain standing_, lying_;  // z fastest, and y fastest with z slowest: sweeps never go along contiguous rows
  NodeValues extinction_, scaled_, lying_extinction_, lying_scaled_;  // per spacing; without the forward peak
  NodeValues albedo_, linear_;  // of what is left of scattering, and three times its mean cosine
  std::array<NodeValues, 4> source_, lying_source_;
  Moments lying_moment_;
  std::vector<NodeValues> radiance_;
  double mean_scale_ = 1;
};

LightFields::LightFields(const GuideMedia& media, const Lights& lights, const Surfaces* surfaces, GuideColour colour,
                         const Task& task) {
  lattice_ = Lattice::over(media.lo(), media.hi(), kVoxelsPerNode * media.voxel(), kMostNodes);
  Solver solver(lattice_, media, colour, task);
  scale_ = solver.mean_scale();
  const auto scaled_transmittance = [&](double depth) { return std::exp(-depth * scale_); };
  const Task own = quiet(task);

  for (LightGroup& group : light_groups(lights, media)) {
    GroupLight g;
    g.group = group;
    Solver::Moments arriving;
    switch (group.kind) {
      case LightGroup::Kind::kSun: {
        const dvec3 towards = group.sun->axis();
        g.sun = SunDepth(media, colour, towards, media.voxel(), kMostSunNodes, own);
        if (surfaces) g.visible.assign(lattice_.size(), 0.0f);
        arriving = solver.no_light();
        const double irradiance = in_colour(group.sun->irradiance(), colour);
        solver.each_node([&](int x, int y, int z, size_t i) {
          const dvec3 p = lattice_.node(x, y, z);
          double share = 1;
          if (surfaces) {
            share = in_colour(surfaces->passage({p, towards}, kUnseen).light, kGrey);
            g.visible[i] = static_cast<float>(share);
          }
          if (solver.extinction()[i] == 0) return;
          const double mean = irradiance / (4 * kPi) * share * scaled_transmittance(g.sun.at(p));
          arriving[0][i] = static_cast<float>(mean);
          for (int a = 0; a < 3; ++a) arriving[static_cast<size_t>(a) + 1][i] = static_cast<float>(-mean * towards[a]);
        });
        break;
      }
      case LightGroup::Kind::kLocal:
      case LightGroup::Kind::kOthers: {
        arriving = solver.no_light();
        const bool alone = group.kind == LightGroup::Kind::kLocal;
        if (alone) g.depth.assign(lattice_.size(), 0.0f);
        if (alone && surfaces) g.visible.assign(lattice_.size(), 0.0f);
        const double step = lattice_.spacing;
        solver.each_node([&](int x, int y, int z, size_t i) {
          const dvec3 p = lattice_.node(x, y, z);
          for (const Light* light : group.lights) {
            const LocalLight l = local_light(*light, p);
            double share = 1, depth = 0;
            if (surfaces) share = in_colour(surfaces->passage({p, l.towards}, l.distance).light, kGrey);
            // Through the lattice's own extinction, a node a step.
            const dvec3 start = lattice_.to_lattice(p);
            const int steps = static_cast<int>(std::min(std::ceil(l.distance / step), 4096.0));
            for (int s = 0; s < steps; ++s) {
              const dvec3 q = start + l.towards * (s + 0.5);
              if (glm::any(glm::lessThan(q, dvec3(0))) || glm::any(glm::greaterThan(q, dvec3(lattice_.n - 1)))) break;
              const ivec3 node = ivec3(glm::round(q));
              depth += solver.extinction()[lattice_.index(node.x, node.y, node.z)];
            }
            if (alone) g.depth[i] = static_cast<float>(depth);
            if (!g.visible.empty()) g.visible[i] = static_cast<float>(share);
            const double mean = in_colour(l.irradiance, colour) / (4 * kPi) * share * scaled_transmittance(depth);
            arriving[0][i] += static_cast<float>(mean);
            for (int a = 0; a < 3; ++a)
              arriving[static_cast<size_t>(a) + 1][i] -= static_cast<float>(mean * l.towards[a]);
          }
        });
        break;
      }
      case LightGroup::Kind::kSky: {
        std::vector<double> incoming = sky_radiance(*lights.environment(), colour);
        if (surfaces) hide_sky(media, *surfaces, incoming);
        g.sky = solver.sky_arriving(incoming);
        arriving = solver.of_sky(incoming);
        break;
      }
      case LightGroup::Kind::kGlow: {
        NodeValues glow(lattice_.size(), 0.0f);
        solver.each_node([&](int x, int y, int z, size_t i) {
          glow[i] = static_cast<float>(in_colour(media.glow(lattice_.node(x, y, z)), colour) * lattice_.spacing);
        });
        arriving = solver.of_glow(glow);
        break;
      }
    }
    ScatteredLight once = solver.scatter(arriving);
    g.orders = solver.orders_after(once);
    if (group.kind == LightGroup::Kind::kOthers || group.kind == LightGroup::Kind::kGlow) g.once = std::move(once);
    groups_.push_back(std::move(g));
    task.check();
  }
}

void LightFields::hide_sky(const GuideMedia& media, const Surfaces& surfaces, std::vector<double>& incoming) {
  // Seen from the corners of a box half as large as the media's.
  const dvec3 middle = 0.5 * (media.lo() + media.hi()), half = 0.25 * (media.hi() - media.lo());
  const double mean = std::accumulate(incoming.begin(), incoming.end(), 0.0) / static_cast<double>(incoming.size());
  for (size_t k = 0; k < incoming.size(); ++k) {
    double sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const dvec3 p = middle + half * dvec3(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
      const auto hit = surfaces.intersect({p, -directions()[k]}, kUnseen);
      sum += hit ? in_colour(surfaces.bsdf(*hit).albedo, kGrey) * mean : incoming[k];
    }
    incoming[k] = sum / 8;
  }
}

size_t LightFields::bytes() const {
  size_t floats = 0, others = 0;
  for (const GroupLight& g : groups_) {
    floats += g.depth.size() + g.visible.size();
    for (const NodeValues& v : g.once) floats += v.size();
    for (const NodeValues& v : g.sky) floats += v.size();
    for (const ScatteredLight& order : g.orders)
      for (const NodeValues& v : order) floats += v.size();
    others += g.sun.bytes();
  }
  return floats * sizeof(float) + others;
}

}  // namespace brume

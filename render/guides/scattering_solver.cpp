#include "render/guides/scattering_solver.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"

namespace brume {
namespace {

constexpr int kDirections = 24;
constexpr int kNear = 4;  // nodes around the media in which light that has left them is followed

int padded(int n) {
  return (n + Lattice::kVector - 1) / Lattice::kVector * Lattice::kVector;
}

/// Whether a direction is swept along z, in arrays that have it slowest.
bool lies(const dvec3& d) {
  return std::abs(d.z) > std::max(std::abs(d.x), std::abs(d.y));
}

}  // namespace

const std::vector<dvec3>& ScatteringSolver::directions() {
  static const std::vector<dvec3> all = spiral_of_directions(kDirections);
  return all;
}

ScatteringSolver::ScatteringSolver(const Lattice& lattice, const GuideMedia& media, GuideColour colour,
                                   const Task& task)
    : ScatteringSolver(lattice, task) {
  // Means over cubes around the nodes.
  const double cube = lattice.spacing;
  const int inner = std::clamp(static_cast<int>(std::lround(cube / media.voxel())), 1, 4),
            count = inner * inner * inner;
  fill([&](int x, int y, int z) {
    NodeMedia node;
    double scattered = 0, forward = 0;
    const dvec3 corner = lattice_.node(x, y, z) - 0.5 * cube;
    for (int k = 0; k < count; ++k) {
      const ivec3 place(k % inner, k / inner % inner, k / (inner * inner));
      const GuideMedia::Point point = media.at(corner + cube / inner * (dvec3(place) + 0.5), colour);
      node.extinction += point.sigma_t;
      scattered += point.sigma_t * point.albedo;
      forward += point.sigma_t * point.albedo * point.g;
    }
    if (!(node.extinction > 0)) return node;
    const double albedo = scattered / node.extinction, g = scattered > 0 ? forward / scattered : 0;
    const double peak = g > 0 ? g * g : 0, left = 1 - albedo * peak;
    node.extinction *= cube / count;
    node.scaled = node.extinction * left;
    node.scattered = node.scaled * albedo * (1 - peak) / left;
    node.linear = node.scaled * 3 * (g - peak) / (1 - peak);
    return node;
  });
}

ScatteringSolver::ScatteringSolver(const Lattice& lattice, const ScatteringSolver& fine, const Task& task)
    : ScatteringSolver(lattice, task) {
  const double ratio = lattice.spacing / fine.lattice_.spacing;
  fill([&](int x, int y, int z) {
    NodeMedia node;
    for (int corner = 0; corner < 8; ++corner) {
      const dvec3 offset = dvec3(corner & 1, corner >> 1 & 1, corner >> 2) - 0.5;
      const dvec3 p = lattice_.node(x, y, z) + 0.5 * lattice_.spacing * offset;
      const double scaled = ratio / 8 * interpolated(fine.lattice_, fine.scaled_, p);
      if (!(scaled > 0)) continue;
      node.extinction += ratio / 8 * interpolated(fine.lattice_, fine.extinction_, p);
      node.scaled += scaled;
      node.scattered += scaled * interpolated(fine.lattice_, fine.albedo_, p);
      node.linear += scaled * interpolated(fine.lattice_, fine.linear_, p);
    }
    return node;
  });
}

ScatteringSolver::ScatteringSolver(const Lattice& lattice, const Task& task) : lattice_(lattice), task_(quiet(task)) {
  const ivec3 n = lattice.n;
  standing_ = {{n.x, n.y, n.z}, lattice.row(), nullptr};
  lying_ = {{n.z, n.x, n.y}, padded(n.y), nullptr};
  for (NodeValues* field : {&extinction_, &scaled_, &albedo_, &linear_}) field->assign(lattice.size(), 0.0f);
  for (NodeValues& values : source_) values.assign(lattice.size(), 0.0f);
  for (Moments* moments : {&lying_source_, &lying_moment_})
    for (NodeValues& values : *moments) values.assign(lying_.size(), 0.0f);
  for (NodeValues* field : {&lying_extinction_, &lying_scaled_}) field->assign(lying_.size(), 0.0f);
  for (const dvec3& d : directions()) radiance_.emplace_back(lies(d) ? lying_.size() : standing_.size(), 0.0f);
}

template <class Sample>
void ScatteringSolver::fill(const Sample& sample) {
  std::vector<NodeMedia> sums(static_cast<size_t>(lattice_.n.x));
  each_node([&](int x, int y, int z, size_t i) {
    const NodeMedia node = sample(x, y, z);
    if (!(node.scaled > 0)) return;
    extinction_[i] = static_cast<float>(node.extinction);
    scaled_[i] = static_cast<float>(node.scaled);
    albedo_[i] = static_cast<float>(node.scattered / node.scaled);
    linear_[i] = static_cast<float>(node.linear / node.scaled);
    sums[static_cast<size_t>(x)].add(node);
  });
  NodeMedia total;
  for (const NodeMedia& s : sums) total.add(s);
  if (total.scaled > 0) {
    mean_scale_ = total.scaled / total.extinction;
    // Where nothing is, as it is on average: light is interpolated between nodes inside and outside.
    for (size_t i = 0; i < extinction_.size(); ++i)
      if (extinction_[i] == 0) {
        albedo_[i] = static_cast<float>(total.scattered / total.scaled);
        linear_[i] = static_cast<float>(total.linear / total.scaled);
      }
  }
  find_rows();
  lay_down(extinction_, lying_extinction_, true);
  lay_down(scaled_, lying_scaled_, true);
}

std::vector<uint8_t> ScatteringSolver::near_media() const {
  std::vector<uint8_t> near(lattice_.size(), 0);
  each_node([&](int x, int y, int z, size_t i) {
    for (int k = 0; k < 27 && !near[i]; ++k)
      near[i] = extinction_[lattice_.index(x + k / 9 - 1, y + k / 3 % 3 - 1, z + k % 3 - 1)] > 0;
  });
  return near;
}

void ScatteringSolver::find_rows() {
  // The media's nodes in each row, then in each row's neighbourhood.
  const auto ranges = [&](const SweepDomain& domain, const NodeValues& extinction) {
    std::vector<SweepRow> own(static_cast<size_t>(domain.n[0]) * domain.n[1]), near(own.size());
    for (size_t r = 0; r < own.size(); ++r) {
      own[r] = {domain.n[2], 0};
      for (int z = 0; z < domain.n[2]; ++z)
        if (extinction[r * domain.row + z] > 0) {
          own[r].begin = std::min(own[r].begin, z);
          own[r].end = z + 1;
        }
    }
    for (int x = 1; x < domain.n[0] - 1; ++x)
      for (int y = 1; y < domain.n[1] - 1; ++y) {
        SweepRow row{domain.n[2], 0};
        for (int u = std::max(0, x - kNear); u <= std::min(domain.n[0] - 1, x + kNear); ++u)
          for (int v = std::max(0, y - kNear); v <= std::min(domain.n[1] - 1, y + kNear); ++v) {
            const SweepRow& other = own[static_cast<size_t>(u) * domain.n[1] + v];
            row.begin = std::min(row.begin, other.begin);
            row.end = std::max(row.end, other.end);
          }
        if (row.begin >= row.end) continue;
        row.begin = std::max(0, row.begin - kNear) / Lattice::kVector * Lattice::kVector;
        row.end = std::min(domain.row, padded(row.end + kNear));
        near[static_cast<size_t>(x) * domain.n[1] + y] = row;
      }
    return near;
  };
  rows_ = ranges(standing_, extinction_);
  NodeValues lying(lying_.size(), 0.0f);
  lay_down(extinction_, lying, true);
  lying_rows_ = ranges(lying_, lying);
}

void ScatteringSolver::lay_down(const NodeValues& standing, NodeValues& lying, bool everywhere) const {
  const ivec3 n = lattice_.n;
  constexpr int kBlock = 16;
  parallel_for(n.x, task_, [&](int x) {
    for (int z0 = 0; z0 < n.z; z0 += kBlock)
      for (int y = 0; y < n.y; ++y) {
        const SweepRow row = everywhere ? SweepRow{0, n.z} : rows_[static_cast<size_t>(x) * n.y + y];
        const float* const from = standing.data() + lattice_.index(x, y, 0);
        for (int z = std::max(z0, row.begin); z < std::min({n.z, z0 + kBlock, row.end}); ++z)
          lying[(static_cast<size_t>(z) * n.x + x) * lying_.row + y] = from[z];
      }
  });
}

void ScatteringSolver::sweep_all(const Moments* source, size_t count, const std::vector<double>& incoming,
                                 bool true_extinction) {
  const bool everywhere = source == nullptr;
  for (size_t a = 0; a < count; ++a) lay_down((*source)[a], lying_source_[a], false);
  const std::vector<dvec3>& all = directions();
  parallel_for(static_cast<int>(all.size()), task_, [&](int i) {
    const auto k = static_cast<size_t>(i);
    const dvec3 d = all[k];
    const bool lying = lies(d);
    SweepSource gained;
    gained.count = count;
    gained.factor = {1, static_cast<float>(d.x), static_cast<float>(d.y), static_cast<float>(d.z)};
    for (size_t a = 0; a < count; ++a) gained.values[a] = lying ? lying_source_[a].data() : (*source)[a].data();
    SweepDomain domain = lying ? lying_ : standing_;
    if (!everywhere) domain.rows = lying ? lying_rows_.data() : rows_.data();
    const NodeValues& extinction =
        lying ? (true_extinction ? lying_extinction_ : lying_scaled_) : (true_extinction ? extinction_ : scaled_);
    const std::array<double, 3> axes = lying ? std::array{d.z, d.x, d.y} : std::array{d.x, d.y, d.z};
    const auto enters = static_cast<float>(everywhere ? incoming[k] : 0.0);
    if (everywhere || dirty_) std::fill(radiance_[k].begin(), radiance_[k].end(), enters);
    sweep(domain, extinction.data(), gained, axes, enters, radiance_[k].data());
  });
  dirty_ = everywhere;
}

Moments ScatteringSolver::nothing() const {
  Moments none;
  for (NodeValues& values : none) values.assign(lattice_.size(), 0.0f);
  return none;
}

Moments ScatteringSolver::moments(bool everywhere) {
  Moments out = nothing();
  const auto sum = [&](bool lying, Moments& to, const SweepDomain& domain, const std::vector<SweepRow>& near) {
    parallel_for(domain.n[0], task_, [&](int p) {
      for (int r = 0; r < domain.n[1]; ++r) {
        const size_t line = static_cast<size_t>(p) * domain.n[1] + r, first = line * domain.row;
        const SweepRow row = everywhere ? SweepRow{0, domain.row} : near[line];
        if (row.begin >= row.end) continue;
        const auto length = static_cast<size_t>(row.end - row.begin), begin = first + row.begin;
        for (NodeValues& v : to) std::fill_n(v.data() + begin, length, 0.0f);
        for (size_t k = 0; k < directions().size(); ++k) {
          const dvec3 d = directions()[k] / static_cast<double>(kDirections);
          if (lies(d) != lying) continue;
          const float* const light = radiance_[k].data() + begin;
          const vec3 f(d);
          float *const m0 = to[0].data() + begin, *const m1 = to[1].data() + begin, *const m2 = to[2].data() + begin,
                       *const m3 = to[3].data() + begin;
          for (size_t i = 0; i < length; ++i) {
            m0[i] += light[i] * (1.0f / kDirections);
            m1[i] += light[i] * f.x;
            m2[i] += light[i] * f.y;
            m3[i] += light[i] * f.z;
          }
        }
      }
    });
  };
  sum(false, out, standing_, rows_);
  sum(true, lying_moment_, lying_, lying_rows_);
  // Both kinds of rows hold the media and some nodes more: what one kind leaves out counts as dark.
  const ivec3 n = lattice_.n;
  parallel_for(n.x, task_, [&](int x) {
    for (int z = 0; z < n.z; ++z) {
      const size_t line = static_cast<size_t>(z) * n.x + x;
      const SweepRow row = everywhere ? SweepRow{0, n.y} : lying_rows_[line];
      for (size_t a = 0; a < 4; ++a) {
        const float* const from = lying_moment_[a].data() + line * lying_.row;
        for (int y = row.begin; y < std::min(row.end, n.y); ++y) out[a][lattice_.index(x, y, z)] += from[y];
      }
    }
  });
  return out;
}

std::vector<NodeValues> ScatteringSolver::arriving(const std::vector<double>& incoming) {
  sweep_all(nullptr, 0, incoming, /*true_extinction=*/true);
  const ivec3 n = lattice_.n;
  std::vector<NodeValues> all;
  for (size_t k = 0; k < directions().size(); ++k) {
    if (!lies(directions()[k])) {
      all.push_back(radiance_[k]);
      continue;
    }
    NodeValues& values = all.emplace_back(lattice_.size(), 0.0f);
    parallel_for(n.x, task_, [&](int x) {
      for (int z = 0; z < n.z; ++z)
        for (int y = 0; y < n.y; ++y)
          values[lattice_.index(x, y, z)] = radiance_[k][(static_cast<size_t>(z) * n.x + x) * lying_.row + y];
    });
  }
  return all;
}

Moments ScatteringSolver::entering(const std::vector<double>& incoming) {
  sweep_all(nullptr, 0, incoming, false);
  return moments(true);
}

Moments ScatteringSolver::emitted(const NodeValues& glow) {
  source_[0] = glow;
  sweep_all(&source_, 1, {}, false);
  return moments(false);
}

Moments ScatteringSolver::scattered(const Moments& light) const {
  Moments out = nothing();
  each_row([&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      const float linear = albedo_[i] * linear_[i];
      out[0][i] = albedo_[i] * light[0][i];
      out[1][i] = linear * light[1][i];
      out[2][i] = linear * light[2][i];
      out[3][i] = linear * light[3][i];
    }
  });
  return out;
}

Moments ScatteringSolver::transported(const Moments& scattered) {
  each_row([&](size_t begin, size_t end) {
    for (size_t a = 0; a < 4; ++a)
      for (size_t i = begin; i < end; ++i) source_[a][i] = scaled_[i] * scattered[a][i];
  });
  sweep_all(&source_, 4, {}, false);
  return moments(false);
}

Moments ScatteringSolver::transported_source(const Moments& source) {
  sweep_all(&source, 4, {}, false);
  return moments(false);
}

Moments ScatteringSolver::source_from(const ScatteringSolver& fine, const Moments& scattered) const {
  Moments leaving = fine.nothing(), source = nothing();
  fine.each_row([&](size_t begin, size_t end) {
    for (size_t a = 0; a < 4; ++a)
      for (size_t i = begin; i < end; ++i) leaving[a][i] = fine.scaled_[i] * scattered[a][i];
  });
  const double ratio = lattice_.spacing / fine.lattice_.spacing;
  each_node([&](int x, int y, int z, size_t i) {
    if (extinction_[i] == 0) return;
    for (size_t a = 0; a < 4; ++a) {
      double sum = 0;
      for (int corner = 0; corner < 8; ++corner) {
        const dvec3 offset = dvec3(corner & 1, corner >> 1 & 1, corner >> 2) - 0.5;
        sum += interpolated(fine.lattice_, leaving[a], lattice_.node(x, y, z) + 0.5 * lattice_.spacing * offset);
      }
      source[a][i] = static_cast<float>(ratio * sum / 8);
    }
  });
  return source;
}

void ScatteringSolver::add(const Moments& from, Moments& to) const {
  each_row([&](size_t begin, size_t end) {
    for (size_t a = 0; a < 4; ++a)
      for (size_t i = begin; i < end; ++i) to[a][i] += from[a][i];
  });
}

double ScatteringSolver::total(const Moments& light) const {
  std::vector<double> sums(static_cast<size_t>(lattice_.n.x), 0.0);
  each_node([&](int x, int, int, size_t i) {
    if (extinction_[i] > 0) sums[static_cast<size_t>(x)] += light[0][i];
  });
  double sum = 0;
  for (const double s : sums) sum += s;
  return sum;
}

}  // namespace brume

#include "render/guides/scattering_solver.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "render/guides/forward_peak.h"
#include "render/guides/lane_media.h"
#include "render/guides/media_line.h"
#include "volume/phase_function.h"

namespace brume {
namespace {

constexpr int kDirections = 24;
// Least of 5 P2 of what is left of scattering, on average, for it to be followed.
constexpr double kLeastQuadratic = 0.25;
// In which beams are scattered first, of which so many are swept together; the mean cosine of what stands for a peak
// there.
constexpr int kBeamDirections = 96;
constexpr size_t kTogether = 4;
constexpr double kPeakMeanCosine = 0.75;
constexpr int kMostLines = 8;         // along which a cell's media are looked up, across each axis
constexpr double kMostOfRow = 32768;  // look-ups of a row, in spacings along all of its lines
constexpr int kNear = 4;              // nodes around the media in which light that has left them is followed

/// Directions in which beams are scattered first: more, as a narrow beam is seen from few of any.
const std::vector<dvec3>& beam_directions() {
  static const std::vector<dvec3> all = spiral_of_directions(kBeamDirections);
  return all;
}

}  // namespace

const std::vector<dvec3>& ScatteringSolver::directions() {
  static const std::vector<dvec3> all = spiral_of_directions(kDirections);
  return all;
}

size_t ScatteringSolver::bundle_of(const dvec3& direction) const {
  const dvec3 d = glm::abs(direction) / lattice_.flat;
  const int axis = d.z > std::max(d.x, d.y) ? 2 : d.y > d.x ? 1 : 0;
  return static_cast<size_t>(2 * axis + (direction[axis] > 0 ? 1 : 0));
}

ScatteringSolver::ScatteringSolver(const Lattice& lattice, const GuideMedia& media, GuideColour colour,
                                   const Task& task, bool leave_out_broad_peak)
    : ScatteringSolver(lattice, task) {
  has_peak_ = !leave_out_broad_peak || media.mean_cosine(0) >= kNarrowPeak;
  // Means over the cells around the nodes, from lines along rows of them, a spacing after the other.
  const double cube = lattice.spacing;
  const int inner = std::clamp(static_cast<int>(std::lround(cube / media.voxel())), 1, 3);
  const LaneMedia lanes(media, colour);
  const bool even = lanes.even();
  const int last = static_cast<int>(lattice.last_place().z);
  const int most_lines = std::clamp(static_cast<int>(std::sqrt(kMostOfRow / static_cast<double>(last))), inner,
                                    std::max(inner, kMostLines));
  fill([&](int x, int y, std::vector<NodeMedia>& row) {
    static thread_local std::vector<std::pair<double, double>> parts;
    static thread_local std::vector<float> extinctions;
    static thread_local std::vector<NodeMedia> spacings;
    spacings.assign(static_cast<size_t>(last) + 1, {});
    MediaLine line(media, colour);
    const dvec2 along_x = lattice.halves(0, x), along_y = lattice.halves(1, y);
    const dvec3 cell(along_x.x + along_x.y, along_y.x + along_y.y, 1), before(along_x.x, along_y.x, 0.5);
    // Wide cells have more lines.
    const auto lines = [&](double width) {
      return std::clamp(static_cast<int>(std::lround(inner * width)), inner, most_lines);
    };
    const int lines_x = lines(cell.x), lines_y = lines(cell.y);
    for (int k = 0; k < lines_x * lines_y; ++k) {
      const dvec3 place(k % lines_x, k / lines_x, 0), samples(lines_x, lines_y, inner);
      const Ray ray{lattice_.node(x, y, 0) + cube * (cell * ((place + 0.5) / samples) - before), {0, 0, cube}};
      for (size_t m = 0; even && m < media.media().size(); ++m) {
        const double albedo = media.constants(m).albedo[static_cast<size_t>(colour + 1)], g = media.mean_cosine(m);
        extinctions.resize(static_cast<size_t>(inner) * (spacings.size() - 2));
        lanes.extinctions(m, ray.at(1), ray.d / static_cast<double>(inner), extinctions);
        for (size_t z = 1; z + 1 < spacings.size(); ++z)
          for (size_t i = 0; i < static_cast<size_t>(inner); ++i)
            spacings[z].add(static_cast<double>(extinctions[(z - 1) * static_cast<size_t>(inner) + i]), albedo, g);
      }
      if (even) continue;
      media.intervals(ray, last, parts);
      line.follow(ray);
      int z = 1;
      for (const auto& [begin, end] : parts)
        for (z = std::max(z, static_cast<int>(begin)); z < last && z <= end; ++z)
          for (int i = 0; i < inner; ++i) {
            const GuideMedia::Point point = line.at(z + static_cast<double>(i) / inner);
            spacings[static_cast<size_t>(z)].add(point.sigma_t, point.albedo, point.g);
          }
    }
    gather_cells(spacings, row);
    for (NodeMedia& node : row) {
      if (!(node.extinction > 0)) continue;
      const double albedo = node.scattered / node.extinction;
      const double g = node.scattered > 0 ? node.linear / node.scattered : 0;
      const double peak = has_peak_ ? peak_weight(g) : 0, left = 1 - albedo * peak;
      node.extinction *= cube / (lines_x * lines_y * inner);
      node.scaled = node.extinction * left;
      node.scattered = node.scaled * albedo * (1 - peak) / left;
      node.linear = node.scaled * 3 * (g - peak) / (1 - peak);
      node.quadratic = node.scaled * 5 * (g * g - peak) / (1 - peak);
      node.cosine = node.scaled * g;
    }
  });
}

ScatteringSolver::ScatteringSolver(const Lattice& lattice, const ScatteringSolver& fine, const Task& task)
    : ScatteringSolver(lattice, task) {
  has_peak_ = fine.has_peak_;
  NodeValues scattered(fine.scaled_.size()), linear(fine.scaled_.size());
  for (size_t i = 0; i < scattered.size(); ++i) {
    scattered[i] = fine.scaled_[i] * fine.albedo_[i];
    linear[i] = fine.scaled_[i] * fine.linear_[i];
  }
  const auto coarse = [&](const NodeValues& values) { return coarsened(fine.lattice_, values, lattice_, task_); };
  const NodeValues extinction = coarse(fine.extinction_), scaled = coarse(fine.scaled_);
  scattered = coarse(scattered);
  linear = coarse(linear);
  fill([&](int x, int y, std::vector<NodeMedia>& row) {
    for (int z = 1; z < lattice_.n.z - 1; ++z) {
      const size_t i = lattice_.index(x, y, z);
      row[static_cast<size_t>(z)] = {2.0 * extinction[i], 2.0 * scaled[i], 2.0 * scattered[i], 2.0 * linear[i]};
    }
  });
}

ScatteringSolver::ScatteringSolver(const Lattice& lattice, const Task& task) : lattice_(lattice), task_(quiet(task)) {
  const ivec3 n = lattice.n;
  z_major_ = {{n.x, n.y, n.z}, lattice.row()};
  y_major_ = {{n.z, n.x, n.y}, Lattice::padded(n.y)};
  for (int a = 0; a < 3; ++a) {
    std::vector<float>& places = places_[static_cast<size_t>(a)];
    std::vector<double>& widths = widths_[static_cast<size_t>(a)];
    for (int i = 0; i < n[a]; ++i) {
      const dvec2 halves = lattice.halves(a, i);
      widths.push_back(halves.x + halves.y);
      if (lattice.planes) places.push_back(static_cast<float>(lattice.place(a, i)));
    }
    if (!lattice.planes) continue;
    z_major_.places[static_cast<size_t>(a)] = places.data();
    y_major_.places[static_cast<size_t>((a + 1) % 3)] = places.data();
  }
  for (NodeValues* field : {&extinction_, &scaled_, &albedo_, &linear_, &quadratic_, &cosine_})
    *field = NodeValues(lattice.size());
  for (NodeValues* field : {&y_major_extinction_, &y_major_scaled_}) *field = NodeValues(y_major_.size());
  z_major_.width = {lattice.flat.x, lattice.flat.y, lattice.flat.z};
  y_major_.width = {lattice.flat.z, lattice.flat.x, lattice.flat.y};
  for (size_t k = 0; k < directions().size(); ++k) bundles_[bundle_of(directions()[k])].directions.push_back(k);
  for (size_t i = 0; i < bundles_.size(); ++i) {
    bundles_[i].y_major = i >= 4;
  }
}

void ScatteringSolver::gather_cells(std::vector<NodeMedia>& spacings, std::vector<NodeMedia>& row) const {
  if (!lattice_.planes) return row.swap(spacings);
  for (int z = 1; z < lattice_.n.z - 1; ++z) {
    const double place = lattice_.place(2, z);
    const dvec2 halves = lattice_.halves(2, z);
    const double begin = place - halves.x, end = place + halves.y;
    for (int k = static_cast<int>(std::floor(begin + 0.5)); k - 0.5 < end; ++k) {
      const double share = std::min(end, k + 0.5) - std::max(begin, k - 0.5);
      row[static_cast<size_t>(z)].add(spacings[static_cast<size_t>(k)], share / (end - begin));
    }
  }
}

template <class Sample>
void ScatteringSolver::fill(const Sample& sample) {
  std::vector<NodeMedia> sums(static_cast<size_t>(lattice_.n.x));
  parallel_for(lattice_.n.x - 2, task_, [&](int k) {
    const int x = k + 1;
    std::vector<NodeMedia> row;
    for (int y = 1; y < lattice_.n.y - 1; ++y) {
      row.assign(static_cast<size_t>(lattice_.n.z), {});
      sample(x, y, row);
      for (int z = 1; z < lattice_.n.z - 1; ++z) {
        const NodeMedia& node = row[static_cast<size_t>(z)];
        if (!(node.scaled > 0)) continue;
        const size_t i = lattice_.index(x, y, z);
        extinction_[i] = static_cast<float>(node.extinction);
        scaled_[i] = static_cast<float>(node.scaled);
        albedo_[i] = static_cast<float>(node.scattered / node.scaled);
        linear_[i] = static_cast<float>(node.linear / node.scaled);
        quadratic_[i] = static_cast<float>(node.quadratic / node.scaled);
        cosine_[i] = static_cast<float>(node.cosine / node.scaled);
        sums[static_cast<size_t>(x)].add(node, volume(x, y, z));
      }
    }
  });
  NodeMedia total;
  for (const NodeMedia& s : sums) total.add(s, 1);
  if (total.scaled > 0) {
    mean_scale_ = total.scaled / total.extinction;
    // Where nothing is, as it is on average: light is interpolated between nodes inside and outside.
    for (size_t i = 0; i < extinction_.size(); ++i)
      if (extinction_[i] == 0) {
        albedo_[i] = static_cast<float>(total.scattered / total.scaled);
        linear_[i] = static_cast<float>(total.linear / total.scaled);
        quadratic_[i] = static_cast<float>(total.quadratic / total.scaled);
      }
  }
  if (!(total.quadratic > kLeastQuadratic * total.scaled)) quadratic_ = cosine_ = {};
  find_rows();
  to_y_major(extinction_, y_major_extinction_, true);
  to_y_major(scaled_, y_major_scaled_, true);
}

std::vector<uint8_t> ScatteringSolver::near_media() const {
  const ivec3 n = lattice_.n;
  std::vector<uint8_t> near(lattice_.size(), 0), along(near.size(), 0);
  const std::ptrdiff_t strides[3] = {1, lattice_.row(), static_cast<std::ptrdiff_t>(lattice_.index(1, 0, 0))};
  for (size_t i = 0; i < near.size(); ++i) near[i] = extinction_[i] > 0;
  for (const std::ptrdiff_t stride : strides) {
    along.swap(near);
    parallel_for(n.x - 2, task_, [&](int i) {
      for (int y = 1; y < n.y - 1; ++y) {
        const size_t first = lattice_.index(i + 1, y, 0);
        for (size_t k = first + 1; k < first + n.z - 1; ++k) near[k] = along[k - stride] | along[k] | along[k + stride];
      }
    });
  }
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
        row.end = std::min(domain.row, Lattice::padded(row.end + kNear));
        near[static_cast<size_t>(x) * domain.n[1] + y] = row;
      }
    return near;
  };
  rows_ = ranges(z_major_, extinction_);
  NodeValues y_major(y_major_.size());
  to_y_major(extinction_, y_major, true);
  y_major_rows_ = ranges(y_major_, y_major);
}

void ScatteringSolver::to_y_major(const NodeValues& z_major, NodeValues& y_major, bool everywhere) const {
  const ivec3 n = lattice_.n;
  constexpr int kBlock = 16;
  parallel_for(n.x, task_, [&](int x) {
    for (int z0 = 0; z0 < n.z; z0 += kBlock)
      for (int y = 0; y < n.y; ++y) {
        const SweepRow row = everywhere ? SweepRow{0, n.z} : rows_[static_cast<size_t>(x) * n.y + y];
        const float* const from = z_major.data() + lattice_.index(x, y, 0);
        for (int z = std::max(z0, row.begin); z < std::min({n.z, z0 + kBlock, row.end}); ++z)
          y_major[(static_cast<size_t>(z) * n.x + x) * y_major_.row + y] = from[z];
      }
  });
}

void ScatteringSolver::sweep_sources(const Emission& source, size_t count, size_t wanted) {
  for (size_t a = 0; a < count; ++a) {
    if (y_major_source_[a].empty()) y_major_source_[a] = NodeValues(y_major_.size());
    to_y_major(source[a], y_major_source_[a], false);
  }
  each_bundle(wanted, [&](const Bundle& bundle, std::span<float* const> moments, bool adds) {
    SweepMedia media{bundle.y_major ? y_major_scaled_.data() : scaled_.data(), {}, count};
    for (size_t a = 0; a < count; ++a) media.source[a] = bundle.y_major ? y_major_source_[a].data() : source[a].data();
    SweepDomain domain = near(bundle);
    domain.rows = domain.kept;
    sweep(domain, media, beams(bundle), moments, adds);
  });
}

SweepDomain ScatteringSolver::near(const Bundle& bundle) const {
  SweepDomain domain = bundle.y_major ? y_major_ : z_major_;
  domain.kept = bundle.y_major ? y_major_rows_.data() : rows_.data();
  return domain;
}

std::vector<SweepBeam> ScatteringSolver::beams(const Bundle& bundle) const {
  std::vector<dvec3> own;
  for (const size_t k : bundle.directions) own.push_back(directions()[k]);
  return beams(bundle, own);
}

std::vector<SweepBeam> ScatteringSolver::beams(const Bundle& bundle, const std::vector<dvec3>& along) const {
  std::vector<SweepBeam> beams;
  for (const dvec3& d : along) {
    SweepBeam& beam = beams.emplace_back();
    beam.direction = bundle.y_major ? std::array{d.z, d.x, d.y} : std::array{d.x, d.y, d.z};
    beam.factor = moments_of(d);
  }
  return beams;
}

void ScatteringSolver::gather(Radiance& light) const {
  if (shares_sums(1))
    gather_sums<true>(light);
  else
    gather_sums<false>(light);
}

template <bool kShared>
void ScatteringSolver::gather_sums(Radiance& light) const {
  constexpr int kBlock = 16;
  constexpr float kShare = 1.0f / kDirections;
  const ivec3 n = lattice_.n;
  parallel_for(n.x, task_, [&](int x) {
    std::vector<float> block(static_cast<size_t>(kBlock) * y_major_.row);
    for (size_t a = 0; a < light.known(); ++a) {
      // Of the two bundles along an axis.
      const auto along_axis = [&](size_t axis) {
        return [one = bundles_[2 * axis].light[a].data(), other = bundles_[2 * axis + 1].light[a].data()](size_t i) {
          return kShared ? one[i] : one[i] + other[i];
        };
      };
      const auto along_x = along_axis(0), along_y = along_axis(1), along_z = along_axis(2);
      // The bundles along z are y-major: kBlock of their lines, y fastest, are read at once.
      const auto read_block = [&](int z0, int count) {
        for (int k = 0; k < count; ++k) {
          const size_t line = (static_cast<size_t>(z0 + k) * n.x + x) * y_major_.row;
          float* const sum = block.data() + static_cast<size_t>(k) * y_major_.row;
          const SweepRow row = y_major_rows_[line / y_major_.row];
          std::fill_n(sum, y_major_.row, 0.0f);
          for (int y = row.begin; y < row.end; ++y) sum[y] = along_z(line + y);
        }
      };
      const auto add_row = [&](int y, int z0, int count) {
        const SweepRow row = rows_[static_cast<size_t>(x) * n.y + y];
        const size_t first = lattice_.index(x, y, 0);
        for (int z = std::max(z0, row.begin); z < std::min(z0 + count, row.end); ++z) {
          const size_t i = first + z;
          light[a][i] = kShare * (along_x(i) + along_y(i) + block[static_cast<size_t>(z - z0) * y_major_.row + y]);
        }
      };
      for (int z0 = 0; z0 < n.z; z0 += kBlock) {
        const int count = std::min(kBlock, n.z - z0);
        read_block(z0, count);
        for (int y = 0; y < n.y; ++y) add_row(y, z0, count);
      }
    }
  });
}

SkyShares ScatteringSolver::arriving(bool peaks) const {
  SkyShares all(lattice_, directions().size());
  const ivec3 n = lattice_.n;
  // One bundle after another, so that few directions are held in full at once.
  for (const Bundle& bundle : bundles_) {
    const SweepDomain domain = near(bundle);
    const std::vector<SweepBeam> swept = beams(bundle);
    std::vector<NodeValues> light(swept.size());
    parallel_for(static_cast<int>(swept.size()), task_, [&](int k) {
      SweepBeam beam = swept[static_cast<size_t>(k)];
      NodeValues& radiance = light[static_cast<size_t>(k)] = NodeValues(domain.size());
      beam.incoming = 1;
      beam.radiance = radiance.data();
      const NodeValues& z_major = peaks ? scaled_ : extinction_;
      const NodeValues& y_major = peaks ? y_major_scaled_ : y_major_extinction_;
      sweep(domain, {bundle.y_major ? y_major.data() : z_major.data(), {}, 0}, {&beam, 1}, {});
    });
    parallel_for(n.x - 2, task_, [&](int i) {
      const int x = i + 1;
      for (int y = 1; y < n.y - 1; ++y) {
        const SweepRow& row = rows_[static_cast<size_t>(x) * n.y + y];
        for (int z = row.begin; z < std::min(row.end, n.z); ++z) {
          const size_t node = lattice_.index(x, y, z);
          const size_t from = bundle.y_major ? (static_cast<size_t>(z) * n.x + x) * y_major_.row + y : node;
          for (size_t k = 0; k < light.size(); ++k) all.set(node, bundle.directions[k], light[k][from]);
        }
      }
    });
  }
  return all;
}

Radiance ScatteringSolver::entering(const std::vector<double>& incoming) {
  each_bundle(4, [&](const Bundle& bundle, std::span<float* const> moments, bool adds) {
    std::vector<SweepBeam> swept = beams(bundle);
    for (size_t k = 0; k < swept.size(); ++k) swept[k].incoming = static_cast<float>(incoming[bundle.directions[k]]);
    sweep(near(bundle), {bundle.y_major ? y_major_scaled_.data() : scaled_.data(), {}, 0}, swept, moments, adds);
  });
  Radiance light = nothing<Radiance>();
  gather(light);
  return light;
}

Radiance ScatteringSolver::emitted(const NodeValues& emission) {
  source_[0] = emission;
  sweep_sources(source_, 1, 4);
  Radiance light = nothing<Radiance>();
  gather(light);
  return light;
}

Source ScatteringSolver::scatter(Radiance light) const {
  each_row([&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      const float linear = albedo_[i] * linear_[i];
      light[0][i] *= albedo_[i];
      light[1][i] *= linear;
      light[2][i] *= linear;
      light[3][i] *= linear;
    }
    for (size_t a = 4; a < light.known(); ++a)
      for (size_t i = begin; i < end; ++i) light[a][i] *= albedo_[i] * quadratic_[i];
  });
  return Source::in_place_of(std::move(light));
}

Radiance ScatteringSolver::transport(Source scattered) {
  const size_t known = scattered.known();
  for (size_t a = 0; a < known; ++a)
    if (source_[a].empty()) source_[a] = NodeValues(lattice_.size());
  each_row([&](size_t begin, size_t end) {
    for (size_t a = 0; a < known; ++a)
      for (size_t i = begin; i < end; ++i) source_[a][i] = scaled_[i] * scattered[a][i];
  });
  sweep_sources(source_, known, known);
  Radiance light = Radiance::in_place_of(std::move(scattered));
  gather(light);
  return light;
}

// Over the directions that the beam comes from the phase function is one of a smaller mean cosine; its forward peak,
// which counts as not scattered, is taken off around the beam.
Radiance ScatteringSolver::transport_beam(const Radiance& arriving) {
  constexpr double kShare = static_cast<double>(kDirections) / kBeamDirections;  // gather() takes means over fewer
  Radiance light = nothing<Radiance>(kMostMoments);
  each_bundle(kMostMoments, [&](const Bundle& bundle, std::span<float* const> moments, bool adds) {
    SweepDomain domain = near(bundle);
    domain.rows = domain.kept;
    std::array<NodeValues, kTogether> sources;
    for (NodeValues& values : sources) values = NodeValues(domain.size());
    std::vector<dvec3> some;
    const auto sweep_some = [&] {
      if (some.empty()) return;
      for (int x = 0; x < lattice_.n.x; ++x)
        for (int y = 0; y < lattice_.n.y; ++y) {
          const SweepRow& row = rows_[static_cast<size_t>(x) * lattice_.n.y + y];
          for (int z = row.begin; z < std::min(row.end, lattice_.n.z); ++z) {
            const size_t i = lattice_.index(x, y, z);
            const size_t to = bundle.y_major ? (static_cast<size_t>(z) * lattice_.n.x + x) * y_major_.row + y : i;
            const double mean = static_cast<double>(arriving[0][i]);
            if (!(mean > 0)) continue;
            const dvec3 flux(arriving[1][i], arriving[2][i], arriving[3][i]);
            const double length = glm::length(flux), narrow = std::min(1.0, length / mean);
            const auto g = static_cast<double>(cosine_[i]);
            const double peak = has_peak_ ? peak_weight(g) : 0;
            const HenyeyGreenstein all{g * narrow}, of_peak{kPeakMeanCosine * narrow};
            const double scattered =
                4 * kPi * kShare * mean * static_cast<double>(scaled_[i] * albedo_[i]) / (1 - peak);
            for (size_t k = 0; k < some.size(); ++k) {
              const double cosine = length > 0 ? std::clamp(glm::dot(some[k], flux) / length, -1.0, 1.0) : 0.0;
              sources[k][to] =
                  static_cast<float>(scattered * std::max(0.0, all.value(cosine) - peak * of_peak.value(cosine)));
            }
          }
        }
      std::vector<SweepBeam> swept = beams(bundle, some);
      for (size_t k = 0; k < swept.size(); ++k) swept[k].source = sources[k].data();
      sweep(domain, {bundle.y_major ? y_major_scaled_.data() : scaled_.data(), {}, kMostMoments}, swept, moments, adds);
      adds = true;
      some.clear();
    };
    for (const dvec3& d : beam_directions()) {
      if (&bundles_[bundle_of(d)] != &bundle) continue;
      some.push_back(d);
      if (some.size() == kTogether) sweep_some();
    }
    sweep_some();
  });
  gather(light);
  return light;
}

Radiance ScatteringSolver::transport(const Emission& emission) {
  sweep_sources(emission, 4, 4);
  Radiance light = nothing<Radiance>();
  gather(light);
  return light;
}

Emission ScatteringSolver::emission_from(const ScatteringSolver& fine, const Source& scattered) const {
  Emission emission;
  for (size_t a = 0; a < 4; ++a) {
    NodeValues leaving(fine.scaled_.size());
    for (size_t i = 0; i < leaving.size(); ++i) leaving[i] = 2 * fine.scaled_[i] * scattered[a][i];
    emission[a] = coarsened(fine.lattice_, leaving, lattice_, task_);
  }
  return emission;
}

template <class Value>
double ScatteringSolver::sum_over_media(const Value& value) const {
  std::vector<double> sums(static_cast<size_t>(lattice_.n.x), 0.0);
  each_node([&](int x, int y, int z, size_t i) {
    if (extinction_[i] > 0) sums[static_cast<size_t>(x)] += volume(x, y, z) * value(i);
  });
  double sum = 0;
  for (const double s : sums) sum += s;
  return sum;
}

double ScatteringSolver::total(const Source& light) const {
  return sum_over_media([&](size_t i) { return static_cast<double>(light[0][i]); });
}

double ScatteringSolver::product(const NodeValues& a, const NodeValues& b) const {
  return sum_over_media([&](size_t i) { return static_cast<double>(a[i]) * static_cast<double>(b[i]); });
}

}  // namespace brume

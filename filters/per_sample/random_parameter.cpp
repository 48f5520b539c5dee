#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/rng.h"
#include "filters/api/registry.h"
#include "filters/inputs/planes.h"
#include "filters/inputs/samples.h"
#include "filters/kernels/sample_filter.h"
#include "filters/patch/neighbourhood.h"
#include "filters/per_sample/mutual_information.h"

namespace brume {
namespace {

enum class Formulas { kPaper, kTechReport };
enum class Information { kLiteral, kCorrected };

struct RandomParameter {
  Formulas formulas = Formulas::kTechReport;
  float variance = 0.02f;
  int largest_neighborhood = 2000, information_samples = 512;
  Information information = Information::kCorrected;
  int keep_energy = 1;
};

constexpr int kPasses = 4;
constexpr std::array<int, kPasses> kBlocks = {55, 35, 17, 7};
// Lanes of the kernel: of pixels with more samples, groups are averaged first.
constexpr int kMostSamples = 16;
// Fewer samples in a neighbourhood say nothing about dependence.
constexpr size_t kFewest = 30;
constexpr float kClusterDeviations = 3, kPositionDeviations = 30, kClusterFloor = 0.1f;

enum class Kind { kColor, kFeature, kParameter, kPosition };

struct Column {
  Kind kind;
  size_t offset;          // in the file's record
  bool is_place = false;  // of a point in the world
};

const std::vector<std::pair<std::string_view, int>> kFeatures = {
    {"position_1", 3}, {"surface_gradient", 3},      {"gradient_1", 3}, {"albedo", 3}, {"density_1", 1},
    {"position_2", 3}, {"light_transmittance_1", 1}, {"normal", 3},     {"flags", 1}};
const std::vector<std::pair<std::string_view, int>> kParameters = {
    {"flight_1", 1}, {"direction_1", 3}, {"light_1", 1}, {"light_uv_1", 2},
    {"flight_2", 1}, {"direction_2", 3}, {"lens", 2},    {"time", 1}};

/// Which numbers of a record are used, and how they are scaled.
class Columns {
 public:
  explicit Columns(RecordReader& reader) {
    const RecordLayout& layout = reader.layout();
    std::vector<Column> wanted;
    const auto add = [&](Kind kind, std::string_view name, int components) {
      const size_t at = field_offset(layout, name);
      for (int c = 0; c < components; ++c)
        wanted.push_back({kind, at + static_cast<size_t>(c), name.starts_with("position")});
    };
    for (const auto& [name, components] : kFeatures) add(Kind::kFeature, name, components);
    for (const auto& [name, components] : kParameters) add(Kind::kParameter, name, components);
    add(Kind::kPosition, "film", 2);
    choose(reader, wanted);
  }
  const std::vector<Column>& list() const { return list_; }
  float scaled(size_t k, const float* record) const { return scale_[k].x * (record[list_[k].offset] - scale_[k].y); }

 private:
  /// Drops columns that never change, and maps features to [0, 1] between their 1st and 99th percentile, judged by some
  /// tiles spread over the whole frame.
  void choose(RecordReader& reader, const std::vector<Column>& wanted) {
    const RecordLayout& layout = reader.layout();
    const int step = std::max(1, layout.tile_count() / 24);
    std::vector<std::vector<float>> values(wanted.size());
    for (int tile = step / 2; tile < layout.tile_count(); tile += step) {
      const std::vector<float> block = reader.read(tile);
      const size_t width = static_cast<size_t>(layout.components()), records = block.size() / width;
      for (size_t i = 0; i < records; i += std::max<size_t>(1, records / 400))
        for (size_t k = 0; k < wanted.size(); ++k)
          if (const float v = block[i * width + wanted[k].offset]; std::isfinite(v)) values[k].push_back(v);
    }
    for (size_t k = 0; k < wanted.size(); ++k) {
      std::vector<float>& v = values[k];
      if (v.empty()) continue;
      std::sort(v.begin(), v.end());
      if (!(v.back() > v.front())) continue;
      float low = v[v.size() / 100], high = v[v.size() - 1 - v.size() / 100];
      if (!(high > low)) {
        low = v.front();
        high = v.back();
      }
      list_.push_back(wanted[k]);
      scale_.push_back(wanted[k].kind == Kind::kFeature ? vec2(1 / (high - low), low) : vec2(1, 0));
    }
  }

  std::vector<Column> list_;
  std::vector<vec2> scale_;  // factor and offset of each column
};

/// The samples of a tile and its apron, one record after another: colour, features, random parameters, film position.
class Store {
 public:
  Store(const FilterFrame& frame, const Columns& columns, RepairedPixels* repaired)
      : width_(frame.width()), height_(frame.height()) {
    const RecordLayout& layout = frame.records->layout();
    const std::vector<size_t> parts = signal_offsets(layout, frame.name);
    const size_t count = static_cast<size_t>(layout.samples), width = static_cast<size_t>(layout.components());
    group_ = (layout.samples + kMostSamples - 1) / kMostSamples;
    samples_ = (layout.samples + group_ - 1) / group_;
    stride_ = (3 + columns.list().size() + 7) / 8 * 8;
    data_.assign(static_cast<size_t>(width_) * static_cast<size_t>(height_) * static_cast<size_t>(samples_) * stride_,
                 0.0f);
    const size_t group = static_cast<size_t>(group_);
    visit_records(frame, repaired, [&](int x, int y, std::span<const float> records) {
      for (size_t s = 0; s < count; ++s) {
        const float* record = records.data() + s * width;
        const size_t g = s / group;
        const float share = 1.0f / static_cast<float>(std::min(count - g * group, group));
        float* to = data_.data() + (index(x, y) + g) * stride_;
        for (const size_t part : parts)
          for (size_t c = 0; c < 3; ++c) {
            const float v = record[part + c];
            to[c] += share * (std::isfinite(v) ? v : 0.0f);
          }
        for (size_t k = 0; k < columns.list().size(); ++k) {
          const float v = columns.scaled(k, record);
          to[3 + k] += share * (std::isfinite(v) ? v : 0.0f);
        }
      }
    });
  }

  int samples() const { return samples_; }
  int group() const { return group_; }
  size_t stride() const { return stride_; }
  size_t count() const { return data_.size() / stride_; }
  /// Of a pixel's first sample among all.
  size_t index(int x, int y) const {
    return (static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x)) *
           static_cast<size_t>(samples_);
  }
  const float* sample(size_t i) const { return data_.data() + i * stride_; }
  const float* sample(int x, int y, int s) const { return sample(index(x, y) + static_cast<size_t>(s)); }

 private:
  int width_, height_, samples_ = 0, group_ = 1;
  size_t stride_ = 0;
  std::vector<float> data_;
};

/// The 7 x 7 places around one, the nearest first.
std::vector<ivec2> search_order() {
  std::vector<ivec2> order;
  for (int y = -3; y <= 3; ++y)
    for (int x = -3; x <= 3; ++x) order.push_back({x, y});
  std::stable_sort(order.begin(), order.end(),
                   [](ivec2 a, ivec2 b) { return a.x * a.x + a.y * a.y < b.x * b.x + b.y * b.y; });
  return order;
}

/// For each pixel the place in another frame whose features are most like its own: where its block lies there.
std::vector<ivec2> best_matches(const Store& here, const Store& there, ivec2 size, const std::vector<size_t>& features,
                                const Task& task) {
  // Means over 3 x 3 pixels, because features of media are noisy.
  const auto means = [&](const Store& store) {
    std::vector<Plane> planes;
    for (const size_t f : features)
      planes.push_back(box_mean(make_plane(size.x, size.y, quiet(task),
                                           [&](int x, int y) {
                                             float sum = 0;
                                             for (int s = 0; s < store.samples(); ++s) sum += store.sample(x, y, s)[f];
                                             return sum / static_cast<float>(store.samples());
                                           }),
                                1, task));
    return planes;
  };
  const std::vector<Plane> own = means(here), other = means(there);
  const std::vector<ivec2> order = search_order();
  std::vector<ivec2> found(static_cast<size_t>(size.x) * static_cast<size_t>(size.y));
  for_each_row(size.y, quiet(task), [&](int y) {
    for (int x = 0; x < size.x; ++x) {
      ivec2 best(0);
      float nearest = std::numeric_limits<float>::infinity();
      // From the middle outwards, so that the nearest of equals is taken.
      for (const ivec2& d : order) {
        const int qx = x + d.x, qy = y + d.y;
        if (qx < 0 || qy < 0 || qx >= size.x || qy >= size.y) continue;
        float distance = 0;
        for (size_t f = 0; f < own.size(); ++f) {
          const float e = own[f](x, y) - other[f](qx, qy);
          distance += e * e;
        }
        if (distance < nearest) {
          nearest = distance;
          best = d;
        }
      }
      found[static_cast<size_t>(y) * static_cast<size_t>(size.x) + static_cast<size_t>(x)] = best;
    }
  });
  return found;
}

/// How much of each colour and feature the distance sees: Sen and Darabi's alpha and beta, and W_c^r.
struct Importance {
  std::array<double, 3> alpha;
  std::vector<double> beta;
  double color_noise = 0;  // share of the colour that random parameters explain
};

/// Which columns of a store are of each kind: the colour stands before them.
struct Kinds {
  std::vector<size_t> features, parameters, positions;

  explicit Kinds(const Columns& columns) {
    for (size_t i = 0; i < columns.list().size(); ++i) {
      const Kind kind = columns.list()[i].kind;
      (kind == Kind::kFeature ? features : kind == Kind::kParameter ? parameters : positions).push_back(3 + i);
    }
  }
};

/// The samples of a neighbourhood, the pixel's own first: records side by side, each with its colour behind.
struct Neighborhood {
  std::vector<float> data;
  size_t count = 0, width = 0;
  std::vector<const float*> drawn, colors;  // what was drawn, of which some belong to it
  const float* row(size_t i) const { return data.data() + i * width; }
};

/// Mean of each column over a neighbourhood, and the inverse of its deviation; 0: it is constant.
struct Scales {
  std::vector<float> mean, inverse;

  Scales(const Neighborhood& hood, size_t columns) : mean(columns), inverse(columns) {
    std::vector<double> sum(columns), squares(columns);
    kernels::column_moments(hood.data.data(), hood.count, hood.width, columns, sum.data(), squares.data());
    const double n = static_cast<double>(hood.count);
    for (size_t k = 0; k < columns; ++k) {
      mean[k] = static_cast<float>(hood.row(0)[k] + sum[k] / n);
      const double deviation = std::sqrt(std::max(0.0, squares[k] / n - sum[k] * sum[k] / (n * n)));
      inverse[k] = deviation > 1e-8 ? static_cast<float>(1 / deviation) : 0.0f;
    }
  }
};

/// Dependences are measured within the neighbourhood.
Importance importance(const RandomParameter& p, const Kinds& kinds, const Neighborhood& hood, const Scales& scales,
                      int pass) {
  const bool corrected = p.information == Information::kCorrected;
  const size_t n = std::min(hood.count, static_cast<size_t>(p.information_samples));
  MutualInformation mi(n);
  std::vector<float> column(n);
  const auto add = [&](size_t at) {
    for (size_t i = 0; i < n; ++i) column[i] = (hood.row(i)[at] - scales.mean[at]) * scales.inverse[at];
    return mi.add(column);
  };
  std::vector<size_t> c, f, r, q;
  for (size_t k = 0; k < 3; ++k) c.push_back(add(k));
  for (const size_t at : kinds.features) f.push_back(add(at));
  for (const size_t at : kinds.parameters) r.push_back(add(at));
  for (const size_t at : kinds.positions) q.push_back(add(at));
  // Sums over the columns of a kind; corrected ones are means, so that many parameters do not outvote two positions.
  const auto depends = [&](size_t a, const std::vector<size_t>& on) {
    double sum = 0;
    for (const size_t b : on) sum += mi(a, b, corrected);
    return corrected && !on.empty() ? sum / static_cast<double>(on.size()) : sum;
  };
  constexpr double kEps = 1e-10;
  const double growth = p.formulas == Formulas::kPaper ? 1 : 1 + 0.1 * pass;
  Importance out;
  double color_r = 0, color_p = 0;
  for (size_t k = 0; k < 3; ++k) {
    const double dr = depends(c[k], r), dp = depends(c[k], q);
    color_r += dr;
    color_p += dp;
    out.alpha[k] = std::max(0.0, 1 - growth * dr / (dr + dp + kEps));
  }
  std::vector<double> color_f;
  double all_f = 0;
  for (size_t k = 0; k < f.size(); ++k) {
    double sum = 0;
    for (const size_t a : c) sum += mi(a, f[k], corrected);
    color_f.push_back(sum);
    all_f += sum;
  }
  if (corrected && !f.empty()) all_f /= static_cast<double>(f.size());
  for (size_t k = 0; k < f.size(); ++k) {
    const double dr = depends(f[k], r), dp = depends(f[k], q);
    const double by_color = color_f[k] / (color_r + color_p + all_f + kEps);
    out.beta.push_back(by_color * std::max(0.0, 1 - growth * dr / (dr + dp + kEps)));
  }
  out.color_noise = color_r / (color_r + color_p + kEps);
  return out;
}

/// Samples more than a deviation from the pixel's mean become the mean; what light that takes is given back to all.
void limit_spikes(std::span<vec3> colors, bool keep_energy) {
  if (colors.size() < 2) return;
  const double n = static_cast<double>(colors.size());
  dvec3 mean(0);
  for (const vec3& c : colors) mean += dvec3(c) / n;
  double squares = 0;
  for (const vec3& c : colors) squares += glm::dot(dvec3(c) - mean, dvec3(c) - mean);
  const double deviation = std::sqrt(squares / (n - 1));
  dvec3 after(0);
  for (vec3& c : colors) {
    if (glm::distance(dvec3(c), mean) > deviation) c = vec3(mean);
    after += dvec3(c) / n;
  }
  if (keep_energy)
    for (vec3& c : colors) c += vec3(mean - after);
}

class Filter {
 public:
  /// @param frames  of a sequence in their order; the `own`-th is to be cleaned
  Filter(const RandomParameter& p, const std::vector<const FilterFrame*>& frames, size_t own, RepairedPixels* repaired,
         const Task& task)
      : p_(p), frame_(*frames[own]), own_(own), columns_(*frame_.records), kinds_(columns_) {
    for (const FilterFrame* f : frames) {
      stores_.emplace_back(*f, columns_, repaired);
      const Store& store = stores_.back();
      std::vector<float>& color = current_.emplace_back(store.count() * 3);
      for (size_t i = 0; i < store.count(); ++i)
        for (size_t c = 0; c < 3; ++c) color[3 * i + c] = store.sample(i)[c];
    }
    next_ = current_;
    around_.resize(frames.size());
    for (size_t f = 0; f < frames.size(); ++f) {
      around_[f].push_back({f, {}});
      for (const size_t g : {f - 1, f + 1})
        if (g < frames.size())
          around_[f].push_back(
              {g, best_matches(stores_[f], stores_[g], {frame_.width(), frame_.height()}, kinds_.features, task)});
    }
    for (int pass = 0; pass < kPasses; ++pass) draw_places(pass);
  }

  void run(const Task& task) {
    const double frames = static_cast<double>(stores_.size());
    for (int pass = 0; pass < kPasses; ++pass) {
      for (size_t f = 0; f < stores_.size(); ++f) {
        // The last pass looks at no other frame's result.
        if (pass + 1 == kPasses && f != own_) continue;
        const double begin = (pass + static_cast<double>(f) / frames) / kPasses;
        // Blocks, because neighbours draw from the same records, which are still in the cache.
        constexpr int kSide = 16;
        for_each_block(frame_.width(), frame_.height(), kSide, kSide,
                       share(task, begin, begin + 1 / (frames * kPasses)), [&](const Box& b) {
                         for (int y = b.y0; y < b.y1; ++y)
                           for (int x = b.x0; x < b.x1; ++x) filter_pixel(f, x, y, pass);
                       });
      }
      std::swap(current_, next_);
    }
  }

  vec3 pixel(int x, int y) const {
    const int samples = stores_[own_].samples();
    dvec3 sum(0);
    for (int s = 0; s < samples; ++s) sum += dvec3(color(own_, x, y, s));
    return vec3(sum / static_cast<double>(samples));
  }

 private:
  vec3 color(size_t f, int x, int y, int s) const {
    const float* c = current_[f].data() + (stores_[f].index(x, y) + static_cast<size_t>(s)) * 3;
    return {c[0], c[1], c[2]};
  }

  /// Side of a pass's blocks [px]: with frames before and after smaller, so that the block holds as many samples.
  int block(int pass) const {
    const double frames = static_cast<double>(std::min<size_t>(stores_.size(), 3));
    return std::max(3, static_cast<int>(kBlocks[static_cast<size_t>(pass)] / std::sqrt(frames)) | 1);
  }

  /// Places of neighbours, from a Gaussian of a quarter of the block, inside the block and not the pixel itself: one
  /// list for all pixels, in which each draws by its own numbers.
  void draw_places(int pass) {
    const int side = block(pass);
    Rng rng(static_cast<uint64_t>(pass));
    while (draws_[static_cast<size_t>(pass)].size() < kDraws) {
      const double radius = side / 4.0 * std::sqrt(2 * rng.exponential());
      const auto angle = portable_sincos_2pi(rng.uniform());
      const ivec2 d(std::lrint(radius * angle.cos), std::lrint(radius * angle.sin));
      if (std::abs(d.x) <= side / 2 && std::abs(d.y) <= side / 2 && (d != ivec2(0) || stores_.size() > 1))
        draws_[static_cast<size_t>(pass)].push_back(d);
    }
  }

  /// Mean and deviation of the features over the pixel's own samples; of a pixel with one, over its 3 x 3.
  void own_statistics(const Store& own, int x, int y, std::vector<float>& mean, std::vector<float>& deviation) const {
    const int radius = own.samples() > 1 ? 0 : 1;
    mean.assign(kinds_.features.size(), 0.0f);
    deviation.assign(kinds_.features.size(), 0.0f);
    std::vector<const float*> rows;
    for (int qy = std::max(0, y - radius); qy <= std::min(frame_.height() - 1, y + radius); ++qy)
      for (int qx = std::max(0, x - radius); qx <= std::min(frame_.width() - 1, x + radius); ++qx)
        for (int s = 0; s < own.samples(); ++s) rows.push_back(own.sample(qx, qy, s));
    for (size_t k = 0; k < kinds_.features.size(); ++k) {
      double sum = 0, squares = 0;
      for (const float* row : rows) sum += row[kinds_.features[k]];
      const double m = sum / static_cast<double>(rows.size());
      for (const float* row : rows) squares += (row[kinds_.features[k]] - m) * (row[kinds_.features[k]] - m);
      mean[k] = static_cast<float>(m);
      deviation[k] = static_cast<float>(std::sqrt(squares / static_cast<double>(std::max<size_t>(rows.size() - 1, 1))));
    }
  }

  /// The pixel's samples, then samples of its surroundings drawn from a Gaussian of a quarter of the block, in this
  /// frame and in those before and after, as far as their features lie within three deviations of the pixel's own.
  void gather(size_t frame, int x, int y, int pass, Neighborhood& n) const {
    const Store& own = stores_[frame];
    const int side = kBlocks[static_cast<size_t>(pass)], s = own.samples();
    const int most = std::min(side * side * s / 2, p_.largest_neighborhood);
    std::vector<float> mean, deviation;
    own_statistics(own, x, y, mean, deviation);
    const auto take = [&](size_t f, int qx, int qy, int k) {
      const size_t i = stores_[f].index(qx, qy) + static_cast<size_t>(k);
      n.drawn.push_back(stores_[f].sample(i));
      n.colors.push_back(current_[f].data() + i * 3);
    };
    n.drawn.clear();
    n.colors.clear();
    for (int k = 0; k < s; ++k) take(frame, x, y, k);
    const int gx = x + frame_.origin.x, gy = y + frame_.origin.y;
    std::vector<float> low(kinds_.features.size()), high(kinds_.features.size());
    for (size_t k = 0; k < kinds_.features.size(); ++k) {
      const float times = columns_.list()[kinds_.features[k] - 3].is_place ? kPositionDeviations : kClusterDeviations;
      // Where both the deviation and the difference are small, the difference is forgiven.
      const float width = std::max(times * deviation[k], deviation[k] < kClusterFloor ? kClusterFloor : 0.0f);
      low[k] = mean[k] - width;
      high[k] = mean[k] + width;
    }
    // Places first, so that the records are on their way before they are looked at.
    const std::vector<ivec2>& draws = draws_[static_cast<size_t>(pass)];
    const std::vector<Around>& around = around_[frame];
    uint64_t state = hash_combine(hash_combine(mix64(static_cast<uint64_t>(pass)), static_cast<uint64_t>(gy)),
                                  static_cast<uint64_t>(gx));
    size_t place = state >> 33;  // in the list, which is read on from there
    for (int i = s; i < most; ++i) {
      state = state * 6364136223846793005ull + 1442695040888963407ull;
      ivec2 d = draws[place++ % kDraws];
      const Around& there = around[(state >> 50) * around.size() >> 14];
      if (there.frame == frame && d == ivec2(0)) continue;
      if (!there.match.empty())
        d += there.match[static_cast<size_t>(y) * static_cast<size_t>(frame_.width()) + static_cast<size_t>(x)];
      const int qx = x + d.x, qy = y + d.y;
      if (qx < 0 || qy < 0 || qx >= frame_.width() || qy >= frame_.height()) continue;
      const uint64_t samples = static_cast<uint64_t>(stores_[there.frame].samples());
      take(there.frame, qx, qy, static_cast<int>(((state >> 20) & 0xfff) * samples >> 12));
    }
    n.width = own.stride() + 4;
    n.data.resize(n.drawn.size() * n.width);
    n.count =
        kernels::collect_records(n.drawn, n.colors, static_cast<size_t>(s), own.stride(),
                                 {3, kinds_.features.size(), low.data(), high.data()},  // features follow the colour
                                 n.data.data(), n.width);
  }

  void filter_pixel(size_t frame, int x, int y, int pass) {
    const int s = stores_[frame].samples();
    thread_local Neighborhood hood;
    gather(frame, x, y, pass, hood);
    if (hood.count < kFewest) {
      for (int k = 0; k < s; ++k) store(frame, x, y, k, color(frame, x, y, k));
      return;
    }
    const Scales scales(hood, 3 + columns_.list().size());
    const Importance w = importance(p_, kinds_, hood, scales, pass);
    // w_ij = exp(-(1 - W_c^r)^2 / (2 sigma^2) [sum alpha dc^2 + sum beta df^2]), sigma^2 = 8 sigma_8^2 / s. Samples
    // that were averaged in groups count as one of their group's size.
    const double sigma2 = 8.0 * static_cast<double>(p_.variance) / (s * stores_[frame].group());
    const double factor = (1 - w.color_noise) * (1 - w.color_noise) / (2 * sigma2);
    std::vector<kernels::ScaledComponent> components;
    const auto use = [&](size_t at, double share) {
      const float scale = static_cast<float>(std::sqrt(factor * share)) * scales.inverse[at];
      if (scale > 0) components.push_back({static_cast<int>(at), scale});
    };
    for (size_t k = 0; k < 3; ++k) use(k, w.alpha[k]);
    for (size_t k = 0; k < kinds_.features.size(); ++k) use(kinds_.features[k], w.beta[k]);
    float sums[4][16];
    kernels::filter_samples(hood.data.data(), static_cast<size_t>(s), hood.count, hood.width, stores_[frame].stride(),
                            components, sums);
    std::array<vec3, kMostSamples> result;
    for (int k = 0; k < s; ++k) result[static_cast<size_t>(k)] = vec3(sums[1][k], sums[2][k], sums[3][k]) / sums[0][k];
    limit_spikes({result.data(), static_cast<size_t>(s)}, p_.keep_energy != 0);
    for (int k = 0; k < s; ++k) store(frame, x, y, k, result[static_cast<size_t>(k)]);
  }

  void store(size_t frame, int x, int y, int s, const vec3& c) {
    float* to = next_[frame].data() + (stores_[frame].index(x, y) + static_cast<size_t>(s)) * 3;
    to[0] = c.x;
    to[1] = c.y;
    to[2] = c.z;
  }

  /// A frame that neighbourhoods reach into, and where each pixel's block lies there; empty: at the pixel.
  struct Around {
    size_t frame;
    std::vector<ivec2> match;
  };

  const RandomParameter& p_;
  const FilterFrame& frame_;
  size_t own_;
  Columns columns_;
  Kinds kinds_;
  std::vector<Store> stores_;                       // of each frame
  std::vector<std::vector<Around>> around_;         // of each frame, itself first
  std::vector<std::vector<float>> current_, next_;  // colours of every sample, of each frame
  static constexpr size_t kDraws = 1 << 16;
  std::array<std::vector<ivec2>, kPasses> draws_;
};

void run(const RandomParameter& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const std::vector<const FilterFrame*> frames = in_order(frame);
  const auto own = static_cast<size_t>(std::find(frames.begin(), frames.end(), &frame) - frames.begin());
  Filter filter(p, frames, own, out.repaired, task);
  filter.run(task);
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x) {
      const vec3 c = filter.pixel(x, y);
      for (int k = 0; k < 3; ++k) (*out[static_cast<size_t>(k)])(x, y) = c[k];
    }
}

const FilterEntry entry =
    declare<RandomParameter>(
        "random_parameter",
        "Random parameter filtering: filters samples, and ignores what mutual information blames on the random parameters.")
        .merit(0.9, "to compare with, on frames with `--records`")
        .source(
            "Sen and Darabi 2012, On filtering the noise from the random parameters in Monte Carlo rendering; and its technical report")
        .notes(
            "For media the random parameters are flights (as the share of light they outlive), directions, the sampled light and its point, lens and time; features are positions, density gradients, albedo, density, the shadow ray's transmittance and the surface normal. `paper`: alpha = 1 - W; `techreport`: 1 - (1 + 0.1 t) W, the report's further factor of 2 being held for a slip by both who re-implemented it. `information=corrected` takes off what independent parameters have by chance and compares means, not sums, because a dozen parameters would outvote two positions by their bias alone. Pixels with more than 16 samples average them in groups first. Cost grows with the square of the samples. Blocks reach into the frames before and after, where they lie around the pixel whose features are most alike within 7 x 7 (section 6.4), and are smaller in return; all frames given are filtered pass by pass.")
        .needs_records()
        .seeded()
        .sequences()
        .paper("formulas=paper,information=literal")
        .preset("techreport", "as in its technical report", "information=literal")
        .param("formulas", &RandomParameter::formulas, {"paper", "techreport"}, "whose formulas",
               {"paper", "techreport"})
        .param("variance", &RandomParameter::variance, {1e-6, 100}, "1",
               "sigma_8^2, at eight samples per pixel; 0.02 for noisy scenes, 0.002 otherwise", {0.002, 0.02, 0.2})
        .param("largest-neighborhood", &RandomParameter::largest_neighborhood, {50, 100000}, "samples",
               "cap on the published b^2 s / 2")
        .param("information-samples", &RandomParameter::information_samples, {64, 4096}, "samples",
               "of a neighbourhood, from which dependence is measured")
        .param("information", &RandomParameter::information, {"literal", "corrected"},
               "mutual information as published, or with its bias taken off", {"literal", "corrected"})
        .param("keep-energy", &RandomParameter::keep_energy, {0, 1}, "",
               "1: the light that the spike rule takes is given back to the pixel")
        .scratch(400)
        .apron([](const RandomParameter&) { return 27 + 17 + 8 + 3 + 4 * 3; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume

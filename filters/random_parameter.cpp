#include <algorithm>
#include <array>
#include <cmath>

#include "base/rng.h"
#include "filters/kernels/sample_filter.h"
#include "filters/mutual_information.h"
#include "filters/planes.h"
#include "filters/registry.h"
#include "filters/samples.h"

namespace brume {
namespace {

enum class Preset { kPaper, kTechReport, kRelease };
enum class Information { kLiteral, kCorrected };

struct RandomParameter {
  Preset preset = Preset::kTechReport;
  float variance = 0.02f;
  int largest_neighborhood = 2000, information_samples = 512;
  Information information = Information::kLiteral;
  int keep_energy = 1;
};

// The released program cuts samples off here, white being 1.
constexpr float kReleaseLimit = 10;
constexpr int kPasses = 4;
constexpr std::array<int, kPasses> kBlocks = {55, 35, 17, 7}, kReleaseBlocks = {45, 30, 15, 5};
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

/// The samples of a tile and its apron, one record after another: colour, features, random parameters, film position.
class Store {
 public:
  Store(const FilterFrame& frame) : width_(frame.width()), height_(frame.height()) {
    RecordReader& reader = *frame.records;
    const RecordLayout& layout = reader.layout();
    const std::vector<size_t> parts = signal_offsets(layout, frame.name);
    std::vector<Column> wanted;
    const auto add = [&](Kind kind, std::string_view name, int components) {
      const size_t at = field_offset(layout, name);
      for (int c = 0; c < components; ++c)
        wanted.push_back({kind, at + static_cast<size_t>(c), name.starts_with("position")});
    };
    for (const auto& [name, components] : kFeatures) add(Kind::kFeature, name, components);
    for (const auto& [name, components] : kParameters) add(Kind::kParameter, name, components);
    add(Kind::kPosition, "film", 2);
    choose_columns(reader, wanted);

    const size_t count = static_cast<size_t>(layout.samples), width = static_cast<size_t>(layout.components());
    group_ = (layout.samples + kMostSamples - 1) / kMostSamples;
    samples_ = (layout.samples + group_ - 1) / group_;
    stride_ = (3 + columns_.size() + 7) / 8 * 8;
    data_.assign(static_cast<size_t>(width_) * static_cast<size_t>(height_) * static_cast<size_t>(samples_) * stride_,
                 0.0f);
    const size_t group = static_cast<size_t>(group_);
    visit_records(frame, [&](int x, int y, std::span<const float> records) {
      for (size_t s = 0; s < count; ++s) {
        const float* record = records.data() + s * width;
        const size_t g = s / group;
        const float share = 1.0f / static_cast<float>(std::min(count - g * group, group));
        float* to = sample(x, y, static_cast<int>(g));
        for (const size_t part : parts)
          for (size_t c = 0; c < 3; ++c) {
            const float v = record[part + c];
            to[c] += share * (std::isfinite(v) ? v : 0.0f);
          }
        for (size_t k = 0; k < columns_.size(); ++k) {
          const float v = scale_[k].x * (record[columns_[k].offset] - scale_[k].y);
          to[3 + k] += share * (std::isfinite(v) ? v : 0.0f);
        }
      }
    });
  }

  int samples() const { return samples_; }
  int group() const { return group_; }
  size_t stride() const { return stride_; }
  const std::vector<Column>& columns() const { return columns_; }
  float* sample(int x, int y, int s) {
    return data_.data() + ((static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x)) *
                               static_cast<size_t>(samples_) +
                           static_cast<size_t>(s)) *
                              stride_;
  }
  const float* sample(int x, int y, int s) const { return const_cast<Store*>(this)->sample(x, y, s); }
  size_t count() const { return data_.size() / stride_; }

 private:
  /// Drops columns that never change, and maps features to [0, 1] between their 1st and 99th percentile, judged by some
  /// tiles spread over the whole frame.
  void choose_columns(RecordReader& reader, const std::vector<Column>& wanted) {
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
      if (!(high > low)) low = v.front(), high = v.back();
      columns_.push_back(wanted[k]);
      scale_.push_back(wanted[k].kind == Kind::kFeature ? vec2(1 / (high - low), low) : vec2(1, 0));
    }
  }

  int width_, height_, samples_ = 0, group_ = 1;
  size_t stride_ = 0;
  std::vector<Column> columns_;
  std::vector<vec2> scale_;  // factor and offset of each column
  std::vector<float> data_;
};

/// How much of each colour and feature the distance sees: Sen and Darabi's alpha and beta, and W_c^r.
struct Importance {
  std::array<double, 3> alpha;
  std::vector<double> beta;
  double color_noise = 0;  // share of the colour that random parameters explain
};

class Filter {
 public:
  Filter(const RandomParameter& p, const FilterFrame& frame, Store& store)
      : p_(p), frame_(frame), store_(store), current_(store.count() * 3), next_(current_.size()) {
    for (size_t i = 0; i < store_.columns().size(); ++i) {
      const size_t at = 3 + i;
      switch (store_.columns()[i].kind) {
        case Kind::kFeature:
          features_.push_back(at);
          break;
        case Kind::kParameter:
          parameters_.push_back(at);
          break;
        default:
          positions_.push_back(at);
      }
    }
    for (int pass = 0; pass < kPasses; ++pass) draw_places(pass);
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x)
        for (int s = 0; s < store_.samples(); ++s)
          for (int c = 0; c < 3; ++c)
            current_[index(x, y, s) * 3 + static_cast<size_t>(c)] =
                p_.preset == Preset::kRelease
                    ? std::min(store_.sample(x, y, s)[c], kReleaseLimit / static_cast<float>(frame.exposure))
                    : store_.sample(x, y, s)[c];
  }

  void run(const Task& task) {
    for (int pass = 0; pass < kPasses; ++pass) {
      for_each_row(frame_.height(), share(task, 0.25 * pass, 0.25 * (pass + 1)), [&](int y) {
        for (int x = 0; x < frame_.width(); ++x) filter_pixel(x, y, pass);
      });
      std::swap(current_, next_);
    }
  }

  vec3 pixel(int x, int y) const {
    dvec3 sum(0);
    for (int s = 0; s < store_.samples(); ++s) sum += dvec3(color(x, y, s));
    return vec3(sum / static_cast<double>(store_.samples()));
  }

 private:
  size_t index(int x, int y, int s) const {
    return (static_cast<size_t>(y) * static_cast<size_t>(frame_.width()) + static_cast<size_t>(x)) *
               static_cast<size_t>(store_.samples()) +
           static_cast<size_t>(s);
  }
  vec3 color(int x, int y, int s) const {
    const float* c = current_.data() + index(x, y, s) * 3;
    return {c[0], c[1], c[2]};
  }

  /// Places of neighbours, from a Gaussian of a quarter of the block, inside the block and not the pixel itself: one
  /// list for all pixels, in which each draws by its own numbers.
  void draw_places(int pass) {
    const int block = (p_.preset == Preset::kRelease ? kReleaseBlocks : kBlocks)[static_cast<size_t>(pass)];
    Rng rng(static_cast<uint64_t>(pass));
    while (draws_[static_cast<size_t>(pass)].size() < kDraws) {
      const double radius = block / 4.0 * std::sqrt(2 * rng.exponential());
      const auto angle = portable_sincos_2pi(rng.uniform());
      const ivec2 d(std::lrint(radius * angle.cos), std::lrint(radius * angle.sin));
      if (std::abs(d.x) <= block / 2 && std::abs(d.y) <= block / 2 && d != ivec2(0))
        draws_[static_cast<size_t>(pass)].push_back(d);
    }
  }

  /// Mean and deviation of the features over the pixel's own samples; of a pixel with one, over its 3 x 3.
  void own_statistics(int x, int y, std::vector<float>& mean, std::vector<float>& deviation) const {
    const int reach = store_.samples() > 1 ? 0 : 1;
    mean.assign(features_.size(), 0.0f);
    deviation.assign(features_.size(), 0.0f);
    std::vector<const float*> rows;
    for (int qy = std::max(0, y - reach); qy <= std::min(frame_.height() - 1, y + reach); ++qy)
      for (int qx = std::max(0, x - reach); qx <= std::min(frame_.width() - 1, x + reach); ++qx)
        for (int s = 0; s < store_.samples(); ++s) rows.push_back(store_.sample(qx, qy, s));
    for (size_t k = 0; k < features_.size(); ++k) {
      double sum = 0, squares = 0;
      for (const float* row : rows) sum += row[features_[k]];
      const double m = sum / static_cast<double>(rows.size());
      for (const float* row : rows) squares += (row[features_[k]] - m) * (row[features_[k]] - m);
      mean[k] = static_cast<float>(m);
      deviation[k] = static_cast<float>(std::sqrt(squares / static_cast<double>(std::max<size_t>(rows.size() - 1, 1))));
    }
  }

  /// The pixel's samples, then samples of its surroundings drawn from a Gaussian of a quarter of the block, as far as
  /// their features lie within three deviations of the pixel's own.
  void gather(int x, int y, int pass, std::vector<const float*>& rows, std::vector<const float*>& colors,
              std::vector<uint32_t>& drawn) const {
    const bool release = p_.preset == Preset::kRelease;
    const int block = (release ? kReleaseBlocks : kBlocks)[static_cast<size_t>(pass)], s = store_.samples();
    const int share = release && pass < 2 ? 3 : 2;
    const int most = std::min(block * block * s / share, p_.largest_neighborhood);
    std::vector<float> mean, deviation;
    own_statistics(x, y, mean, deviation);
    rows.clear(), colors.clear();
    const auto take = [&](int qx, int qy, int k) {
      rows.push_back(store_.sample(qx, qy, k));
      colors.push_back(current_.data() + index(qx, qy, k) * 3);
    };
    for (int k = 0; k < s; ++k) take(x, y, k);
    const int gx = x + frame_.origin.x, gy = y + frame_.origin.y;
    std::vector<float> low(features_.size()), high(features_.size());
    for (size_t k = 0; k < features_.size(); ++k) {
      const float times = store_.columns()[features_[k] - 3].is_place ? kPositionDeviations : kClusterDeviations;
      // Where both the deviation and the difference are small, the difference is forgiven.
      const float width = std::max(times * deviation[k], deviation[k] < kClusterFloor ? kClusterFloor : 0.0f);
      low[k] = mean[k] - width, high[k] = mean[k] + width;
    }
    // Places first, so that the records are on their way before they are looked at.
    const std::vector<ivec2>& draws = draws_[static_cast<size_t>(pass)];
    uint64_t state = hash_combine(hash_combine(mix64(static_cast<uint64_t>(pass)), static_cast<uint64_t>(gy)),
                                  static_cast<uint64_t>(gx));
    drawn.clear();
    for (int i = s; i < most; ++i) {
      state = state * 6364136223846793005ull + 1442695040888963407ull;
      const ivec2 d = draws[(state >> 33) % kDraws];
      const int qx = x + d.x, qy = y + d.y;
      if (qx < 0 || qy < 0 || qx >= frame_.width() || qy >= frame_.height()) continue;
      const int k = static_cast<int>(((state >> 20) & 0xfff) * static_cast<uint64_t>(s) >> 12);
      drawn.push_back(static_cast<uint32_t>(index(qx, qy, k)));
    }
    const float* const data = store_.sample(0, 0, 0);
    const size_t stride = store_.stride();
    constexpr size_t kAhead = 12;
    for (size_t i = 0; i < drawn.size(); ++i) {
      if (i + kAhead < drawn.size()) {
        const char* next = reinterpret_cast<const char*>(data + drawn[i + kAhead] * stride);
        for (size_t line = 0; line < stride * sizeof(float); line += 64) __builtin_prefetch(next + line);
      }
      const float* row = data + drawn[i] * stride;
      int outside = 0;
      for (size_t f = 0; f < features_.size(); ++f) {
        const float v = row[3 + f];  // features follow the colour
        outside |= static_cast<int>(v < low[f]) | static_cast<int>(v > high[f]);
      }
      if (outside) continue;
      rows.push_back(row);
      colors.push_back(current_.data() + drawn[i] * 3);
    }
  }

  Importance importance(const std::vector<const float*>& rows, const std::vector<float>& mean,
                        const std::vector<float>& inverse, int pass) const {
    const bool corrected = p_.information == Information::kCorrected;
    const size_t n = std::min(rows.size(), static_cast<size_t>(p_.information_samples));
    MutualInformation mi(n);
    std::vector<float> column(n);
    const auto add = [&](size_t at) {
      for (size_t i = 0; i < n; ++i) column[i] = (rows[i][at] - mean[at]) * inverse[at];
      return mi.add(column);
    };
    std::vector<size_t> c, f, r, q;
    for (size_t k = 0; k < 3; ++k) c.push_back(add(k));
    for (const size_t at : features_) f.push_back(add(at));
    for (const size_t at : parameters_) r.push_back(add(at));
    for (const size_t at : positions_) q.push_back(add(at));
    // Sums over the columns of a kind; corrected ones are means, so that many parameters do not outvote two positions.
    const auto depends = [&](size_t a, const std::vector<size_t>& on) {
      double sum = 0;
      for (const size_t b : on) sum += mi(a, b, corrected);
      return corrected && !on.empty() ? sum / static_cast<double>(on.size()) : sum;
    };
    constexpr double kEps = 1e-10;
    const bool release = p_.preset == Preset::kRelease;
    const double growth = p_.preset == Preset::kPaper ? 1 : release ? 1 + 0.3 + 0.05 * pass : 1 + 0.1 * pass;
    Importance out;
    double color_r = 0, color_p = 0;
    for (size_t k = 0; k < 3; ++k) {
      const double dr = depends(c[k], r), dp = depends(c[k], q);
      color_r += dr, color_p += dp;
      out.alpha[k] = std::max(0.0, 1 - (release ? 4 : 1) * growth * dr / (dr + dp + kEps));
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

  void filter_pixel(int x, int y, int pass) {
    const int s = store_.samples();
    thread_local std::vector<const float*> rows, colors;
    thread_local std::vector<uint32_t> drawn;
    gather(x, y, pass, rows, colors, drawn);
    if (rows.size() < kFewest) {
      for (int k = 0; k < s; ++k) store(x, y, k, color(x, y, k));
      return;
    }
    const size_t columns = 3 + store_.columns().size();
    std::vector<float> mean(columns), inverse(columns);
    std::vector<double> sum(columns, 0.0), squares(columns, 0.0);
    const float* const first = rows[0];
    for (const float* row : rows)
      for (size_t k = 0; k < columns; ++k) {
        const double d = static_cast<double>(row[k]) - first[k];
        sum[k] += d, squares[k] += d * d;
      }
    const double n = static_cast<double>(rows.size());
    for (size_t k = 0; k < columns; ++k) {
      mean[k] = static_cast<float>(first[k] + sum[k] / n);
      const double deviation = std::sqrt(std::max(0.0, squares[k] / n - sum[k] * sum[k] / (n * n)));
      inverse[k] = deviation > 1e-8 ? static_cast<float>(1 / deviation) : 0.0f;
    }
    const Importance w = importance(rows, mean, inverse, pass);
    // w_ij = exp(-(1 - W_c^r)^2 / (2 sigma^2) [sum alpha dc^2 + sum beta df^2]), sigma^2 = 8 sigma_8^2 / s. Samples
    // that were averaged in groups count as one of their group's size.
    const double sigma2 = 8.0 * static_cast<double>(p_.variance) / (s * store_.group());
    const double factor = (1 - w.color_noise) * (1 - w.color_noise) / (2 * sigma2);
    std::vector<kernels::ScaledComponent> components;
    const auto use = [&](size_t at, double share) {
      const float scale = static_cast<float>(std::sqrt(factor * share)) * inverse[at];
      if (scale > 0) components.push_back({static_cast<int>(at), scale});
    };
    for (size_t k = 0; k < 3; ++k) use(k, w.alpha[k]);
    for (size_t k = 0; k < features_.size(); ++k) use(features_[k], w.beta[k]);
    float sums[4][16];
    kernels::filter_samples({rows.data(), static_cast<size_t>(s)}, rows, colors, components, sums);
    std::array<vec3, kMostSamples> result;
    for (int k = 0; k < s; ++k) result[static_cast<size_t>(k)] = vec3(sums[1][k], sums[2][k], sums[3][k]) / sums[0][k];
    limit_spikes({result.data(), static_cast<size_t>(s)});
    for (int k = 0; k < s; ++k) store(x, y, k, result[static_cast<size_t>(k)]);
  }

  /// Samples more than a deviation from the pixel's mean become the mean; what light that takes is given back to all.
  void limit_spikes(std::span<vec3> colors) const {
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
    if (p_.keep_energy)
      for (vec3& c : colors) c += vec3(mean - after);
  }

  void store(int x, int y, int s, const vec3& c) {
    float* to = next_.data() + index(x, y, s) * 3;
    to[0] = c.x, to[1] = c.y, to[2] = c.z;
  }

  const RandomParameter& p_;
  const FilterFrame& frame_;
  const Store& store_;
  std::vector<size_t> features_, parameters_, positions_;  // columns of each kind
  std::vector<float> current_, next_;                      // colours of every sample
  static constexpr size_t kDraws = 1 << 16;
  std::array<std::vector<ivec2>, kPasses> draws_;
};

void run(const RandomParameter& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  Store store(frame);
  Filter filter(p, frame, store);
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
        "Random parameter filtering: filters samples, and ignores what mutual information blames on "
        "the random parameters.")
        .source(
            "Sen and Darabi 2012, On filtering the noise from the random parameters in Monte Carlo rendering; presets "
            "of its technical report and of the authors' later program")
        .notes(
            "For media the random parameters are flights (as the share of light they outlive), directions, the sampled "
            "light and its point, lens and time; features are positions, density gradients, albedo, density, the "
            "shadow "
            "ray's transmittance and the surface normal. `paper`: alpha = 1 - W; `techreport`: 1 - (1 + 0.1 t) W, the "
            "report's further factor of 2 being held for a slip by both who re-implemented it; `release`: 1 - 4 (1.3 + "
            "0.05 t) W, smaller blocks. `information=corrected` takes off what independent parameters have by chance "
            "and "
            "compares means, not sums, because a dozen parameters would outvote two positions by their bias alone. "
            "Pixels with more than 16 samples average them in groups first. Cost grows with the square of the samples.")
        .needs_records()
        .seeded()
        .param("preset", &RandomParameter::preset, {"paper", "techreport", "release"}, "whose formulas and blocks",
               {"paper", "techreport", "release"})
        .param("variance", &RandomParameter::variance, {1e-6, 100}, "1",
               "sigma_8^2, at eight samples per pixel; 0.02 for noisy scenes, 0.002 otherwise", {0.002, 0.02, 0.2})
        .param("largest-neighborhood", &RandomParameter::largest_neighborhood, {50, 100000}, "samples",
               "cap on the published b^2 s / 2")
        .param("information-samples", &RandomParameter::information_samples, {64, 4096}, "samples",
               "of a neighbourhood, from which dependence is measured")
        .param("information", &RandomParameter::information, {"literal", "corrected"},
               "mutual information as published, or with its bias taken off")
        .param("keep-energy", &RandomParameter::keep_energy, {0, 1}, "",
               "1: the light that the spike rule takes is given back to the pixel")
        .scratch(400)
        .apron([](const RandomParameter&) { return 27 + 17 + 8 + 3; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume

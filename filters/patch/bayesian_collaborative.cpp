#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/parallel_for.h"
#include "filters/api/registry.h"
#include "filters/inputs/samples.h"
#include "filters/kernels/histogram.h"
#include "filters/patch/neighbourhood.h"

namespace brume {
namespace {

enum class Estimate { kBayes, kMean };

struct BayesianCollaborative {
  int search_radius = 6, scales = 3;
  float threshold = 1;
  int bins = 20;
  Estimate estimate = Estimate::kBayes;
  int spikes = 0;
};

constexpr int kPatchRadius = 1, kPatchPixels = 9, kDimensions = 27;
// Values beyond the histograms' range, and their gamma (the authors' accumulator).
constexpr double kGamma = 2.2, kMaximum = 2.5;
// Fewer patches than dimensions say nothing about a covariance.
constexpr size_t kFewest = kDimensions + 1;
constexpr float kSpikeDeviations = 2;
// Beside a pixel this many times brighter than white and than the picture, single precision has no digits left for the
// others of its group.
constexpr double kRange = 1e4;

/// Histograms of every pixel, a row's bins after one another: what the distance reads.
class Histograms {
 public:
  Histograms() = default;
  Histograms(int width, int height, size_t bins)
      : bins_(bins), stride_(static_cast<size_t>(width)), data_(bins * stride_ * static_cast<size_t>(height)) {}
  size_t bins() const { return bins_; }
  size_t stride() const { return stride_; }
  const float* row(int y) const { return data_.data() + bins_ * stride_ * static_cast<size_t>(y); }
  float& at(size_t bin, int x, int y) {
    return data_[(bins_ * static_cast<size_t>(y) + bin) * stride_ + static_cast<size_t>(x)];
  }
  float at(size_t bin, int x, int y) const {
    return data_[(bins_ * static_cast<size_t>(y) + bin) * stride_ + static_cast<size_t>(x)];
  }

 private:
  size_t bins_ = 0, stride_ = 0;
  std::vector<float> data_;
};

/// What is known of each pixel of one scale.
struct Scale {
  Rgb color;
  Histograms histogram;             // bins x 3
  std::array<Plane, 6> covariance;  // of the pixel mean: rr, gg, bb, gb, rb, rg
  Plane samples;
  int width() const { return color[0].width(); }
  int height() const { return color[0].height(); }
};

/// Adds a value to its two nearest bins. The last two bins hold what lies between once and twice the range, saturated.
void add_to_histogram(Histograms& histogram, int bins, size_t channel, int x, int y, double value) {
  const double v = std::pow(std::max(value, 0.0), 1 / kGamma) / kMaximum;
  const size_t first = channel * static_cast<size_t>(bins);
  double position = v < 1 ? v * (bins - 2) : (bins - 2) + std::min(v - 1, 1.0);
  position = std::min(position, bins - 1.0);
  const int low = std::min(static_cast<int>(position), bins - 2);
  const float high_share = static_cast<float>(position - low);
  histogram.at(first + static_cast<size_t>(low), x, y) += 1 - high_share;
  histogram.at(first + static_cast<size_t>(low) + 1, x, y) += high_share;
}

Scale gather(const BayesianCollaborative& p, const FilterFrame& frame, RepairedPixels* repaired) {
  Scale s;
  const int width = frame.width(), height = frame.height();
  for (size_t c = 0; c < 3; ++c) s.color[c] = *frame.signal[c];
  s.histogram = Histograms(width, height, 3 * static_cast<size_t>(p.bins));
  for (Plane& plane : s.covariance) plane = Plane(width, height);
  s.samples = Plane(width, height);
  visit_samples(frame, repaired, [&](int x, int y, std::span<const vec3> samples) {
    const double n = static_cast<double>(samples.size());
    dvec3 mean(0), squares(0), products(0);
    for (const vec3& v : samples) {
      mean += dvec3(v) / n;
      for (int c = 0; c < 3; ++c)
        add_to_histogram(s.histogram, p.bins, static_cast<size_t>(c), x, y, frame.exposure * v[c]);
    }
    for (const vec3& v : samples) {
      const dvec3 d = dvec3(v) - mean;
      squares += d * d;
      products += dvec3(d.y * d.z, d.x * d.z, d.x * d.y);
    }
    // One sample has no spread of its own; the prepared variance stands in for it.
    const double scale = n > 1 ? 1 / (n * (n - 1)) : 0;
    for (size_t c = 0; c < 3; ++c) {
      const int i = static_cast<int>(c);
      s.covariance[c](x, y) = n > 1 ? static_cast<float>(squares[i] * scale) : (*frame.variance[c])(x, y);
      s.covariance[c + 3](x, y) = static_cast<float>(products[i] * scale);
    }
    s.samples(x, y) = static_cast<float>(n);
  });
  return s;
}

/// Takes over all that is known of a pixel.
void copy_pixel(const Scale& in, ivec2 from, Scale& out, ivec2 to) {
  for (size_t c = 0; c < 3; ++c) out.color[c](to.x, to.y) = in.color[c](from.x, from.y);
  for (size_t b = 0; b < in.histogram.bins(); ++b) out.histogram.at(b, to.x, to.y) = in.histogram.at(b, from.x, from.y);
  for (size_t k = 0; k < 6; ++k) out.covariance[k](to.x, to.y) = in.covariance[k](from.x, from.y);
  out.samples(to.x, to.y) = in.samples(from.x, from.y);
}

/// Pixels more than two deviations from the mean of their 3 x 3 in any channel become the one among them nearest to the
/// median colour, with all that is known of it.
void replace_spikes(Scale& s, const Task& task) {
  const Scale in = s;
  const int width = s.width(), height = s.height();
  for_each_row(height, quiet(task), [&](int y) {
    for (int x = 0; x < width; ++x) {
      std::array<dvec3, 9> colors;
      std::array<ivec2, 9> places;
      size_t n = 0;
      for (int qy = std::max(0, y - 1); qy <= std::min(height - 1, y + 1); ++qy)
        for (int qx = std::max(0, x - 1); qx <= std::min(width - 1, x + 1); ++qx, ++n) {
          colors[n] = dvec3(in.color[0](qx, qy), in.color[1](qx, qy), in.color[2](qx, qy));
          places[n] = {qx, qy};
        }
      if (n < 4) continue;
      dvec3 mean(0), squares(0);
      for (size_t i = 0; i < n; ++i) mean += colors[i] / static_cast<double>(n);
      for (size_t i = 0; i < n; ++i) squares += (colors[i] - mean) * (colors[i] - mean) / static_cast<double>(n - 1);
      const dvec3 own(in.color[0](x, y), in.color[1](x, y), in.color[2](x, y));
      bool spike = false;
      for (int c = 0; c < 3; ++c)
        spike |= std::abs(own[c] - mean[c]) > static_cast<double>(kSpikeDeviations) * std::sqrt(squares[c]);
      if (!spike) continue;
      size_t best = 0;
      double least = std::numeric_limits<double>::infinity();
      for (size_t i = 0; i < n; ++i) {
        double sum = 0;
        for (size_t k = 0; k < n; ++k) sum += glm::distance(colors[i], colors[k]);
        if (sum < least) {
          least = sum;
          best = i;
        }
      }
      copy_pixel(in, places[best], s, {x, y});
    }
  });
}

/// Pixels further than `limit` from black in any channel take what is known of an in-range pixel beside them, so that
/// their neighbours can be filtered; one without such a pixel is cut off at the limit.
/// @return  those pixels
std::vector<ivec2> replace_out_of_range(Scale& s, float limit) {
  const auto within = [&](int x, int y) {
    return std::all_of(s.color.begin(), s.color.end(), [&](const Plane& c) { return std::abs(c(x, y)) <= limit; });
  };
  std::vector<ivec2> found;
  for (int y = 0; y < s.height(); ++y)
    for (int x = 0; x < s.width(); ++x)
      if (!within(x, y)) found.push_back({x, y});
  std::vector<std::pair<ivec2, ivec2>> sources;
  for (const ivec2& p : found)
    for (int qy = std::max(0, p.y - 1); qy <= std::min(s.height() - 1, p.y + 1); ++qy)
      for (int qx = std::max(0, p.x - 1); qx <= std::min(s.width() - 1, p.x + 1); ++qx)
        if (within(qx, qy) && (sources.empty() || sources.back().first != p)) sources.push_back({p, {qx, qy}});
  for (const ivec2& p : found) {
    for (Plane& c : s.color) c(p.x, p.y) = std::clamp(c(p.x, p.y), -limit, limit);
    for (Plane& c : s.covariance) c(p.x, p.y) = 0;
  }
  for (const auto& [to, from] : sources) copy_pixel(s, from, s, to);
  return found;
}

/// Bilinear, pixel centres of the coarse grid lying between four fine ones.
Plane doubled(const Plane& in, int width, int height, const Task& task) {
  return make_plane(width, height, quiet(task), [&](int x, int y) {
    const float fx = 0.5f * static_cast<float>(x) - 0.25f, fy = 0.5f * static_cast<float>(y) - 0.25f;
    const int x0 = static_cast<int>(std::floor(fx)), y0 = static_cast<int>(std::floor(fy));
    const float u = fx - static_cast<float>(x0), v = fy - static_cast<float>(y0);
    const auto at = [&](int i, int j) {
      return in(std::clamp(i, 0, in.width() - 1), std::clamp(j, 0, in.height() - 1));
    };
    return (1 - v) * ((1 - u) * at(x0, y0) + u * at(x0 + 1, y0)) +
           v * ((1 - u) * at(x0, y0 + 1) + u * at(x0 + 1, y0 + 1));
  });
}

Scale coarser(const Scale& s, const Task& task) {
  Scale out;
  for (size_t c = 0; c < 3; ++c) out.color[c] = halved(s.color[c], 0.25f, task);
  const int width = out.color[0].width(), height = out.color[0].height();
  out.histogram = Histograms(width, height, s.histogram.bins());
  for_each_row(height, quiet(task), [&](int y) {
    const int y0 = 2 * y, y1 = std::min(2 * y + 1, s.height() - 1);
    for (size_t b = 0; b < s.histogram.bins(); ++b)
      for (int x = 0; x < width; ++x) {
        const int x0 = 2 * x, x1 = std::min(2 * x + 1, s.width() - 1);
        out.histogram.at(b, x, y) = s.histogram.at(b, x0, y0) + s.histogram.at(b, x1, y0) + s.histogram.at(b, x0, y1) +
                                    s.histogram.at(b, x1, y1);
      }
  });
  for (size_t k = 0; k < 6; ++k) out.covariance[k] = halved(s.covariance[k], 1 / 16.f, task);
  out.samples = halved(s.samples, 1, task);
  return out;
}

using Matrix = Eigen::Matrix<float, kDimensions, kDimensions>;
using Patches = Eigen::Matrix<float, kDimensions, Eigen::Dynamic>;
using Patch = Eigen::Matrix<float, kDimensions, 1>;

Matrix covariance_of(const Patches& patches, const Patch& mean) {
  const Patches centred = patches.colwise() - mean;
  return (centred * centred.transpose()) / static_cast<float>(patches.cols() - 1);
}

/// x - S_n S^-1 (x - mean) of every patch, where S is `signal` without negative eigenvalues, plus the noise.
Patches shrunk(const Patches& patches, const Patch& mean, const Matrix& signal, const Matrix& noise) {
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(signal);
  const Matrix clean =
      eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0f).asDiagonal() * eigen.eigenvectors().transpose();
  Matrix sum = clean + noise;
  sum.diagonal().array() += 1e-6f * std::max(sum.trace() / kDimensions, 1e-20f);
  // One matrix for all patches: S_n S^-1 = (S^-1 S_n)^T, both being symmetric.
  const Matrix shrink = sum.ldlt().solve(noise).transpose();
  return patches - shrink * (patches.colwise() - mean);
}

/// Denoises one scale: every pixel's patch together with the patches whose histograms are like its own.
class Collaboration {
 public:
  Collaboration(const BayesianCollaborative& p, const Scale& scale) : p_(p), s_(scale) {
    for (Plane& plane : sums_) plane = Plane(s_.width(), s_.height());
    weight_ = Plane(s_.width(), s_.height());
    done_ = Plane(s_.width(), s_.height());
  }

  Rgb run(const Task& task) {
    const int width = s_.width(), height = s_.height();
    if (width < 3 || height < 3) return s_.color;  // not one patch
    // Blocks of one colour of a 2 x 2 pattern do not reach one another's pixels; the colours follow one another.
    const int side = std::max(46, 4 * (p_.search_radius + kPatchRadius));  // 48 with the patches' apron
    const int across = (width + side - 1) / side, down = (height + side - 1) / side;
    for (int colour = 0; colour < 4; ++colour) {
      std::vector<Box> blocks;
      for (int by = colour / 2; by < down; by += 2)
        for (int bx = colour % 2; bx < across; bx += 2)
          blocks.push_back({bx * side, by * side, std::min(width, (bx + 1) * side), std::min(height, (by + 1) * side)});
      parallel_for(static_cast<int>(blocks.size()), share(task, 0.25 * colour, 0.25 * (colour + 1)),
                   [&](int i) { run_block(blocks[static_cast<size_t>(i)]); });
    }
    Rgb out;
    for (size_t c = 0; c < 3; ++c)
      out[c] = make_plane(width, height, quiet(task), [&](int x, int y) {
        return weight_(x, y) > 0 ? sums_[c](x, y) / weight_(x, y) : s_.color[c](x, y);
      });
    return out;
  }

 private:
  /// Whether the patches around a block's pixels and around their neighbours have alike histograms: a byte for every
  /// offset and pixel, pixels in a row.
  void find_alike(const Box& block, std::vector<uint8_t>& alike) const {
    const int r = p_.search_radius, side = 2 * r + 1, width = s_.width(), height = s_.height();
    const Box outer = block.grown(kPatchRadius, width, height);
    // Distances and bins of single pixels, with a rim of zeros where the patch reaches outside the image.
    const size_t line = static_cast<size_t>(block.width() + 2), plane = line * static_cast<size_t>(block.height() + 2);
    const size_t n = static_cast<size_t>(block.width());
    const auto at = [&](int x, int y) {
      return static_cast<size_t>(y - block.y0 + 1) * line + static_cast<size_t>(x - block.x0 + 1);
    };
    alike.resize(static_cast<size_t>(side * side) * n * static_cast<size_t>(block.height()));
    std::vector<float> sums, counts, total(line), used(line);
    for (int dy = -r; dy <= r; ++dy) {
      sums.assign(plane * static_cast<size_t>(side), 0.0f);
      counts.assign(plane * static_cast<size_t>(side), 0.0f);
      for (int y = outer.y0; y < outer.y1; ++y) {
        if (y + dy < 0 || y + dy >= height) continue;
        const float *first = s_.histogram.row(y), *second = s_.histogram.row(y + dy);
        for (int dx = -r; dx <= r; ++dx) {
          const int x0 = std::max(outer.x0, -dx), x1 = std::min(outer.x1, width - dx);
          if (x0 >= x1) continue;
          const size_t place = plane * static_cast<size_t>(dx + r) + at(x0, y);
          kernels::histogram_distance_row(first + x0, second + x0 + dx, s_.samples.row(y) + x0,
                                          s_.samples.row(y + dy) + x0 + dx, static_cast<int>(s_.histogram.bins()),
                                          s_.histogram.stride(), x1 - x0, sums.data() + place, counts.data() + place);
        }
      }
      for (int dx = -r; dx <= r; ++dx)
        for (int y = block.y0; y < block.y1; ++y) {
          const float* s = sums.data() + plane * static_cast<size_t>(dx + r) + at(block.x0 - 1, y);
          const float* c = counts.data() + plane * static_cast<size_t>(dx + r) + at(block.x0 - 1, y);
          for (size_t x = 0; x < line; ++x) {
            total[x] = (s - line)[x] + s[x] + s[x + line];
            used[x] = (c - line)[x] + c[x] + c[x + line];
          }
          uint8_t* to =
              alike.data() + (static_cast<size_t>((dy + r) * side + dx + r) * static_cast<size_t>(block.height()) +
                              static_cast<size_t>(y - block.y0)) *
                                 n;
          for (size_t x = 0; x < n; ++x) {
            const float bins = used[x] + used[x + 1] + used[x + 2];
            to[x] = bins > 0 && total[x] + total[x + 1] + total[x + 2] <= p_.threshold * bins;
          }
        }
    }
  }

  bool is_centre(int x, int y) const {
    return x >= kPatchRadius && y >= kPatchRadius && x < s_.width() - kPatchRadius && y < s_.height() - kPatchRadius;
  }

  void run_block(const Box& block) {
    const int r = p_.search_radius, side = 2 * r + 1;
    std::vector<uint8_t> alike;
    find_alike(block, alike);
    const size_t pixels = static_cast<size_t>(block.width()) * static_cast<size_t>(block.height());
    std::vector<ivec2> similar;
    for (int y = block.y0; y < block.y1; ++y)
      for (int x = block.x0; x < block.x1; ++x) {
        if (!is_centre(x, y) || done_(x, y) > 0) continue;
        const uint8_t* own = alike.data() + static_cast<size_t>(y - block.y0) * static_cast<size_t>(block.width()) +
                             static_cast<size_t>(x - block.x0);
        similar.clear();
        for (int dy = -r; dy <= r; ++dy)
          for (int dx = -r; dx <= r; ++dx)
            if (is_centre(x + dx, y + dy) &&
                ((dx == 0 && dy == 0) || own[static_cast<size_t>((dy + r) * side + dx + r) * pixels]))
              similar.push_back({x + dx, y + dy});
        estimate({x, y}, similar);
      }
  }

  void estimate(ivec2 centre, const std::vector<ivec2>& similar) {
    const Eigen::Index n = static_cast<Eigen::Index>(similar.size());
    Patches patches(kDimensions, n);
    for (Eigen::Index i = 0; i < n; ++i) patches.col(i) = patch_at(similar[static_cast<size_t>(i)]);
    const Patch mean = patches.rowwise().mean();
    if (similar.size() < kFewest || p_.estimate == Estimate::kMean) {
      add(centre, mean);
      done_(centre.x, centre.y) = 1;
      return;
    }
    const Matrix noise = noise_of(similar);
    const Patches first = shrunk(patches, mean, covariance_of(patches, mean) - noise, noise);
    // The second step takes the first's result for the signal.
    const Patch second_mean = first.rowwise().mean();
    const Patches second = shrunk(patches, second_mean, covariance_of(first, second_mean), noise);
    for (Eigen::Index i = 0; i < n; ++i) {
      add(similar[static_cast<size_t>(i)], second.col(i));
      done_(similar[static_cast<size_t>(i)].x, similar[static_cast<size_t>(i)].y) = 1;
    }
  }

  /// Mean covariance of the noise of some patches: pixels are independent, their channels are not.
  Matrix noise_of(const std::vector<ivec2>& similar) const {
    Matrix noise = Matrix::Zero();
    for (const ivec2& q : similar)
      for (int k = 0; k < kPatchPixels; ++k) {
        const int x = q.x + k % 3 - 1, y = q.y + k / 3 - 1, at = 3 * k;
        const auto cov = [&](size_t i) { return s_.covariance[i](x, y) / static_cast<float>(similar.size()); };
        noise(at, at) += cov(0);
        noise(at + 1, at + 1) += cov(1);
        noise(at + 2, at + 2) += cov(2);
        const float gb = cov(3), rb = cov(4), rg = cov(5);
        noise(at + 1, at + 2) += gb;
        noise(at + 2, at + 1) += gb;
        noise(at, at + 2) += rb;
        noise(at + 2, at) += rb;
        noise(at, at + 1) += rg;
        noise(at + 1, at) += rg;
      }
    return noise;
  }

  Patch patch_at(ivec2 q) const {
    Patch v;
    for (int k = 0; k < kPatchPixels; ++k)
      for (size_t c = 0; c < 3; ++c) v(3 * k + static_cast<int>(c)) = s_.color[c](q.x + k % 3 - 1, q.y + k / 3 - 1);
    return v;
  }

  void add(ivec2 q, const Patch& v) {
    for (int k = 0; k < kPatchPixels; ++k) {
      const int x = q.x + k % 3 - 1, y = q.y + k / 3 - 1;
      for (size_t c = 0; c < 3; ++c) sums_[c](x, y) += v(3 * k + static_cast<int>(c));
      weight_(x, y) += 1;
    }
  }

  const BayesianCollaborative& p_;
  const Scale& s_;
  Rgb sums_;
  Plane weight_, done_;
};

void run(const BayesianCollaborative& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  std::vector<Scale> scales;
  scales.push_back(gather(p, frame, out.repaired));
  const std::vector<ivec2> out_of_range = replace_out_of_range(
      scales[0], static_cast<float>(kRange * std::max(1 / frame.exposure, frame.typical_luminance)));
  if (p.spikes) replace_spikes(scales[0], task);
  while (static_cast<int>(scales.size()) < p.scales && scales.back().width() >= 8 && scales.back().height() >= 8)
    scales.push_back(coarser(scales.back(), task));
  task.report(0.1);
  // From coarse to fine: low frequencies come from the coarser result, high ones from the finer.
  Rgb clean;
  double done = 0.1;
  for (size_t i = scales.size(); i-- > 0;) {
    const double part = 0.63 * std::pow(0.25, static_cast<double>(i));
    Rgb fine = Collaboration(p, scales[i]).run(share(task, done, i == 0 ? 1 : done + part));
    done += part;
    if (i + 1 < scales.size())
      for (size_t c = 0; c < 3; ++c) {
        const Plane low = halved(fine[c], 0.25f, task);
        const Plane change = make_plane(low.width(), low.height(), quiet(task),
                                        [&](int x, int y) { return clean[c](x, y) - low(x, y); });
        const Plane up = doubled(change, fine[c].width(), fine[c].height(), task);
        for_each_pixel(up.width(), up.height(), quiet(task), [&](int x, int y) { fine[c].row(y)[x] += up(x, y); });
      }
    // A low frequency that single samples lift or sink would lead beyond all values around.
    for (size_t c = 0; c < 3; ++c) {
      const Plane low = window_minimum(scales[i].color[c], p.search_radius, task),
                  high = window_maximum(scales[i].color[c], p.search_radius, task);
      clean[c] = make_plane(low.width(), low.height(), quiet(task),
                            [&](int x, int y) { return std::clamp(fine[c](x, y), low(x, y), high(x, y)); });
    }
  }
  for (size_t c = 0; c < 3; ++c) {
    *out[c] = std::move(clean[c]);
    // Left unfinished: apply_filter gives such pixels their input back, and says so.
    for (const ivec2& q : out_of_range) (*out[c])(q.x, q.y) = std::numeric_limits<float>::quiet_NaN();
  }
}

const FilterEntry entry =
    declare<BayesianCollaborative>(
        "bayesian_collaborative",
        "Finds patches whose samples have alike histograms, and shrinks each group toward its mean by as much as its noise.")
        .merit(5.1, "for fine detail that keeps its contrast, at 32 samples per pixel and more; wants `--buckets`")
        .source(
            "Boughida and Boubekeur 2017, Bayesian Collaborative Denoising for Monte Carlo Rendering; Delbracio et al. 2014, ray histogram fusion, for the distance and `estimate=mean`")
        .notes(
            "With `--records` the histograms and the noise covariance are those of every sample, as published; without, those of the eight bucket means. Good from 32 samples per pixel on. Pixels ten thousand times brighter than white and than the picture keep their input, and do not disturb their neighbours.")
        .paper("")
        .statistics(Statistics::kBuckets)
        .can_use_records()
        .seeded()
        .also_compare({"estimate=mean"})
        .param("search-radius", &BayesianCollaborative::search_radius, {1, 12}, "px", "half width of the search window",
               {6, 9})
        .param("scales", &BayesianCollaborative::scales, {1, 6}, "", "resolutions, each half of the one before", {1, 3})
        .param("threshold", &BayesianCollaborative::threshold, {0, 100}, "1",
               "largest histogram distance of alike patches; 1 is what equal distributions have", {0.7, 1, 1.5, 2.5})
        .param("bins", &BayesianCollaborative::bins, {4, 64}, "", "of each channel's histogram")
        .param("estimate", &BayesianCollaborative::estimate, {"bayes", "mean"},
               "shrinkage toward the group's mean, or the mean itself (ray histogram fusion)")
        .param("spikes", &BayesianCollaborative::spikes, {0, 1}, "", "1: replace outliers by the medoid of their 3 x 3")
        .scratch(160)
        .apron([](const BayesianCollaborative& p) { return (p.search_radius + 3) * (2 << (p.scales - 1)); })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume

#include <cstring>

#include "filters/api/registry.h"
#include "filters/inputs/planes.h"
#include "filters/kernels/rows.h"

namespace brume {
namespace {

using kernels::Shrink;

struct Wavelet {
  int scales = 5;
  float strength = 1;
  Shrink shrink = Shrink::kBayes;
};

int mirrored(int i, int n) {
  if (n == 1) return 0;
  const int period = 2 * (n - 1);
  i = ((i % period) + period) % period;
  return i < n ? i : period - i;
}

/// Separable convolution with taps `spacing` apart, edges mirrored without repeating the edge pixel.
Plane convolve(const Plane& in, const std::vector<float>& taps, int spacing, const Task& task) {
  const int width = in.width(), height = in.height(), radius = static_cast<int>(taps.size()) / 2;
  Plane horizontal(width, height), out(width, height);
  for_each_row(height, quiet(task), [&](int y) {
    const int pad = radius * spacing;
    std::vector<float> wide(static_cast<size_t>(width + 2 * pad));
    std::memcpy(wide.data() + pad, in.row(y), sizeof(float) * static_cast<size_t>(width));
    for (int j = 1; j <= pad; ++j) {
      wide[static_cast<size_t>(pad - j)] = in(mirrored(-j, width), y);
      wide[static_cast<size_t>(pad + width - 1 + j)] = in(mirrored(width - 1 + j, width), y);
    }
    std::vector<const float*> rows;
    for (int j = -radius; j <= radius; ++j) rows.push_back(wide.data() + pad + j * spacing);
    kernels::weighted_sum_rows(rows.data(), taps.data(), static_cast<int>(taps.size()), horizontal.row(y), width);
  });
  for_each_row(height, quiet(task), [&](int y) {
    std::vector<const float*> rows;
    for (int j = -radius; j <= radius; ++j) rows.push_back(horizontal.row(mirrored(y + j * spacing, height)));
    kernels::weighted_sum_rows(rows.data(), taps.data(), static_cast<int>(taps.size()), out.row(y), width);
  });
  return out;
}

const std::vector<float> kSpline = {1 / 16.f, 4 / 16.f, 6 / 16.f, 4 / 16.f, 1 / 16.f};

/// What noise of variance 1 per pixel has left in the details of each scale: the sum of the squares of the band's
/// impulse response. Noise levels that change slowly scale it.
std::vector<double> band_gains(int scales) {
  const auto wider = [](const std::vector<double>& h, int spacing) {
    std::vector<double> out(h.size() + 4 * static_cast<size_t>(spacing), 0.0);
    for (size_t i = 0; i < h.size(); ++i)
      for (size_t j = 0; j < 5; ++j)
        out[i + j * static_cast<size_t>(spacing)] += h[i] * static_cast<double>(kSpline[j]);
    return out;
  };
  const auto dot = [](const std::vector<double>& a, const std::vector<double>& b) {
    const size_t shift = (b.size() - a.size()) / 2;
    double sum = 0;
    for (size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i + shift];
    return sum;
  };
  std::vector<double> gains, h = {1.0};
  for (int s = 0; s < scales; ++s) {
    const std::vector<double> next = wider(h, 1 << s);
    // |h x h - n x n|^2 of the two-dimensional responses, from products of the one-dimensional ones.
    const double hh = dot(h, h), hn = dot(h, next), nn = dot(next, next);
    gains.push_back(hh * hh - 2 * hn * hn + nn * nn);
    h = next;
  }
  return gains;
}

void run(const Wavelet& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const int width = frame.width(), height = frame.height();
  const std::vector<double> gains = band_gains(p.scales);
  for (size_t c = 0; c < 3; ++c) {
    Plane approximation = *frame.signal[c], sum(width, height), variance = *frame.variance[c];
    for (int s = 0; s < p.scales; ++s) {
      Plane smooth = convolve(approximation, kSpline, 1 << s, task);
      // The band sees the noise level of its own surroundings.
      variance = convolve(variance, kSpline, 1 << s, task);
      const float gain = static_cast<float>(gains[static_cast<size_t>(s)]);
      Plane energy;
      if (p.shrink == Shrink::kBayes)
        energy = box_mean(make_plane(width, height, quiet(task),
                                     [&](int x, int y) {
                                       const float w = approximation(x, y) - smooth(x, y);
                                       return w * w;
                                     }),
                          3, task);
      for_each_row(height, quiet(task), [&](int y) {
        kernels::shrink_row(p.shrink, p.strength, gain, approximation.row(y), smooth.row(y), variance.row(y),
                            energy.empty() ? nullptr : energy.row(y), sum.row(y), width);
      });
      approximation = std::move(smooth);
      task.check();
      task.report((static_cast<double>(c) * p.scales + s + 1) / (3.0 * p.scales));
    }
    for_each_pixel(width, height, quiet(task),
                   [&](int x, int y) { (*out[c])(x, y) = sum(x, y) + approximation(x, y); });
  }
}

const FilterEntry entry =
    declare<Wavelet>("wavelet", "Shrinks the details of each scale by as much as their noise.")
        .merit(3.8, "for a result that stays close to the input, with nothing but variance")
        .source(
            "undecimated B3-spline wavelets (Starck and Murtagh 1994) shrunk in the spirit of Overbeck, Donner and Ramamoorthi 2009, Adaptive Wavelet Rendering, which takes one standard deviation off")
        .notes(
            "Each band's noise follows from the variance of the pixels and the band's impulse response. With `soft`, `strength=0` gives the input back; `bayes` drops bands whose energy the noise explains. Results can be negative beside bright edges; they are left so.")
        .paper("shrink=soft")
        .statistics(Statistics::kVariance)
        .param("scales", &Wavelet::scales, {1, 8}, "", "bands; the rest stays as it is", {3, 4, 5})
        .param("strength", &Wavelet::strength, {0, 100}, "deviations", "c, of the threshold", {0.7, 1, 1.5, 2, 3})
        .param("shrink", &Wavelet::shrink, {"soft", "bayes"},
               "soft: |w| - c sigma; bayes: threshold sigma^2 over the band's local signal", {"soft", "bayes"})
        .scratch(14)
        .apron([](const Wavelet& p) { return 2 * ((1 << p.scales) - 1) + 3; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume

#include "tests/support/reference_window_filters.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace brume::kernels {
namespace {

double kernel(double squared_distance, double sigma) {
  if (!(sigma > 0)) return 1.0;  // the term is off
  const double s = std::max(sigma, 1e-6);
  return std::exp(-squared_distance / (2 * s * s));
}

double squared(const dvec3& v) {
  return glm::dot(v, v);
}

/// sum w v / sum w over the clipped window of every pixel; `otherwise(p)` where the weights vanish.
template <class Weight, class Otherwise>
std::vector<dvec3> average(const ReferenceImage& image, int radius, const Weight& weight, const Otherwise& otherwise) {
  std::vector<dvec3> out;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      const ivec2 p(x, y);
      dvec3 sum(0);
      double total = 0;
      for (int qy = std::max(0, y - radius); qy <= std::min(image.height - 1, y + radius); ++qy)
        for (int qx = std::max(0, x - radius); qx <= std::min(image.width - 1, x + radius); ++qx) {
          const double w = weight(p, ivec2(qx, qy));
          sum += w * image.at(qx, qy);
          total += w;
        }
      out.push_back(total > 1e-30 ? sum / total : otherwise(p));
    }
  return out;
}

double domain(const ivec2& p, const ivec2& q, double sigma) {
  const ivec2 d = p - q;
  return kernel(d.x * d.x + d.y * d.y, sigma);
}

}  // namespace

std::vector<dvec3> reference_gaussian(const ReferenceImage& image, int radius, double sigma) {
  return average(
      image, radius, [&](ivec2 p, ivec2 q) { return domain(p, q, sigma); },
      [&](ivec2 p) { return image.at(p.x, p.y); });
}

std::vector<dvec3> reference_bilateral(const ReferenceImage& image, int radius, const Bilateral& s) {
  return average(
      image, radius,
      [&](ivec2 p, ivec2 q) {
        return domain(p, q, s.sigma_domain) * kernel(squared(image.at(p.x, p.y) - image.at(q.x, q.y)), s.sigma_range);
      },
      [&](ivec2 p) { return image.at(p.x, p.y); });
}

std::vector<dvec3> reference_extended_bilateral(const ReferenceImage& image, int radius, const Bilateral& s) {
  const std::vector<dvec3> smooth = reference_gaussian(image, radius, s.sigma_domain);
  const auto prefiltered = [&](ivec2 p) { return smooth[static_cast<size_t>(p.y) * image.width + p.x]; };
  return average(
      image, radius,
      [&](ivec2 p, ivec2 q) {
        return domain(p, q, s.sigma_domain) * kernel(squared(prefiltered(p) - image.at(q.x, q.y)), s.sigma_range);
      },
      prefiltered);
}

std::vector<dvec3> reference_gradient_kernel(const ReferenceImage& image, int radius, const GradientWeights& s) {
  const auto index = [&](ivec2 p) { return static_cast<size_t>(p.y) * image.width + p.x; };
  return average(
      image, radius,
      [&](ivec2 p, ivec2 q) {
        const double w_d = domain(p, q, s.bilateral.sigma_domain);
        const double w_l = kernel(squared(image.at(p.x, p.y) - image.at(q.x, q.y)), s.bilateral.sigma_range);
        const dvec3 gp = image.gradient[index(p)], gq = image.gradient[index(q)];
        const bool own = gp != dvec3(0), both = own && gq != dvec3(0);
        const double apart = 1.0 - std::clamp(glm::dot(gp, gq), -1.0, 1.0);
        const double w_g = both ? kernel(apart * apart, s.sigma_gradient) : 0.0;
        switch (s.variant) {
          case GradientVariant::kMultiply:
            return own ? w_d * w_l * w_g : w_d * w_l;
          case GradientVariant::kGate: {
            const double o = image.opacity[index(p)] - image.opacity[index(q)];
            return w_d * (w_l + s.gate_strength * w_g * kernel(o * o, s.sigma_opacity));
          }
          default:
            return w_d * (w_l + w_g);
        }
      },
      [&](ivec2 p) { return image.at(p.x, p.y); });
}

double reference_road(const ReferenceImage& image, int x, int y) {
  std::array<double, 9> distances{};
  size_t n = 0;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx)
      if (dx != 0 || dy != 0)
        distances[n++] = glm::distance(
            image.at(x, y), image.at(std::clamp(x + dx, 0, image.width - 1), std::clamp(y + dy, 0, image.height - 1)));
  std::sort(distances.begin(), distances.begin() + 8);
  return distances[0] + distances[1] + distances[2] + distances[3];
}

std::vector<dvec3> reference_trilateral(const ReferenceImage& image, int radius, const TrilateralWeights& s) {
  std::vector<double> road;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) road.push_back(reference_road(image, x, y));
  const auto road_at = [&](ivec2 p) { return road[static_cast<size_t>(p.y) * image.width + p.x]; };
  return average(
      image, radius,
      [&](ivec2 p, ivec2 q) {
        const double mean = 0.5 * (road_at(p) + road_at(q));
        const double j = 1.0 - kernel(mean * mean, s.sigma_joint);
        const double w_r = kernel(squared(image.at(p.x, p.y) - image.at(q.x, q.y)), s.bilateral.sigma_range);
        const double w_i = kernel(road_at(q) * road_at(q), s.sigma_impulse);
        return domain(p, q, s.bilateral.sigma_domain) * std::pow(w_r, 1.0 - j) * std::pow(w_i, j);
      },
      [&](ivec2 p) { return image.at(p.x, p.y); });
}

}  // namespace brume::kernels

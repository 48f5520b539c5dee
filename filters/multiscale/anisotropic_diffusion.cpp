#include <cmath>

#include "filters/api/registry.h"
#include "filters/inputs/directions.h"
#include "filters/patch/neighbourhood.h"

namespace brume {
namespace {

struct AnisotropicDiffusion {
  int iterations = 20;
  float rate = 0.2f;
  float sigma_color = 4, sigma_gradient = 0, sigma_feature = 2;
};

// How often the conductances are computed anew, and by how much the propagated variance is held to be too small,
// because it takes neighbours as independent.
constexpr int kRefresh = 5;
constexpr float kCorrelation = 1.1f;

/// What two neighbours differ by: colour in units of its variance v, direction of the gradient, the other features.
WeightModel conductance(const AnisotropicDiffusion& p, const FilterFrame& frame, const std::vector<Plane>& u,
                        const Plane& v, const std::vector<Plane>& directions,
                        const std::vector<Plane>& feature_variance) {
  WeightModel model;
  const auto add = [&](Distance d, float sigma) {
    if (!(sigma > 0)) return;
    d.scale = 1 / (2 * sigma * sigma);
    model.distances.push_back(std::move(d));
  };
  Distance color;
  color.kind = Distance::Kind::kRatio;
  color.guide = {&u[0], &u[1], &u[2]};
  color.variance = {&v};
  color.floor = 1e-20f;
  add(color, p.sigma_color);
  if (!directions.empty()) {
    Distance angle;
    angle.kind = Distance::Kind::kAngle;
    angle.guide = pointers(directions);
    add(angle, p.sigma_gradient);
  }
  for (size_t k = 0; k < frame.features->size(); ++k) {
    const Feature& f = (*frame.features)[k];
    if (f.name == "gradient") continue;
    Distance feature;
    feature.kind = Distance::Kind::kRatio;
    feature.guide = pointers(f.mean);
    feature.variance = {&feature_variance[k]};
    // What neighbours differ by on a slope across a twentieth of the range is no edge.
    feature.floor = 2.5e-3f;
    add(feature, p.sigma_feature);
  }
  return model;
}

void run(const AnisotropicDiffusion& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const int width = frame.width(), height = frame.height();
  const std::vector<Plane> directions = unit_directions(frame, task);
  std::vector<Plane> feature_variance;
  for (const Feature& f : *frame.features) feature_variance.push_back(sum_of(f.variance));

  std::vector<Plane> u;
  for (size_t c = 0; c < 3; ++c) u.push_back(*frame.signal[c]);
  if (frame.carries())
    for (size_t c = 0; c < 3; ++c) u.push_back(*frame.values[c]);
  Plane v = make_plane(width, height, quiet(task), [&](int x, int y) {
    return (*frame.variance[0])(x, y) + (*frame.variance[1])(x, y) + (*frame.variance[2])(x, y);
  });
  std::vector<Plane> next = u;
  Plane next_v = v, right, down;
  for (int i = 0; i < p.iterations; ++i) {
    if (i % kRefresh == 0) {
      const WeightModel model = conductance(p, frame, u, v, directions, feature_variance);
      // Conductance between each pixel and its right, and its lower, neighbour.
      right = weights_toward(model, 1, 0, width, height, task);
      down = weights_toward(model, 0, 1, width, height, task);
    }
    for_each_row(height, quiet(task), [&](int y) {
      const float *gr = right.row(y), *gd = down.row(y), *gu = y > 0 ? down.row(y - 1) : nullptr;
      const int above = std::max(0, y - 1), below = std::min(height - 1, y + 1);
      // The flux to each neighbour leaves here and arrives there, so that the sum of all pixels stays.
      for (size_t c = 0; c < u.size(); ++c) {
        const float *row = u[c].row(y), *a = u[c].row(above), *b = u[c].row(below);
        float* to = next[c].row(y);
        for (int x = 0; x < width; ++x) {
          float flux = gd[x] * (b[x] - row[x]);
          if (gu) flux += gu[x] * (a[x] - row[x]);
          if (x + 1 < width) flux += gr[x] * (row[x + 1] - row[x]);
          if (x > 0) flux += gr[x - 1] * (row[x - 1] - row[x]);
          to[x] = row[x] + p.rate * flux;
        }
      }
      for (int x = 0; x < width; ++x) {
        const float d = gd[x], t = gu ? gu[x] : 0.0f, r = gr[x], l = x > 0 ? gr[x - 1] : 0.0f;
        const float own = 1 - p.rate * (d + t + r + l), k = p.rate * p.rate;
        next_v(x, y) =
            own * own * v(x, y) + kCorrelation * k *
                                      (d * d * v(x, below) + t * t * v(x, above) +
                                       r * r * v(std::min(width - 1, x + 1), y) + l * l * v(std::max(0, x - 1), y));
      }
    });
    std::swap(u, next);
    std::swap(v, next_v);
    task.check();
    task.report((i + 1) / static_cast<double>(p.iterations));
  }
  for (size_t c = 0; c < 3; ++c) *out[c] = std::move(u[frame.carries() ? c + 3 : c]);
}

const FilterEntry entry =
    declare<AnisotropicDiffusion>("anisotropic_diffusion",
                                  "Lets light flow between neighbours that noise cannot tell apart, until it can.")
        .merit(4.8, "when light must be conserved to the last digit")
        .source("in the spirit of McCool 1999; structure from its abstract, constants ours")
        .notes(
            "The conductance between two pixels falls with their difference in units of its own variance, which diffuses along and falls, so that the flow stops by itself; with the angle between density gradients; and with the other features. Light is conserved.")
        .paper("iterations=100,sigma-color=2,sigma-gradient=0.1")
        .statistics(Statistics::kVariance)
        .features()
        .carries()
        .param("iterations", &AnisotropicDiffusion::iterations, {1, 1000}, "", "steps", {10, 20, 40, 100})
        .param("rate", &AnisotropicDiffusion::rate, {0.01, 0.25}, "1", "lambda, share that flows along an open edge")
        .param("sigma-color", &AnisotropicDiffusion::sigma_color, {0, 1000}, "deviations",
               "k_c, of colour difference over its noise; 0: off", {1, 2, 4})
        .param("sigma-gradient", &AnisotropicDiffusion::sigma_gradient, {0, 100}, "1",
               "of 1 - cos of the angle of the density gradient; 0: off", {0, 0.1, 0.3})
        .param("sigma-feature", &AnisotropicDiffusion::sigma_feature, {0, 1000}, "deviations",
               "of every other feature over its noise, at least a twentieth of its range; 0: off", {0, 2, 4})
        .scratch(20)
        .apron([](const AnisotropicDiffusion& p) { return p.iterations + 1; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume

#include <algorithm>

#include "base/error.h"
#include "filters/api/registry.h"
#include "filters/regression/guided_filter.h"
#include "filters/regression/regression.h"

namespace brume {
namespace {

struct Guided {
  int radius = 3;
  float epsilon = 1e-2f;
  FeatureSet feature_set = FeatureSet::kAll;
};

void run(const Guided& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  std::vector<const Plane*> guide;
  for (const Feature& f : *frame.features)
    for (const Plane& plane : f.mean) guide.push_back(&plane);
  // A single pixel has nothing to be guided to.
  if (guide.empty() && frame.frame_size != ivec2(1))
    throw InputError(
        "filter guided: no feature of the frame varies by more than its noise, and without one it would only blur. A filter that needs none is nl_means; more samples make features cleaner");
  std::vector<Plane> clean = guided_filter(frame.values, guide, p.radius, p.epsilon, task);
  // A line that leads beyond the values of its window is drawn back to their mean as far as that. The signal decides,
  // so that layers that are carried along are drawn back alike.
  const std::vector<Plane> own =
      frame.carries() ? guided_filter(frame.signal, guide, p.radius, p.epsilon, quiet(task)) : std::vector<Plane>();
  for (size_t c = 0; c < 3; ++c) {
    const Plane &signal = *frame.signal[c], &line = own.empty() ? clean[c] : own[c];
    const Plane low = window_minimum(signal, p.radius, task), high = window_maximum(signal, p.radius, task),
                level = box_mean(signal, p.radius, task),
                mean = own.empty() ? level : box_mean(*frame.values[c], p.radius, task);
    *out[c] = make_plane(frame.width(), frame.height(), quiet(task), [&](int x, int y) {
      const float slope = line(x, y) - level(x, y),
                  inside = std::clamp(line(x, y), low(x, y), high(x, y)) - level(x, y);
      const float share = slope == 0 ? 1.0f : std::clamp(inside / slope, 0.0f, 1.0f);
      return share == 1.0f ? clean[c](x, y) : mean(x, y) + share * (clean[c](x, y) - mean(x, y));
    });
  }
}

const FilterEntry entry =
    declare<Guided>("guided", "Guided filter: in every window the picture is a linear function of the features.")
        .merit(3.8, "for a quick look with features: near the best at few samples, in hundredths of a second")
        .source("He, Sun and Tang 2013, equations 11 to 20")
        .notes(
            "Each feature has its own coefficients. Without features it would be a box filter run twice, and refuses. Time does not depend on the radius much. On noise-free guides it does best with wide windows and hardly a ridge: preset=guides comes near transport_regression.")
        .needs_features()
        .feature_set(&Guided::feature_set)
        .preset("paper", "a usual choice, the paper giving none for this use", "radius=5,epsilon=0.001")
        .preset("guides", "for the guides that the renderer computes, found on the same scenes as the defaults",
                "feature-set=guides,radius=32,epsilon=3e-5")
        .carries()
        .param("radius", &Guided::radius, {1, 32}, "px", "half width of a window", {1, 3, 8, 32})
        .param("epsilon", &Guided::epsilon, {0, 100}, "feature^2", "ridge; features have range 1", {3e-5, 1e-3, 1e-2})
        .scratch(16)
        .apron([](const Guided& p) { return 2 * p.radius; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume

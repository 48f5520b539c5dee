#include "base/error.h"
#include "filters/neighbourhood.h"
#include "filters/registry.h"

namespace brume {
namespace {

enum class Buffers { kTwo, kOne };

struct NlMeans {
  int search_radius = 10, patch_radius = 3;
  float strength = 0.45f, feature_strength = 0;
  Buffers buffers = Buffers::kTwo;
};

constexpr float kFeatureFloor = 1e-3f;

void run(const NlMeans& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  if (p.buffers == Buffers::kTwo && !frame.half_a[0])
    throw InputError(
        "filter nl_means: buffers=two needs the two half images, which the frame does not have; brume render records "
        "them unless --no-statistics is given. buffers=one works without");
  const FeatureDistances features(*frame.features, p.feature_strength, kFeatureFloor, task);
  const std::vector<Offset> window = square_window(p.search_radius);
  const auto average = [&](const RgbPlanes& guide, const RgbPlanes& variance, const RgbPlanes& values,
                           const Task& part) {
    WeightModel model;
    model.join = WeightModel::Join::kLargest;
    model.distances.push_back(noise_distance(guide, variance, p.patch_radius, p.strength));
    features.add_to(model);
    return weighted_average(model, window, values, part).values;
  };
  if (p.buffers == Buffers::kOne) {
    std::vector<Plane> clean = average(frame.signal, frame.variance, frame.values, task);
    for (size_t c = 0; c < 3; ++c) *out[c] = std::move(clean[c]);
    return;
  }
  // Weights of one half are independent of the noise of the other, which they average. Where layers are carried along,
  // which have no halves here, both sets of weights average the whole of each.
  Rgb variance;
  for (size_t c = 0; c < 3; ++c)
    variance[c] = make_plane(frame.width(), frame.height(), quiet(task),
                             [&](int x, int y) { return 2.0f * (*frame.variance[c])(x, y); });
  const std::vector<Plane> a = average(frame.half_b, view(variance), frame.together ? frame.values : frame.half_a,
                                       share(task, 0, 0.5)),
                           b = average(frame.half_a, view(variance), frame.together ? frame.values : frame.half_b,
                                       share(task, 0.5, 1));
  for (size_t c = 0; c < 3; ++c)
    for_each_row(frame.height(), quiet(task), [&](int y) {
      for (int x = 0; x < frame.width(); ++x) (*out[c])(x, y) = 0.5f * (a[c](x, y) + b[c](x, y));
    });
}

const FilterEntry entry =
    declare<NlMeans>("nl_means",
                     "Non-local means: averages pixels whose patches differ by no more than noise explains.")
        .merit(3.3, "for texture as fine as the noise, when features say little")
        .source("Buades, Coll and Morel 2005; distance and two buffers of Rousselle, Knaus and Zwicker 2012, section 4")
        .notes(
            "The patch distance takes the variance of each pixel off the squared difference and divides by it, so that "
            "one strength serves every noise level. `buffers=two` filters each half image with the weights of the "
            "other. "
            "With `feature-strength` above 0, features count too: the weight is the smallest of the colour's and the "
            "features'.")
        .paper("")
        .statistics(Statistics::kVariance, Statistics::kHalves)
        .features([](const NlMeans& p) { return p.feature_strength > 0; })
        .carries()
        .param("search-radius", &NlMeans::search_radius, {0, 40}, "px", "half width of the search window")
        .param("patch-radius", &NlMeans::patch_radius, {0, 8}, "px", "half width of a patch", {1, 3})
        .param("strength", &NlMeans::strength, {0.05, 100}, "1", "k, noise deviations still taken as equal",
               {0.3, 0.45, 0.7, 1, 1.5})
        .param("feature-strength", &NlMeans::feature_strength, {0, 100}, "1",
               "k_f, the same for features; 0: colour alone", {0, 0.6, 2})
        .param("buffers", &NlMeans::buffers, {"two", "one"}, "weights from the other half image, or from the whole")
        .scratch(12)
        .apron([](const NlMeans& p) { return p.search_radius + p.patch_radius; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume

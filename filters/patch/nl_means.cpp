#include "base/error.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/patch/neighbourhood.h"

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
        "filter nl_means: buffers=two needs the two half images, which the frame does not have; buffers=one works without. " +
        way_to("brume render records them unless --no-statistics is given, or there is one sample per pixel",
               frame.layers));
  const FeatureDistances features(*frame.features, p.feature_strength, kFeatureFloor, task);
  const std::vector<Offset> window = square_window(p.search_radius);
  const auto frame_at = [&](size_t i) -> const FilterFrame& { return i == 0 ? frame : *frame.nearby[i - 1]; };
  // Over the frame to clean and those nearby; `noisy` and `values` say which pictures of a frame.
  const auto average = [&](const auto& noisy, const auto& values, const Task& part) {
    std::vector<Slice> slices;
    const Noisy here = noisy(0);
    for (size_t i = 0; i <= frame.nearby.size(); ++i) {
      const FilterFrame& there = frame_at(i);
      Slice& slice = slices.emplace_back();
      slice.model.join = WeightModel::Join::kLargest;
      slice.model.distances.push_back(noise_distance(here, noisy(i), p.patch_radius, p.strength));
      features.add_to(slice.model, i == 0 ? nullptr : there.features);
      slice.offsets = window;
      const RgbPlanes of_frame = values(there);
      slice.values.assign(of_frame.begin(), of_frame.end());
    }
    return average_over_frames(slices, values(frame), part);
  };
  if (p.buffers == Buffers::kOne) {
    std::vector<Plane> clean = average(
        [&](size_t i) {
          return Noisy{frame_at(i).signal, frame_at(i).variance};
        },
        [](const FilterFrame& f) { return f.values; }, task);
    for (size_t c = 0; c < 3; ++c) *out[c] = std::move(clean[c]);
    return;
  }
  // Weights of one half are independent of the noise of the other, which they average. Where layers are carried along,
  // which have no halves here, both sets of weights average the whole of each.
  std::vector<Rgb> variance(1 + frame.nearby.size());
  for (size_t i = 0; i < variance.size(); ++i)
    for (size_t c = 0; c < 3; ++c)
      variance[i][c] = make_plane(frame.width(), frame.height(), quiet(task),
                                  [&](int x, int y) { return 2.0f * (*frame_at(i).variance[c])(x, y); });
  const std::vector<Plane> a = average(
                               [&](size_t i) {
                                 return Noisy{frame_at(i).half_b, view(variance[i])};
                               },
                               [&](const FilterFrame&f) { return frame.together ? f.values : f.half_a; },
                               share(task, 0, 0.5)),
                           b = average(
                               [&](size_t i) {
                                 return Noisy{frame_at(i).half_a, view(variance[i])};
                               },
                               [&](const FilterFrame&f) { return frame.together ? f.values : f.half_b; },
                               share(task, 0.5, 1));
  for (size_t c = 0; c < 3; ++c)
    for_each_pixel(frame.width(), frame.height(), quiet(task),
                   [&](int x, int y) { (*out[c])(x, y) = 0.5f * (a[c](x, y) + b[c](x, y)); });
}

const FilterEntry entry =
    declare<NlMeans>("nl_means",
                     "Non-local means: averages pixels whose patches differ by no more than noise explains.")
        .merit(3.3, "for texture as fine as the noise, when features say little")
        .source("Buades, Coll and Morel 2005; distance and two buffers of Rousselle, Knaus and Zwicker 2012, section 4")
        .notes(
            "The patch distance takes the variance of each pixel off the squared difference and divides by it, so that one strength serves every noise level. `buffers=two` filters each half image with the weights of the other. With `feature-strength` above 0, features count too: the weight is the smallest of the colour's and the features'.")
        .paper("")
        .statistics(Statistics::kVariance, Statistics::kHalves)
        .features([](const NlMeans& p) { return p.feature_strength > 0; })
        .carries()
        .aligned_sequences()
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

#pragma once
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <vector>

#include "base/running_statistics.h"
#include "render/session/renderer.h"
#include "render/transport/wavefront.h"
#include "render/world/camera.h"
#include "tests/support/volumes.h"

// Small square pictures of fire, and the means of what paths find in them.

namespace brume::test {

/// data/scenes/fire.toml with so many pixels along each side, changed.
inline Scene fire_picture(int size, const std::function<void(Scene&)>& change) {
  Scene scene = demo("fire", size);
  scene.film.height = size;
  change(scene);
  return scene;
}

struct PictureMean {
  double value = 0, variance = 0;  ///< of the picture's mean, from the spread within its pixels
};

/// Means over a picture of size x size pixels of `count` numbers of its path samples: value(sample, k), k from 0.
/// @param context  the scene's, perhaps with another plan
template <class Value>
std::vector<PictureMean> picture_means(const PreparedScene& scene, const PathContext& context, int size, size_t count,
                                       int spp, int64_t seed, const Value& value) {
  const Camera camera = scene.camera();
  std::vector<PictureMean> all(count);
  for (int y = 0; y < size; ++y)
    for (int x = 0; x < size; ++x) {
      std::vector<PathRequest> requests;
      for (int s = 0; s < spp; ++s) requests.push_back(scene.request(camera, seed, x, y, static_cast<uint32_t>(s)));
      std::vector<RunningStatistics> pixel(count);
      PathCounters counters;
      trace_paths(
          context, requests,
          [&](size_t, const PathSample& sample) {
            for (size_t k = 0; k < count; ++k) pixel[k].add(value(sample, k));
          },
          counters);
      EXPECT_EQ(counters.paths, requests.size()) << "spp counts camera rays";
      for (size_t k = 0; k < count; ++k) {
        all[k].value += pixel[k].mean / (size * size);
        all[k].variance += pixel[k].mean_variance() / std::pow(size, 4);
      }
    }
  return all;
}

}  // namespace brume::test

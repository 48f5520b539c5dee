#pragma once
#include <functional>
#include <optional>

#include "base/rng.h"
#include "image/layers.h"
#include "image/sample_records.h"
#include "tests/support/files.h"

namespace brume::test {

using Value = std::function<float(int x, int y, size_t c)>;

/// A number in [0, 1) for each pixel and purpose.
double chance(int x, int y, uint64_t purpose);

/// A normal deviate likewise.
double normal(int x, int y, uint64_t purpose);

/// Fills a layer, or one of its statistics.
void put(Layers& frame, const LayerName& l, std::string_view statistic, const Value& value);

/// A layer with statistics that agree with one another: eight buckets around the mean, whose spread is the variance,
/// and two halves.
/// @param spread  of the buckets and halves instead, as a variance; < 0: the variance itself
void put_with_statistics(Layers& frame, const LayerName& l, double variance, const Value& value, double spread = -1);

/// A frame with every layer that a filter may want, of which the indirect one is given.
Layers frame_of(int width, int height, const Value& indirect, double variance = 0.013, double spread = -1);

/// The same, of uniform noise around a step.
Layers noisy_frame(int width, int height, uint64_t seed);

/// A frame sampled as a renderer would: each of `samples` samples of the indirect light is the truth plus a normal
/// deviate, and mean, variance, halves and buckets follow from the samples.
Layers sampled_frame(int width, int height, int samples, double deviation, uint64_t seed, const Value& truth);
/// Likewise, of any samples around the truth.
using Sample = std::function<double(int, int, size_t, Rng&)>;
Layers sampled_frame(int width, int height, int samples, uint64_t seed, const Value& truth, const Sample& sample);

/// A frame's buckets as recorded samples, each with random numbers on which its colour depends.
struct Records {
  TemporaryFolder folder;
  std::optional<RecordReader> reader;
  explicit Records(const Layers& frame);
};

}  // namespace brume::test

#include "filters/api/recommend.h"

#include <gtest/gtest.h>

#include "base/error.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/run/apply.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

ApplyOptions whole_picture() {
  ApplyOptions options;
  options.component = Component::kAll;
  return options;
}

/// The channels of a frame that `keep` accepts, with one pixel each.
template <class Keep>
Layers outline(const Keep& keep) {
  Layers result(1, 1);
  for (const std::string& name : test::noisy_frame(4, 4, 1).names())
    if (keep(name)) result.add(name);
  return result;
}

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(Recommend, NoFilterOfHigherMeritCouldRun) {
  const auto everything = [](const std::string&) { return true; };
  const auto no_buckets = [](const std::string& n) { return !holds(n, "bucket"); };
  const auto no_statistics = [](const std::string& n) {
    return !holds(n, "bucket") && !holds(n, "half") && !holds(n, "variance");
  };
  const auto bare = [](const std::string& n) { return n == "R" || n == "G" || n == "B"; };
  for (const Layers& frame : {outline(everything), outline(no_buckets), outline(no_statistics), outline(bare)}) {
    const Recommendation best = recommend_filter(frame, whole_picture());
    EXPECT_NO_THROW(check_requirements(best.filter, frame, whole_picture()));
    for (const FilterEntry* e : filters_by_merit()) {
      if (e == &best.filter.entry()) break;
      if (e->guides || e->learned)
        continue;  // it would run, but is of little use without guides, or only on some machines
      EXPECT_THROW(check_requirements(FilterSettings(*e), frame, whole_picture()), InputError) << e->name;
    }
  }
}

// The recommended filter runs on a real frame, whatever is left out of it.
TEST(Recommend, WhatIsRecommendedRuns) {
  const Layers full = test::noisy_frame(24, 20, 2);
  for (const std::string left_out : {"", "bucket", "half", "variance", "transmittance", "gradient"}) {
    Layers frame(full.width(), full.height());
    for (const auto& [name, plane] : full.channels())
      if (left_out.empty() || !holds(name, left_out)) frame.set(name, plane);
    for (const NoiseSource noise : {NoiseSource::kLayers, NoiseSource::kSpatial}) {
      ApplyOptions options = whole_picture();
      options.noise = noise;
      const Recommendation best = recommend_filter(frame, options);
      EXPECT_NO_THROW(apply_filter(best.filter, frame, options, {})) << left_out << " " << best.filter.entry().name;
    }
  }
}

TEST(Recommend, ASequenceGetsAFilterThatLooksAround) {
  const Layers frame = outline([](const std::string&) { return true; });
  EXPECT_TRUE(recommend_filter(frame, whole_picture(), true).filter.entry().sequences);
}

TEST(Recommend, SaysWhatWouldMakeItBetter) {
  const Layers bare = outline([](const std::string& n) { return n == "R" || n == "G" || n == "B"; });
  const std::string reason = recommend_filter(bare, whole_picture()).reason;
  EXPECT_TRUE(holds(reason, "more of brume render would make it better")) << reason;
  EXPECT_TRUE(holds(reason, "statistics")) << reason;
  EXPECT_EQ(reason.find('\n'), std::string::npos) << "one line";
}

TEST(Recommend, AFrameWithoutAPictureIsRefusedWithItsLayers) {
  Layers odd(1, 1);
  odd.add("Noisy Image.R");
  try {
    recommend_filter(odd, whole_picture());
    FAIL();
  } catch (const InputError& error) {
    EXPECT_TRUE(holds(error.what(), "no channels R, G, B to clean; it has: Noisy Image")) << error.what();
  }
}

}  // namespace
}  // namespace brume

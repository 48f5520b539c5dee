// Moving a result to candidates: where the data prove a gain, and only there.

#include "filters/regression/transport/mixing.h"

#include <gtest/gtest.h>

#include <cmath>

#include "filters/inputs/half_pair.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

constexpr int kWidth = 640, kHeight = 320;
constexpr float kNoise = 0.2f;

bool in_shadow(int x, int y) {
  return x >= 500 && x < 540 && y >= 40 && y < 80;
}

/// Root mean square error of the red of the first half, in the columns before `end`.
double error_of(const HalfPair& result, const HalfPair& truth, int end) {
  double squares = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < end; ++x) squares += std::pow(result.a[0](x, y) - truth.a[0](x, y), 2);
  return std::sqrt(squares / (static_cast<double>(end) * kHeight));
}

/// A picture of 1, a shadow of 0.5 in it.
struct Shadow {
  HalfPair truth, data, bright;  // `bright` does not know the shadow
  Plane weight{kWidth, kHeight, 1.0f};
  std::vector<MixingRegion> regions;

  Shadow() {
    const auto half = [](float shadow, uint64_t seed) {
      Rgb rgb;
      for (size_t c = 0; c < 3; ++c)
        rgb[c] = make_plane(kWidth, kHeight, {}, [&](int x, int y) {
          const float noise = seed > 0 ? kNoise * static_cast<float>(test::normal(x, y, 10 * seed + c)) : 0.0f;
          return (in_shadow(x, y) ? shadow : 1.0f) + noise;
        });
      return rgb;
    };
    truth = {half(0.5f, 0), half(0.5f, 0)};
    data = {half(0.5f, 1), half(0.5f, 2)};
    bright = {half(1, 0), half(1, 0)};
    regions.push_back({Plane(kWidth, kHeight, 1.0f), 3});
  }
  HalfPair mixed(const std::vector<Proposal>& proposals, const LateProposal& late) const {
    HalfPair result = bright;
    mix(result, proposals, late, {view(data.a), view(data.b), weight, regions}, {});
    return result;
  }
};

TEST(Mixing, TakesTheBetterCandidateInTheShadowAndLeavesTheRestAlone) {
  const Shadow s;
  const std::vector<Proposal> proposals = {
      [&](const HalfPair&, const Box& box, HalfPair& room) -> const HalfPair& { return room = cut(s.truth, box); },
      [&](const HalfPair&, const Box& box, HalfPair& room) -> const HalfPair& { return room = cut(s.data, box); }};
  const HalfPair result = s.mixed(proposals, [&](const Box& box, const Plane&) { return cut(s.bright, box); });
  for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(result.a[c](520, 60), 0.5f, 0.05f);
  EXPECT_LT(error_of(result, s.truth, 400), 0.02 * kNoise);
}

// What is dear is asked for near the shadow alone, where something was moved.
TEST(Mixing, AsksForTheLateCandidateOnlyAroundWhatWasMoved) {
  const Shadow s;
  int asked = 0;
  const LateProposal late = [&](const Box& box, const Plane& wanted) {
    ++asked;
    EXPECT_LT(box.width() * box.height(), kWidth * kHeight / 2);
    EXPECT_TRUE(box.x0 <= 500 && box.x1 >= 540 && box.y0 <= 40 && box.y1 >= 80);
    EXPECT_EQ(wanted.width(), box.width());
    EXPECT_EQ(wanted.height(), box.height());
    EXPECT_GT(wanted(520 - box.x0, 60 - box.y0), 0);
    return cut(s.truth, box);
  };
  const std::vector<Proposal> halfway = {[&](const HalfPair&, const Box& box, HalfPair& room) -> const HalfPair& {
    room = cut(s.bright, box);
    for (Rgb* half : {&room.a, &room.b})
      for (size_t c = 0; c < 3; ++c) add_to((*half)[c], 1, cut(s.truth, box).a[c], {});
    for (Rgb* half : {&room.a, &room.b})
      for (Plane& plane : *half)
        for (int y = 0; y < plane.height(); ++y)
          for (float& v : plane.pixels(y)) v *= 0.5f;
    return room;
  }};
  const HalfPair result = s.mixed(halfway, late);
  EXPECT_EQ(asked, 1);
  EXPECT_NEAR(result.a[0](520, 60), 0.5f, 0.05f);
}

TEST(Mixing, MovesNothingWhereTheResultIsTheTruth) {
  const Shadow s;
  HalfPair result = s.truth;
  const std::vector<Proposal> proposals = {
      [&](const HalfPair&, const Box& box, HalfPair& room) -> const HalfPair& { return room = cut(s.bright, box); },
      [&](const HalfPair&, const Box& box, HalfPair& room) -> const HalfPair& { return room = cut(s.data, box); }};
  mix(result, proposals, [&](const Box& box, const Plane&) { return cut(s.bright, box); },
      {view(s.data.a), view(s.data.b), s.weight, s.regions}, {});
  EXPECT_LT(error_of(result, s.truth, kWidth), 0.02 * kNoise);
}

}  // namespace
}  // namespace brume

#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

// The paths in flight on one thread, in single precision, one array per member.

namespace brume {

constexpr size_t kPool = 2048;   ///< paths in flight per thread: their state stays in the second-level cache
constexpr size_t kPadding = 64;  ///< lists may be read up to a vector past their end: those slots belong to no path

/// State of the paths of one thread. Ray parameters and local directions are in lane units (LaneScene::unit).
struct PathStates {
  template <class T>
  using Column = std::array<T, kPool + kPadding>;
  Column<float> ox, oy, oz;    // position: local coordinates of the bricks
  Column<float> dx, dy, dz;    // direction: world, unit
  Column<float> lx, ly, lz;    // the same in local coordinates
  Column<float> sx, sy, sz;    // direction of the shadow ray, local
  Column<float> tr, tg, tb;    // throughput
  Column<float> cr, cg, cb;    // contribution of the light sample, unoccluded
  Column<float> t_max;         // ray parameter where the flight ends; only where LaneScene::flights_end
  Column<float> shadow_t_max;  // distance of the light sample; only where LaneScene::shadows_end
  Column<float> pdf;           // of the last direction
  Column<float> mis;           // the light sample's weight against direction sampling; only where LaneScene::world
  Column<float> transmittance;
  // Only in chromatic scenes: each channel's density of the path's choices; what a flight through a medium
  // multiplied weight and density with; the colour of the shadow ray's transmittance; the channel that decides.
  Column<float> qr, qg, qb, fr, fg, fb, shadow_r, shadow_g, shadow_b;
  Column<int32_t> hero;
  Column<float> time;    // in [0, 1] of the shutter; only where LaneScene::displaced
  Column<float> passed;  // transmittance of the camera ray
  Column<float> direct_r, direct_g, direct_b, indirect_r, indirect_g, indirect_b;
  Column<uint32_t> s0, s1, s2, s3;  // generator: xoshiro128++
  Column<uint32_t> events;
  Column<uint32_t> request;  // which of the batch
};

/// A list of slots, padded so that whole vectors can be read.
struct SlotList {
  std::array<int32_t, kPool + kPadding> slot;
  size_t count = 0;
  void pad() {
    std::fill(slot.begin() + static_cast<std::ptrdiff_t>(count),
              slot.begin() + static_cast<std::ptrdiff_t>(count + kPadding), static_cast<int32_t>(kPool));
  }
  void push(int32_t s) { slot[count++] = s; }
};

}  // namespace brume

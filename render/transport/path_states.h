#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "base/vec.h"

// The paths in flight on one thread, in single precision, one array per member.

namespace brume {

constexpr size_t kPool = 2048;   ///< paths in flight per thread: their state stays in the second-level cache
constexpr size_t kPadding = 64;  ///< lists may be read up to a vector past their end: those slots belong to no path

/// A number for each slot.
template <class T>
using Column = std::array<T, kPool + kPadding>;

/// A vector or a colour for each slot.
struct Column3 {
  Column<float> x, y, z;

  vec3 operator[](size_t slot) const { return {x[slot], y[slot], z[slot]}; }
  void set(size_t slot, const vec3& v) {
    x[slot] = v.x;
    y[slot] = v.y;
    z[slot] = v.z;
  }
};

/// Rays in a grid's local coordinates and lane units (LaneScene::unit), for each slot.
struct LocalRays {
  Column3 o, d;
  Column<float> end;  ///< ray parameter; only where rays can end before the grid does
};

/// State of the paths of one thread.
struct PathStates {
  LocalRays flight;      // where Plan::one_grid from event to event, elsewhere for one flight through one medium
  LocalRays shadow;      // towards the light sample, likewise; where Plan::one_grid from the flight's origin
  Column<float> travel;  // ray parameter of a flight's collision; only where flights can end before the grid does
  Column3 d;             // direction: world, unit
  Column3 throughput;
  Column3 contribution;  // of the light sample, unoccluded
  Column3 wi;            // its direction, world; not where Plan::one_grid
  Column<float> pdf;     // of the last direction
  Column<float> mis;     // the light sample's weight against direction sampling; where Plan::one_grid with groups alone
  Column<float> transmittance;
  // Only in chromatic scenes: each channel's density of the path's choices; what a flight through a medium
  // multiplied weight and density with; the colour of the shadow ray's transmittance; the channel that decides.
  Column3 channel_density, flight_factor, shadow_colour;
  Column<int32_t> hero;
  Column<float> time;                  // in [0, 1] of the shutter; only where LaneScene::displaced
  Column<float> camera_transmittance;  // of the camera ray
  Column3 direct, indirect;
  std::array<Column<uint32_t>, 4> generator;  // xoshiro128++
  Column<uint32_t> events;
  Column<uint32_t> request;  // which of the batch
};

/// A list of slots, padded so that whole vectors can be read.
struct SlotList {
  std::array<int32_t, kPool + kPadding> slot;
  size_t count = 0;

  class Iterator {
   public:
    explicit Iterator(const int32_t* at) : at_(at) {}
    size_t operator*() const { return static_cast<size_t>(*at_); }
    Iterator& operator++() {
      ++at_;
      return *this;
    }
    bool operator==(const Iterator&) const = default;

   private:
    const int32_t* at_;
  };
  Iterator begin() const { return Iterator(slot.data()); }
  Iterator end() const { return Iterator(slot.data() + count); }
  size_t operator[](size_t k) const { return static_cast<size_t>(slot[k]); }
  void clear() { count = 0; }
  void push(size_t s) { slot[count++] = static_cast<int32_t>(s); }
  /// Drops the slots for which keep(slot) is false.
  template <class Keep>
  void keep_if(const Keep& keep) {
    const size_t all = count;
    clear();
    for (size_t k = 0; k < all; ++k)
      if (keep((*this)[k])) push((*this)[k]);
  }
  void pad() {
    std::fill(slot.begin() + static_cast<std::ptrdiff_t>(count),
              slot.begin() + static_cast<std::ptrdiff_t>(count + kPadding), static_cast<int32_t>(kPool));
  }
};

}  // namespace brume

#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "render/transport/path_states.h"
#include "volume/medium.h"

namespace brume {

/// Takes rays to the instances of a medium that they meet: first to the one in which their paths collided last, where
/// most of them end, then to the others, nearest first. Of all rays at a time to the next one of each.
class InstanceVisits {
 public:
  /// None is visited yet. @param first  instance; below 0: there is none
  void begin(size_t slot, int32_t first) {
    OfRay& own = rays_[slot];
    own.last = {};
    own.count = own.at = 0;
    own.first = first;
    own.begins = true;
    own.told = false;
    own.around.reset();
  }
  /// The next instance that a ray meets before `end`; false where there is none.
  bool next(const Instances& instances, size_t slot, const Ray& ray, double end) {
    OfRay& own = rays_[slot];
    if (own.begins) {
      own.begins = false;
      instance[slot] = own.first;
      if (own.first >= 0) return true;
    } else if (own.first >= 0 && !own.told && end < kUnbounded) {
      // A ray that ends where it began meets no others but those around.
      own.told = true;
      const auto number = static_cast<size_t>(own.first);
      const auto [from, to] = instances.part(number, ray, kUnbounded);
      if (from == 0 && end <= to) own.around = instances.around(number);
    }
    if (own.around) {
      while (own.at < own.around->size()) {
        const uint32_t other = (*own.around)[own.at++];
        const auto [from, to] = instances.part(other, ray, end);
        instance[slot] = static_cast<int32_t>(other);
        if (from < to) return true;
      }
      return false;
    }
    while (next_in_order(instances, own, ray, end)) {
      instance[slot] = static_cast<int32_t>(own.last.number);
      if (instance[slot] != own.first) return true;
    }
    return false;
  }

  std::array<int32_t, kPool> instance;  ///< by slot: that is visited

 private:
  static constexpr size_t kAtOnce = 4;
  struct OfRay {
    std::array<Instances::Met, kAtOnce> met;
    Instances::Met last;
    uint32_t count, at;
    int32_t first;
    bool begins, told;                                // told: whether there are few around
    std::optional<std::span<const uint32_t>> around;  // of the first one, where no others are met
  };
  static bool next_in_order(const Instances& instances, OfRay& own, const Ray& ray, double end) {
    if (own.at == own.count) {
      if (own.count > 0 && own.count < kAtOnce) return false;
      own.count = static_cast<uint32_t>(instances.next(ray, end, own.last, own.met));
      own.at = 0;
      if (own.count == 0) return false;
    }
    own.last = own.met[own.at++];
    return own.last.t < end;
  }
  std::array<OfRay, kPool> rays_;
};

}  // namespace brume

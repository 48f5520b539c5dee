#pragma once
#include <array>
#include <cstdint>

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
    own.searched = false;
    instance[slot] = kNone;
  }
  /// The next instance that a ray may meet before `end`; false where there is none.
  bool next(const Instances& instances, size_t slot, const Ray& ray, double end) {
    OfRay& own = rays_[slot];
    if (instance[slot] == kNone && own.first >= 0) {
      instance[slot] = own.first;
      return true;
    }
    if (!own.searched) {
      own.searched = true;
      own.begin = instances.begin(ray);
      search(instances, own, ray, end);
    }
    for (;;) {
      if (own.at == own.count) {
        if (own.count < kAtOnce) return false;
        search(instances, own, ray, end);
        continue;
      }
      own.last = own.met[own.at++];
      if (own.begin + static_cast<double>(own.last.t) * kNearer >= end) return false;
      instance[slot] = static_cast<int32_t>(own.last.number);
      if (instance[slot] != own.first) return true;
    }
  }

  std::array<int32_t, kPool> instance;  ///< by slot: that is visited

 private:
  static constexpr int32_t kNone = -1;
  static constexpr size_t kAtOnce = 4;
  static constexpr double kNearer = 1 - 1e-5;  // than single precision rounds
  struct OfRay {
    std::array<Instances::Met, kAtOnce> met;
    Instances::Met last;
    uint32_t count, at;
    int32_t first;
    bool searched;
    double begin;  // Instances::begin
  };
  static void search(const Instances& instances, OfRay& own, const Ray& ray, double end) {
    own.count = static_cast<uint32_t>(
        own.first >= 0 ? instances.next_from(static_cast<size_t>(own.first), ray, end, own.last, own.met)
                       : instances.next(ray, own.begin, end, own.last, own.met));
    own.at = 0;
  }
  std::array<OfRay, kPool> rays_;
};

}  // namespace brume

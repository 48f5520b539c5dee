#pragma once
#include <array>
#include <cstdint>

#include "render/transport/path_states.h"
#include "volume/instances.h"

namespace brume {

/// Takes rays to the instances of a medium that they meet, nearest first: of all rays at a time the next one of each.
class InstanceVisits {
 public:
  /// None is visited yet.
  void begin(const SlotList& rays) {
    for (const size_t i : rays) rays_[i] = {};
  }
  /// The next instance that a ray meets before `end`; false where there is none.
  bool next(const Instances& instances, size_t slot, const Ray& ray, double end) {
    OfRay& own = rays_[slot];
    if (own.at == own.count) {
      if (own.count > 0 && own.count < kAtOnce) return false;
      own.count = static_cast<uint32_t>(instances.next(ray, end, own.last, own.met));
      own.at = 0;
      if (own.count == 0) return false;
    }
    own.last = own.met[own.at++];
    instance[slot] = static_cast<int32_t>(own.last.number);
    return own.last.t < end;
  }

  std::array<int32_t, kPool> instance;  ///< by slot: that is visited

 private:
  static constexpr size_t kAtOnce = 4;
  struct OfRay {
    std::array<Instances::Met, kAtOnce> met;
    Instances::Met last;
    uint32_t count = 0, at = 0;
  };
  std::array<OfRay, kPool> rays_;
};

}  // namespace brume

#include "volume/constant_parts.h"

#include <algorithm>
#include <bit>
#include <cstddef>

#include "volume/voxel_box.h"

namespace brume {

void normalise(std::vector<ConstantPart>& list, int width) {
  const auto covers = [&](const ConstantPart& c) {
    return glm::all(glm::lessThanEqual(c.lo, ivec3(0))) && glm::all(glm::greaterThanEqual(c.hi, ivec3(width)));
  };
  for (size_t i = list.size(); i-- > 1;)
    if (covers(list[i])) {
      list = {list[i]};
      break;
    }
  constexpr size_t kFew = 16;
  if (list.size() > kFew) return;
  const auto join = [](ConstantPart& a, const ConstantPart& b) {
    if (std::bit_cast<uint32_t>(a.value) != std::bit_cast<uint32_t>(b.value)) return false;
    int apart = 0, axis = 0;
    for (int k = 0; k < 3; ++k)
      if (a.lo[k] != b.lo[k] || a.hi[k] != b.hi[k]) ++apart, axis = k;
    if (apart > 1 || a.lo[axis] > b.hi[axis] + 1 || b.lo[axis] > a.hi[axis] + 1) return false;
    a = {glm::min(a.lo, b.lo), glm::max(a.hi, b.hi), a.value};
    return true;
  };
  for (size_t i = 0; i < list.size(); ++i)
    for (size_t k = i + 1; k < list.size();)
      if (join(list[i], list[k])) {
        list.erase(list.begin() + static_cast<std::ptrdiff_t>(k));
        k = i + 1;
      } else {
        ++k;
      }
}

Distribution::Distribution(const std::vector<ConstantPart>& list, const ivec3& parts, int bits) {
  first_.resize(static_cast<size_t>(product(parts)) + 1);
  const auto each = [&](const auto& visit) {
    for (size_t i = 0; i < list.size(); ++i) {
      const ivec3 from = glm::max(ivec3(0), (list[i].lo - 1) >> bits), to = glm::min(parts - 1, list[i].hi >> bits);
      for (int x = from.x; x <= to.x; ++x)
        for (int y = from.y; y <= to.y; ++y)
          for (int z = from.z; z <= to.z; ++z)
            visit((static_cast<size_t>(x) * parts.y + y) * parts.z + z, static_cast<uint32_t>(i));
    }
  };
  each([&](size_t part, uint32_t) { ++first_[part + 1]; });
  for (size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
  members_.resize(first_.back());
  std::vector<size_t> next(first_.begin(), first_.end() - 1);
  each([&](size_t part, uint32_t i) { members_[next[part]++] = i; });
}

}  // namespace brume

#pragma once
#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <string>
#include <vector>

namespace brume::test {

/// A test that runs once for every instruction set that this machine has and the kernels are compiled for.
class EveryTarget : public ::testing::TestWithParam<int64_t> {
 protected:
  void SetUp() override { hwy::SetSupportedTargetsForTest(GetParam()); }
  void TearDown() override { hwy::SetSupportedTargetsForTest(0); }
};

/// Calls visit(name) under each instruction set that this machine has, then leaves the best one.
/// @return how many there were
template <class Visit>
int on_every_target(const Visit& visit) {
  int seen = 0;
  for (int64_t targets = hwy::SupportedTargets(); targets; targets &= targets - 1, ++seen) {
    const int64_t target = targets & -targets;
    hwy::SetSupportedTargetsForTest(target);
    visit(std::string(hwy::TargetName(target)));
  }
  hwy::SetSupportedTargetsForTest(0);
  return seen;
}

inline std::vector<int64_t> targets() {
  std::vector<int64_t> list;
  for (int64_t bits = hwy::SupportedTargets() & HWY_TARGETS; bits != 0; bits &= bits - 1)
    list.push_back(bits & ~(bits - 1));
  return list;
}

inline std::string target_name(const ::testing::TestParamInfo<int64_t>& target) {
  return hwy::TargetName(target.param);
}

}  // namespace brume::test

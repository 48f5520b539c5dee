#pragma once
#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <string>
#include <vector>

namespace brume::test {

/// A test that runs once for every instruction set this machine has.
class EveryTarget : public ::testing::TestWithParam<int64_t> {
 protected:
  void SetUp() override { hwy::SetSupportedTargetsForTest(GetParam()); }
  void TearDown() override { hwy::SetSupportedTargetsForTest(0); }
};

inline std::vector<int64_t> targets() {
  std::vector<int64_t> list;
  for (int64_t bits = hwy::SupportedTargets(); bits != 0; bits &= bits - 1)
    if (const int64_t one = bits & ~(bits - 1); std::string(hwy::TargetName(one)) != "Unknown") list.push_back(one);
  return list;
}

inline std::string target_name(const ::testing::TestParamInfo<int64_t>& target) {
  return hwy::TargetName(target.param);
}

}  // namespace brume::test

#pragma once
#include <gtest/gtest.h>

#include <string>

#include "tests/support/files.h"

namespace brume::test {

inline bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// Commands of the program that read and write files in a folder of their own.
class CommandFolder : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  void run(const std::string& arguments) {
    const auto r = run_brume(arguments);
    ASSERT_EQ(r.status, 0) << arguments << "\n" << r.err;
  }
  /// What is said of bad input.
  std::string refused(const std::string& arguments) {
    const auto r = run_brume(arguments);
    EXPECT_EQ(r.status, 2) << arguments;
    return r.err;
  }
  TemporaryFolder folder_;
};

}  // namespace brume::test

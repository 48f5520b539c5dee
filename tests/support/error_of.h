#pragma once
#include <functional>
#include <string>

#include "base/error.h"

namespace brume::test {

/// The words of the InputError that some work ends with; empty where it ends well.
inline std::string error_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

}  // namespace brume::test

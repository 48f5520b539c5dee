#pragma once
#include <stdexcept>
#include <string>

namespace brume {

/// Bad input: a file, a scene, an option. The message says where, what was found, what was expected and what exists
/// instead. Only app/ catches it: one line on stderr, exit status 2.
struct InputError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The user asked to stop. Nothing half-written is left behind; exit status 3.
struct Interrupted : std::runtime_error {
  explicit Interrupted(const std::string& what_is_left = "no file was left half-written")
      : std::runtime_error("interrupted; " + what_is_left) {}
};

}  // namespace brume

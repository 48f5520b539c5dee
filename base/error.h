#pragma once
#include <new>
#include <stdexcept>
#include <string>

namespace brume {

/// Bad input: a file, a scene, an option. The message says where, what was found, what was expected and what exists
/// instead. Only apps/ catches it: one line on stderr, exit status 2.
struct InputError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Memory was not enough for what the message says. No InputError: a file that could not be held is not damaged, and
/// what is missing of a shot is not rendered again because of it. One line on stderr, exit status 2.
class OutOfMemory : public std::bad_alloc {
 public:
  explicit OutOfMemory(const std::string& message) : message_(message) {}
  /// "f.exr: not enough memory to read it, which takes at least 1.2 GB"
  /// @param bytes  0: not known
  OutOfMemory(const std::string& where, const std::string& purpose, double bytes = 0);
  const char* what() const noexcept override { return message_.what(); }

 private:
  std::runtime_error message_;  // is copied without throwing
};

/// Stands in the messages that tell of it.
constexpr const char* kNotEnoughMemory = "not enough memory";

/// For a handler of std::bad_alloc: throws OutOfMemory "WHERE: not enough memory to read it", or the one that it is.
[[noreturn]] void fail_reading(const std::string& where, const std::bad_alloc& error);

/// The user asked to stop. Nothing half-written is left behind; exit status 3.
struct Interrupted : std::runtime_error {
  explicit Interrupted(const std::string& what_is_left = "no file was left half-written")
      : std::runtime_error("interrupted; " + what_is_left) {}
};

}  // namespace brume

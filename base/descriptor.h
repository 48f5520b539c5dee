#pragma once
#include <fcntl.h>
#include <unistd.h>

namespace brume {

/// A copy of a descriptor that does not lie where a child's own ones go, closed in the end and by programs that are
/// started.
class Descriptor {
 public:
  explicit Descriptor(int of) : number_(fcntl(of, F_DUPFD_CLOEXEC, 16)) {}
  ~Descriptor() { reset(); }
  Descriptor(Descriptor&&) = delete;
  int number() const { return number_; }
  void reset() {
    if (number_ >= 0) close(number_);
    number_ = -1;
  }

 private:
  int number_;
};

}  // namespace brume

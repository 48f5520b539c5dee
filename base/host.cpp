#include "base/host.h"

#include <sys/utsname.h>

#include <cerrno>
#include <csignal>

namespace brume {

std::string host_name() {
  utsname names{};
  return uname(&names) == 0 ? names.nodename : "unknown";
}

bool is_gone(const std::string& host, int process) {
  return process > 0 && host == host_name() && kill(process, 0) != 0 && errno == ESRCH;
}

}  // namespace brume

#pragma once
#include <string>

namespace brume {

/// This machine's name, as `uname -n` prints it.
std::string host_name();

/// Whether a process is known to be gone: it ran on this machine and runs no more. Of other machines nothing is known.
bool is_gone(const std::string& host, int process);

}  // namespace brume

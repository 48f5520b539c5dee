#pragma once
#include <string>

namespace brume {

/// The part of docs/filters.md that says how to compare a filter of one's own: a command, a function of Python, a file
/// of C++. A test runs its examples.
std::string own_filters_reference();

}  // namespace brume

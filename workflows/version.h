#pragma once
#include <string>

#include "image/layers.h"

namespace brume {

/// "0.1.0", and the commit it was built from.
std::string version_number();
std::string version_commit();
/// Both, as `--version` prints them: states of renders by another are refused.
std::string version_text();
/// Software, version, commit, into the header.
void stamp(Layers& layers);

}  // namespace brume

#pragma once
#include <set>
#include <string>
#include <vector>

#include "image/layers.h"

namespace brume::app {

/// An EXR with brume's layer names, whoever wrote it. `note` gets a line when another renderer's were recognised.
/// @param wanted  channels to load; empty: all. Another renderer's frame is loaded whole
/// @throws InputError
Layers read_frame(const std::string& path, const std::set<std::string>& wanted = {}, std::string* note = nullptr);

/// Names of the RGB and other layers in a frame, without statistics; "beauty" for the top.
std::vector<std::string> layer_names(const Layers& frame);

/// "header" (1 where the header has none), "auto" or a number above 0. @throws InputError
double choose_exposure(const std::string& option, const Layers& frame);

}  // namespace brume::app

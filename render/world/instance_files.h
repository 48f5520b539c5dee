#pragma once
#include <filesystem>
#include <string>

#include "render/scene/scene.h"

namespace brume {

/// The places of [[instances]], with a density and a tint for each.
/// @param name  of the entry, for errors: "instances.0"
/// @throws InputError: a file that cannot be read, the line or point at fault and what was expected; a matrix that is
///         singular or no number; a density or a tint that is negative; no places, or too many
InstanceList places_of(const InstanceSettings& settings, const std::string& name);

}  // namespace brume

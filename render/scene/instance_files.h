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

/// Whether a list in memory holds what a scene can take: a density and a tint for each place, or none, at least 0.
/// @return  what tells it from others   @throws InputError
std::string check_places(const std::string& name, const InstanceList& list);

}  // namespace brume

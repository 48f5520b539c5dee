#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "base/vec.h"
#include "image/layers.h"

namespace brume {

/// How much of each light group a picture has, by colour: 1 is as it was rendered. Groups that are not named stay.
using LightMix = std::map<std::string, dvec3>;

/// "key=2" into a factor of all colours, "fill=1,.8,.6" into one of each; both multiply.
/// @throws InputError for what is neither
void add_to_mix(LightMix& mix, const std::string& assignment);

/// @param of  who has the groups, for the message   @throws InputError for a group that is none of them
void check_light_groups(const LightMix& mix, const std::vector<std::string>& groups, const std::string& of);

/// Whether a channel holds light of all groups together, which no mix of them can tell.
bool is_light_of_all_groups(std::string_view channel);

/// "key = 2, 2, 2; rim = 0, 0, 0"
std::string text_of_mix(const LightMix& mix);

/// A frame with light groups as it would be with other lights: the sum of its groups, clean ones where it is clean.
/// Groups have their new light and statistics; parts of the picture that are not known by group are left out.
/// @throws InputError for a frame without groups, or without one that is named
Layers mix_lights(const Layers& frame, const LightMix& mix);

/// What makes a scene's lights as the mix has them: assignments for edited_scene.
/// @throws InputError for a group that the scene does not have, and for a colour of a black body
std::vector<std::string> assignments_of_mix(const std::string& text, const std::filesystem::path& path,
                                            const LightMix& mix);

}  // namespace brume

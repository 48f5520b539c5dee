#pragma once
#include <array>
#include <map>
#include <string>

#include "image/foreign.h"
#include "image/layers.h"

namespace brume {

/// Channels of light, each with the names under which a frame then has its two halves.
using HalvesOf = std::map<std::string, std::array<std::string, 2>>;

/// Those of a frame by brume, and of another renderer's picture, whose signals are given them.
HalvesOf halves_of_layers(const Layers& frame);
HalvesOf halves_of_signals(const ForeignFrame& picture);
/// Tells a picture that its signals have halves under those names, and twice the samples.
void give_halves(ForeignFrame& picture);

/// Two renders of one frame whose noise is independent become one frame: every channel is the mean of both, or for
/// counts of samples their sum, variances become those of the mean, and light has the two as its halves.
/// @param names  by which errors call the two
/// @throws InputError: another size, place or scene; a channel is missing; the very same pixels
void join_second(Layers& frame, const Layers& second, const HalvesOf& halves, const std::array<std::string, 2>& names);

/// The same of two frames of any renderer, in memory.
Layers joined(const Layers& frame, const Layers& second, const std::array<std::string, 2>& names);

}  // namespace brume

#pragma once
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "volume/medium.h"

namespace brume {

struct ScalarField;

/// Refuses numbers that single precision cannot multiply.
/// @param named  the file, or what stands for it in errors   @throws InputError
void check_range(const ScalarField& field, std::string_view named);

/// What a person should know of flights through a medium before anything is rendered: that they take very long, with
/// the densities that make it so. Nothing where they do not.
/// @param medium  of a grid, with the majorants of the render   @param grid  its name
/// @param number  of the volume in the scene                     @throws InputError where flights would never end
std::optional<std::string> flights_note(const Medium& medium, std::string_view grid, std::string_view named,
                                        size_t number);

}  // namespace brume

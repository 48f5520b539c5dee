#pragma once
#include <functional>
#include <string>
#include <vector>

#include "image/color_space.h"
#include "image/layers.h"

namespace brume {

/// Makes the colours of a picture that lights or colours a scene usable: in the scene's space, finite, not negative.
/// NaN and negative values count as 0, positive infinity as the largest finite value of the picture, as in volumes
/// (volume/stored_values.h); colours of another space are converted (image/color_space.h), and what lies outside of
/// the scene's then, negative in a channel, is 0 there.
/// @param picture  has layer::beauty; its header says which space that is, Rec. 709 where it says nothing
/// @param name     the file's
/// @param space    the scene's
/// @return         a line for each kind of thing that was done, none where nothing had to be
/// @throws InputError: chromaticities that are none
std::vector<std::string> repair_colors(Layers& picture, const std::string& name, const WorkingSpace& space = {});

/// Multiplies R, G and B of layers by a matrix, pixel by pixel, negative ones and all.
/// @param wanted  says of a layer's name, empty for the beauty, whether it is one of them
void convert_colors(Layers& frame, const dmat3& matrix, const std::function<bool(const std::string&)>& wanted);

/// Brings the light in a frame, and the albedos, to linear Rec. 709 where its header says that they are another
/// space's. Variances, which a matrix cannot convert, stay.
/// @param name  the frame's, for errors   @return the name of the space that it was; empty where nothing was done
/// @throws InputError: chromaticities that are none
std::string convert_to_rec709(Layers& frame, const std::string& name);

}  // namespace brume

#pragma once
#include <optional>

#include "evaluate/protocol/protocol.h"
#include "image/picture_io.h"

namespace brume {

/// Noisy frame, each filter, reference in a row; below, the Lab distance of each to the reference in false colour.
/// Nothing where no method has that tuning.
std::optional<Picture> comparison_strip(const SceneResult& scene, int spp, Tuning tuning);

/// False colour from black over red and yellow to white at `full` and above.
Picture error_picture(const Plane& error, double full);

/// Draws a line of text, its top left corner at (x, y), 8 px high times `scale`.
void draw_text(Picture& picture, int x, int y, const std::string& text, int scale = 1);

}  // namespace brume

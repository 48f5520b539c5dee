#pragma once
#include <string>

#include "image/display.h"

namespace brume::web {

/// A display as a cube of colours between which a page interpolates, which is far faster than the display itself: the
/// header's length (32 bits) and the header, in JSON, then 16-bit values, RGB after RGB, red fastest, 65535 for white.
/// The first node of an edge is black, the next one 2^lowest, the others per_stop to each doubling, so that white is a
/// node. Within 1/255 of the display where it is smooth, or breaks at powers of two.
std::string cube_of(const Display& display);

}  // namespace brume::web

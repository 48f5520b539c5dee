#pragma once
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "base/progress.h"
#include "image/layers.h"

namespace brume {

/// New values for a channel of a file that is copied.
struct ExrEdit {
  std::string channel;  ///< as read_exr names it
  const Plane* values;
  PixelWindow window;       ///< where the values lie, as Layers::data_window(); holds the part's data window
  std::string beside = {};  ///< name of a new channel that takes the values, of the same type, in the same part; empty:
                            ///< they replace the channel's
};

/// What could not be kept to the bit.
struct ExrCopyReport {
  std::vector<std::string> recoded;  ///< parts whose other channels were unpacked and packed again with loss
  std::vector<std::string> rounded;  ///< parts that keep 24 bits of the floats that were put in (PXR24)
};

/// Writes a file again with some channels replaced or added: every part, channel, pixel type, compression, window,
/// tile, resolution level, attribute and their order stay. Parts without edits are copied packed as they are; in others
/// all other channels keep their bits, unless the part's compression loses some (B44, DWA). Deep parts are copied, too.
///
/// Lower resolution levels of an edited channel are made anew, each pixel the mean of the area that it covers; a
/// subsampled one takes tent-weighted means. Edits of R, G and B go into a part's Y, RY and BY, all three together.
/// Half channels take values up to their largest finite one.
///
/// The file appears whole or not at all.
/// @param attributes  added to the header of each part that is edited
/// @param task        only whether it is cancelled
/// @throws InputError: missing, not an EXR, truncated, nothing but deep pixels, a new channel's name is taken; cannot
/// be written;
/// Interrupted;
///         std::logic_error for an edit of a channel that the file has not, or of whole numbers
ExrCopyReport copy_exr(const std::filesystem::path& from, const std::filesystem::path& to,
                       std::span<const ExrEdit> edits, const std::map<std::string, Attribute>& attributes = {},
                       const Task& task = {});

/// Rounds to what a half channel can hold: to nearest, its largest finite value for more; NaN and infinities stay.
void round_to_half(Plane& plane);

}  // namespace brume

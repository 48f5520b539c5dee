#pragma once

namespace brume {

/// A radiance as a display's code value: times exposure, clipped to [0, 1], sRGB-encoded. Interpolated in a table,
/// within 2e-6 of the curve; for metrics over millions of pixels.
float srgb_code(float radiance, double exposure);

}  // namespace brume

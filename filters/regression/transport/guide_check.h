#pragma once
#include "base/progress.h"
#include "image/layers.h"

namespace brume {

/// How well guides explain a frame, against its own features.
struct GuideCheck {
  /// Mean squared error of the luminance at pixels that the fits do not know, noise included.
  double guides = 0, features = 0;
  double standard_error = 0;  ///< of their difference
  /// Guides of another scene or camera do; the right ones of four media do not, at 1 to 64 samples per pixel
  /// (docs/frames.md).
  bool misleads() const { return guides > 1.1 * features && guides - features > 1.5 * standard_error; }
};

/// Fits the luminance of a frame's beauty twice, by regression on its guides and by regression on a constant and the
/// features that it has, each in windows from the whole frame to 4 px, and judges both where the medium of the guides
/// is: each half image by the fit of the other, without halves the pixels of one colour of a chessboard by the fit of
/// those of the other. Each side is judged by its best window.
/// @param frame  with R, G, B and guides
GuideCheck check_guides(const Layers& frame, const Task& task);

}  // namespace brume

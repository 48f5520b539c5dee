#pragma once
#include <optional>
#include <string>
#include <vector>

#include "evaluate/metrics/metric.h"
#include "workflows/frame.h"
#include "workflows/host.h"

namespace brume {

/// A picture and its reference, cut to the pixels that both have: what lies outside a data window is absent, not black.
class Comparison {
 public:
  /// Tells where frames were rendered from scenes that differ, so that their difference is no error alone.
  /// @param second  an independent reference, to take the references' noise off
  /// @throws InputError for unequal display windows, and when no pixel is common
  Comparison(NamedFrame picture, NamedFrame reference, std::optional<NamedFrame> second, const Host& host);

  /// The colours of a layer; the beauty for an empty name. @throws InputError with the layers there are
  RgbPlanes picture(const std::string& layer = "") const { return colours(picture_, layer); }
  RgbPlanes reference(const std::string& layer = "") const { return colours(reference_, layer); }
  /// The second reference's; null pointers where there is none.
  RgbPlanes second(const std::string& layer = "") const { return second_ ? colours(*second_, layer) : RgbPlanes{}; }

  /// Layers of three colours that both have, the beauty aside; halves, variances and guides are no pictures.
  std::vector<std::string> common_layers() const;
  const PixelWindow& window() const { return window_; }
  const PixelWindow& display() const { return display_; }
  /// Where the reference shows the medium; empty where it does not tell.
  const Mask& medium() const { return medium_; }
  /// @param exposure  as choose_exposure takes it, of the reference   @param clip  to [0, 1] before CIE-Lab
  LabPolicy policy(const std::string& exposure, bool clip) const {
    return {choose_exposure(exposure, reference_.frame), clip};
  }
  /// Over the whole picture, and where it is known the medium.
  std::vector<Errors> errors(const std::string& layer, const LabPolicy& policy, ErrorScope scope,
                             const Task& task) const;

 private:
  static RgbPlanes colours(const NamedFrame& frame, const std::string& layer);

  NamedFrame picture_, reference_;
  std::optional<NamedFrame> second_;
  PixelWindow window_, display_;
  Mask medium_;
};

}  // namespace brume

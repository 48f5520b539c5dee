#pragma once
#include <string>

#include "filters/run/apply.h"
#include "render/film/film.h"
#include "render/session/render_job.h"
#include "workflows/host.h"

namespace brume {

/// The clean picture of a render, and where its next samples do most for it.
class Cleaner {
 public:
  /// @param filter  as `denoise -f` takes it: NAME or NAME:parameter=value,...   @throws InputError
  Cleaner(const std::string& filter, double exposure, Host host, Outliers outliers = Outliers::kExtreme);

  /// What a render must record for it, beside `wanted`. Guides that were not asked for are not in the clean frame.
  /// @param samples  per pixel that will be rendered
  /// @throws InputError for a filter that could not run on what will be recorded
  LayerRequest request(const LayerRequest& wanted, int samples);

  /// Whether the frames that are cleaned may hold a channel in Layers::stored: after request().
  bool may_store(const std::string& channel) const;

  /// The frame with the clean picture on top: the raw one goes to `noisy`, the parts to clean_direct and
  /// clean_indirect, the estimated error to clean_error, where the filter makes them.
  Layers clean(Layers frame);
  /// The same, with the parts of direct and indirect light that are recorded clean too (clean_parts).
  Layers clean_with_parts(Layers frame);

  /// The round after this one; without goals where the target is reached, or nothing can be gained.
  ///
  /// With a filter that estimates its error, samples are spread so that the sum of the squared relative errors falls
  /// most, each tile's squared error falling like samples^-0.8; with one that makes a map of samples (sobel_guided), by
  /// it; evenly otherwise. The last round is as long as the errors of the rounds so far say that it must be.
  /// @param target  relative error of the clean picture (Cleaner::error); 0: none
  NextRound next_round(const RenderRound& round, double target);

  /// Estimated relative error of the last picture: root of the mean over pixels of clean_error^2 / (mean^2 + 0.01
  /// white^2), white being 1 / exposure. Below 0 where the filter estimates none.
  double error() const { return error_; }
  bool estimates_error() const;
  const FilterSettings& filter() const { return filter_; }
  /// The clean picture of the last round.
  const Layers& picture() const { return picture_; }
  /// Cleans its light groups, too: they add up to it.
  void clean_lights_of_picture();
  double seconds() const { return seconds_; }

 private:
  Layers clean(Layers frame, bool parts);
  double relative_square(double error, double luminance) const;

  FilterSettings filter_;
  double exposure_, error_ = -1, seconds_ = 0;
  Outliers outliers_;
  Host host_;
  Layers picture_;
  bool keep_guides_ = false;
};

}  // namespace brume

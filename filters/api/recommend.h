#pragma once
#include <string>

#include "filters/api/filter.h"
#include "filters/api/options.h"

namespace brume {

struct Recommendation {
  FilterSettings filter;
  std::string reason;  ///< why it, and what the frame lacks for a better one, in one line
};

/// The filter of the highest merit that can run on a frame with these options, at its defaults. Only which layers there
/// are counts, so that one pixel of each is enough. A filter that reads guides is not recommended without any.
/// @param sequence  it must look into the frames before and after
/// @throws InputError when the frame has no channels R, G, B, or not the layers of the component
Recommendation recommend_filter(const Layers& frame, const ApplyOptions& options, bool sequence = false);

}  // namespace brume

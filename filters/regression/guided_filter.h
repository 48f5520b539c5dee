#pragma once
#include <span>
#include <vector>

#include "base/progress.h"
#include "image/plane.h"

namespace brume {

/// The guided filter with a guide of any number of channels: q = mean(a) . I + mean(b), where a, b are the ridge
/// regression of each input on the guide in the square window around each pixel, (Sigma + eps U) a = cov(I, p),
/// b = mean p - a . mean I. Windows are clipped to the image.
/// Source: He, Sun and Tang 2013, Guided Image Filtering, equations 11 to 20.
std::vector<Plane> guided_filter(std::span<const Plane* const> inputs, std::span<const Plane* const> guide, int radius,
                                 float eps, const Task& task);

}  // namespace brume

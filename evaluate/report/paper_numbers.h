#pragma once
#include <optional>
#include <string>

namespace brume {

/// What Table 1 of the gradient-kernel paper prints for a scene, spp and filter.
struct PaperNumbers {
  double rms = 0, seconds = 0;
};
std::optional<PaperNumbers> paper_numbers(const std::string& scene, const std::string& filter, int spp);

}  // namespace brume

#include "render/world/volume_checks.h"

#include <fmt/format.h>

#include "base/error.h"
#include "volume/majorant_cost.h"
#include "volume/volume_grids.h"

namespace brume {
namespace {

void check_depth(const Medium& medium, std::string_view named) {
  constexpr double kMost = 1e30;
  const double depth = medium.extinction_per_density() * medium.maximum_density() * 2 * medium.bounding_sphere().radius;
  if (depth <= kMost) return;
  throw InputError(fmt::format(
      "{}: sigma_t = {:.3g} on densities up to {:.3g} makes an optical depth of {:.3g}; expected at most {:.0e}", named,
      medium.extinction_per_density(), medium.maximum_density(), depth, kMost));
}

}  // namespace

void check_range(const ScalarField& field, std::string_view named) {
  constexpr double kLeast = 1e-30, kMost = 1e30;
  const double highest = field.bricks.maximum();
  if (field.bricks.empty() || (highest >= kLeast && highest <= kMost)) return;
  throw InputError(fmt::format(
      "{}: grid '{}' holds values up to {:.3g}; expected its largest value within {:.0e} .. {:.0e}: another unit, or damage",
      named, field.summary.name, highest, kLeast, kMost));
}

std::optional<std::string> flights_note(const Medium& medium, std::string_view grid, std::string_view named,
                                        size_t number) {
  constexpr double kSlow = 1e6, kEndless = 1e12;  // tentative collisions; a core takes some ten million a second
  const double most = most_tentative_collisions(medium);
  if (!(most > kSlow)) {
    check_depth(medium, named);
    return {};
  }
  const auto q = density_quantiles(medium.bricks(), {0.5, 0.99, 0.9999});
  const bool few = q.at(2) < 0.1 * medium.maximum_density();  // so large that they may be damage
  std::string text = fmt::format(
      "{}: grid '{}' holds densities up to {:.3g}: a flight through one cell may take {:.1g} steps{}; half of its positive voxels are at most {:.3g}, 99 % {:.3g}, 99.99 % {:.3g}; {}",
      named, grid, medium.maximum_density(), most, most > kEndless ? ", which never ends" : ", and the render be slow",
      q.at(0), q.at(1), q.at(2),
      few ? fmt::format("if the rest is damage, limit it: -D volumes.{}.max_density={:.3g}", number, q.at(2))
          : "expected a smaller sigma_t or density");
  if (most > kEndless) throw InputError(text);
  check_depth(medium, named);
  return text;
}

}  // namespace brume

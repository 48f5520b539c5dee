#pragma once
#include <memory>
#include <vector>

#include "render/world/environment.h"
#include "render/world/light_kinds.h"

namespace brume {

/// A sky as guides take it: small bright parts of a picture, as a sun or a window, count as suns; the rest is smooth.
class SkyParts {
 public:
  explicit SkyParts(const Environment& sky);

  const std::vector<std::unique_ptr<Sun>>& suns() const { return suns_; }
  /// Without the suns: what is around them in their place.
  dvec3 radiance(const dvec3& d) const;
  bool constant() const { return sky_.constant(); }

 private:
  struct Cell;
  size_t cell_of(const dvec3& d) const;
  /// Makes a sun of the brightest cells, if they are few and matter. @return  false where no cell is bright
  bool take_brightest(std::vector<Cell>& cells, double mean);

  const Environment& sky_;
  std::vector<std::unique_ptr<Sun>> suns_;
  std::vector<dvec3> around_;  // each sun, radiance
  std::vector<int> sun_;       // of each cell of directions; -1: none. Empty where there are no suns
};

}  // namespace brume

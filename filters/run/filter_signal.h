#pragma once
#include <map>
#include <set>
#include <string>
#include <vector>

#include "filters/run/tiles.h"

namespace brume {

/// Where the results of all tiles are gathered.
struct Gathered {
  using Target = std::array<Plane*, 3>;
  Layers layers;
  Target sum;                                // of the component's signals
  std::map<std::string_view, Target> parts;  // by signal, of a filter that cleans the parts apart
  std::vector<Target> carried;               // as options.carried
  std::map<std::string, Plane*> products;    // by full channel name

  Gathered(const Run& run, const Layers& frame);
};

struct Totals {
  size_t not_finite = 0;
  double energy = 0;  // that the outlier rule took
  size_t outliers = 0;
  RepairedPixels repaired_records;
  std::vector<std::string> notes;  // of the filter
};

/// What is measured once for the whole of a signal.
struct SignalLevel {
  double typical_luminance = 0, lab_noise = 0;
};

/// Filters one signal of a tile and adds the result to the sum; the first signal's weights also filter the carried
/// layers, and its run leaves the products.
void filter_signal(const Run& run, const std::vector<Source>& sources, const Tile& tile, const LayerName& name,
                   const SignalLevel& level, bool first_signal, Gathered& gathered, Totals& totals, const Task& task);

/// Calls visit(x, y) for the pixels of a box.
template <class Visit>
void for_each_pixel(const Box& box, const Visit& visit) {
  for (int y = box.y0; y < box.y1; ++y)
    for (int x = box.x0; x < box.x1; ++x) visit(x, y);
}

}  // namespace brume

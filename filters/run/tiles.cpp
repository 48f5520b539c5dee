#include "filters/run/tiles.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "base/peak_memory.h"
#include "filters/api/requirements.h"

namespace brume {
namespace {

// What a run may always hold, however little it reads [bytes]: tiles cost work for their aprons.
constexpr double kFreeMemory = 5e8;
constexpr int kSmallestTile = 128;

/// Side of the tiles, and what the run holds at its height [bytes].
/// @param channels  that the filter reads, of all frames together
int choose_tile(const FilterEntry& filter, const Layers& frame, const ApplyOptions& options, size_t channels, int apron,
                double& peak) {
  constexpr double kPrepared = 12;  // variance, result, background [planes]
  const double pixels = static_cast<double>(frame.width()) * frame.height();
  const double frames = static_cast<double>(1 + options.sequence.size());
  const double read = 4.0 * pixels * frames * static_cast<double>(frame.channels().size());
  double results = 4.0 + 3.0 * static_cast<double>(options.carried.size());
  for (const LayerName& l : filter.produces) results += static_cast<double>(l.channels.size());
  const double written = 4.0 * pixels * results;
  const double whole = 4.0 * frames * (filter.scratch + kPrepared);  // per pixel of the frame at once
  const double tiled = whole + 4.0 * static_cast<double>(channels);  // per pixel of a tile, which is cut out first
  const double budget = std::max(0.25 * read, kFreeMemory);
  const int longest = std::max(frame.width(), frame.height()), shortest = std::min(frame.width(), frame.height());
  int tile = filter.box ? longest : options.tile;
  if (tile == 0)
    // A frame that fits as a whole has no apron.
    tile = whole * pixels <= budget ? longest
                                    : std::max(kSmallestTile, static_cast<int>(std::sqrt(budget / tiled)) - 2 * apron);
  tile = std::clamp(tile, 1, longest);
  const double side = std::min<double>(tile + 2.0 * apron, longest);
  peak = read + written + (tile == longest ? whole : tiled) * side * std::min<double>(side, shortest);
  return tile;
}

/// Where any signal of any frame may change.
Box box_of(const Run& run, const std::vector<Source>& sources) {
  Box all{run.frame_size.x, run.frame_size.y, 0, 0};
  for (const Source& s : sources)
    for (const LayerName& signal : signals_of(run.options)) {
      const Box box = run.filter.entry().box(s.layers(), signal);
      if (box.width() <= 0) continue;
      all = {std::min(all.x0, box.x0), std::min(all.y0, box.y0), std::max(all.x1, box.x1), std::max(all.y1, box.y1)};
    }
  return all.width() > 0 ? all : Box{0, 0, 1, 1};
}

}  // namespace

TilePlan plan_tiles(const Run& run, const Layers& frame, const std::vector<Source>& sources) {
  const FilterEntry& entry = run.filter.entry();
  const int apron = run.filter.apron() + (entry.can_use_statistics > Statistics::kNone ? kNoiseReach : 0) +
                    (limits_outliers(run.options) ? kOutlierReach : 0);
  size_t channels = 0;
  for (const Source& s : sources) channels += s.channels();
  double peak = 0;
  const int side = choose_tile(entry, frame, run.options, channels, apron, peak);
  if (peak > physical_memory())
    throw InputError(
        fmt::format("filter {} would hold {:.1f} GB for this frame in tiles of {} px, this machine has {:.1f} GB{}",
                    entry.name, peak / 1e9, side, physical_memory() / 1e9,
                    side > kSmallestTile ? fmt::format("; try --tile {}", kSmallestTile) : ""));
  TilePlan plan{side, apron, (frame.width() + side - 1) / side, (frame.height() + side - 1) / side};
  if (entry.box) plan.box = box_of(run, sources);
  return plan;
}

}  // namespace brume

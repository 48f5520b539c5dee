#include "render/session/render_job.h"

#include <fmt/format.h>

#include "base/progress.h"

namespace brume {

std::string RenderReport::summary() const {
  const double paths = static_cast<double>(counters.paths), lookups = static_cast<double>(counters.tracking.lookups);
  std::string text = fmt::format(
      "{:.3g} paths in {} ({} of processor time): {:.3g} paths/s, {:.3g} look-ups/s, {:.1f} scatterings per path, longest {}\n",
      paths, format_duration(seconds), format_duration(cpu_seconds), paths / seconds, lookups / seconds,
      paths > 0 ? static_cast<double>(counters.tracking.collisions) / paths : 0.0, counters.longest);
  if (uneven)
    text += fmt::format("warning: the time ran out in the middle of a pass: some tiles have more than {} samples\n",
                        samples_per_pixel);
  if (counters.capped_paths)
    text += fmt::format("warning: {} paths were cut at max_events, carrying {:.3g} of the throughput of all paths\n",
                        counters.capped_paths, counters.capped_throughput / paths);
  if (const LimitedLight& limited = counters.limited; limited.paths)
    text += fmt::format("warning: indirect_limit took {:.3g} % of the indirect light, from {} paths\n",
                        100 * limited.taken / limited.found, limited.paths);
  if (invalid_samples)
    text += fmt::format("warning: {} samples were not finite and were left out{}\n", invalid_samples,
                        first_invalid ? fmt::format("; the first: --replay {},{},{}", first_invalid->x,
                                                    first_invalid->y, first_invalid->sample)
                                      : ", all of them before this session");
  if (counters.tracking.majorant_violations)
    text += fmt::format("warning: {} look-ups passed their majorant: a bug, please report it\n",
                        counters.tracking.majorant_violations);
  return text;
}

}  // namespace brume

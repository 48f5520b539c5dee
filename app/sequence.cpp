#include "app/sequence.h"

#include <fmt/format.h>

#include "base/error.h"
#include "base/sequence.h"
#include "base/text.h"

namespace brume::app {

int each_frame(const Common& common, const std::vector<int>& frames, const std::function<FrameEnd(int)>& work) {
  std::vector<int> done, missed, skipped, failed;
  std::string last_error;
  const auto fail = [&](int frame, const std::string& error) {
    failed.push_back(frame);
    warn(fmt::format("frame {} failed: {}", frame, error == last_error ? "for the same reason" : error));
    last_error = error;
  };
  const auto summary = [&] {
    std::vector<std::string> parts;
    for (const auto& [list, what] :
         {std::pair(&done, "done"), {&missed, "missed a threshold"}, {&skipped, "were complete"}, {&failed, "failed"}})
      if (!list->empty()) parts.push_back(fmt::format("{} {} ({})", list->size(), what, frames_text(*list)));
    return fmt::format("of {} frame{}: {}", frames.size(), frames.size() == 1 ? "" : "s",
                       parts.empty() ? "none done" : join(parts, "; "));
  };
  for (const int frame : frames) {
    try {
      const FrameEnd end = work(frame);
      (end == FrameEnd::kDone ? done : end == FrameEnd::kMissed ? missed : skipped).push_back(frame);
    } catch (const Interrupted&) {
      log(common, summary());
      throw;
    } catch (const InputError& error) {
      fail(frame, error.what());
    } catch (const OutOfMemory& error) {
      fail(frame, error.what());
    } catch (const std::bad_alloc&) {
      fail(frame, fmt::format("{} for it", kNotEnoughMemory));
    }
  }
  const bool well = failed.empty() && missed.empty();
  // Of a single frame all is said, and an error that is the last line is what a farm's log is read for.
  if (frames.size() > 1 && well) log(common, summary());
  if (frames.size() > 1 && !well) warn(summary());
  return well ? kDone : kThresholdFailed;
}

void check_pattern(const std::string& option, const std::string& name, const std::vector<int>& frames) {
  if (frames.size() > 1 && !name.empty() && !FramePattern::of(name))
    throw InputError(fmt::format("{} {}: all {} frames would go into one file; expected a name such as shot.####.exr",
                                 option, name, frames.size()));
}

}  // namespace brume::app

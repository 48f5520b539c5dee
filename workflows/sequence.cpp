#include "workflows/sequence.h"

#include <fmt/format.h>

#include "base/error.h"
#include "base/sequence.h"
#include "base/text.h"

namespace brume {
namespace {

std::string summary(const SequenceEnd& end, size_t frames) {
  std::vector<std::string> parts;
  for (const auto& [list, what] : {std::pair(&end.done, "done"),
                                   {&end.missed, "missed a threshold"},
                                   {&end.skipped, "were complete"},
                                   {&end.failed, "failed"}})
    if (!list->empty()) parts.push_back(fmt::format("{} {} ({})", list->size(), what, frames_text(*list)));
  return fmt::format("of {} frame{}: {}", frames, frames == 1 ? "" : "s",
                     parts.empty() ? "none done" : join(parts, "; "));
}

}  // namespace

SequenceEnd each_frame(const std::vector<int>& frames, const Host& host, const std::function<FrameEnd(int)>& work) {
  SequenceEnd ends;
  std::string last_error;
  const auto fail = [&](int frame, const std::string& error) {
    ends.failed.push_back(frame);
    host.message(fmt::format("frame {} failed: {}", frame, error == last_error ? "for the same reason" : error));
    last_error = error;
  };
  for (const int frame : frames) {
    try {
      const FrameEnd end = work(frame);
      (end == FrameEnd::kDone ? ends.done : end == FrameEnd::kMissed ? ends.missed : ends.skipped).push_back(frame);
    } catch (const Interrupted&) {
      host.log(summary(ends, frames.size()));
      throw;
    } catch (const InputError& error) {
      fail(frame, error.what());
    } catch (const OutOfMemory& error) {
      fail(frame, error.what());
    } catch (const std::bad_alloc&) {
      fail(frame, fmt::format("{} for it", kNotEnoughMemory));
    }
  }
  // Of a single frame all is said, and an error that is the last line is what a farm's log is read for.
  if (frames.size() > 1) host.say(ends.well() ? Host::Word::kLog : Host::Word::kMessage, summary(ends, frames.size()));
  return ends;
}

}  // namespace brume

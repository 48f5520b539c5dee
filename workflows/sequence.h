#pragma once
#include <functional>
#include <vector>

#include "workflows/host.h"

namespace brume {

/// What became of a frame of a sequence.
enum class FrameEnd {
  kDone,
  kMissed,   ///< written, but a threshold was missed
  kSkipped,  ///< was complete already
};

/// What became of a sequence's frames, by their numbers.
struct SequenceEnd {
  std::vector<int> done, missed, skipped, failed;

  bool well() const { return failed.empty() && missed.empty(); }
};

/// Works on frames one after another. One that fails is told, and the others go on; a summary ends it.
/// @throws Interrupted
SequenceEnd each_frame(const std::vector<int>& frames, const Host& host, const std::function<FrameEnd(int)>& work);

}  // namespace brume

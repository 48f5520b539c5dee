#pragma once
#include <functional>
#include <string>
#include <vector>

#include "app/command.h"

namespace brume::app {

/// What became of a frame of a sequence.
enum class FrameEnd {
  kDone,
  kMissed,   ///< written, but a threshold was missed
  kSkipped,  ///< was complete already
};

/// Works on frames one after another. One that fails is named on stderr, and the others go on; a summary ends it.
/// @return kDone, or kThresholdFailed where a frame failed or missed a threshold   @throws Interrupted
int each_frame(const Common& common, const std::vector<int>& frames, const std::function<FrameEnd(int)>& work);

/// Throws InputError unless an output's name has a place for the frame's number, which several frames need.
/// @param option  as on the command line
void check_pattern(const std::string& option, const std::string& name, const std::vector<int>& frames);

}  // namespace brume::app

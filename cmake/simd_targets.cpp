// Prints the instruction sets that a build for this machine alone needs, as Highway's names: what every processor has,
// and the best that this one has.
#include <hwy/targets.h>

#include <cstdio>

int main() {
  const int64_t supported = hwy::SupportedTargets() & HWY_TARGETS, best = supported & -supported;
  std::printf("HWY_%s|HWY_%s", hwy::TargetName(HWY_STATIC_TARGET), hwy::TargetName(best));
}

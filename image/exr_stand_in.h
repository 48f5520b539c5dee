#pragma once
#include <filesystem>
#include <memory>

#include "base/scratch_folder.h"

namespace brume {

/// The EXR that is read for a file: itself, or of a Radiance HDR picture or a portable float map an EXR of the same
/// values, R G B or Y, in a temporary folder that is removed in the end.
class ExrStandIn {
 public:
  /// @throws InputError: missing, damaged
  explicit ExrStandIn(const std::filesystem::path& file);
  const std::filesystem::path& exr() const { return exr_; }

 private:
  std::unique_ptr<ScratchFolder> folder_;  // null: it is an EXR itself, or nothing known
  std::filesystem::path exr_;
};

}  // namespace brume

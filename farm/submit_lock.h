#pragma once
#include <filesystem>
#include <string>

namespace brume {

/// Whoever plans and submits a shot holds FOLDER/submit.lock meanwhile, so that two do not submit the same work. The
/// file is made exclusively, which NFS does in one step too; it says host, process and time, and goes with this object.
class SubmitLock {
 public:
  /// Makes the folder too where it is missing.
  /// @param break_it  take it even from another   @throws InputError that says who holds it
  SubmitLock(const std::filesystem::path& folder, bool break_it);
  ~SubmitLock();
  SubmitLock(SubmitLock&&) = delete;

  /// "render7, process 4711, since 2026-11-23T20:15:04Z" where one of another was broken; else empty.
  const std::string& broken() const { return broken_; }

 private:
  std::filesystem::path file_;
  std::string text_, broken_;
};

}  // namespace brume

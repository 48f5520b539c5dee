#pragma once
#include <array>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace brume {

/// The files of a sequence: a name in which the frame's number stands as "####", "@@@@", "$F", "$F4", "${F4}", "<F4>",
/// "<frame>" or "%04d", at one place or several, in folders too. "####" and the like give the fewest digits: frame
/// 12345 of "####" has five.
class FramePattern {
 public:
  /// Nothing for a name without a number's place. @throws InputError for one of more than nine digits
  static std::optional<FramePattern> of(const std::filesystem::path& name);

  /// @param frame  at least 0
  std::filesystem::path path(int frame) const;

  /// The frames whose files there are, rising. Empty where the folder is missing.
  std::vector<int> frames_on_disk() const;

  const std::filesystem::path& name() const { return name_; }

 private:
  explicit FramePattern(std::filesystem::path name) : name_(std::move(name)) {}
  std::filesystem::path name_;
};

/// The name itself, or where it is a pattern the file of that frame. @throws InputError as FramePattern::of
std::filesystem::path file_of_frame(const std::filesystem::path& name, int frame);

/// Refuses a name without a number's place for several frames, which would be one file. An empty name is fine.
/// @param what  the option or argument that it is of: "--png"
/// @throws InputError
void check_pattern(std::string_view what, const std::filesystem::path& name, std::span<const int> frames);

/// The frames that "7", "1-240", "1-240x2" (every second) or several of these with commas between them name: rising,
/// each once. Frames count from 0; there are none below it, since "-" stands between first and last.
/// @throws InputError that says which piece is wrong
std::vector<int> parse_frames(std::string_view text);

/// The frames that `text` names as parse_frames does; where it is empty those that are there of `name`, of which there
/// are none where it is no pattern or itself a file.
/// @throws InputError as parse_frames and FramePattern::of
std::vector<int> frames_or_all_of(const std::filesystem::path& name, std::string_view text = {});

/// The frames to make of `source` into `output`: those of `text`; where it is empty and `output` names a sequence those
/// that there are of `source`. A single # in `output` is the name's. Empty where `output` is the file of one frame.
/// @param what  what `output` and `text` are called: "-o", "--frames"
/// @throws InputError where `output` names a sequence and nothing says of which frames; as parse_frames
std::vector<int> frames_to_make(const std::filesystem::path& source, const std::filesystem::path& output,
                                std::string_view text, const std::array<std::string_view, 2>& what);

/// "1-10, 20" for rising frames.
std::string frames_text(std::span<const int> frames);

}  // namespace brume

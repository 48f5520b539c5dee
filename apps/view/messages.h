#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "workflows/view/messages.h"

namespace brume::web {

// What `brume view` and its page say to one another over the WebSocket; docs/view.md has the list.

/// Longest message of a page [bytes], and what one may hold.
inline constexpr size_t kLongestMessage = 64 * 1024, kMostAssignments = 400, kMostLayers = 4;
inline constexpr int kLargestSide = 4096;  // of a picture [px]
inline constexpr size_t kMostMixed = 256;  // light groups
inline constexpr double kMostGain = 1e6;   // of one

/// A message of a page. @throws InputError that says what is wrong with it
std::variant<ViewLook, ViewProbe> parse_message(std::string_view text);

std::string text_of(const ViewSceneText& scene);
std::string progress_text(const ViewProgress& progress);
/// To a page whose turn another one has: what it shows is as it was.
std::string elsewhere_text(uint64_t id);
std::string problem_text(const ViewProblem& problem);
/// Assignments as a list.
std::string assignments_text(const std::vector<std::string>& assignments);
std::string point_text(uint64_t id, std::optional<dvec3> position);
/// The header's length and the header, in JSON, then the half floats.
std::string bytes_of(const ViewPicture& picture);

}  // namespace brume::web

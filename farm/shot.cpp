#include "farm/shot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "base/error.h"
#include "base/output_file.h"
#include "base/rng.h"
#include "base/sequence.h"
#include "base/text.h"

namespace brume {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/// Visits every value that is saved.
template <class S, class Visitor>
void each_value(S& shot, Visitor&& visit) {
  visit("name", shot.name);
  visit("program", shot.program);
  visit("brume", shot.brume);
  visit("scene", shot.scene);
  visit("scene_text", shot.scene_text);
  visit("overrides", shot.overrides);
  visit("frames", shot.frames);
  visit("parts", shot.parts);
  visit("spp", shot.spp);
  visit("seed", shot.seed);
  visit("layers", shot.layers);
  visit("statistics", shot.statistics);
  visit("filter", shot.filter);
  visit("window", shot.window);
  visit("threads", shot.threads);
  visit("keep_parts", shot.keep_parts);
}

template <class T>
std::string text_of(const T& value) {
  const json j = value;
  return j.is_string() ? j.get<std::string>() : j.dump();
}
std::string text_of(const std::vector<int>& frames) {
  return frames_text(frames);
}

std::string number(int value, int digits) {
  return fmt::format("{:0{}}", value, digits);
}

constexpr int kFrameDigits = 4, kPartDigits = 5;

}  // namespace

fs::path Shot::part(int frame, int number_of_part) const {
  return folder / "parts" / number(frame, kFrameDigits) / (number(number_of_part, kPartDigits) + ".exr");
}
fs::path Shot::checkpoint(int frame, int number_of_part) const {
  return folder / "parts" / number(frame, kFrameDigits) / (number(number_of_part, kPartDigits) + ".checkpoint.exr");
}
fs::path Shot::group(int frame, int number_of_group) const {
  return folder / "parts" / number(frame, kFrameDigits) / ("group." + number(number_of_group, kPartDigits) + ".exr");
}
fs::path Shot::frame(int frame) const {
  return folder / "frames" / fmt::format("{}.{}.exr", name, number(frame, kFrameDigits));
}
fs::path Shot::clean(int frame) const {
  return folder / "clean" / fmt::format("{}.{}.exr", name, number(frame, kFrameDigits));
}
fs::path Shot::log(const std::string& command) const {
  return folder / "logs" / (command + ".log");
}

int Shot::groups() const {
  if (parts <= kMostMerged) return 0;
  return static_cast<int>(std::ceil(std::sqrt(static_cast<double>(parts))));
}

std::pair<int, int> Shot::parts_of_group(int group) const {
  const auto before = [&](int g) { return static_cast<int>(static_cast<int64_t>(parts) * g / groups()); };
  return {before(group - 1) + 1, before(group)};
}

std::vector<int> Shot::window_of(int frame) const {
  std::vector<int> around;
  for (const int f : frames)
    if (std::abs(f - frame) <= window) around.push_back(f);
  return around;
}

void Shot::check() const {
  constexpr size_t kLongestName = 128, kLongestFolder = 3500;  // bytes: room for what is appended to them
  std::vector<std::pair<std::string, std::string>> texts = {{"the folder of the shot", folder.string()},
                                                            {"the name of the shot", name},
                                                            {"the scene", scene},
                                                            {"the program", brume},
                                                            {"the layers", layers},
                                                            {"the filter", filter}};
  for (const std::string& assignment : overrides) texts.emplace_back("-D", assignment);
  for (const auto& [what, text] : texts) {
    check_one_line(what, text);
    try {
      json(text).dump();
    } catch (const json::type_error&) {
      throw InputError(fmt::format("{} {}: is not UTF-8; expected a name in UTF-8, as shot.json keeps it", what, text));
    }
  }
  if (name.size() > kLongestName)
    throw InputError(fmt::format(
        "the name of the shot {}: has {} bytes; expected at most {}, as its frames are named by it; name it in the scene: name = \"smoke\"",
        name, name.size(), kLongestName));
  if (folder.string().size() > kLongestFolder)
    throw InputError(fmt::format("the folder of the shot {}: has {} bytes; expected at most {}", folder.string(),
                                 folder.string().size(), kLongestFolder));
  // Every command would put its frame's number there.
  if (FramePattern::of(folder / name))
    throw InputError(fmt::format(
        "{}: holds a place for a frame's number (#, $F or %d); expected a folder and a name of the shot without",
        (folder / name).string()));
}

void Shot::save() const {
  std::vector<std::string> folders = {"frames", "logs", "rounds"};
  if (parts > 1) folders.emplace_back("parts");
  if (!filter.empty()) folders.emplace_back("clean");
  for (const std::string& inside : folders) {
    std::error_code error;
    fs::create_directories(folder / inside, error);
    if (error) throw InputError(fmt::format("{}: cannot be made: {}", (folder / inside).string(), error.message()));
  }
  json j;
  each_value(*this, [&](const char* key, const auto& value) { j[key] = value; });
  write_text(folder / "shot.json", j.dump(2) + "\n");
}

Shot Shot::load(const fs::path& folder) {
  const fs::path file = folder / "shot.json";
  std::ifstream stream(file);
  if (!stream) throw InputError(fmt::format("{}: holds no shot: there is no shot.json", folder.string()));
  Shot shot;
  shot.folder = fs::absolute(folder).lexically_normal();
  try {
    const json j = json::parse(stream);
    each_value(shot, [&](const char* key, auto& value) { j.at(key).get_to(value); });
  } catch (const json::exception& error) {
    throw InputError(fmt::format("{}: damaged: {}", file.string(), error.what()));
  }
  if (shot.parts < 1 || shot.frames.empty())
    throw InputError(fmt::format("{}: damaged: no frames, or no parts of them", file.string()));
  return shot;
}

std::string Shot::difference(const Shot& here) const {
  std::vector<std::string> differing;
  std::vector<std::string> there;
  each_value(*this, [&](const char*, const auto& value) { there.push_back(text_of(value)); });
  size_t i = 0;
  each_value(here, [&](const char* key, const auto& value) {
    const std::string text = text_of(value);
    if (there[i] != text) differing.push_back(fmt::format("{} is {} there, {} here", key, there[i], text));
    ++i;
  });
  return join(differing, "; ");
}

std::string fingerprint(const std::string& text) {
  uint64_t hash = 0;
  for (const char c : text) hash = hash_combine(hash, static_cast<unsigned char>(c));
  return fmt::format("{:016x}", hash);
}

void check_one_line(const std::string& what, const std::string& text) {
  const auto control = [](unsigned char c) { return (c < 0x20 && c != '\t') || c == 0x7f; };
  if (std::none_of(text.begin(), text.end(), control)) return;
  std::string shown;
  for (const char c : text) shown += control(c) ? fmt::format("\\x{:02x}", c) : std::string(1, c);
  throw InputError(fmt::format("{} {}: holds a line break or another control character; expected none", what, shown));
}

}  // namespace brume

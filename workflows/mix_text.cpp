#include "workflows/mix_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <iterator>

#include "base/error.h"
#include "base/missing_file.h"
#include "base/text.h"
#include "base/toml_text.h"
#include "render/scene/toml_table.h"

namespace brume {
namespace {

bool is_grey(const dvec3& factor) {
  return factor.x == factor.y && factor.x == factor.z;
}

double number_of(const toml::value& value) {
  const double number = value.is_integer()    ? static_cast<double>(value.as_integer())
                        : value.is_floating() ? value.as_floating()
                                              : -1;
  if (!(number >= 0 && number <= 1e30))
    fail_at("a light group's factor is wrong", value, "expected a number of at least 0, or three of them in brackets");
  return number;
}

dvec3 factor_of(const toml::value& value) {
  if (!value.is_array()) return dvec3(number_of(value));
  if (value.as_array().size() != 3)
    fail_at("a light group's factor has no three colours", value, "expected [red, green, blue]");
  return {number_of(value.as_array()[0]), number_of(value.as_array()[1]), number_of(value.as_array()[2])};
}

}  // namespace

LightMix read_mix(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  check_exists(path);
  if (!stream) throw InputError(fmt::format("{}: cannot be opened", path.string()));
  const toml::value root = parse_toml(stream, path.string());
  for (const auto& [key, value] : root.as_table())
    if (key != "mix") fail_at(fmt::format("unknown key '{}'", key), value, "expected the table [mix]");
  if (!root.contains("mix") || !root.at("mix").is_table())
    throw InputError(fmt::format("{}: has no table [mix] with a factor for each light group", path.string()));
  LightMix mix;
  for (const auto& [group, value] : root.at("mix").as_table()) mix[group] = factor_of(value);
  return mix;
}

std::string toml_of_mix(const LightMix& mix) {
  std::string text = "# Light groups of a frame, for brume mix --mix\n[mix]\n";
  for (const auto& [group, factor] : mix)
    text += fmt::format("{} = [{}, {}, {}]\n", toml_key(group), toml_number(factor.x), toml_number(factor.y),
                        toml_number(factor.z));
  return text;
}

std::vector<std::string> words_of_mix(const LightMix& mix) {
  std::vector<std::string> gains, words;
  for (const auto& [group, factor] : mix)
    if (is_grey(factor)) gains.push_back(fmt::format("{}={}", group, factor.x));
  if (!gains.empty()) words = {"--gain", join(gains, ",")};
  for (const auto& [group, factor] : mix)
    if (!is_grey(factor))
      words.insert(words.end(), {"--colour", fmt::format("{}={},{},{}", group, factor.x, factor.y, factor.z)});
  return words;
}

}  // namespace brume

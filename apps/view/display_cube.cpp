#include "apps/view/display_cube.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <vector>

namespace brume::web {
namespace {

constexpr int kLowest = -10, kPerStop = 4, kSide = 65;  // up to 2^5.75 times white

}  // namespace

std::string cube_of(const Display& display) {
  std::vector<float> edge = {0};
  for (int i = 1; i < kSide; ++i) edge.push_back(std::exp2(static_cast<float>(kLowest + (i - 1.0) / kPerStop)));
  std::vector<float> rgb;
  for (const float b : edge)
    for (const float g : edge)
      for (const float r : edge) rgb.insert(rgb.end(), {r, g, b});
  display.apply(rgb);
  std::vector<uint16_t> values;
  for (const float v : rgb) values.push_back(static_cast<uint16_t>(std::lround(65535 * v)));
  const DisplaySetting& chosen = display.setting();
  std::string header = nlohmann::json{
      {"name", chosen.display + ", " + chosen.view},
      {"side", kSide},
      {"lowest", kLowest},
      {"per_stop",
       kPerStop}}.dump();
  const auto length = static_cast<uint32_t>(header.size());
  std::string bytes(sizeof length + header.size() + 2 * values.size(), '\0');
  std::memcpy(bytes.data(), &length, sizeof length);
  std::memcpy(bytes.data() + sizeof length, header.data(), header.size());
  std::memcpy(bytes.data() + sizeof length + header.size(), values.data(), 2 * values.size());
  return bytes;
}

}  // namespace brume::web

#include "app/frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <set>

#include "base/error.h"
#include "image/exr_io.h"
#include "image/foreign.h"

namespace brume::app {

Layers read_frame(const std::string& path, const std::set<std::string>& wanted, std::string* note) {
  Layers frame = read_exr(path, [&](const std::string& name) { return wanted.empty() || wanted.contains(name); });
  if (!wanted.empty() && !frame.has(layer::beauty)) frame = read_exr(path);
  const std::string recognised = adopt_foreign_layers(frame);
  if (note) *note = recognised;
  return frame;
}

std::vector<std::string> layer_names(const Layers& frame) {
  std::set<std::string> names;
  for (const std::string& channel : frame.names()) {
    const size_t dot = channel.rfind('.');
    const std::string name = dot == std::string::npos ? "beauty" : channel.substr(0, dot);
    if (name.find("mean_variance") == std::string::npos && name.find("half_") == std::string::npos) names.insert(name);
  }
  return {names.begin(), names.end()};
}

double choose_exposure(const std::string& option, const Layers& frame) {
  if (option == "header") return frame.number("exposure").value_or(1.0);
  if (option == "auto") {
    if (!frame.has(layer::beauty)) throw InputError("--exposure auto needs the channels R, G, B");
    const auto rgb = frame.rgb(layer::beauty);
    std::vector<float> values;
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        const float v = luminance(vec3((*rgb[0])(x, y), (*rgb[1])(x, y), (*rgb[2])(x, y)));
        if (std::isfinite(v)) values.push_back(v);
      }
    if (values.empty()) return 1.0;
    const auto nth = values.begin() + static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), nth, values.end());
    return *nth > 0 ? 1.0 / *nth : 1.0;
  }
  char* end = nullptr;
  const double value = std::strtod(option.c_str(), &end);
  if (*end || option.empty() || !(value > 0) || !std::isfinite(value))
    throw InputError(fmt::format("--exposure {}: expected header, auto or a number above 0", option));
  return value;
}

}  // namespace brume::app

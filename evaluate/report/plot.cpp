#include "evaluate/report/plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "base/text.h"

namespace brume {
namespace {

constexpr double kWidth = 820, kLeastHeight = 520, kLeft = 70, kRight = 220, kTop = 40, kBottom = 60, kLegendLine = 17;
// Okabe and Ito's palette, told apart by colour-blind readers too.
constexpr const char* kColours[] = {"#000000", "#E69F00", "#56B4E9", "#009E73", "#CC79A7", "#0072B2", "#D55E00"};

/// A point of the plot; those of one colour are told apart by their shape.
std::string marker(size_t shape, double x, double y, const std::string& paint) {
  const auto polygon = [&](const char* corners) {
    return fmt::format("<polygon transform=\"translate({:.1f} {:.1f})\" points=\"{}\" {}/>\n", x, y, corners, paint);
  };
  switch (shape % 4) {
    case 0:
      return fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"3.5\" {}/>\n", x, y, paint);
    case 1:
      return polygon("-3.2,-3.2 3.2,-3.2 3.2,3.2 -3.2,3.2");
    case 2:
      return polygon("0,-4.5 4.2,3.2 -4.2,3.2");
    default:
      return polygon("0,-4.8 4.8,0 0,4.8 -4.8,0");
  }
}

/// A logarithmic axis in pixels.
struct Axis {
  double lo, hi, start, end;
  Axis(double low, double high, double from, double to)
      : lo(std::log10(low)), hi(std::log10(high)), start(from), end(to) {}
  double at(double v) const { return start + (std::log10(v) - lo) / (hi - lo) * (end - start); }
  /// 1, 2, 5 of each decade inside.
  std::vector<double> ticks() const {
    std::vector<double> result;
    for (int decade = static_cast<int>(std::floor(lo)); decade <= static_cast<int>(hi) + 1; ++decade)
      for (const double m : {1.0, 2.0, 5.0})
        if (const double v = m * std::pow(10.0, decade); std::log10(v) >= lo && std::log10(v) <= hi)
          result.push_back(v);
    return result;
  }
};

std::string xml_text(const std::string& text) {
  return replaced(replaced(replaced(text, "&", "&amp;"), "<", "&lt;"), ">", "&gt;");
}

}  // namespace

std::string error_seconds_plot(const SceneResult& scene,
                               const std::vector<std::pair<std::string, std::string>>& origin) {
  struct Series {
    std::string name;
    bool dotted;
    std::vector<std::pair<double, double>> points;
  };
  std::vector<Series> series;
  double x_lo = 1e300, x_hi = 0, y_lo = 1e300, y_hi = 0;
  bool searched = false;
  for (const MethodResult& m : scene.methods) searched = searched || m.tuning == Tuning::kSearched;
  std::map<std::string, size_t> place;  // of a filter among all: its colour and shape
  for (const MethodResult& m : scene.methods) {
    // Searched parameters where there are any, dotted beside them the defaults.
    if (m.tuning == Tuning::kTransfer || m.tuning == Tuning::kPaper || !m.failed.empty() || m.seconds() <= 0) continue;
    const bool dotted = searched && m.tuning == Tuning::kDefault;
    place.emplace(m.label(), place.size());
    auto it = std::find_if(series.begin(), series.end(),
                           [&](const Series& s) { return s.name == m.label() && s.dotted == dotted; });
    if (it == series.end()) it = series.insert(series.end(), {m.label(), dotted, {}});
    const double seconds = m.seconds(), rms = std::max(m.whole().mean, 1e-6);
    it->points.emplace_back(seconds, rms);
    x_lo = std::min(x_lo, seconds);
    x_hi = std::max(x_hi, seconds);
    y_lo = std::min(y_lo, rms);
    y_hi = std::max(y_hi, rms);
  }
  if (series.empty()) return {};
  // The legend in the order of the lines' right ends.
  std::stable_sort(series.begin(), series.end(),
                   [](const Series& a, const Series& b) { return a.points.back().second > b.points.back().second; });
  const auto lines = std::count_if(series.begin(), series.end(), [](const Series& s) { return !s.dotted; });
  const double height = std::max(kLeastHeight, kTop + kBottom + kLegendLine * static_cast<double>(lines));
  const Axis x(x_lo / 1.2, x_hi * 1.2, kLeft, kWidth - kRight), y(y_lo / 1.2, y_hi * 1.2, height - kBottom, kTop);
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\" font-family=\"sans-serif\" font-size=\"12\">\n"
      "<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n<text x=\"{2}\" y=\"24\" font-size=\"15\">{3}: error against seconds</text>\n",
      kWidth, height, kLeft, xml_text(scene.name));
  svg += "<desc>";
  for (const auto& [key, value] : origin) svg += xml_text(key + ": " + value + "; ");
  svg += "</desc>\n";
  for (const double t : x.ticks())
    svg += fmt::format(
        "<line x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1}\" y2=\"{2}\" stroke=\"#ddd\"/><text x=\"{0:.1f}\" y=\"{3}\" text-anchor=\"middle\">{4:g}</text>\n",
        x.at(t), kTop, height - kBottom, height - kBottom + 18, t);
  for (const double t : y.ticks())
    svg += fmt::format(
        "<line x1=\"{0}\" x2=\"{1}\" y1=\"{2:.1f}\" y2=\"{2:.1f}\" stroke=\"#ddd\"/><text x=\"{3}\" y=\"{4:.1f}\" text-anchor=\"end\">{5:g}</text>\n",
        kLeft, kWidth - kRight, y.at(t), kLeft - 6, y.at(t) + 4, t);
  svg += fmt::format("<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">render + guides + filter [s]</text>\n",
                     (kLeft + kWidth - kRight) / 2, height - 18);
  svg += fmt::format(
      "<text transform=\"translate(20 {}) rotate(-90)\" text-anchor=\"middle\">Lab RMS, whole frame</text>\n",
      (kTop + height - kBottom) / 2);
  double legend = kTop + 6;
  for (const Series& s : series) {
    const size_t k = place[s.name], shape = k / std::size(kColours);
    const char* c = kColours[k % std::size(kColours)];
    std::string path;
    for (const auto& [px, py] : s.points) path += fmt::format("{:.1f},{:.1f} ", x.at(px), y.at(py));
    const char* dash = s.dotted ? " stroke-dasharray=\"3 4\" opacity=\"0.6\"" : "";
    const std::string paint =
        fmt::format("fill=\"{}\" stroke=\"{}\"{}", s.dotted ? "white" : c, c, s.dotted ? " opacity=\"0.6\"" : "");
    svg += fmt::format("<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\"{}/>\n", path, c,
                       s.name == "path tracing" ? 3 : 1.6, dash);
    for (const auto& [px, py] : s.points) svg += marker(shape, x.at(px), y.at(py), paint);
    if (s.dotted) continue;
    svg += fmt::format("<line x1=\"{0}\" x2=\"{1}\" y1=\"{2}\" y2=\"{2}\" stroke=\"{3}\" stroke-width=\"1.6\"/>\n",
                       kWidth - kRight + 12, kWidth - kRight + 36, legend, c);
    svg += marker(shape, kWidth - kRight + 24, legend, paint);
    svg += fmt::format("<text x=\"{}\" y=\"{}\">{}</text>\n", kWidth - kRight + 42, legend + 4, xml_text(s.name));
    legend += kLegendLine;
  }
  if (searched)
    svg += fmt::format("<text x=\"{}\" y=\"{}\" fill=\"#555\">dotted, hollow: defaults</text>\n", kWidth - kRight + 12,
                       legend + 4);
  return svg + "</svg>\n";
}

}  // namespace brume

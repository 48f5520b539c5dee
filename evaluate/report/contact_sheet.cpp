#include "evaluate/report/contact_sheet.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "evaluate/report/strips.h"

namespace brume {
namespace {

constexpr int kCaption = 26, kGap = 4, kNarrowestCell = 128, kNarrowestSheet = 800, kKeyHeight = 44;

/// Means over blocks of `step` x `step` pixels; what is left at the right and below is cut.
Plane smaller(const Plane& plane, int step) {
  if (step == 1) return plane;
  Plane out(std::max(1, plane.width() / step), std::max(1, plane.height() / step));
  for (int y = 0; y < out.height(); ++y)
    for (int x = 0; x < out.width(); ++x) {
      double sum = 0;
      for (int v = 0; v < step; ++v)
        for (int u = 0; u < step; ++u)
          sum += static_cast<double>(
              plane(std::min(x * step + u, plane.width() - 1), std::min(y * step + v, plane.height() - 1)));
      out(x, y) = static_cast<float>(sum / (step * step));
    }
  return out;
}

Picture smaller_picture(const RgbPlanes& rgb, int step, double exposure) {
  const Plane planes[] = {smaller(*rgb[0], step), smaller(*rgb[1], step), smaller(*rgb[2], step)};
  return to_picture({&planes[0], &planes[1], &planes[2]}, exposure);
}

/// 1, 2 or 5 times a power of ten, at least `value`.
double round_up(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(std::max(value, 1e-6))));
  for (const double step : {1.0, 2.0, 5.0})
    if (value <= step * power) return step * power;
  return 10 * power;
}

/// What the brightest hundredth of the pixels of some planes reaches: false colours end there.
double full_scale(const std::vector<const Plane*>& planes) {
  std::vector<float> values;
  for (const Plane* plane : planes)
    for (int y = 0; y < plane->height(); ++y)
      for (const float v : plane->pixels(y))
        if (std::isfinite(v)) values.push_back(v);
  if (values.empty()) return 1;
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(values.size() * 99 / 100);
  std::nth_element(values.begin(), place, values.end());
  return round_up(static_cast<double>(*place));
}

}  // namespace

void ContactSheet::add(int number, const RgbPlanes& picture, const RgbPlanes& reference, double lab_rms,
                       const std::optional<Plane>& change) {
  const int shown = std::min(frames_, kMostColumns), index = added_++;
  // Of all frames the i-th is shown where the i-th of the columns begins.
  if (index * shown / frames_ == (index - 1) * shown / frames_ && index > 0) return;
  const int step = (picture[0]->width() + kWidestCell - 1) / kWidestCell;
  const LabRms metric(reference, nullptr, policy_, {});
  columns_.push_back({fmt::format("{}  {:.2f}", number, lab_rms), smaller_picture(picture, step, policy_.exposure),
                      smaller_picture(reference, step, policy_.exposure), smaller(metric.error_map(picture), step),
                      change ? smaller(*change, step) : Plane()});
}

Picture ContactSheet::draw() const {
  if (columns_.empty()) return Picture(1, 1);
  const int h = columns_[0].picture.height, scale = columns_[0].picture.width >= 200 ? 2 : 1;
  const int w = std::max(columns_[0].picture.width, kNarrowestCell);
  const int count = static_cast<int>(columns_.size());
  std::vector<const Plane*> errors, changes;
  for (const Column& c : columns_) {
    errors.push_back(&c.error);
    if (!c.change.empty()) changes.push_back(&c.change);
  }
  const double full_error = full_scale(errors), full_change = full_scale(changes);
  const int sheet_width = std::max(count * (w + kGap) - kGap, kNarrowestSheet);
  Picture sheet(sheet_width, kCaption + 4 * (h + kGap) + kKeyHeight);
  for (int i = 0; i < count; ++i) {
    const Column& column = columns_[static_cast<size_t>(i)];
    const int x = i * (w + kGap);
    draw_text(sheet, x + 4, 6, column.caption, scale);
    int y = kCaption;
    const auto add = [&](const Picture& picture) {
      sheet.paste(picture, x, y);
      y += h + kGap;
    };
    add(column.picture);
    add(column.reference);
    add(error_picture(column.error, full_error));
    if (!column.change.empty()) add(error_picture(column.change, full_change));
  }
  const int y = kCaption + 4 * (h + kGap);
  Plane ramp(200, 12);
  for (int v = 0; v < ramp.height(); ++v)
    for (int u = 0; u < ramp.width(); ++u) ramp(u, v) = static_cast<float>(u) / static_cast<float>(ramp.width() - 1);
  sheet.paste(error_picture(ramp, 1), 4, y + 6);
  draw_text(sheet, 212, y + 8,
            "numbers: frame, Lab RMS of the whole of it; rows: picture, reference, and in these colours", 1);
  draw_text(
      sheet, 4, y + 24,
      fmt::format(
          "Lab distance to the reference, 0 ... {:g}; how far its change since the frame before is from the reference's, 0 ... {:g}",
          full_error, full_change),
      1);
  return sheet;
}

}  // namespace brume

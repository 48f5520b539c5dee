#include "filters/window/lab_window.h"

#include <cstring>
#include <utility>

#include "filters/inputs/planes.h"
#include "filters/kernels/lab.h"

namespace brume {

WorkImage padded(std::span<const Plane* const> planes, int radius) {
  WorkImage image(planes[0]->width(), planes[0]->height(), radius, planes.size());
  for (int y = 0; y < image.height(); ++y) {
    for (size_t c = 0; c < planes.size(); ++c)
      std::memcpy(image.channels[c].row(y), planes[c]->row(y), sizeof(float) * static_cast<size_t>(image.width()));
    image.extend_row(y);
  }
  return image;
}

namespace {

std::array<const float*, 3> rows(const WorkImage& image, int y) {
  return {image.channels[0].row(y), image.channels[1].row(y), image.channels[2].row(y)};
}
std::array<float*, 3> rows(WorkImage& image, int y) {
  return {image.channels[0].row(y), image.channels[1].row(y), image.channels[2].row(y)};
}

}  // namespace

LabWindow::LabWindow(const FilterFrame& frame, int radius, Average average, const Task& task)
    : frame_(frame),
      radius_(radius),
      average_(frame.carries() ? Average::kLinear : average),
      lab_(frame.width(), frame.height(), radius, 3),
      out_(frame.width(), frame.height(), radius, 3) {
  if (average_ == Average::kLinear) rgb_ = WorkImage(frame.width(), frame.height(), radius, 3);
  if (frame.medium) medium_ = PaddedPlane(frame.width(), frame.height(), radius);
  for_each_row(frame.height(), quiet(task), [&](int y) {
    const std::array<const float*, 3> signal = {frame.signal[0]->row(y), frame.signal[1]->row(y),
                                                frame.signal[2]->row(y)};
    kernels::lab_from_rgb_row(signal, static_cast<float>(frame.exposure), rows(lab_, y), frame.width(),
                              frame.space.xyz_from_rgb());
    lab_.extend_row(y);
    if (average_ == Average::kLinear) {
      for (size_t c = 0; c < 3; ++c)
        std::memcpy(rgb_.channels[c].row(y), frame.values[c]->row(y),
                    sizeof(float) * static_cast<size_t>(frame.width()));
      rgb_.extend_row(y);
    }
    if (frame.medium) {
      std::memcpy(medium_.row(y), frame.medium->row(y), sizeof(float) * static_cast<size_t>(frame.width()));
      medium_.extend_row(y);
    }
  });
}

kernels::WindowInput LabWindow::input() {
  kernels::WindowInput in;
  in.radius = radius_;
  in.guide = &lab_;
  in.values = &values();
  in.out = &out_;
  in.medium = frame_.medium ? &medium_ : nullptr;
  return in;
}

void LabWindow::use_result_as_guide(const Task& task) {
  for_each_row(frame_.height(), quiet(task), [&](int y) {
    if (average_ == Average::kLinear) {
      kernels::lab_from_rgb_row(rows(std::as_const(out_), y), static_cast<float>(frame_.exposure), rows(lab_, y),
                                frame_.width(), frame_.space.xyz_from_rgb());
      lab_.extend_row(y);
    }
    out_.extend_row(y);
  });
  std::swap(average_ == Average::kLinear ? rgb_ : lab_, out_);
}

void LabWindow::finish(const FilterOutput& out, const Task& task) {
  for_each_row(frame_.height(), quiet(task), [&](int y) {
    const std::array<float*, 3> target = {out[0]->row(y), out[1]->row(y), out[2]->row(y)};
    if (average_ == Average::kDomain)
      kernels::rgb_from_lab_row(rows(std::as_const(out_), y), static_cast<float>(frame_.exposure), target,
                                frame_.width(), frame_.space.xyz_from_rgb());
    else
      for (size_t c = 0; c < 3; ++c)
        std::memcpy(target[c], out_.channels[c].row(y), sizeof(float) * static_cast<size_t>(frame_.width()));
  });
}

WorkImage gaussian(const WorkImage& in, int radius, float sigma, const Task& task) {
  WorkImage horizontal(in.width(), in.height(), radius, in.channels.size()), out = horizontal;
  for_each_row(in.height(), quiet(task),
               [&](int y) { kernels::gaussian_horizontal_row(in, horizontal, radius, sigma, y); });
  for_each_row(in.height(), quiet(task), [&](int y) {
    kernels::gaussian_vertical_row(horizontal, out, radius, sigma, y);
    out.extend_row(y);
  });
  return out;
}

}  // namespace brume

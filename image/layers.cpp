#include "image/layers.h"

#include <fmt/format.h>

#include <bit>
#include <stdexcept>
#include <utility>

#include "base/text.h"

namespace brume {

std::string PixelWindow::text() const {
  return fmt::format("{},{},{},{}", lo.x, lo.y, hi.x, hi.y);
}

std::string LayerName::channel_of(std::string_view statistic, size_t index) const {
  std::string full(name);
  for (const std::string_view part : {statistic, channels.substr(index, 1)})
    if (!part.empty()) full += (full.empty() ? "" : ".") + std::string(part);
  return full;
}

std::vector<std::string> LayerName::channel_names(std::string_view statistic) const {
  std::vector<std::string> names;
  for (size_t i = 0; i < channels.size(); ++i) names.push_back(channel_of(statistic, i));
  return names;
}

Plane& Layers::add(const std::string& name, float value) {
  const auto found = channels_.find(name);
  if (found != channels_.end()) return found->second;
  Plane plane = value == 0 ? Plane::lazy_zeros(width_, height_) : Plane(width_, height_, value);
  return channels_.emplace(name, std::move(plane)).first->second;
}

void Layers::set(const std::string& name, Plane plane) {
  if (plane.width() != width_ || plane.height() != height_)
    throw std::logic_error(fmt::format("channel {} is {} x {}, the frame is {} x {}", name, plane.width(),
                                       plane.height(), width_, height_));
  channels_.insert_or_assign(name, std::move(plane));
}

void Layers::store_rows(const std::string& name, int y, const Plane& rows, const Task& task) {
  stored_.try_emplace(name, width_, height_).first->second.set_rows(y, rows, task);
}

void Layers::set_stored(const std::string& name, StoredPlane plane) {
  if (plane.width() != width_ || plane.height() != height_)
    throw std::logic_error(fmt::format("stored channel {} is {} x {}, the frame is {} x {}", name, plane.width(),
                                       plane.height(), width_, height_));
  stored_.insert_or_assign(name, std::move(plane));
}

const Plane* Layers::find(const std::string& name) const {
  const auto it = channels_.find(name);
  return it == channels_.end() ? nullptr : &it->second;
}

Plane* Layers::find(const std::string& name) {
  return const_cast<Plane*>(std::as_const(*this).find(name));
}

const Plane& Layers::at(const std::string& name) const {
  if (const Plane* plane = find(name)) return *plane;
  throw std::logic_error(fmt::format("no channel {}; there are: {}", name, join(names())));
}

std::vector<uint32_t>& Layers::add_words(const std::string& name) {
  std::vector<uint32_t>& words = words_[name];
  words.resize(static_cast<size_t>(width_) * height_);
  return words;
}

const std::vector<uint32_t>* Layers::find_words(const std::string& name) const {
  const auto it = words_.find(name);
  return it == words_.end() ? nullptr : &it->second;
}

PixelWindow Layers::display_window() const {
  return display == ivec2(0) ? data_window() : PixelWindow{display_origin, display_origin + display};
}

void Layers::lie_like(const Layers& other) {
  if (width_ != other.width_ || height_ != other.height_)
    throw std::logic_error(
        fmt::format("{} x {} pixels cannot lie like {} x {}", width_, height_, other.width_, other.height_));
  origin = other.origin;
  display = other.display;
  display_origin = other.display_origin;
}

Layers Layers::without_channels() const {
  Layers empty(width_, height_);
  empty.header = header;
  empty.lie_like(*this);
  return empty;
}

Layers Layers::cut(const PixelWindow& window) const {
  Layers part(window.width(), window.height());
  part.header = header;
  part.origin = window.lo;
  part.display_origin = display_window().lo;
  part.display = display_window().hi - display_window().lo;
  const PixelWindow filled = window.common(data_window());
  for (const auto& [name, plane] : channels_) {
    Plane& target = part.add(name);
    for (int y = filled.lo.y; y < filled.hi.y; ++y)
      for (int x = filled.lo.x; x < filled.hi.x; ++x)
        target(x - window.lo.x, y - window.lo.y) = plane(x - origin.x, y - origin.y);
  }
  return part;
}

bool Layers::has(const LayerName& layer, std::string_view statistic) const {
  for (size_t i = 0; i < layer.channels.size(); ++i)
    if (!find(layer.channel_of(statistic, i))) return false;
  return true;
}

RgbPlanes Layers::rgb(const LayerName& layer, std::string_view statistic) const {
  RgbPlanes planes;
  for (size_t i = 0; i < 3; ++i) planes[i] = &at(layer.channel_of(statistic, i));
  return planes;
}

std::array<Plane*, 3> Layers::add_rgb(const LayerName& layer, std::string_view statistic) {
  std::array<Plane*, 3> planes;
  for (size_t i = 0; i < 3; ++i) planes[i] = &add(layer.channel_of(statistic, i));
  return planes;
}

std::vector<std::string> Layers::names() const {
  std::vector<std::string> names;
  for (const auto& [name, plane] : channels_) names.push_back(name);
  return names;
}

std::string Layers::text(const std::string& key, const std::string& otherwise) const {
  const auto it = header.find(key);
  const auto* text = it == header.end() ? nullptr : std::get_if<std::string>(&it->second);
  return text ? *text : otherwise;
}

std::optional<double> Layers::number(const std::string& key) const {
  const auto it = header.find(key);
  if (it == header.end()) return std::nullopt;
  if (const int* i = std::get_if<int>(&it->second)) return *i;
  if (const float* f = std::get_if<float>(&it->second)) return *f;
  return std::nullopt;
}

std::optional<Chromaticities> chromaticities_of(const std::map<std::string, Attribute>& header) {
  if (const auto found = header.find("chromaticities"); found != header.end())
    if (const auto* const values = std::get_if<Chromaticities>(&found->second)) return *values;
  if (const auto found = header.find("acesImageContainerFlag"); found != header.end())
    if (const int* const flag = std::get_if<int>(&found->second); flag && *flag == 1) return kAces;
  for (const char* const key : {"colorInteropID", "oiio:ColorSpace"})
    if (const auto found = header.find(key); found != header.end())
      if (const auto* const name = std::get_if<std::string>(&found->second)) return space_of_name(*name);
  return std::nullopt;
}

Layers over_display_window(Layers frame) {
  return frame.display_window() == frame.data_window() ? std::move(frame) : frame.cut(frame.display_window());
}

size_t count_not_finite(const Plane& plane) {
  size_t count = 0;
  for (int y = 0; y < plane.height(); ++y) {
    // By the exponent's bits, in a loop that compilers turn into vectors.
    uint32_t row = 0;
    for (const float value : plane.pixels(y)) row += (std::bit_cast<uint32_t>(value) & 0x7f800000u) == 0x7f800000u;
    count += row;
  }
  return count;
}

}  // namespace brume

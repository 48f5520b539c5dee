#include "workflows/second_frame.h"

#include <fmt/format.h>

#include <set>

#include "base/error.h"

namespace brume {
namespace {

bool equal(const Plane& a, const Plane& b) {
  for (int y = 0; y < a.height(); ++y)
    for (int x = 0; x < a.width(); ++x)
      if (a(x, y) != b(x, y)) return false;
  return true;
}

/// a = factor * (a + b)
void scale_sum(float factor, const Plane& b, Plane& a) {
  for (int y = 0; y < a.height(); ++y)
    for (int x = 0; x < a.width(); ++x) a(x, y) = factor * (a(x, y) + b(x, y));
}

std::array<std::string, 2> names_of_halves(const std::string& channel) {
  return {"first frame: " + channel, "second frame: " + channel};
}

void check_alike(const Layers& frame, const Layers& second, const std::array<std::string, 2>& names) {
  if (frame.data_window() != second.data_window())
    throw InputError(fmt::format("{}: it has the pixels {}, {} has {}; two halves are renders of one frame", names[1],
                                 second.data_window().text(), names[0], frame.data_window().text()));
  const std::string ours = frame.text("sceneHash"), theirs = second.text("sceneHash");
  if (!ours.empty() && !theirs.empty() && ours != theirs)
    throw InputError(
        fmt::format("{}: it is of another scene than {}: two halves are renders of one scene", names[1], names[0]));
}

}  // namespace

HalvesOf halves_of_layers(const Layers& frame) {
  HalvesOf halves;
  for (const LayerName& l : {layer::beauty, layer::direct, layer::indirect})
    if (frame.has(l))
      for (size_t c = 0; c < 3; ++c)
        halves[l.channel(c)] = {l.channel_of(statistic::half_a, c), l.channel_of(statistic::half_b, c)};
  return halves;
}

HalvesOf halves_of_signals(const ForeignFrame& picture) {
  HalvesOf halves;
  const auto add = [&](const ForeignSignal& signal) {
    for (const std::string& channel : signal.channels) halves[channel] = names_of_halves(channel);
  };
  add(picture.color);
  for (const ForeignSignal& pass : picture.passes) add(pass);
  return halves;
}

void give_halves(ForeignFrame& picture) {
  const auto give = [](ForeignSignal& signal) {
    signal.halves.emplace();
    for (size_t c = 0; c < 3; ++c)
      for (size_t half = 0; half < 2; ++half) (*signal.halves)[half][c] = names_of_halves(signal.channels[c])[half];
  };
  give(picture.color);
  for (ForeignSignal& pass : picture.passes) give(pass);
  picture.samples *= 2;
}

void join_second(Layers& frame, const Layers& second, const HalvesOf& halves, const std::array<std::string, 2>& names) {
  check_alike(frame, second, names);
  std::set<std::string> made;
  bool same = !halves.empty();
  for (const auto& [channel, both] : halves) {
    made.insert(both.begin(), both.end());
    const Plane *const ours = frame.find(channel), *const theirs = second.find(channel);
    if (ours) same = same && theirs && equal(*ours, *theirs);
  }
  if (same)
    throw InputError(
        fmt::format("{}: it has the very pixels of {}: two halves are renders of one frame by different seeds",
                    names[1], names[0]));
  for (const std::string& channel : frame.names()) {
    if (made.contains(channel)) continue;
    const Plane* const other = second.find(channel);
    if (!other) throw InputError(fmt::format("{}: it has no channel {}, which {} has", names[1], channel, names[0]));
    Plane& own = *frame.find(channel);
    if (const auto found = halves.find(channel); found != halves.end()) {
      frame.set(found->second[0], own);
      frame.set(found->second[1], *other);
    }
    const bool count = channel == layer::sample_count.channel(0) || channel == layer::invalid_count.channel(0);
    const bool variance = channel.find(statistic::mean_variance) != std::string::npos;
    scale_sum(count ? 1.0f : variance ? 0.25f : 0.5f, *other, *frame.find(channel));
  }
  if (const auto a = frame.number("samplesPerPixel"), b = second.number("samplesPerPixel"); a && b)
    frame.header["samplesPerPixel"] = static_cast<int>(*a + *b);
}

Layers joined(const Layers& frame, const Layers& second, const std::array<std::string, 2>& names) {
  Layers a = frame, b = second;
  for (Layers* layers : {&a, &b}) adopt_foreign_layers(*layers);
  join_second(a, b, halves_of_layers(a), names);
  return a;
}

}  // namespace brume

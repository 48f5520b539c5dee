#include "image/recognise/channels.h"

namespace brume::recognition {
namespace {

ForeignSignal brume_signal(const Channels& file, const LayerName& layer) {
  const auto named = [&](std::string_view statistic) {
    return ChannelTriple{layer.channel_of(statistic, 0), layer.channel_of(statistic, 1),
                         layer.channel_of(statistic, 2)};
  };
  ForeignSignal signal{.name = layer.label(), .channels = named(""), .indirect = layer == layer::indirect};
  const auto there = [&](const ChannelTriple& c) { return file.has(c[0]) && file.has(c[1]) && file.has(c[2]); };
  if (there(named(statistic::mean_variance)))
    signal.variance = {.channels = listed(named(statistic::mean_variance)), .meaning = VarianceMeaning::kOfMean};
  if (there(named(statistic::half_a)) && there(named(statistic::half_b)))
    signal.halves = {named(statistic::half_a), named(statistic::half_b)};
  return signal;
}

}  // namespace

std::vector<ForeignFrame> brume_frame(const Channels& file, const ExrInfo& info) {
  if (!is_brume_frame(info) || !file.colour("")) return {};
  ForeignFrame p{.renderer = "a frame by brume", .of_brume = true, .target = *file.colour("")};
  p.color = brume_signal(file, layer::beauty);
  if (file.colour("direct.") && file.colour("indirect."))
    p.passes = {brume_signal(file, layer::direct), brume_signal(file, layer::indirect)};
  add_alpha(file, p, "");
  p.sample_count = file.single("sample_count");
  p.samples = header_number(info, "samplesPerPixel");
  return {p};
}

}  // namespace brume::recognition

#include "render/session/render_state.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

#include "base/error.h"
#include "base/parallel_for.h"
#include "base/text.h"
#include "image/exr_io.h"
#include "render/film/film.h"

namespace brume {
namespace {

std::string attribute_text(const Layers& frame, const std::string& key) {
  if (const auto number = frame.number(key)) return fmt::format("{}", *number);
  return frame.text(key, "nothing");
}

std::string window_text(const Layers& frame) {
  if (frame.display == ivec2(0)) return fmt::format("{} x {}", frame.width(), frame.height());
  return fmt::format("{},{},{},{} of {} x {}", frame.origin.x, frame.origin.y, frame.origin.x + frame.width(),
                     frame.origin.y + frame.height(), frame.display.x, frame.display.y);
}

struct Range {
  int first, end;
};

std::vector<Range> ranges_of(const Layers& frame, const std::string& name) {
  std::vector<Range> ranges;
  for (const std::string& text : split(frame.text("sampleRanges"), ',')) {
    Range r{};
    if (std::sscanf(text.c_str(), "%d-%d", &r.first, &r.end) != 2)
      throw InputError(fmt::format("{}: its header does not say which samples it holds (sampleRanges)", name));
    if (r.end > r.first) ranges.push_back(r);
  }
  return ranges;
}

/// The lines "key = value" of a scene's settings.
std::map<std::string, std::string> settings_of(const Layers& frame) {
  std::map<std::string, std::string> settings;
  for (const std::string& line : split(frame.text("sceneSettings"), '\n'))
    if (const size_t equals = line.find(" = "); equals != std::string::npos)
      settings[line.substr(0, equals)] = line.substr(equals + 3);
  return settings;
}

/// "camera.fov is 30 in the first, its default in the second", for each key in which two scenes differ.
std::vector<std::string> differing_settings(const Layers& a, const Layers& b, const std::string& says_a,
                                            const std::string& says_b) {
  const auto in_a = settings_of(a), in_b = settings_of(b);
  std::set<std::string> keys;
  for (const auto* settings : {&in_a, &in_b})
    for (const auto& [key, value] : *settings) keys.insert(key);
  const auto value = [](const auto& settings, const std::string& key) {
    const auto it = settings.find(key);
    return it == settings.end() ? std::string("its default") : it->second;
  };
  std::vector<std::string> differing;
  for (const std::string& key : keys)
    if (value(in_a, key) != value(in_b, key))
      differing.push_back(fmt::format("{} is {} {}, {} {}", key, value(in_a, key), says_a, value(in_b, key), says_b));
  return differing;
}

}  // namespace

std::string differing_render(const Layers& a, const Layers& b, const std::string& in_a, const std::string& in_b) {
  if (attribute_text(a, "sceneHash") != attribute_text(b, "sceneHash"))
    if (const std::vector<std::string> differing = differing_settings(a, b, in_a, in_b); !differing.empty())
      return join(differing, "; ");
  for (const auto& [key, what] : {std::pair("sceneHash", "the scene's fingerprint"),
                                  {"seed", "the seed"},
                                  {"frame", "the frame"},
                                  {"recordedLayers", "the list of layers"},
                                  {"statistics", "what is kept of their statistics"},
                                  {"program", "the program version"}})
    if (attribute_text(a, key) != attribute_text(b, key))
      return fmt::format("{} is {} {}, {} {}", what, attribute_text(a, key), in_a, attribute_text(b, key), in_b);
  if (window_text(a) != window_text(b))
    return fmt::format("the crop is {} {}, {} {}", window_text(a), in_a, window_text(b), in_b);
  return "";
}

void check_same_render(const Layers& a, const std::string& name_a, const Layers& b, const std::string& name_b,
                       bool same_samples) {
  if (a.words().empty())
    throw InputError(
        fmt::format("{}: holds no sums of its samples; expected a frame written with --part or --checkpoint", name_a));
  std::string differing = differing_render(a, b);
  if (differing.empty() && same_samples && attribute_text(a, "sampleFirst") != attribute_text(b, "sampleFirst"))
    differing = fmt::format("the first sample is {} in the first, {} in the second", attribute_text(a, "sampleFirst"),
                            attribute_text(b, "sampleFirst"));
  if (!differing.empty())
    throw InputError(fmt::format("{} and {} are not parts of one render: {}", name_a, name_b, differing));
}

LayerRequest recorded_in(const Layers& frame) {
  const std::string names = frame.text("recordedLayers"), statistics = frame.text("statistics");
  return LayerRequest::of(names.empty() ? std::vector<std::string>{} : split(names, ','), statistics != "none",
                          statistics == "buckets");
}

void write_limited_light(Layers& frame, const LimitedLight& limited) {
  frame.header["indirectLimitPaths"] = static_cast<int>(std::min<uint64_t>(limited.paths, INT32_MAX));
  frame.header["indirectLimitTaken"] = static_cast<float>(limited.taken);
  frame.header["indirectLimitFound"] = static_cast<float>(limited.found);
}

LimitedLight limited_light_of(const Layers& frame) {
  return {static_cast<uint64_t>(frame.number("indirectLimitPaths").value_or(0.0)),
          frame.number("indirectLimitTaken").value_or(0.0), frame.number("indirectLimitFound").value_or(0.0)};
}

void write_biases(Layers& frame, const std::vector<std::string>& biases) {
  frame.header["biased"] = biases.empty() ? std::string("false") : "true: " + join(biases, "; ");
}

std::vector<std::string> biases_of(const Layers& frame) {
  const std::string text = frame.text("biased");
  std::vector<std::string> biases;
  if (!text.starts_with("true: ")) return biases;
  for (size_t begin = 6, end = 0; end != std::string::npos; begin = end + 2) {
    end = text.find("; ", begin);
    biases.push_back(text.substr(begin, end - begin));
  }
  return biases;
}

bool CheckpointWriter::write(const Layers& frame, const WordRows& state) {
  std::string message;
  try {
    write_exr(path_, frame, {}, state);
    if (failing_) message = fmt::format("the checkpoint {} is written again", path_.string());
    failing_ = false;
  } catch (const InputError& error) {
    if (!failing_) message = fmt::format("no checkpoint for now, the render goes on: {}", error.what());
    failing_ = true;
  }
  if (warn_ && !message.empty()) warn_(message);
  return !failing_;
}

Layers merge_parts(const std::vector<std::filesystem::path>& files, bool keep_state, const Task& task) {
  Layers first = read_exr_state(files.at(0), task);
  check_same_render(first, files[0].string(), first, files[0].string(), false);
  Film film(first.width(), first.height(), recorded_in(first));
  std::vector<std::pair<Range, std::string>> held;
  double seconds = 0, cpu = 0, invalid = 0, capped = 0, total = 0, whole = 0;
  LimitedLight limited;
  std::string whole_of;  // the part that says so
  std::vector<std::string> biases;
  for (const auto& path : files) {
    const std::string name = path.string();
    const Layers part = path == files[0] ? std::move(first) : read_exr_state(path, task);
    if (path != files[0]) {
      Layers header(film.width(), film.height());
      header.header = first.header;
      header.origin = first.origin;
      header.display = first.display;
      check_same_render(part, name, header, files[0].string(), false);
    }
    if (part.text("interrupted").starts_with("true"))
      throw InputError(fmt::format("{}: was interrupted in the middle of a pass; finish it with --resume first", name));
    if (files.size() > 1 && part.text("adaptive").starts_with("true"))
      throw InputError(fmt::format(
          "{}: was rendered in rounds, its tiles hold different samples; expected parts of even samples", name));
    // A finished frame may be joined by the later samples of a longer one, parts only by those of their own.
    const double planned = part.number("sampleTotal").value_or(0.0);
    if (part.number("samplesPerPixel").value_or(0.0) < planned) {
      if (!whole_of.empty() && planned != whole)
        throw InputError(fmt::format(
            "{} is a part of a render of {} samples per pixel, {} of one of {}; expected parts of one render", whole_of,
            whole, name, planned));
      whole = planned;
      whole_of = name;
    }
    for (const Range& r : ranges_of(part, name)) {
      for (const auto& [other, whose] : held)
        if (r.first < other.end && other.first < r.end)
          throw InputError(fmt::format("{} and {} overlap: samples {} .. {} are in both; expected disjoint parts",
                                       whose, name, std::max(r.first, other.first), std::min(r.end, other.end) - 1));
      held.emplace_back(r, name);
    }
    film.merge_state(part, name, task);
    seconds += part.number("renderTimeSeconds").value_or(0.0);
    cpu += part.number("cpuSeconds").value_or(0.0);
    total = std::max(total, planned);
    invalid += part.number("invalidSampleCount").value_or(0.0);
    capped += part.number("cappedPaths").value_or(0.0);
    limited.merge(limited_light_of(part));
    for (const std::string& bias : biases_of(part))
      if (std::find(biases.begin(), biases.end(), bias) == biases.end()) biases.push_back(bias);
    if (path == files[0]) {
      first = Layers(part.width(), part.height());
      first.header = part.header;
      first.origin = part.origin;
      first.display = part.display;
    }
    // The same in all of them; a checkpoint may have none.
    if (first.channels().empty())
      for (const auto& [channel, plane] : part.channels())
        if (channel.starts_with("guide.")) first.set(channel, plane);
  }
  parallel_for(film.tile_count(), task, [&](int tile) { film.develop(tile); });
  Layers result = film.layers();
  if (keep_state) film.save_state(result);
  result.origin = first.origin;
  result.display = first.display;
  result.header = first.header;
  for (const auto& [channel, plane] : first.channels()) result.set(channel, plane);
  std::sort(held.begin(), held.end(), [](const auto& a, const auto& b) { return a.first.first < b.first.first; });
  std::vector<Range> joined;
  int samples = 0;
  for (const auto& [r, name] : held) {
    samples += r.end - r.first;
    if (!joined.empty() && joined.back().end == r.first)
      joined.back().end = r.end;
    else
      joined.push_back(r);
  }
  std::vector<std::string> texts;
  for (const Range& r : joined) texts.push_back(fmt::format("{}-{}", r.first, r.end));
  auto& header = result.header;
  header["sampleRanges"] = join(texts, ",");
  header["sampleFirst"] = joined.empty() ? 0 : joined.front().first;
  header["sampleEnd"] = joined.empty() ? 0 : joined.back().end;
  header["samplesPerPixel"] = samples;
  header["sampleTotal"] = static_cast<int>(total);
  header["partsMerged"] = static_cast<int>(files.size());
  header["renderTimeSeconds"] = static_cast<float>(seconds);
  header["cpuSeconds"] = static_cast<float>(cpu);
  header["invalidSampleCount"] = static_cast<int>(invalid);
  header["cappedPaths"] = static_cast<int>(capped);
  if (header.contains("indirectLimitPaths")) write_limited_light(result, limited);
  write_biases(result, biases);
  return result;
}

}  // namespace brume

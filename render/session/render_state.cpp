#include "render/session/render_state.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

#include "base/error.h"
#include "base/parallel_for.h"
#include "base/text.h"
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

namespace {

/// The windows and header of a part, without its channels.
Layers frame_like(const Layers& part) {
  Layers frame(part.width(), part.height());
  frame.header = part.header;
  frame.origin = part.origin;
  frame.display = part.display;
  return frame;
}

/// The samples that parts hold, and the sums in their headers.
class PartsHeader {
 public:
  /// @throws InputError when the part cannot be joined with those before
  void add(const Layers& part, const std::string& name) {
    add_total(part, name);
    for (const Range& r : ranges_of(part, name)) {
      for (const auto& [other, whose] : held_)
        if (r.first < other.end && other.first < r.end)
          throw InputError(fmt::format("{} and {} overlap: samples {} .. {} are in both; expected disjoint parts",
                                       whose, name, std::max(r.first, other.first), std::min(r.end, other.end) - 1));
      held_.emplace_back(r, name);
    }
    seconds_ += part.number("renderTimeSeconds").value_or(0.0);
    cpu_ += part.number("cpuSeconds").value_or(0.0);
    invalid_ += part.number("invalidSampleCount").value_or(0.0);
    capped_ += part.number("cappedPaths").value_or(0.0);
    limited_.merge(limited_light_of(part));
    for (const std::string& bias : biases_of(part))
      if (std::find(biases_.begin(), biases_.end(), bias) == biases_.end()) biases_.push_back(bias);
  }

  void write(Layers& frame, size_t parts) {
    std::sort(held_.begin(), held_.end(), [](const auto& a, const auto& b) { return a.first.first < b.first.first; });
    std::vector<Range> joined;
    int samples = 0;
    for (const auto& [r, name] : held_) {
      samples += r.end - r.first;
      if (!joined.empty() && joined.back().end == r.first)
        joined.back().end = r.end;
      else
        joined.push_back(r);
    }
    std::vector<std::string> texts;
    for (const Range& r : joined) texts.push_back(fmt::format("{}-{}", r.first, r.end));
    auto& header = frame.header;
    header["sampleRanges"] = join(texts, ",");
    header["sampleFirst"] = joined.empty() ? 0 : joined.front().first;
    header["sampleEnd"] = joined.empty() ? 0 : joined.back().end;
    header["samplesPerPixel"] = samples;
    header["sampleTotal"] = static_cast<int>(total_);
    header["partsMerged"] = static_cast<int>(parts);
    header["renderTimeSeconds"] = static_cast<float>(seconds_);
    header["cpuSeconds"] = static_cast<float>(cpu_);
    header["invalidSampleCount"] = static_cast<int>(invalid_);
    header["cappedPaths"] = static_cast<int>(capped_);
    if (header.contains("indirectLimitPaths")) write_limited_light(frame, limited_);
    write_biases(frame, biases_);
  }

 private:
  /// A finished frame may be joined by the later samples of a longer one, parts only by those of their own.
  void add_total(const Layers& part, const std::string& name) {
    const double planned = part.number("sampleTotal").value_or(0.0);
    total_ = std::max(total_, planned);
    if (!(part.number("samplesPerPixel").value_or(0.0) < planned)) return;
    if (!whole_of_.empty() && planned != whole_)
      throw InputError(
          fmt::format("{} is a part of a render of {} samples per pixel, {} of one of {}; expected parts of one render",
                      whole_of_, whole_, name, planned));
    whole_ = planned;
    whole_of_ = name;
  }

  std::vector<std::pair<Range, std::string>> held_;
  double seconds_ = 0, cpu_ = 0, invalid_ = 0, capped_ = 0, total_ = 0;
  double whole_ = 0;      // samples of the render that a part is of
  std::string whole_of_;  // the part that says so
  LimitedLight limited_;
  std::vector<std::string> biases_;
};

void check_even_samples(const Layers& part, const std::string& name, size_t parts) {
  if (part.text("interrupted").starts_with("true"))
    throw InputError(fmt::format("{}: was interrupted in the middle of a pass; finish it with --resume first", name));
  if (parts > 1 && part.text("adaptive").starts_with("true"))
    throw InputError(fmt::format(
        "{}: was rendered in rounds, its tiles hold different samples; expected parts of even samples", name));
}

}  // namespace

Layers merge_parts(const std::vector<std::filesystem::path>& files, bool keep_state, const Task& task) {
  std::vector<RenderPart> parts;
  for (const std::filesystem::path& file : files) parts.push_back(RenderPart::of_file(file));
  return merge_parts(parts, keep_state, task);
}

Layers merge_parts(const std::vector<RenderPart>& parts, bool keep_state, const Task& task) {
  Layers read;
  const auto open = [&](const RenderPart& part) -> const Layers& {
    if (part.frame) return *part.frame;
    read = read_exr_state(part.file, task);
    return read;
  };
  const std::string& first_name = parts.at(0).name;
  const Layers* part = &open(parts[0]);
  const Layers first = frame_like(*part);
  check_same_render(*part, first_name, *part, first_name, false);
  Film film(part->width(), part->height(), recorded_in(*part));
  std::map<std::string, Plane, std::less<>> guides;  // the same in all parts; a checkpoint may have none
  PartsHeader header;
  for (size_t i = 0; i < parts.size(); ++i) {
    const std::string& name = parts[i].name;
    if (i > 0) {
      part = &open(parts[i]);
      check_same_render(*part, name, first, first_name, false);
    }
    check_even_samples(*part, name, parts.size());
    header.add(*part, name);
    film.merge_state(*part, name, task);
    if (guides.empty())
      for (const auto& [channel, plane] : part->channels())
        if (channel.starts_with("guide.")) guides.emplace(channel, plane);
  }
  parallel_for(film.tile_count(), task, [&](int tile) { film.develop(tile); });
  Layers result = film.layers();
  if (keep_state) film.save_state(result);
  result.origin = first.origin;
  result.display = first.display;
  result.header = first.header;
  for (auto& [channel, plane] : guides) result.set(channel, std::move(plane));
  header.write(result, parts.size());
  return result;
}

}  // namespace brume

#include "evaluate/protocol/command_filter.h"

#include <fmt/format.h>

#include <algorithm>
#include <csignal>
#include <cstring>
#include <thread>

#include "base/command.h"
#include "base/missing_file.h"
#include "base/scratch_folder.h"
#include "base/text.h"
#include "evaluate/protocol/cache.h"
#include "filters/inputs/guide_layers.h"
#include "image/exr_io.h"
#include "image/pfm_io.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kColourName = "color", kOutputName = "output";

/// What stands in braces.
struct Place {
  enum class Kind { kFrame, kOutput, kLayer, kFolder, kSpp, kSeed, kThreads };
  Kind kind = Kind::kFrame;
  std::string layer = {}, statistic = {};  ///< of kLayer; the colour's name is empty
  bool pfm = false;                        ///< rather than an EXR
  std::string file = {};                   ///< name in the scratch folder
};

/// A word of the command: texts, each with the place behind it.
using Word = std::vector<std::pair<std::string, std::optional<Place>>>;

/// "NAME.pfm", "NAME.exr": the name and whether it is a PFM.
std::optional<std::pair<std::string, bool>> file_place(const std::string& name) {
  if (name.ends_with(".pfm")) return {{name.substr(0, name.size() - 4), true}};
  if (name.ends_with(".exr")) return {{name.substr(0, name.size() - 4), false}};
  return std::nullopt;
}

class CommandParser {
 public:
  CommandParser(const CommandFilter& settings, std::span<const LayerName> known) : known_(known) {
    for (const std::string& name : settings.layers) asked.ask_for(name, known, "layers");
    asked.statistics = settings.statistics;
    for (const std::string& text : parse_words(settings.command)) words.push_back(word_of(text));
    if (words.empty()) throw InputError("the command has no words");
    check_places();
  }

  std::vector<Word> words;
  ExternalFilter asked;  // what it reads

 private:
  Place place_of(const std::string& name) {
    using Kind = Place::Kind;
    const std::pair<const char*, Place> simple[] = {{"frame", {Kind::kFrame, "", "", false, "frame.exr"}},
                                                    {"output", {Kind::kOutput, "", "", false, "output.exr"}},
                                                    {"folder", {Kind::kFolder}},
                                                    {"spp", {Kind::kSpp}},
                                                    {"seed", {Kind::kSeed}},
                                                    {"threads", {Kind::kThreads}}};
    for (const auto& [known, place] : simple)
      if (name == known) return place;
    const auto file = file_place(name);
    if (!file) {
      std::vector<std::string> names;
      for (const CommandPlace& place : command_places()) names.push_back("{" + place.name + "}");
      throw InputError(fmt::format("no place '{{{}}}' in a command{}; a brace itself is written twice", name,
                                   suggestion("{" + name + "}", names)));
    }
    const auto& [what, pfm] = *file;
    if (what == kOutputName) return {Kind::kOutput, "", "", pfm, name};
    Place place{Kind::kLayer, what, "", pfm, name};
    for (const std::string_view known : {statistic::mean_variance, statistic::half_a, statistic::half_b})
      if (const std::string end = "." + std::string(known); what.ends_with(end)) {
        place.layer.resize(what.size() - end.size());
        place.statistic = known;
        asked.statistics = true;
      }
    if (place.layer == kColourName)
      place.layer.clear();
    else
      asked.ask_for(place.layer, known_, "{" + name + "}");
    return place;
  }

  Word word_of(const std::string& text) {
    Word word = {{"", std::nullopt}};
    for (size_t i = 0; i < text.size(); ++i) {
      const char c = text[i];
      if ((c == '{' || c == '}') && i + 1 < text.size() && text[i + 1] == c) {
        word.back().first += c;
        ++i;
        continue;
      }
      if (c == '}') throw InputError("a brace '}' closes none; a brace itself is written twice");
      if (c != '{') {
        word.back().first += c;
        continue;
      }
      const size_t end = text.find('}', i);
      if (end == std::string::npos) throw InputError("a brace '{' is not closed; a brace itself is written twice");
      word.back().second = place_of(text.substr(i + 1, end - i - 1));
      word.emplace_back("", std::nullopt);
      i = end;
    }
    return word;
  }

  void check_places() const {
    int inputs = 0;
    std::vector<std::string> outputs;
    for (const Word& word : words)
      for (const auto& [text, place] : word) {
        if (!place) continue;
        inputs += place->kind == Place::Kind::kFrame || place->kind == Place::Kind::kLayer;
        if (place->kind == Place::Kind::kOutput &&
            std::find(outputs.begin(), outputs.end(), place->file) == outputs.end())
          outputs.push_back(place->file);
      }
    if (outputs.empty())
      throw InputError("the command does not say where its picture goes: expected {output}, an EXR, or {output.pfm}");
    if (outputs.size() > 1)
      throw InputError(fmt::format("the command writes its picture to both {}; expected one", join(outputs, " and ")));
    if (inputs == 0)
      throw InputError("the command reads nothing of the frame: expected {frame}, an EXR, or {color.pfm}");
  }

  std::span<const LayerName> known_;
};

/// The channels of a layer of a frame: three, or one. @throws InputError when it has none
std::vector<const Plane*> planes_of(const Layers& frame, const Place& place) {
  for (const char* letters : {"RGB", "XYZ", "A", "Y", "Z"}) {
    const LayerName name{place.layer, letters, ""};
    if (!frame.has(name, place.statistic)) continue;
    std::vector<const Plane*> planes;
    for (const std::string& channel : name.channel_names(place.statistic)) planes.push_back(&frame.at(channel));
    return planes;
  }
  throw InputError(
      fmt::format("the frame has no layer for {{{}}}; its channels are {}", place.file, join(frame.names())));
}

void write_input(const Layers& frame, const Place& place, const ScratchFolder& folder) {
  if (place.kind == Place::Kind::kFrame) return write_exr(folder / place.file, frame);
  const std::vector<const Plane*> planes = planes_of(frame, place);
  if (place.pfm) return write_pfm(folder / place.file, planes);
  // Under names that any reader takes for a picture.
  Layers layer(frame.width(), frame.height());
  layer.lie_like(frame);
  for (size_t c = 0; c < planes.size(); ++c) layer.set(planes.size() == 3 ? layer::beauty.channel(c) : "Y", *planes[c]);
  write_exr(folder / place.file, layer);
}

std::string filled_in(const Word& word, const ExternalInput& input, const ScratchFolder& folder, int threads) {
  std::string text;
  for (const auto& [before, place] : word) {
    text += before;
    if (!place) continue;
    switch (place->kind) {
      case Place::Kind::kSpp:
        text += std::to_string(input.spp);
        break;
      case Place::Kind::kSeed:
        text += std::to_string(input.seed);
        break;
      case Place::Kind::kThreads:
        text += std::to_string(threads);
        break;
      case Place::Kind::kFolder:
        text += folder.path().string();
        break;
      default:
        text += (folder / place->file).string();
    }
  }
  return text;
}

std::string with_last_words(const std::string& what, const CommandEnd& end) {
  return end.said.empty() ? what + " without a word"
                          : fmt::format("{}; its last words: {}", what, join(split(end.said, '\n'), " / "));
}

/// @throws LimitPassed; InputError that says how it failed
void check_end(const CommandEnd& end, const ExternalInput& input, double memory_limit) {
  if (end.passed == CommandEnd::Limit::kTime)
    throw LimitPassed(with_last_words(fmt::format("took longer than {:g} s and was ended", input.time_limit), end));
  if (end.passed == CommandEnd::Limit::kMemory)
    throw LimitPassed(with_last_words(fmt::format("held {:.3g} GB, more than the {:.3g} GB that it may, and was ended",
                                                  end.peak_bytes / 1e9, memory_limit / 1e9),
                                      end));
  if (end.signal == SIGKILL)
    throw InputError(with_last_words("was killed, by the system for want of memory perhaps", end));
  if (end.signal != 0)
    throw InputError(
        with_last_words(fmt::format("was ended by signal {} ({})", end.signal, strsignal(end.signal)), end));
  if (end.status != 0) throw InputError(with_last_words(fmt::format("ended with exit status {}", end.status), end));
}

/// A command that is ready to run.
struct Prepared {
  CommandParser parsed;
  fs::path program, folder;
  double memory_limit = 0;

  ExternalOutput run(const ExternalInput& input, const Task& task) const {
    const ScratchFolder scratch;
    const int threads = task.threads > 0 ? task.threads : static_cast<int>(std::thread::hardware_concurrency());
    Command command;
    command.program = program;
    command.folder = folder;
    command.environment["OMP_NUM_THREADS"] = std::to_string(threads);
    command.time_limit = input.time_limit > 0 ? input.time_limit - input.time_used : 0;
    command.memory_limit = memory_limit;
    const Stopwatch writing;
    Place output;
    std::vector<std::string> written;
    for (const Word& word : parsed.words) {
      command.words.push_back(filled_in(word, input, scratch, threads));
      for (const auto& [text, place] : word) {
        if (!place) continue;
        if (place->kind == Place::Kind::kOutput) output = *place;
        if (place->kind != Place::Kind::kFrame && place->kind != Place::Kind::kLayer) continue;
        if (std::find(written.begin(), written.end(), place->file) != written.end()) continue;
        written.push_back(place->file);
        write_input(input.frame, *place, scratch);
      }
    }
    ExternalOutput result;
    result.exchange_seconds = writing.seconds();
    CommandEnd end = run_command(command, task);
    end.said = without_folder(std::move(end.said), scratch.path());
    check_end(end, input, memory_limit);
    result.seconds = end.seconds;
    if (end.peak_bytes > 0) result.peak_bytes = end.peak_bytes;
    const Stopwatch reading;
    result.picture = read_output(scratch.path(), output, end);
    result.exchange_seconds += reading.seconds();
    return result;
  }

 private:
  static Layers read_output(const fs::path& folder, const Place& output, const CommandEnd& end) {
    const fs::path path = folder / output.file;
    const char* const place = output.pfm ? "output.pfm" : "output";
    std::error_code ignored;
    const fs::file_status status = fs::status(path, ignored);
    if (!fs::exists(status)) throw InputError(with_last_words(fmt::format("wrote no picture to {{{}}}", place), end));
    // Another kind of file, such as a pipe, might be read without end.
    if (!fs::is_regular_file(status))
      throw InputError(
          with_last_words(fmt::format("made {{{}}} a {}; expected a file", place, kind_of(status.type())), end));
    try {
      return output.pfm ? read_pfm(path) : read_exr(path);
    } catch (const InputError& error) {
      std::string what = error.what();
      if (const std::string name = path.string() + ": "; what.starts_with(name)) what.erase(0, name.size());
      what = without_folder(std::move(what), folder);
      throw InputError(with_last_words(fmt::format("its picture cannot be read: {}", what), end));
    }
  }

  static const char* kind_of(fs::file_type type) {
    switch (type) {
      case fs::file_type::directory:
        return "folder";
      case fs::file_type::fifo:
        return "named pipe";
      case fs::file_type::socket:
        return "socket";
      default:
        return "device";
    }
  }

  /// A text in which the scratch folder, whose name is another each time, is called as in commands.
  static std::string without_folder(std::string text, const fs::path& folder) {
    return replaced(std::move(text), folder.string(), "{folder}");
  }
};

/// The text of a word in which nothing is filled in.
std::optional<std::string> plain_text(const Word& word) {
  return word.size() == 1 ? std::optional(word[0].first) : std::nullopt;
}

bool is_script(const fs::path& path) {
  static constexpr std::string_view kEndings[] = {".py", ".sh", ".jl", ".R", ".r", ".pl", ".rb", ".lua", ".js", ".m"};
  return std::find(std::begin(kEndings), std::end(kEndings), path.extension().string()) != std::end(kEndings);
}

fs::path program_of(const CommandFilter& settings, const Word& word) {
  const std::optional<std::string> name = plain_text(word);
  if (!name) throw InputError("the command begins with a place to fill in; expected a program");
  if (const fs::path program = find_program(*name, settings.folder); !program.empty()) return program;
  std::error_code ignored;
  const fs::path path = settings.folder / *name;
  if (name->find('/') == std::string::npos)
    throw InputError(fmt::format(
        "no program '{}' in the folders of PATH{}", *name,
        fs::exists(path, ignored) ? fmt::format("; write ./{} for the one beside the experiment", *name) : ""));
  throw InputError(fs::exists(path, ignored)
                       ? fmt::format("{}: is no program that may be run (chmod +x)", path.string())
                       : fmt::format("{}: no such program", path.string()));
}

/// Everything that decides the result: the words, and what the files hold that they name.
std::string key_of(const CommandFilter& settings, const CommandParser& parsed, const fs::path& program) {
  std::string key = fmt::format("command {}\nprogram {}", settings.command, Cache::hash_contents(program));
  std::error_code ignored;
  for (size_t i = 1; i < parsed.words.size(); ++i) {
    const std::optional<std::string> text = plain_text(parsed.words[i]);
    if (!text) continue;
    std::vector<std::string> names = {*text};
    if (const size_t equals = text->find('='); equals != std::string::npos) names.push_back(text->substr(equals + 1));
    for (const std::string& name : names)
      if (const fs::path path = settings.folder / name; !name.empty() && fs::is_regular_file(path, ignored))
        key += fmt::format("\nfile {} {}", name, Cache::hash_contents(path));
    if (!text->starts_with('-') && is_script(*text)) check_exists(settings.folder / *text);
  }
  for (const fs::path& path : settings.depends) key += fmt::format("\ndepends {}", Cache::hash_contents(path));
  return key;
}

}  // namespace

const std::vector<CommandPlace>& command_places() {
  static const std::vector<CommandPlace> places = {
      {"frame",
       "an EXR with all that the filter is given: the colour to clean as R G B, and what `layers` and `statistics` ask for"},
      {"output", "the EXR to write: R G B, of the frame's size"},
      {"output.pfm", "the same as a PFM"},
      {"color.pfm",
       "the colour to clean as a PFM: 32-bit floats, the bottom row first, as Open Image Denoise reads and writes it"},
      {"LAYER.pfm",
       "a layer by itself, such as `{albedo.pfm}`, `{normal.pfm}`, `{guide.opacity.pfm}`, which need not stand in `layers`"},
      {"LAYER.mean_variance.pfm",
       "a statistic of a layer: `mean_variance`, `half_a` or `half_b`, such as `{color.mean_variance.pfm}`"},
      {"LAYER.exr", "any of these as an EXR of R G B or Y"},
      {"spp", "samples per pixel of the frame"},
      {"seed", "of the frame, a whole number"},
      {"threads", "that filters may use, as OMP_NUM_THREADS says too"},
      {"folder", "a folder for files of its own, which is empty but for those named here and removed afterwards"},
  };
  return places;
}

ExternalFilter command_filter(const CommandFilter& settings, std::span<const LayerName> known) {
  CommandParser parsed(settings, known);
  fs::path program = program_of(settings, parsed.words[0]);
  ExternalFilter filter = parsed.asked;
  filter.kind = "command";
  filter.words = settings.command;
  filter.key = key_of(settings, parsed, program);
  filter.memory_limit = settings.memory_limit;
  const auto prepared = std::make_shared<const Prepared>(
      Prepared{std::move(parsed), std::move(program), settings.folder, settings.memory_limit});
  filter.run = [prepared](const ExternalInput& input, const Task& task) { return prepared->run(input, task); };
  return filter;
}

std::string command_label(const std::string& command) {
  const std::vector<std::string> words = parse_words(command);
  // The script rather than what runs it.
  for (const std::string& word : words)
    if (is_script(word)) return fs::path(word).stem().string();
  return words.empty() ? "" : fs::path(words[0]).stem().string();
}

}  // namespace brume

#include "workflows/view/viewed_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <sstream>

#include "base/error.h"
#include "base/output_file.h"
#include "base/sequence.h"
#include "base/text.h"
#include "render/scene/scene_fingerprint.h"
#include "render/scene/scene_io.h"
#include "volume/vdb_io.h"
#include "workflows/scene.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr size_t kKept = 3, kKeptFrames = 8;  // scenes that one may come back to: by undo, on the time line

/// What of the assignments decides what is made up around a bare volume: the grid that it is made for.
std::vector<std::string> guess_of(const std::vector<std::string>& assignments) {
  std::vector<std::string> guess;
  for (const std::string& assignment : assignments)
    for (const char* key : {"volumes.0.grid=", "volumes.0.convert_level_set="})
      if (assignment.starts_with(key)) guess.push_back(assignment);
  return guess;
}

/// What a made-up scene says of camera and extinction, as assignments.
std::vector<std::string> guesses_in(const std::string& text) {
  std::vector<std::string> guesses;
  std::istringstream lines(text);
  std::string table;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("[")) table = line == "[camera]" ? "camera" : line == "[[volumes]]" ? "volumes.0" : "";
    const size_t equals = line.find(" = ");
    if (equals == std::string::npos || table.empty()) continue;
    const std::string key = line.substr(0, equals);
    if (table == "camera" || key == "sigma_t")
      guesses.push_back(fmt::format("{}.{}={}", table, key, line.substr(equals + 3)));
  }
  return guesses;
}

/// The files that a scene names, as it names them.
std::set<std::string> files_of(const std::vector<SceneTable>& tables) {
  std::set<std::string> files;
  for (const SceneTable& table : tables)
    for (const SceneKey& key : table.keys)
      if (key.type == SceneKey::Type::kFile) files.insert(std::get<std::string>(key.value));
  return files;
}

}  // namespace

std::optional<int> ViewedText::frame_of(std::optional<int> frame) const {
  if (frames.empty()) return std::nullopt;
  return frame && std::find(frames.begin(), frames.end(), *frame) != frames.end() ? *frame : frames.front();
}

std::vector<std::string> ViewedText::assignments(const std::vector<std::string>& own, const ivec2& size,
                                                 std::optional<int> frame) const {
  std::vector<std::string> all = overrides;
  if (const std::optional<int> number = frame_of(frame)) all.push_back(fmt::format("render.frame={}", *number));
  all.insert(all.end(), own.begin(), own.end());
  if (size.x > 0) {
    all.push_back(fmt::format("film.width={}", size.x));
    all.push_back(fmt::format("film.height={}", size.y));
  }
  return all;
}

std::string ViewedText::scene(const std::vector<std::string>& own, const ivec2& size, std::optional<int> frame) const {
  if (text.empty()) throw InputError(fmt::format("{}: has not been read yet", path.string()));
  return edited_scene(text, path, assignments(own, size, frame));
}

std::string ViewedText::command(const std::vector<std::string>& own, const ivec2& size,
                                std::optional<int> frame) const {
  const std::optional<int> number = frame_of(frame);
  std::vector<std::string> words = {"brume", "render", path.string()};
  std::vector<std::string> said = assignments(own, size, frame);
  if (!own.empty() || size != guessed_for) {
    const std::set<std::string> keys = assigned_keys(said);
    for (const std::string& guess : guessed)
      if (!keys.contains(guess.substr(0, guess.find('=')))) said.push_back(guess);
  }
  for (const std::string& assignment : said)
    if (!number || !assignment.starts_with("render.frame=") || frames.size() == 1)
      words.insert(words.end(), {"-D", assignment});
  words.push_back("--clean");
  const std::string stem = path.stem().string();
  if (number) words.insert(words.end(), {"--frames", std::to_string(*number)});
  const bool has_place = FramePattern::of(path.filename()).has_value();
  words.insert(words.end(), {"-o", number && !has_place ? stem + ".####.exr" : stem + ".exr"});
  std::string line;
  for (const std::string& word : words) line += (line.empty() ? "" : " ") + shell_word(word);
  return line;
}

std::vector<std::string> ViewedText::mixed(std::vector<std::string> own, const ivec2& size, std::optional<int> frame,
                                           const LightMix& mix) const {
  if (!mix.empty())
    for (std::string& assignment : assignments_of_mix(scene(own, size, frame), path, mix))
      own.push_back(std::move(assignment));
  return own;
}

ViewedScene::ViewedScene(fs::path scene, std::vector<int> frames, std::vector<std::string> overrides,
                         LayerRequest layers)
    : source_{std::move(scene), std::move(frames), std::move(overrides), {}},
      layers_(std::move(layers)),
      cache_(source_.frames.empty() ? kKept : kKeptFrames) {
  layers_.guides = true;
}

void ViewedScene::read_again() {
  source_.text.clear();
  solving_.reset();
  cache_.forget();
  grids_.clear();
}

std::vector<fs::path> ViewedScene::files() const {
  std::vector<fs::path> all = {file_};
  const auto add = [&](const fs::path& path) {
    if (std::find(all.begin(), all.end(), path) == all.end()) all.push_back(path);
  };
  for (const std::string& name : named_)
    if (!name.empty()) add(source_.path.parent_path() / file_of_frame(name, frame_.value_or(0)));
  return all;
}

void ViewedScene::read(const std::vector<std::string>& assignments, const ivec2& size, const Task& task) {
  const fs::path& path = source_.path;
  source_.text.clear();
  file_ = file_of_frame(path, frame_.value_or(0));
  named_.clear();
  made_.reset();
  const std::vector<int>& frames = source_.frames;
  const bool bare = frames.empty() ? is_volume(file_) : std::any_of(frames.begin(), frames.end(), [&](int frame) {
    return is_volume(file_of_frame(path, frame));
  });
  if (bare) {
    made_ = frames.empty() ? scene_for_volume(file_, assignments, task)
                           : scene_for_volumes(path, frames, assignments, task);
    source_.text = made_->text(path.filename().string());
    source_.guessed = guesses_in(source_.text);
    source_.guessed_for = size;
  } else {
    read_scene_alone(file_, source_.assignments({}, ivec2(0), frame_));  // says what is wrong with the file
    source_.text = read_text(file_);
  }
}

bool ViewedScene::show(const std::vector<std::string>& assignments, const ivec2& size, std::optional<int> frame,
                       const Task& task) {
  frame_ = source_.frame_of(frame);
  wanted_ = assignments;
  const fs::path& path = source_.path;
  const bool read_now = source_.text.empty() ||
                        (made_ ? guess_of(assignments) != guess_ : file_ != file_of_frame(path, frame_.value_or(0)));
  const std::vector<std::string> all = source_.assignments(assignments, size, frame_);
  if (read_now) {
    guess_ = guess_of(assignments);
    read(all, size, task);
  }
  std::vector<SceneTable> tables = outline_scene(source_.text, path, all);
  const std::set<std::string> named = files_of(outline_scene(source_.text, path, source_.overrides));
  for (const std::string& file : files_of(tables))
    if (!file.empty() && !named.contains(file))
      throw InputError(fmt::format("{}: is no file that the scene names; only its own can be looked at", file));
  named_ = named;
  Scene scene = parse_scene_alone(source_.text, path, all);
  if (read_now && made_ && made_->density && !scene.volumes.empty())
    cache_.know(scene.volumes.at(0).file, made_->density);
  const PreparedScene* const before = cache_.empty() ? nullptr : &cache_.last();
  const auto pixels = [](const FilmSettings& film) { return 1.0 * film.width * film.height; };
  if (before && (world_of(scene) != world_of(before->scene()) || pixels(scene.film) != pixels(before->scene().film)))
    solving_.reset();
  const bool other = &cache_.prepare(scene, layers_, task) != before;
  scene_ = std::move(scene);
  tables_ = std::move(tables);
  return other;
}

const Guides& ViewedScene::guides(const Task& task) {
  if (!has_guides()) {
    if (!solving_) {
      solving_ = std::make_unique<Solving>();
      const Task beside{task.threads, [&now = *solving_](double share) { now.share = share; }, &solving_->cancel};
      solving_->done = std::async(std::launch::async, prepared().guides_solver(kGuideSamples), beside);
    }
    while (solving_->done.wait_for(std::chrono::milliseconds(20)) != std::future_status::ready) {
      task.check();
      task.report(solving_->share);
    }
    std::exchange(solving_, nullptr)->done.get();
  }
  return *prepared().guides(kGuideSamples, task);
}

Layers ViewedScene::coarse(const ivec2& size, int samples, const Task& task) {
  Scene scene = scene_;
  scene.film.width = size.x;
  scene.film.height = size.y;
  LayerRequest picture;
  picture.names = {};
  RenderResult result = cache_.prepare(std::move(scene), picture, task).render(samples, scene_.render.seed, task);
  cache_.prepare(scene_, layers_, task);
  return std::move(result.layers);
}

std::string ViewedScene::title() const {
  const std::string& name = prepared().scene().name;
  const auto is_of = [&](int frame) { return file_of_frame(source_.path, frame).stem() == name; };
  return std::any_of(source_.frames.begin(), source_.frames.end(), is_of) ? source_.path.stem().string() : name;
}

std::pair<std::string, std::string> ViewedScene::fingerprint() {
  Scene scene = scene_;
  cache_.add_fingerprint(scene);
  return {scene.hash, scene.settings};
}

std::vector<std::string> ViewedScene::notes() const {
  std::vector<std::string> all;
  if (made_)
    for (const std::string& line : made_->all_assumptions()) all.push_back("assumed " + line);
  if (!cache_.empty()) {
    const std::vector<std::string>& own = prepared().notes();
    all.insert(all.end(), own.begin(), own.end());
  }
  return all;
}

std::vector<std::string> ViewedScene::grids(const std::string& file) {
  if (file.empty()) return {};
  const auto [known, fresh] = grids_.try_emplace(file);
  if (!fresh) return known->second;
  const fs::path path = source_.path.parent_path() / file_of_frame(file, frame_.value_or(0));
  try {
    for (const GridSummary& grid : read_vdb_contents(path).grids) known->second.push_back(grid.name);
  } catch (const InputError&) {  // told by who reads the volume
  }
  return known->second;
}

std::pair<std::string, std::vector<GridChoice>> ViewedScene::grids_instead() const {
  const auto choices = [](const fs::path& file) {
    std::vector<GridChoice> all;
    try {
      for (const GridSummary& grid : read_vdb_info(file).grids) {
        const bool number = grid.type == "float" || grid.type == "double" || grid.type == "half";
        const bool something = grid.active_voxels + grid.active_tiles > 0 && (!grid.has_range || grid.maximum > 0);
        all.push_back({grid.name, grid.type, number && something});
      }
    } catch (const std::exception&) {  // told by who reads the volume
    }
    return all;
  };
  try {
    // A bare volume around which nothing could be made up.
    if (is_volume(file_)) {
      if (!source_.text.empty()) return {};
      return {"volumes.0.grid",
              choices(source_.frames.empty() ? file_ : file_of_frame(source_.path, source_.frames.back()))};
    }
    for (const SceneTable& table :
         outline_scene(source_.text, source_.path, source_.assignments(wanted_, ivec2(0), frame_))) {
      const SceneKey *const file = table.find("file"), *const grid = table.find("grid");
      if (!table.path.starts_with("volumes.") || !file || !grid || std::get<std::string>(file->value).empty()) continue;
      const auto& wanted = std::get<std::string>(grid->value);
      std::vector<GridChoice> all =
          choices(source_.path.parent_path() / file_of_frame(std::get<std::string>(file->value), frame_.value_or(0)));
      const bool there = std::any_of(all.begin(), all.end(), [&](const GridChoice& choice) {
        return choice.usable && choice.name == (wanted.empty() ? "density" : wanted);
      });
      if (!all.empty() && !there) return {table.path + ".grid", std::move(all)};
    }
  } catch (const InputError&) {  // the scene itself is wrong
  }
  return {};
}

}  // namespace brume

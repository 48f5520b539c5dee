#include "workflows/viewed_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <set>

#include "base/error.h"
#include "base/sequence.h"
#include "base/text.h"
#include "render/scene/scene_io.h"
#include "volume/vdb_io.h"
#include "workflows/scene.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr size_t kKept = 3, kKeptFrames = 8;  // scenes that one may come back to: by undo, on the time line

/// The files that a scene names, as it names them.
std::set<std::string> files_of(const std::vector<SceneTable>& tables) {
  std::set<std::string> files;
  for (const SceneTable& table : tables)
    for (const SceneKey& key : table.keys)
      if (key.type == SceneKey::Type::kFile) files.insert(std::get<std::string>(key.value));
  return files;
}

}  // namespace

ViewedScene::ViewedScene(fs::path scene, std::vector<int> frames, std::vector<std::string> overrides,
                         LayerRequest layers)
    : path_(std::move(scene)),
      frames_(std::move(frames)),
      overrides_(std::move(overrides)),
      layers_(std::move(layers)),
      cache_(frames_.empty() ? kKept : kKeptFrames) {
  layers_.guides = true;
}

void ViewedScene::read_again() {
  text_.clear();
  cache_.forget();
  grids_.clear();
}

void ViewedScene::read(const std::vector<std::string>& assignments, const Task& task) {
  std::error_code error;
  file_ = file_of_frame(path_, frame_.value_or(0));
  written_ = fs::last_write_time(file_, error);
  made_.reset();
  const bool bare = frames_.empty() ? is_volume(file_) : std::any_of(frames_.begin(), frames_.end(), [&](int frame) {
    return is_volume(file_of_frame(path_, frame));
  });
  if (bare) {
    made_ = frames_.empty() ? scene_for_volume(file_, assignments, task)
                            : scene_for_volumes(path_, frames_, assignments, task);
    text_ = made_->text(path_.filename().string());
  } else {
    read_scene_alone(file_, all_assignments({}, ivec2(0)));  // says what is wrong with the file
    std::ifstream stream(file_, std::ios::binary);
    text_.assign(std::istreambuf_iterator<char>(stream), {});
  }
}

std::vector<std::string> ViewedScene::all_assignments(const std::vector<std::string>& assignments,
                                                      const ivec2& size) const {
  std::vector<std::string> all = overrides_;
  if (frame_) all.push_back(fmt::format("render.frame={}", *frame_));
  all.insert(all.end(), assignments.begin(), assignments.end());
  if (size.x > 0) {
    all.push_back(fmt::format("film.width={}", size.x));
    all.push_back(fmt::format("film.height={}", size.y));
  }
  return all;
}

bool ViewedScene::show(const std::vector<std::string>& assignments, const ivec2& size, std::optional<int> frame,
                       const Task& task) {
  if (!frames_.empty() && (!frame || std::find(frames_.begin(), frames_.end(), *frame) == frames_.end()))
    frame = frames_.front();
  frame_ = frames_.empty() ? std::nullopt : frame;
  const bool read_now = text_.empty();
  const std::vector<std::string> all = all_assignments(assignments, size);
  if (read_now || (!made_ && file_ != file_of_frame(path_, frame_.value_or(0)))) read(all, task);
  std::vector<SceneTable> tables = outline_scene(text_, path_, all);
  const std::set<std::string> named = files_of(outline_scene(text_, path_, overrides_));
  for (const std::string& file : files_of(tables))
    if (!file.empty() && !named.contains(file))
      throw InputError(fmt::format("{}: is no file that the scene names; only its own can be looked at", file));
  Scene scene = parse_scene_alone(text_, path_, all);
  if (read_now && made_ && made_->density && !scene.volumes.empty())
    cache_.know(scene.volumes.at(0).file, made_->density);
  const PreparedScene* const before = cache_.empty() ? nullptr : &cache_.last();
  const bool other = &cache_.prepare(std::move(scene), layers_, task) != before;
  tables_ = std::move(tables);
  assignments_ = assignments;
  size_ = size;
  return other;
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
  const fs::path path = path_.parent_path() / file_of_frame(file, frame_.value_or(0));
  try {
    for (const GridSummary& grid : read_vdb_contents(path).grids) known->second.push_back(grid.name);
  } catch (const InputError&) {  // told by who reads the volume
  }
  return known->second;
}

std::string ViewedScene::text() const {
  return edited_scene(text_, path_, all_assignments(assignments_, size_));
}

std::string ViewedScene::command() const {
  std::vector<std::string> words = {"brume", "render", path_.string()};
  for (const std::string& assignment : all_assignments(assignments_, size_))
    if (!frame_ || !assignment.starts_with("render.frame=") || frames_.size() == 1)
      words.insert(words.end(), {"-D", assignment});
  words.push_back("--clean");
  const std::string stem = path_.stem().string();
  if (frame_) words.insert(words.end(), {"--frames", std::to_string(*frame_)});
  const bool has_place = FramePattern::of(path_.filename()).has_value();
  words.insert(words.end(), {"-o", frame_ && !has_place ? stem + ".####.exr" : stem + ".exr"});
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : " ") + shell_word(word);
  return text;
}

}  // namespace brume

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

constexpr int kGuideSamples = 16;             // that guides are made for: a picture is looked at for seconds
constexpr size_t kKept = 3, kKeptFrames = 8;  // scenes that one may come back to: by undo, on the time line
constexpr double kMostMemory = 0.25;          // of the machine's, for all of them but the one that is shown

/// Whether light depends on a key of the camera: not on where it stands and how its rays spread.
bool lights_depend_on(const SceneKey& key) {
  const std::string_view name = key.field.key;
  return name == "shutter" || name == "position_end" || name == "look_at_end" || name == "up_end" || name == "keys";
}

/// The tables without the keys that light does not depend on.
std::vector<SceneTable> what_light_depends_on(const std::vector<SceneTable>& all) {
  std::vector<SceneTable> tables;
  for (const SceneTable& table : all) {
    if (table.path == "film") continue;
    SceneTable& own = tables.emplace_back(table);
    if (own.path == "camera") std::erase_if(own.keys, [](const SceneKey& key) { return !lights_depend_on(key); });
  }
  return tables;
}

/// The files that a scene names, as it names them.
std::set<std::string> files_of(const std::vector<SceneTable>& tables) {
  std::set<std::string> files;
  for (const SceneTable& table : tables)
    for (const SceneKey& key : table.keys)
      if (key.type == SceneKey::Type::kFile) files.insert(std::get<std::string>(key.value));
  return files;
}

double bytes_of(const PreparedScene& scene) {
  double sum = 0;
  for (const Medium& m : scene.context().media)
    if (!m.homogeneous()) sum += static_cast<double>(m.bricks().bytes());
  return sum;
}

}  // namespace

ViewedScene::ViewedScene(fs::path scene, std::vector<int> frames, std::vector<std::string> overrides,
                         LayerRequest layers)
    : path_(std::move(scene)),
      frames_(std::move(frames)),
      overrides_(std::move(overrides)),
      layers_(std::move(layers)) {
  layers_.guides = true;
}

void ViewedScene::read_again() {
  text_.clear();
  fields_.clear();
  grids_.clear();
}

void ViewedScene::read(const Task& task) {
  std::error_code error;
  file_ = file_of_frame(path_, frame_.value_or(0));
  written_ = fs::last_write_time(file_, error);
  made_.reset();
  if (is_volume(file_)) {
    // One camera for a sequence of bare volumes, as render_sequence has it: what lies around the last one.
    made_ = scene_for_volume(frames_.empty() ? file_ : file_of_frame(path_, frames_.back()), task);
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

void ViewedScene::add_fields(Scene& scene, const Task& task) {
  for (VolumeSettings& v : scene.volumes) {
    if (v.shape != "grid" || v.convert_level_set || !v.remap.empty() || v.max_density > 0) continue;
    std::weak_ptr<const ScalarField>& known = fields_[{v.file, v.grid}];
    v.field = known.lock();
    if (std::error_code error; !v.field && made_ && frames_.empty() && fs::equivalent(v.file, path_, error) &&
                               made_->density->summary.name == v.grid)
      v.field = made_->density;
    if (!v.field) v.field = std::make_shared<const ScalarField>(load_scalar(v.file, {v.grid}, task));
    known = v.field;
    v.grid = v.field->summary.name;
  }
  std::erase_if(fields_, [](const auto& entry) { return entry.second.expired(); });
}

bool ViewedScene::show(const std::vector<std::string>& assignments, const ivec2& size, std::optional<int> frame,
                       const Task& task) {
  if (!frames_.empty() && (!frame || std::find(frames_.begin(), frames_.end(), *frame) == frames_.end()))
    frame = frames_.front();
  frame_ = frames_.empty() ? std::nullopt : frame;
  const bool read_now = text_.empty();
  if (read_now || (!made_ && file_ != file_of_frame(path_, frame_.value_or(0)))) read(task);
  const std::vector<std::string> all = all_assignments(assignments, size);
  std::vector<SceneTable> tables = outline_scene(text_, path_, all);
  const std::set<std::string> named = files_of(outline_scene(text_, path_, overrides_));
  for (const std::string& file : files_of(tables))
    if (!file.empty() && !named.contains(file))
      throw InputError(fmt::format("{}: is no file that the scene names; only its own can be looked at", file));
  Scene scene = parse_scene_alone(text_, path_, all);
  std::vector<SceneTable> light = what_light_depends_on(tables);

  const auto known = std::find_if(shown_.begin(), shown_.end(),
                                  [&](const auto& s) { return s->light == light && s->frame == frame_; });
  const bool other = read_now || known != shown_.begin() || shown_.empty();
  if (known != shown_.end() && !read_now) {
    (*known)->prepared->look_from(scene.camera, scene.film);
    shown_.splice(shown_.begin(), shown_, known);
  } else {
    add_fields(scene, task);
    auto fresh = std::make_unique<Shown>(Shown{std::move(light), frame_, nullptr, nullptr, nullptr});
    fresh->prepared = std::make_unique<PreparedScene>(std::move(scene), layers_, task);
    if (read_now) shown_.clear();
    shown_.push_front(std::move(fresh));
    double bytes = 0;
    const size_t most = frames_.empty() ? kKept : kKeptFrames;
    for (auto it = std::next(shown_.begin()); it != shown_.end();) {
      bytes += bytes_of(*(*it)->prepared);
      const bool keep =
          bytes < kMostMemory * physical_memory() && static_cast<size_t>(std::distance(shown_.begin(), it)) < most;
      it = keep ? std::next(it) : shown_.erase(it);
    }
  }
  tables_ = std::move(tables);
  assignments_ = assignments;
  size_ = size;
  return other;
}

const Guides& ViewedScene::sketch(const Task& task) {
  Shown& now = *shown_.front();
  if (!now.sketch) {
    const FilmSettings& film = now.prepared->scene().film;
    now.sketch = std::make_unique<Guides>(now.prepared->context(), 0, 1.0 * film.width * film.height, task);
  }
  return *now.sketch;
}

const Guides& ViewedScene::guides(const Task& task) {
  Shown& now = *shown_.front();
  if (!now.guides) now.guides = now.prepared->guides(kGuideSamples, task);
  return *now.guides;
}

std::vector<std::string> ViewedScene::notes() const {
  std::vector<std::string> all;
  if (made_)
    for (const std::string& line : made_->assumptions) all.push_back("assumed " + line);
  if (!shown_.empty()) {
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

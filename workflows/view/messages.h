#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "render/scene/scene_outline.h"
#include "workflows/mix_lights.h"
#include "workflows/view/viewed_scene.h"

namespace brume {

// What a viewer is asked, and what it answers.

/// What is looked at: the whole of it, each time.
struct ViewLook {
  uint64_t id = 0;  ///< what is shown names it
  std::vector<std::string> assignments;
  ivec2 size{0};
  bool moving = false;              ///< more of them follow at once: answered fast, at lower resolution
  std::vector<std::string> layers;  ///< that are shown, by names out of ViewSceneText::layers
  std::optional<int> frame;
  bool needs_scene = false;    ///< who looks has been told nothing of the scene yet
  int most_samples = 1 << 20;  ///< per pixel
  /// Of light groups, in what is shown and kept; nothing is rendered again for it.
  LightMix mix = {};
  /// Of the scene's text: where another one was looked at before, the file is read again, and of those that it names
  /// the ones that are new.
  uint64_t revision = 0;

  /// Whether the same is rendered for it, of whichever layers and mix.
  bool shows_as(const ViewLook& other) const {
    return assignments == other.assignments && size == other.size && frame == other.frame &&
           most_samples == other.most_samples && revision == other.revision;
  }
};

/// A point of the picture that somebody points at, from the top left corner, 0 to 1.
struct ViewProbe {
  uint64_t id = 0;
  dvec2 at{0};
};

/// One layer as half floats, channel by channel, rows from the top.
struct ViewPicture {
  uint64_t id = 0;
  std::string layer;
  int width = 0, height = 0, channels = 0;
  bool predicted = false;   ///< from guides alone; else path traced and clean
  bool full = true;         ///< of the size asked for, and no better prediction follows
  bool misses_mix = false;  ///< lights are as rendered, although a mix is asked for: it is not known by light group
  int samples = 0;          ///< per pixel, on average
  std::optional<double> error;
  double seconds = 0;  ///< since it was asked for
  double exposure = 1;
  std::optional<int> frame;
  std::vector<uint16_t> halves;
};

/// What a page needs to know of the scene.
struct ViewSceneText {
  struct Layer {
    std::string name, title;
    int channels;
    std::string group = "", unit = "";  ///< under which it is listed; of its values
    friend bool operator==(const Layer&, const Layer&) = default;
  };
  struct Table {
    SceneTable keys;
    std::string title;
    std::vector<std::string> grids;              ///< of a volume's file
    std::optional<std::array<double, 3>> depth;  ///< of a volume: optical depth through its middle along the axes
  };
  uint64_t id = 0;
  std::string name, command;
  bool of_frames = false;  ///< frames that are there: no scene, and nothing is rendered
  bool reloaded = false;   ///< the file has changed
  std::vector<int> frames;
  dvec3 lo{0}, hi{0};  ///< of what the volumes and lights that are seen fill
  std::vector<Layer> layers;
  std::vector<std::string> light_groups;  ///< that can be mixed
  std::vector<std::string> notes, left_out;
  std::vector<Table> tables;
};

enum class ViewStage { kReading, kSolvingLight, kMarching, kSampling, kCleaning, kDone };

/// How far what is being computed has come.
struct ViewProgress {
  uint64_t id = 0;
  ViewStage stage = ViewStage::kDone;
  int samples = 0;                   ///< per pixel, taken on average so far
  int goal = 0;                      ///< samples per pixel at the end of the round
  std::optional<double> share = {};  ///< of the stage that is done, where it is known
  std::optional<double> error = {};
  double seconds = 0;  ///< since it was asked for
};

/// What is wrong, and where another grid would mend it, which there are.
struct ViewProblem {
  uint64_t id = 0;
  std::string text;
  std::string grid_key = {};  ///< to assign one of the grids to
  std::vector<GridChoice> grids = {};
  bool lasting = false;  ///< over with a scene that was read again, not by another look
};

/// Told of everything that a viewer makes, from its thread or from look(); must not throw, nor call the viewer.
class ViewListener {
 public:
  virtual ~ViewListener() = default;
  virtual void scene(const ViewSceneText& scene) = 0;
  virtual void picture(ViewPicture picture) = 0;
  virtual void progress(const ViewProgress& progress) = 0;
  /// It is over with a later look, or when the scene has been read again.
  virtual void problem(const ViewProblem& problem) = 0;
  virtual void point(uint64_t id, std::optional<dvec3> position) = 0;
};

}  // namespace brume

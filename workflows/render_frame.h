#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "filters/run/apply.h"
#include "render/film/film.h"
#include "render/session/render_job.h"
#include "workflows/frame.h"
#include "workflows/host.h"
#include "workflows/scene_cache.h"
#include "workflows/sequence.h"

namespace brume {

/// Someone who looks at a picture while it is rendered. Called from any thread, one call at a time.
class RenderWatcher {
 public:
  virtual ~RenderWatcher() = default;
  /// The pixels of a tile have changed.
  virtual void update(const Film& film, int tile) = 0;
  /// The picture after a round, or at the end, clean; where it waits for one, between passes too.
  virtual void show(const Layers& frame) = 0;
  /// Whether show() would be of use now.
  virtual bool waits() { return false; }
};

/// What to render, and where it goes. Names of files are patterns where a sequence is rendered.
struct RenderOptions {
  std::filesystem::path scene;         ///< scene file (TOML), or an OpenVDB file, around which a scene is made up
  std::string scene_text = {};         ///< read instead of the file `scene`; relative paths in it start at that file
  SceneArrays arrays = {};             ///< of the text: what stands in no file
  SceneCache* scenes = nullptr;        ///< keeps what is prepared; null: it is dropped before the picture is cleaned
  std::vector<std::string> overrides;  ///< "camera.fov=30"
  std::filesystem::path save_scene;    ///< where to write what was made up around a volume
  std::optional<int> spp;              ///< instead of the scene's
  std::optional<int64_t> seed;
  LayerRequest layers;
  std::string clean_filter;  ///< that cleans the picture: NAME or NAME:parameter=value,...; empty: none
  Outliers outliers = Outliers::kExtreme;
  struct Part {
    int number, parts;  ///< from 1 on
  };
  std::filesystem::path sequence;  ///< the pattern of which `scene` is a frame, where it is one
  std::optional<Part> part;        ///< a share of the samples, to be merged with the others
  std::string crop;                ///< "x0,y0,x1,y1", the last two exclusive; empty: the whole picture
  double time_limit = 0;           ///< RenderJob::time_limit
  double target_error = 0;         ///< relative error at which to stop, of the clean picture where one is made; 0: none
  std::filesystem::path output, preview, records, checkpoint, resume;  ///< empty: none
  std::filesystem::path deep;  ///< deep EXR of the picture, clean where a filter cleans it; empty: none
  int deep_samples = 16;       ///< that it has of each pixel, at most
  bool deep_float = false;     ///< its colours are floats, not halves
  double checkpoint_seconds = 300;
  /// EXR of the picture, R G B A, again and again while it is rendered, and at the end: but for the first, after one
  /// sample, clean where a filter cleans it. Each replaces the one before as a whole, and Host::updated is told.
  /// Samples and result stay the same. Empty: none.
  std::filesystem::path updates;
  PictureOptions picture;      ///< of the preview
  bool skip_complete = false;  ///< leave out a frame whose output is whole and of this render; go on from checkpoints
  bool require_valid = false;  ///< miss a threshold by one sample that is not finite; else by one in a million
  bool fixed_seed = false;     ///< in a sequence: the same random numbers in every frame
  /// Makes someone who watches a picture of this name and size; null: nothing is made.
  std::function<std::unique_ptr<RenderWatcher>(const std::string& name, ivec2 size)> watch;
};

struct RenderedFrame {
  FrameEnd end = FrameEnd::kDone;
  Layers layers;  ///< with the clean picture on top where one was asked for; empty where the frame was complete
  RenderReport report;
  std::optional<double> clean_error;  ///< estimated relative error of the clean picture, where the filter makes it
};

/// Renders a frame, cleans it, and writes the files that are named. @throws InputError, Interrupted
RenderedFrame render_frame(const RenderOptions& options, const Host& host);

/// Renders the frames of a sequence, one after another; `scene` and the files are patterns.
SequenceEnd render_sequence(const RenderOptions& options, const std::vector<int>& frames, const Host& host);

/// What would be modelled, and what it costs.
std::string explain_render(const RenderOptions& options, const Host& host);

/// Traces one sample again: a line for each layer that can be recorded.
/// @param which  "x,y,sample", from 0
std::string replay_sample(const RenderOptions& options, const std::string& which, const Host& host);

}  // namespace brume

#include <algorithm>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "workflows/version.h"
#include "workflows/view/scene_text.h"
#include "workflows/view/viewed_layers.h"
#include "workflows/view/viewer.h"

// The part of Viewer that shows predicted light (render/guides): marched coarse, in steps, then whole.

namespace brume {
namespace {

constexpr double kStepGrowth = 1.4;  // of the sides, at least from step to step
constexpr double kShowEvery = 0.7;   // s between pictures on their way
constexpr double kShowShare = 0.1;   // of the time, at most for showing them

/// Drawn larger, bilinearly; the middles of its pixels stay where they are in the picture.
Plane enlarged(const Plane& from, int width, int height) {
  Plane to(width, height);
  struct Place {
    int low, high;
    float share;
  };
  const auto place = [](int i, int of, int in) {
    const double at = std::clamp((i + 0.5) * in / of - 0.5, 0.0, in - 1.0);
    const int low = static_cast<int>(at);
    return Place{low, std::min(low + 1, in - 1), static_cast<float>(at - low)};
  };
  std::vector<Place> columns;
  for (int x = 0; x < width; ++x) columns.push_back(place(x, width, from.width()));
  for (int y = 0; y < height; ++y) {
    const Place row = place(y, height, from.height());
    const float *const above = from.row(row.low), *const below = from.row(row.high);
    for (int x = 0; x < width; ++x) {
      const Place& c = columns[static_cast<size_t>(x)];
      const float top = above[c.low] + c.share * (above[c.high] - above[c.low]);
      const float bottom = below[c.low] + c.share * (below[c.high] - below[c.low]);
      to(x, y) = top + row.share * (bottom - top);
    }
  }
  return to;
}

}  // namespace

void Viewer::march(const ViewLook& look, const Guides& guides, const ivec2& size, const Task& task) {
  tell(ViewStage::kMarching);
  const Stopwatch watch;
  const PreparedScene& prepared = scene_.prepared();
  auto frame = std::make_shared<Layers>(size.x, size.y);
  const Camera camera(prepared.scene().camera, size.x, size.y, prepared.world_shift());
  const bool sketch = size != look.size || pace_.is_slow(look.size);
  guides.record(camera, ivec2(0), *frame, task, sketch);
  if (sketch)
    pace_.measure_coarse(size, watch.seconds());
  else
    pace_.measure_whole(1.0 * size.x * size.y / std::max(1e-3, watch.seconds()));
  guide_layers_ = guide_layers_in(*frame);
  ViewPicture known = about(/*predicted=*/true, 0, {});
  known.full = false;
  keep(predicted_, frame, look, known);
}

void Viewer::refine(const ViewLook& look, const Task& task) {
  ivec2 shown(0);
  {
    const std::lock_guard lock(mutex_);
    if (predicted_.frame && predicted_.about.full) return show(*last_, predicted_);  // the same look again
    if (predicted_.frame) shown = {predicted_.frame->width(), predicted_.frame->height()};
  }
  const auto larger = [&](const ivec2& size) { return size.x > kStepGrowth * shown.x; };
  const auto step = [&](const Guides& guides, const ivec2& size) {
    march(look, guides, size, task);
    shown = size;
  };
  if (!scene_.has_guides()) {
    // There is light for a coarse picture while that for a good one is solved.
    if (const ivec2 size = pace_.size_within(5 * kMovingSeconds, look.size); larger(size))
      step(scene_.sketch(task), size);
    tell(ViewStage::kSolvingLight);
  }
  const Guides& guides = scene_.guides(told(ViewStage::kSolvingLight, task));
  for (const int part : {8, 4, 2}) {
    const ivec2 size = glm::max(look.size / part, ivec2(1));
    if (!pace_.is_worth(size, look.size)) break;
    if (larger(size)) step(guides, size);
  }
  march_whole(look, guides, task);
}

/// The whole picture while it is marched, tile by tile, over the coarse one that was there.
class Viewer::Emerging {
 public:
  Emerging(Viewer& viewer, const Layers& frame) : viewer_(viewer), frame_(frame) {
    const std::lock_guard lock(viewer.mutex_);
    coarse_ = viewer.predicted_.frame;
  }
  /// Pixels that are there. One call at a time.
  void add(const ivec2& from, const ivec2& to) {
    tiles_.push_back({from, to});
    pixels_ += static_cast<double>(to.x - from.x) * (to.y - from.y);
    if (watch_.seconds() < next_ || pixels_ >= static_cast<double>(frame_.width()) * frame_.height()) return;
    const Stopwatch showing;
    show();
    next_ = watch_.seconds() + std::max(kShowEvery, showing.seconds() / kShowShare);
  }
  /// Pixels a second so far; 0 while that is not known.
  double pace() const { return pixels_ > 0 ? pixels_ / std::max(1e-3, watch_.seconds()) : 0; }

 private:
  void show() {
    const ViewLook look = viewer_.current();
    Layers seen(frame_.width(), frame_.height());
    for (const std::string& layer : look.layers)
      for (const std::string& channel : ViewedLayer(frame_, layer, /*predicted=*/true, look.mix).sources()) {
        if (seen.find(channel)) continue;
        const Plane* const before = coarse_ ? coarse_->find(channel) : nullptr;
        Plane plane = before ? enlarged(*before, seen.width(), seen.height()) : Plane(seen.width(), seen.height());
        const Plane& now = frame_.at(channel);
        for (const PixelWindow& tile : tiles_)
          for (int y = tile.lo.y; y < tile.hi.y; ++y)
            std::copy(now.row(y) + tile.lo.x, now.row(y) + tile.hi.x, plane.row(y) + tile.lo.x);
        seen.set(channel, std::move(plane));
      }
    ViewPicture known = viewer_.about(/*predicted=*/true, 0, {});
    known.full = false;
    viewer_.show(look, known, seen);
  }

  Viewer& viewer_;
  const Layers& frame_;
  std::shared_ptr<const Layers> coarse_;
  std::vector<PixelWindow> tiles_;
  double pixels_ = 0, next_ = kShowEvery;
  Stopwatch watch_;
};

void Viewer::march_whole(const ViewLook& look, const Guides& guides, const Task& task) {
  tell(ViewStage::kMarching);
  const PreparedScene& prepared = scene_.prepared();
  auto frame = std::make_shared<Layers>(look.size.x, look.size.y);
  const Camera camera = prepared.camera();
  Emerging emerging(*this, *frame);
  try {
    guides.record_watched(camera, *frame, told(ViewStage::kMarching, task),
                          [&](const ivec2& from, const ivec2& to) { emerging.add(from, to); });
    pace_.measure_whole(emerging.pace());
  } catch (const Interrupted&) {
    if (const double pace = emerging.pace(); pace > 0) pace_.measure_whole(pace);
    throw;
  }
  guide_layers_ = guide_layers_in(*frame);
  RenderJob job;
  job.seed = prepared.scene().render.seed;
  job.program = version_text();
  describe_render(*frame, prepared.scene(), layers_, job);
  std::tie(frame->header["sceneHash"], frame->header["sceneSettings"]) = scene_.fingerprint();
  frame->header["picture"] = std::string("predicted, without samples");
  frame->header["samplesPerPixel"] = 0;
  frame->header["exposure"] = static_cast<float>(prepared.scene().film.exposure);
  frame->header["worldToCamera"] = camera.world_to_camera();
  frame->header["worldToNDC"] = camera.world_to_ndc();
  stamp(*frame);
  keep(predicted_, frame, look, about(/*predicted=*/true, 0, {}));
}

}  // namespace brume

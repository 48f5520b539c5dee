#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "image/light_layers.h"
#include "render/scene/light_groups.h"
#include "workflows/version.h"
#include "workflows/view/viewer.h"

// The part of Viewer that path traces: rounds of samples, each cleaned and shown.

namespace brume {
namespace {

constexpr int kCoarseSamples = 4;  // per pixel of a coarse picture

bool has_light_layer(const ViewLook& look) {
  return std::any_of(look.layers.begin(), look.layers.end(),
                     [](const std::string& layer) { return layer.starts_with(kLightPrefix); });
}

}  // namespace

void Viewer::trace_coarse(const ViewLook& look, const Task& task) {
  tell(ViewStage::kSampling);
  const Stopwatch watch;
  const ivec2 size = pace_.size_within(kMovingSeconds, look.size);
  const Layers frame = scene_.coarse(size, kCoarseSamples, task);
  pace_.measure_coarse(size, watch.seconds());
  ViewPicture known = about(/*predicted=*/false, kCoarseSamples, {});
  known.full = false;
  show(current(), known, frame);
}

/// The rounds of one look.
class Viewer::Tracing {
 public:
  Tracing(Viewer& viewer, const ViewLook& look)
      : viewer_(viewer),
        look_(look),
        prepared_(viewer.scene_.prepared()),
        pixels_(1.0 * look.size.x * look.size.y),
        has_groups_(!light_groups_of(prepared_.scene()).names.empty()),
        cleaner_(viewer.options_.clean_filter, prepared_.scene().film.exposure, cleaning_host()) {
    LayerRequest wanted;
    wanted.names = {};
    wanted.guides = true;
    cleaner_.request(wanted, kFirstRound);
    // Those of the whole predicted picture are what the samples' frame holds too.
    const std::lock_guard lock(viewer.mutex_);
    if (viewer.predicted_.frame && viewer.predicted_.about.full) guides_ = viewer.predicted_.frame;
  }

  void run(const Task& task) {
    const RenderJob job = make_job();
    Task sampling = task;
    sampling.progress = [&](double of_all) {
      taken_ = std::clamp(of_all * job.spp, taken_, goal_);
      report_now_and_then(ViewStage::kSampling, (taken_ - begin_) / (goal_ - begin_));
    };
    report(ViewStage::kSampling, 0);
    prepared_.render(job, sampling);
    viewer_.tell({.stage = ViewStage::kDone, .samples = shown_, .goal = shown_, .error = error()});
  }

 private:
  Host cleaning_host() {
    Host host = viewer_.host_;
    host.progress = [this](const std::string&) {
      return [this](double share) { report_now_and_then(ViewStage::kCleaning, share); };
    };
    return host;
  }

  RenderJob make_job() {
    RenderJob job;
    job.spp = look_.most_samples;
    job.guide_samples = kGuideSamples;
    job.first_round = kFirstRound;
    job.seed = prepared_.scene().render.seed;
    job.program = version_text();
    const auto [hash, settings] = viewer_.scene_.fingerprint();
    job.stamp = [hash = hash, settings = settings](Layers& frame) {
      frame.header["sceneHash"] = hash;
      frame.header["sceneSettings"] = settings;
      stamp(frame);
    };
    job.recorded_guides = guides_.get();
    job.next_round = [this](const RenderRound& round) { return clean_round(round); };
    return job;
  }

  NextRound clean_round(const RenderRound& round) {
    taken_ = goal_;
    report(ViewStage::kCleaning, 0);
    NextRound next = cleaner_.next_round(round, 0);
    const auto mean_over_pixels = [&](const auto& samples_of_tile) {
      double sum = 0;
      for (int t = 0; t < round.film.tile_count(); ++t)
        sum += static_cast<double>(round.film.bounds(t).pixels()) * samples_of_tile(static_cast<size_t>(t));
      return sum / pixels_;
    };
    shown_ = static_cast<int>(
        std::lround(mean_over_pixels([&](size_t t) { return round.film.taken(static_cast<int>(t)); })));
    guides_.reset();
    show_clean();
    begin_ = taken_;
    const double goal = next.goals.empty() ? 0 : mean_over_pixels([&](size_t t) { return next.goals[t]; });
    goal_ = std::max(goal, begin_ + 1);
    report(ViewStage::kSampling, 0);
    return next;
  }

  /// The picture does not wait for its groups, unless they are what is seen. Their sum makes it a little better, so it
  /// is shown again: what is mixed and what is not are then one picture.
  void show_clean() {
    if (!has_groups_ || !shows_groups()) show_picture();
    if (has_groups_) {
      cleaner_.clean_lights_of_picture();
      show_picture();
    }
  }

  void show_picture() {
    viewer_.store(viewer_.traced_, std::make_shared<const Layers>(cleaner_.picture()), look_,
                  viewer_.about(/*predicted=*/false, shown_, error()));
    {
      const std::lock_guard lock(viewer_.mutex_);
      viewer_.predicted_.frame.reset();
    }
    viewer_.show(viewer_.current(), viewer_.traced_);
  }

  bool shows_groups() const {
    const ViewLook now = viewer_.current();
    return !now.mix.empty() || has_light_layer(now);
  }

  std::optional<double> error() const { return cleaner_.error() >= 0 ? std::optional(cleaner_.error()) : std::nullopt; }

  void report(ViewStage stage, double share) {
    viewer_.tell({.stage = stage,
                  .samples = static_cast<int>(taken_),
                  .goal = static_cast<int>(std::lround(goal_)),
                  .share = share,
                  .error = error()});
  }
  void report_now_and_then(ViewStage stage, double share) {
    if (viewer_.since_told_.seconds() >= kTellEvery) report(stage, share);
  }

  Viewer& viewer_;
  const ViewLook& look_;
  const PreparedScene& prepared_;
  const double pixels_;
  const bool has_groups_;
  Cleaner cleaner_;
  std::shared_ptr<const Layers> guides_;
  // Samples a pixel, on average: taken so far, at the beginning and the end of the round, of the picture that is shown.
  double taken_ = 0, begin_ = 0, goal_ = kFirstRound;
  int shown_ = 0;
};

void Viewer::trace(const ViewLook& look, const Task& task) {
  Tracing(*this, look).run(task);
}

}  // namespace brume

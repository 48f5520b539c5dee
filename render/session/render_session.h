#pragma once
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "base/progress.h"
#include "image/sample_records.h"
#include "render/film/film.h"
#include "render/session/render_job.h"
#include "render/session/render_state.h"
#include "render/session/renderer.h"
#include "render/session/round_progress.h"

namespace brume {

/// One render on its way: passes over the picture until it has its samples, or time, error or the user end it.
class RenderSession {
 public:
  /// @throws InputError: a film that does not fit into memory, a state of another render, options that contradict
  RenderSession(const PreparedScene& scene, const RenderJob& job, const Task& task);

  /// @throws Interrupted after a checkpoint was written, where one was asked for; InputError
  RenderResult run();

 private:
  struct TileReport {
    PathCounters counters;
    uint64_t invalid = 0;
    std::optional<RenderReport::Where> first_invalid;
  };

  void resume();
  void open_records();
  void run_passes();
  /// How far the next pass goes: longer and longer, but never so far that time or a checkpoint is overrun by much.
  uint32_t next_goal() const;
  /// Rounds of samples where next_round wants them, from the round that a checkpoint was interrupted in.
  void run_rounds();
  /// The next round, for the film as it is.
  NextRound ask_for_round(double sampling_seconds);
  /// The share of a render in rounds that is done at this many samples, in seconds spent and left.
  /// @param before  samples when the pass began
  double rounds_share(double samples, double before, double pass_seconds) const;
  void write_regular_checkpoint();
  /// Seconds that the samples to come will take, of this round or, where there are none, of the render.
  double sampling_to_come() const;
  /// Shows the picture to who watches it, unless that would take too much of the time.
  void show_picture();
  /// Each tile up to its goal of samples of each pixel.
  void pass(const std::vector<uint32_t>& goals);
  void develop_all();
  /// What each tile was to have after the round in which a checkpoint was written. @throws InputError
  void read_goals(const std::string& text);
  /// The errors after the rounds before that. @throws InputError
  void read_errors(const std::string& text);
  /// The frame that the film holds now, with the guides where they are recorded.
  Layers film_so_far() const;
  void record_guides(const Task& task);
  /// Traces the next samples of a tile and adds them to the film.
  void trace_batch(int tile, uint32_t goal, std::vector<PathRecord>& records);
  /// Whether all rays of a tile that do not meet the medium see the same.
  bool sky_is_uniform(const Film::Bounds& tile) const;
  void finish_tile(int tile, const std::vector<PathRecord>& records);
  /// Whether the time is over or the target error reached.
  bool enough();
  /// @return whether the disk took it
  bool write_checkpoint();

  /// Samples that every pixel has by now.
  uint32_t fewest_taken() const;
  /// Samples of the pixels that have most.
  uint32_t most_taken() const;
  double elapsed() const { return resumed_.seconds + wall_.seconds(); }
  /// Samples of all pixels together.
  double samples_taken() const;
  /// The share of this session's work that is done at this many samples: of the samples, the time or the way to the
  /// target error, whichever ends the render first. Below 1, and 0 while nothing is known.
  double done_share(double samples) const;
  /// Of all samples so far, those of the resumed session included.
  RenderReport report() const;
  /// Writes the header of a frame that holds what the film holds.
  void finish_header(Layers& frame, const RenderReport& report) const;
  void describe(Layers& frame, const RenderReport& report, int first, int end) const;

  const PreparedScene& scene_;
  const RenderJob& job_;
  const Task& task_;
  const RenderJob::Crop window_;
  const int first_, end_;  // sample numbers
  const bool progressive_, keep_;
  const Camera camera_;
  Film film_;
  PathContext context_;
  StopSignal stop_;
  std::unique_ptr<RecordWriter> records_;
  CheckpointWriter checkpoint_;
  std::vector<EntryBound> bounds_;  // of the window's pixels
  std::vector<TileReport> tiles_;
  RenderReport resumed_;  // what the resumed session had done
  Layers guides_;         // once they are recorded
  std::optional<DeepRecord> deep_;
  std::mutex watching_;
  Stopwatch wall_;
  double cpu_start_ = 0;
  uint32_t resumed_at_ = 0, done_ = 0;  // samples of each pixel
  std::vector<uint32_t> goals_;         // of the tiles in this round
  std::vector<RoundError> errors_;      // after the rounds so far
  RoundProgress rounds_;
  double resumed_samples_ = 0;  // of all pixels together
  double needed_samples_ = 0;   // until the target error is reached, estimated; 0: unknown
  double last_checkpoint_ = 0;  // on the wall clock
  double last_shown_ = -1;      // when the picture was there, likewise; below 0: never
  double showing_seconds_ = 0;  // that it took
  double guide_seconds_ = 0, sampling_seconds_ = 0;
};

}  // namespace brume

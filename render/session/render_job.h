#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/shares.h"
#include "image/layers.h"
#include "render/film/film.h"
#include "render/guides/deep_pixels.h"
#include "render/guides/matte_pixels.h"
#include "render/scene/scene.h"
#include "render/transport/integrator.h"

namespace brume {

/// What a render cost and whether it kept its promises.
struct RenderReport {
  double seconds = 0, cpu_seconds = 0;  ///< of the sampling alone, without loading
  PathCounters counters;
  uint64_t invalid_samples = 0;
  struct Where {
    int x, y;
    uint32_t sample;
  };
  std::optional<Where> first_invalid;  ///< first in row order
  int samples_per_pixel = 0;           ///< that every pixel of the frame holds now
  int most_samples_per_pixel = 0;      ///< of any tile; more than the others where samples went in rounds
  double mean_samples_per_pixel = 0;
  bool uneven = false;          ///< stopped in the middle of a pass: some tiles hold more
  std::optional<double> error;  ///< Film::relative_error, where statistics are kept

  /// One line a person reads, and a line for each promise not kept.
  std::string summary() const;
};

struct RenderResult {
  Layers layers;
  std::optional<DeepRecord> deep;     ///< where RenderJob::deep_samples asks for it
  std::optional<MatteRecord> mattes;  ///< where RenderJob::mattes asks for it
  RenderReport report;
};

/// The error that was estimated after a round.
struct RoundError {
  double samples, error;  ///< of all pixels together; relative
};

/// A render between two rounds of samples.
struct RenderRound {
  const Film& film;
  const Layers& frame;                     ///< what the film holds, with header and guides
  double most_growth;                      ///< of the number of samples, that the time allows
  const std::vector<RoundError>& earlier;  ///< rounds, also those before a checkpoint that is resumed
};

/// What comes after a round.
struct NextRound {
  std::vector<uint32_t> goals;  ///< samples that each tile of the film is to have; empty: the render is done
  double samples_needed = 0;    ///< of all pixels together until the target is reached, estimated; 0: unknown
  int rounds_needed = 1;        ///< that it takes to get there, estimated
  double error = 0;             ///< estimated after the round that is over; 0: unknown
};

/// Which samples to take, and what to do on the way.
struct RenderJob {
  int spp = 64;           ///< of the whole picture
  int guide_samples = 0;  ///< samples that the guides are to serve; 0: spp
  int samples_for_guides() const { return guide_samples > 0 ? guide_samples : spp; }
  int64_t seed = 0;
  int part = 1, parts = 1;  ///< this render takes the part-th of `parts` equal shares of the samples, counted from 1
  int first_sample() const { return end_of_share(spp, part - 1, parts); }
  int end_sample() const { return end_of_share(spp, part, parts); }  ///< exclusive
  struct Crop {
    int x0, y0, x1, y1;  ///< x1, y1 exclusive
    int width() const { return x1 - x0; }
    int height() const { return y1 - y0; }
  };
  std::optional<Crop> crop;
  double time_limit = 0;    ///< seconds of sampling after which no new pass begins; one that takes much longer is cut
  double target_error = 0;  ///< relative error (Film::relative_error) at which to stop; 0: none

  /// Takes samples in rounds: asked between them for the next one. The first round takes first_round samples
  /// everywhere.
  std::function<NextRound(const RenderRound&)> next_round;
  int first_round = 8;

  /// The whole picture's guides where they are there already, as Guides::record makes them for so many samples; null:
  /// they are recorded. Not with `crop` or `stored`; needed until the first round or picture has been shown.
  const Layers* recorded_guides = nullptr;
  /// Guides that the frame holds in Layers::stored; null: none.
  std::function<bool(const std::string& channel)> stored;
  int deep_samples = 0;     ///< that the deep picture has of each pixel, at most; 0: none is made. Needs guides
  bool mattes = false;      ///< what covers each pixel is found, too
  bool keep_state = false;  ///< the result carries the sums of its samples, to be merged
  /// Written every checkpoint_seconds, at the end and when interrupted. A checkpoint that cannot be written ends
  /// nothing: `warn` is told, and the next one is tried.
  std::filesystem::path checkpoint;
  double checkpoint_seconds = 300;
  bool checkpoint_at_end = true;  ///< not needed where the result is kept and the checkpoint is not
  std::filesystem::path resume;   ///< a checkpoint (or part) to go on from
  std::string program;            ///< who renders: states of another program version are refused

  std::filesystem::path
      records;  ///< per-sample records go here (PathRecord); needs LayerRequest::records, and one pass

  /// Called whenever a tile's pixels have changed, from any thread, one at a time.
  std::function<void(const Film&, int tile)> watch;
  /// Shown the picture between two passes for as long as there are more samples to come: first after one sample of each
  /// pixel, before there are guides, then with them as often as showing takes no more than a quarter of the time,
  /// and less than the samples to come. Rounds that next_round asks for are not shown: it sees them.
  /// @param frame  makes what the film holds: layers, header and guides
  std::function<void(const Film&, const std::function<Layers()>& frame, bool first)> show;
  /// Called at once with what someone who waits for the picture should know.
  std::function<void(const std::string&)> warn;
  /// Called between passes with what the frame holds; to fill in what its caller adds to headers.
  std::function<void(Layers&)> stamp;
};

/// Writes into a header which space a frame's colours are of, where that is not Rec. 709.
void describe_colors(Layers& frame, const FilmSettings& film);
/// Writes into a header what tells this render from others: scene, seed, frame, colours, layers, program.
void describe_render(Layers& frame, const Scene& scene, const LayerRequest& layers, const RenderJob& job);

}  // namespace brume

#pragma once
#include <set>

#include "evaluate/protocol/protocol.h"

namespace brume {

/// The frame without some of its layers, what is below them and what is known of them: "guide" leaves out all guides.
Layers without_layers(const Layers& frame, const std::vector<std::string>& names);
/// The beauty alone.
Layers only_colours(const Layers& frame);
/// Whether errors are taken of a channel: the beauty, and direct and indirect light by themselves.
bool is_judged(const std::string& channel);
/// What reads an entry's header alone.
bool no_channel(const std::string& channel);
/// What all guides are below.
std::string guide_root();

/// A filter's settings from their text. @throws InputError
FilterSettings settings_from(const FilterEntry& filter, const std::string& text);

/// How the settings have frames of that exposure filtered.
ApplyOptions options_of(const EvaluationSettings& settings, double exposure);

/// One run of a filter: what decides its result beside the frame.
struct FilterRun {
  const FilterSettings* filter;
  ApplyOptions options;
  std::vector<std::string> left_out = {};  ///< layers by name that the filter does not get to see
  double time_limit = 0;                   ///< seconds; 0: none
  const Contender* external = nullptr;     ///< whose filter is not brume's; null: `filter` is run

  /// @param filter  the contender's, with parameters of their own
  FilterRun(const Contender& contender, const FilterSettings& filter, const EvaluationSettings& settings,
            ApplyOptions options);
};

/// A frame of a sequence beside the one that is filtered.
struct NearbyInput {
  int distance;
  const Layers* layers;
  std::filesystem::path records;  ///< empty: none
};

/// What a filter is run on; it is read where the cache lacks the result.
struct FilterInput {
  std::string key;  ///< everything that decides it
  int spp = 0;
  int64_t seed = 0;
  std::function<const Layers&()> frame;
  std::filesystem::path records = {};
  std::function<std::vector<NearbyInput>()> nearby = {};  ///< null: a still
};

/// What came of it; the picture lies in the cache.
struct FilterOutcome {
  std::string key;                     ///< of the picture, what is judged of it
  std::optional<Layers> picture = {};  ///< where it was asked for, or made
  double seconds = 0;
  std::optional<double> exchange_seconds = {};  ///< of handing frames to a filter that is not brume's
  std::optional<double> peak_bytes;
  std::string failed;  ///< why there is no picture; empty: there is one
};

/// Errors of a picture by what is judged, "" being the beauty, and by region.
using PictureErrors = std::map<std::string, std::vector<Errors>>;

/// The noisy frames of a scene at one sample count, which differ in their seeds.
class NoisyFrames;

/// Frames and results out of the cache, rendered and filtered where it lacks them.
class ResultStore {
 public:
  ResultStore(const Cache& cache, const EvaluationSettings& settings, Evaluation::Work& work)
      : cache_(cache), settings_(settings), work_(work) {}

  /// A frame; its seconds are what rendering it took when it was rendered.
  /// @param wanted  channels to read; all without it
  TimedFrame frame(const EvaluationScene& scene, int spp, int64_t seed, const RecordedData& data, const Task& task,
                   const std::function<bool(const std::string&)>& wanted = {}) const;
  std::string frame_key(const EvaluationScene& scene, int spp, int64_t seed, const RecordedData& data) const;
  std::filesystem::path records(const std::string& frame_key) const { return cache_.companion(frame_key, ".records"); }

  /// Seconds of a render that records so much, median of three where one takes less than a second.
  double render_seconds(const EvaluationScene& scene, int spp, const RecordedData& data, const Task& task) const;
  /// Seconds of the guides of a frame; 0 where they cannot be timed.
  double guide_seconds(const EvaluationScene& scene, int spp, const Task& task) const;

  /// @param needs_picture  whether it is to be read, where it is there, by its key; null: always
  /// @throws InputError when the cache cannot be written; Interrupted when the user ends it
  FilterOutcome filter(const FilterRun& run, const FilterInput& input, const Task& task,
                       const std::function<bool(const std::string&)>& needs_picture = {}) const;
  FilterOutcome filter(const FilterRun& run, NoisyFrames& frames, size_t seed, const Task& task,
                       const std::function<bool(const std::string&)>& needs_picture) const;

  /// What is judged of a result or frame that is there. @throws InputError when it has gone meanwhile
  Layers picture(const std::string& key) const;

  /// Errors that were measured before; nothing: they were not.
  std::optional<PictureErrors> known_errors(const std::string& key) const;
  void keep_errors(const std::string& key, const PictureErrors& errors) const;

  /// What a search found: the text of the settings.
  FilterSettings found(const std::string& key, const FilterEntry& filter,
                       const std::function<FilterSettings()>& search) const;

 private:
  struct Cleaned {
    Layers picture;
    double seconds = 0;
    std::optional<double> exchange_seconds = {}, peak_bytes = {};
  };
  /// Runs a filter on what it may see. @throws InputError when it fails; Interrupted
  /// @param unlimited  for what is in no time of the filter's
  static Cleaned clean(const FilterRun& run, const FilterInput& given, const std::vector<NearbyInput>& nearby,
                       const Task& task, const Task& unlimited);
  std::string machine() const;

  /// Counts an entry that lay in the cache before this run.
  void count_found(const std::string& key, int& count) const {
    if (known_.insert(key).second) ++count;
  }

  const Cache& cache_;
  const EvaluationSettings& settings_;
  Evaluation::Work& work_;
  mutable std::set<std::string> known_;  // made or found in this run
};

class NoisyFrames {
 public:
  NoisyFrames(const ResultStore& store, const EvaluationScene& scene, int spp, int seeds, RecordedData data)
      : store_(store), scene_(scene), spp_(spp), data_(std::move(data)), frames_(static_cast<size_t>(seeds)) {}

  size_t count() const { return frames_.size(); }
  int spp() const { return spp_; }
  const EvaluationScene& scene() const { return scene_; }
  const RecordedData& data() const { return data_; }
  std::string key(size_t seed) const { return store_.frame_key(scene_, spp_, number(seed), data_); }
  /// Read, or rendered, when it is first asked for.
  const TimedFrame& at(size_t seed, const Task& task);
  /// What rendering it took.
  double seconds(size_t seed, const Task& task) const;
  /// What is judged of it alone.
  Layers judged(size_t seed, const Task& task) const;
  std::filesystem::path records(size_t seed) const { return store_.records(key(seed)); }
  /// Makes room; they are read again where they are needed.
  void forget() { frames_.assign(frames_.size(), std::nullopt); }

 private:
  static int64_t number(size_t seed) { return kFirstNoisySeed + static_cast<int64_t>(seed); }

  const ResultStore& store_;
  const EvaluationScene& scene_;
  int spp_;
  RecordedData data_;
  std::vector<std::optional<TimedFrame>> frames_;
};

}  // namespace brume

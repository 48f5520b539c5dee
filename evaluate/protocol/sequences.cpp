#include "evaluate/protocol/sequences.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "base/error.h"
#include "evaluate/metrics/temporal.h"
#include "evaluate/protocol/result_store.h"

namespace brume {
namespace {

// Of the noisy frames: those of one frame's seeds lie between this and the next.
constexpr int64_t kFirstSequenceSeed = 3000001, kSeedsOfAFrame = 1000;

double root_mean(const std::vector<double>& squares) {
  double sum = 0;
  for (const double v : squares) sum += v;
  return std::sqrt(sum / static_cast<double>(squares.size()));
}

class SequenceRun {
 public:
  SequenceRun(const EvaluationSequence& sequence, const EvaluationSettings& settings, const ResultStore& store)
      : sequence_(sequence), settings_(settings), store_(store), data_(data_to_record(settings)) {
    result_.name = sequence.name;
    result_.frames = sequence.frames;
    result_.policy = {sequence.scenes[0].exposure, true};
    for (const EvaluationScene& scene : sequence.scenes) result_.hashes.push_back(scene.hash);
  }

  void render_references(const Task& task) {
    for (size_t i = 0; i < count(); ++i)
      for (int r = 0; r < 2; ++r) {
        const double done = static_cast<double>(2 * i) + r, all = 2.0 * static_cast<double>(count());
        reference(i, r, share(task, done / all, (done + 1) / all));
      }
  }

  void render(int spp, int seed, const Task& task) {
    for (size_t i = 0; i < count(); ++i)
      store_.frame(sequence_.scenes[i], spp, noisy_seed(i, seed), data_,
                   share(task, static_cast<double>(i) / static_cast<double>(count()),
                         static_cast<double>(i + 1) / static_cast<double>(count())),
                   no_channel);
  }

  void run_methods(int spp, const Task& task) {
    size_t done = 0;
    const double all = static_cast<double>(1 + settings_.contenders.size());
    const auto next = [&] {
      const Task part = share(task, static_cast<double>(done) / all, static_cast<double>(done + 1) / all);
      ++done;
      return part;
    };
    run(nullptr, 0, spp, next());
    for (const Contender& contender : settings_.contenders) {
      const Task part = next();
      const int frame_window = contender.settings.entry().sequences ? contender.settings.entry().frame_window : 0;
      run(&contender, 0, spp, share(part, 0, frame_window > 0 ? 0.5 : 1));
      if (frame_window > 0) run(&contender, frame_window, spp, share(part, 0.5, 1));
    }
    task.report(1);
  }

  SequenceResult& result() { return result_; }

 private:
  size_t count() const { return sequence_.scenes.size(); }

  static int64_t noisy_seed(size_t frame, int seed) {
    return kFirstSequenceSeed + static_cast<int64_t>(frame) * kSeedsOfAFrame + seed;
  }

  Layers reference(size_t frame, int which, const Task& task) const {
    return store_
        .frame(sequence_.scenes[frame], settings_.reference_spp,
               kReferenceSeed + 2 * static_cast<int64_t>(frame) + which, data_of_references(), task,
               [](const std::string& channel) {
                 return channel == "R" || channel == "G" || channel == "B" || channel == layer::coverage.channel(0);
               })
        .layers;
  }

  std::string key(size_t frame, int spp, int seed) const {
    return store_.frame_key(sequence_.scenes[frame], spp, noisy_seed(frame, seed), data_);
  }

  /// A noisy frame, in memory while it is within the filter's frame window.
  const Layers& noisy(size_t frame, int spp, int seed, size_t middle, int frame_window, const Task& task) {
    const auto far = [&](size_t f) { return std::abs(static_cast<int>(f) - static_cast<int>(middle)) > frame_window; };
    const std::string wanted = key(frame, spp, seed);
    std::erase_if(window_,
                  [&](const auto& item) { return far(item.first) || item.second.key != key(item.first, spp, seed); });
    const auto found = window_.find(frame);
    if (found != window_.end()) return found->second.layers;
    Layers layers = store_.frame(sequence_.scenes[frame], spp, noisy_seed(frame, seed), data_, quiet(task)).layers;
    return window_.insert_or_assign(frame, Held{wanted, std::move(layers)}).first->second.layers;
  }

  FilterInput input_of(size_t frame, int frame_window, int spp, int seed, bool records, const Task& task) {
    const size_t distance = static_cast<size_t>(frame_window), first = frame > distance ? frame - distance : 0,
                 last = std::min(count() - 1, frame + distance);
    FilterInput input;
    input.key = key(frame, spp, seed);
    input.spp = spp;
    input.seed = noisy_seed(frame, seed);
    for (size_t f = first; f <= last; ++f)
      if (f != frame)
        input.key += fmt::format("\n{:+} {}", static_cast<int>(f) - static_cast<int>(frame), key(f, spp, seed));
    input.frame = [this, frame, spp, seed, frame_window, task]() -> const Layers& {
      return noisy(frame, spp, seed, frame, frame_window, task);
    };
    if (records) input.records = store_.records(key(frame, spp, seed));
    input.nearby = [this, frame, spp, seed, frame_window, task, first, last, records] {
      std::vector<NearbyInput> list;
      for (size_t f = first; f <= last; ++f)
        if (f != frame)
          list.push_back({static_cast<int>(f) - static_cast<int>(frame),
                          &noisy(f, spp, seed, frame, frame_window, task),
                          records ? store_.records(key(f, spp, seed)) : std::filesystem::path()});
      return list;
    };
    return input;
  }

  void run(const Contender* contender, int frame_window, int spp, const Task& task) {
    SequenceMethod m;
    m.spp = spp;
    m.frame_window = frame_window;
    std::vector<double> seconds;
    if (contender) {
      m.filter = contender->label;
      m.parameters = contender->settings.text();
    }
    try {
      for (int seed = 0; seed < settings_.seeds; ++seed) {
        run_seed(contender, seed, m, seconds, task);
        task.report(static_cast<double>(seed + 1) / settings_.seeds);
      }
    } catch (const InputError& error) {
      m.failed = error.what();
      m.regions = {};
    }
    if (!seconds.empty()) {
      std::sort(seconds.begin(), seconds.end());
      m.filter_seconds = seconds[seconds.size() / 2];
    }
    window_.clear();
    result_.methods.push_back(std::move(m));
  }

  /// @throws InputError that names the frame
  void run_seed(const Contender* contender, int seed, SequenceMethod& m, std::vector<double>& seconds,
                const Task& task) {
    std::array<TemporalError, 2> temporal = {TemporalError(result_.policy), TemporalError(result_.policy)};
    std::array<std::vector<double>, 2> squares;
    for (size_t i = 0; i < count(); ++i) {
      task.check();
      const auto about = [&](const std::string& what) {
        return fmt::format("frame {}, seed {}: {}", sequence_.frames[i], seed + 1, what);
      };
      Layers picture;
      if (!contender) {
        picture = store_.picture(key(i, m.spp, seed));
      } else {
        const bool records = contender->settings.entry().records == FilterEntry::Records::kNeeds;
        FilterOutcome outcome = store_.filter(
            FilterRun(*contender, contender->settings, settings_, options_of(settings_, result_.policy.exposure)),
            input_of(i, m.frame_window, m.spp, seed, records, task), quiet(task));
        if (!outcome.failed.empty()) throw InputError(about(outcome.failed));
        seconds.push_back(outcome.seconds);
        picture = std::move(*outcome.picture);
      }
      const Layers first = reference(i, 0, quiet(task)), second = reference(i, 1, quiet(task));
      const RgbPlanes x = picture.rgb(layer::beauty), r1 = first.rgb(layer::beauty), r2 = second.rgb(layer::beauty);
      result_.width = first.width();
      result_.height = first.height();
      const Mask medium = medium_mask(first);
      std::vector<Mask> masks = {{}};
      if (!medium.empty()) masks.push_back(medium);
      std::vector<Errors> errors;
      try {
        errors = compare_regions(x, r1, result_.policy, masks, &r2, ErrorScope::kPixels, task);
      } catch (const InputError& error) {
        throw InputError(about(error.what()));
      }
      for (size_t region = 0; region < masks.size(); ++region) {
        squares[region].push_back(errors[region].lab_rms * errors[region].lab_rms);
        temporal[region].add(x, r1, &r2, masks[region]);
      }
    }
    for (size_t region = 0; region < 2; ++region) {
      const auto t = temporal[region].result();
      if (squares[region].size() != count() || !t) continue;
      m.regions[region].lab_rms.push_back(root_mean(squares[region]));
      m.regions[region].temporal_error.push_back(t->temporal_error);
      m.regions[region].flicker.push_back(t->flicker);
      result_.reference_change[region] = t->reference;
    }
  }

  struct Held {
    std::string key;
    Layers layers;
  };

  const EvaluationSequence& sequence_;
  const EvaluationSettings& settings_;
  const ResultStore& store_;
  RecordedData data_;
  std::map<size_t, Held> window_;
  SequenceResult result_;
};

}  // namespace

size_t stage_count(const std::vector<EvaluationSequence>& sequences, const EvaluationSettings& settings) {
  return sequences.size() * (1 + settings.spp.size() * (1 + static_cast<size_t>(settings.seeds)));
}

void evaluate_sequences(const std::vector<EvaluationSequence>& sequences, const Cache& cache,
                        const std::function<Task(const std::string&)>& stage, Evaluation& result) {
  const ResultStore store(cache, result.settings, result.work);
  for (const EvaluationSequence& sequence : sequences) {
    SequenceRun run(sequence, result.settings, store);
    run.render_references(stage(fmt::format("{}: references", sequence.name)));
    for (const int spp : result.settings.spp) {
      for (int seed = 0; seed < result.settings.seeds; ++seed)
        run.render(
            spp, seed,
            stage(fmt::format("{}: {} spp, seed {} of {}", sequence.name, spp, seed + 1, result.settings.seeds)));
      run.run_methods(spp, stage(fmt::format("{}: {} spp, filter and measure", sequence.name, spp)));
    }
    result.sequences.push_back(std::move(run.result()));
  }
}

}  // namespace brume

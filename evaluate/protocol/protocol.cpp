#include "evaluate/protocol/protocol.h"

#include <fmt/format.h>

#include "evaluate/protocol/scene_run.h"

namespace brume {

size_t stage_count(const std::vector<EvaluationScene>& scenes, const EvaluationSettings& settings) {
  const size_t spp = settings.spp.size();
  size_t count = 0;
  for (const EvaluationScene& scene : scenes) {
    count += 2;  // references; filter and measure
    if (scene.foreign) continue;
    count += spp * static_cast<size_t>(settings.seeds);
    // A frame to search on; a search for each filter of brume's.
    if (settings.tune) count += spp;
    for (const Contender& contender : settings.contenders)
      if (settings.tune && !contender.external) count += spp;
  }
  if (settings.ablation || settings.sensitivity) count += scenes.size();
  return count;
}

Evaluation evaluate(const std::vector<EvaluationScene>& scenes, const EvaluationSettings& settings, const Cache& cache,
                    const std::function<Task(const std::string&)>& stage) {
  Evaluation result{settings, {}, {}, {}};
  const ResultStore store(cache, result.settings, result.work);
  std::vector<SceneRun> runs;
  for (const EvaluationScene& scene : scenes) runs.emplace_back(scene, result.settings, store);

  for (SceneRun& run : runs) {
    const std::string& name = run.scene().name;
    run.load_references(settings.reference_spp, stage(fmt::format("{}: references", name)));
    if (run.scene().foreign) continue;
    for (const int spp : run.spp())
      for (int seed = 0; seed < run.seeds(); ++seed)
        run.render(spp, seed, stage(fmt::format("{}: {} spp, seed {} of {}", name, spp, seed + 1, run.seeds())));
  }

  std::vector<std::vector<TuningFrame>> tuning_frames(runs.size());  // by scene, spp
  for (size_t s = 0; s < runs.size(); ++s)
    if (runs[s].is_searched())
      for (const int spp : settings.spp)
        tuning_frames[s].push_back(
            runs[s].tuning_frame(spp, stage(fmt::format("{}: {} spp to search on", scenes[s].name, spp))));
  const auto find = [&](size_t s, size_t k, const Contender& contender) {
    std::vector<TuningFrame*> others;
    for (size_t o = 0; o < runs.size(); ++o)
      if (o != s && !tuning_frames[o].empty()) others.push_back(&tuning_frames[o][k]);
    if (contender.external) {
      Found as_it_is{contender.settings, {}};
      if (!others.empty()) as_it_is.elsewhere = contender.settings;
      return as_it_is;
    }
    const Task task = stage(fmt::format("{}: search for {}, {} spp", scenes[s].name, contender.label, settings.spp[k]));
    const auto on = [&](std::vector<TuningFrame*> frames, const Task& part) {
      std::string key = fmt::format("search\n{}\nrestarts {}", contender.key(), settings.restarts);
      for (const TuningFrame* frame : frames) key += "\n" + frame->key();
      return store.found(key, contender.settings.entry(),
                         [&] { return search(contender, frames, settings.restarts, part); });
    };
    Found found{on({&tuning_frames[s][k]}, share(task, 0, others.empty() ? 1 : 0.5)), {}};
    if (!others.empty()) found.elsewhere = on(others, share(task, 0.5, 1));
    task.report(1);
    return found;
  };
  std::vector<std::vector<std::vector<Found>>> found(runs.size());  // by scene, spp, contender
  for (size_t s = 0; s < runs.size(); ++s)
    for (size_t k = 0; k < tuning_frames[s].size(); ++k) {
      std::vector<Found>& list = found[s].emplace_back();
      for (const Contender& contender : settings.contenders) list.push_back(find(s, k, contender));
    }
  tuning_frames.clear();

  for (size_t s = 0; s < runs.size(); ++s) {
    runs[s].filter_and_measure(found[s], stage(fmt::format("{}: filter and measure", scenes[s].name)));
    if (settings.ablation || settings.sensitivity)
      runs[s].study(stage(fmt::format("{}: {}", scenes[s].name,
                                      settings.ablation && settings.sensitivity ? "ablation and sensitivity"
                                      : settings.ablation                       ? "ablation"
                                                                                : "sensitivity")));
    result.scenes.push_back(std::move(runs[s].result()));
  }
  return result;
}

}  // namespace brume

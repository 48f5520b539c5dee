#pragma once
#include "evaluate/protocol/results.h"
#include "evaluate/report/table.h"

namespace brume {

/// "1.234 ± 0.056", or "1.234" of a single value.
std::string interval(const MeanInterval& value);
/// The same of a method's error; "failed" where it has none.
std::string error_text(const MethodResult& method, const MeanInterval& value);
/// How many times longer plain path tracing would take for this method's error, its error falling as 1 / sqrt(spp).
double speed_up(const MethodResult& method, const MethodResult& plain);

// Of one scene.

/// Each method with its errors and times.
Table scene_table(const SceneResult& scene);
/// One line for each filter, with every tuning's error side by side.
Table summary_table(const SceneResult& scene, const Evaluation& evaluation);
/// One line for each filter, with its best setting, the best first: at most samples, and what failed last.
Table ranking(const SceneResult& scene, const Evaluation& evaluation);

// Methods against one another, over all scenes.

/// The best method over everything, of each setting: of all, of those that clean a frame in under half a second, and of
/// those that need no guides.
Table overall_winners(const Evaluation& evaluation);
/// The winner of each spp, and whether it leads the second by more than the noise of the seeds.
Table winners(const Evaluation& evaluation);
/// The paper's claims about its own filter, one by one.
Table claims(const Evaluation& evaluation);
Table pareto(const Evaluation& evaluation);
Table time_to_error(const Evaluation& evaluation);

// What else was measured, and how.

/// Light groups by themselves, where a scene has any.
Table passes(const Evaluation& e);

/// Direct and indirect light by themselves, where they are cleaned so.
Table lights(const Evaluation& evaluation);
Table sequences(const Evaluation& evaluation);
Table ablation(const Evaluation& evaluation);
Table sensitivity(const Evaluation& evaluation);
Table parameters(const Evaluation& evaluation);
Table failures(const Evaluation& evaluation);

}  // namespace brume

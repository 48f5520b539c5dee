#pragma once
#include <string>

#include "evaluate/protocol/protocol.h"
#include "workflows/experiment_file.h"
#include "workflows/host.h"

namespace brume {

/// What is evaluated, and what keeps it.
struct EvaluateOptions {
  Experiment experiment;
  std::vector<Contender> others = {};  ///< filters of the caller's own, beside the experiment's
  bool chosen_filters = false;         ///< the user named them all, and can leave one out; none are then not all
  /// Folder of frames and results, which may hold those of other runs; frames then hold what any filter may read, so
  /// that other runs can use them. Empty: nothing is kept.
  std::filesystem::path cache;
  std::filesystem::path output;  ///< folder of tables, plots, pictures and the page; empty: none is written
  std::string command;           ///< what the user typed, for tables
};

/// Renders references and noisy frames, tunes and runs the filters, measures them, and writes the report, which appears
/// whole or not at all. Stages are called "[3/14] cloud: references". @throws InputError, Interrupted
Evaluation evaluate_experiment(const EvaluateOptions& options, const Host& host);

}  // namespace brume

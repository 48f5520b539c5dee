#pragma once
#include <string>

#include "evaluate/protocol/protocol.h"
#include "workflows/experiment_file.h"
#include "workflows/host.h"

namespace brume {

/// What is evaluated, and what keeps it.
struct EvaluateOptions {
  Experiment experiment;
  std::filesystem::path cache;  ///< folder of frames and results, which may hold those of other runs
  bool all_layers = false;      ///< frames hold what any filter may read, so that other runs can use them
  bool chosen_filters = false;  ///< the experiment's were named by the user, who can leave one out
  std::string command;          ///< what the user typed, for tables
};

/// Renders references and noisy frames, tunes and runs the filters, and measures them. @throws InputError, Interrupted
Evaluation evaluate_experiment(const EvaluateOptions& options, const Host& host);

}  // namespace brume

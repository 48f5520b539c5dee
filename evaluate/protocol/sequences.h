#pragma once
#include "evaluate/protocol/protocol.h"

namespace brume {

/// A sequence to evaluate: each of its frames is a scene of its own.
struct EvaluationSequence {
  std::string name;
  std::vector<int> frames;              ///< their numbers, rising
  std::vector<EvaluationScene> scenes;  ///< of the frames
};

/// How many stages evaluate_sequences() will announce.
size_t stage_count(const std::vector<EvaluationSequence>& sequences, const EvaluationSettings& settings);

/// Each filter with its fixed and default parameters on every frame of the sequences: alone and, where it looks through
/// time, with as many frames on either side as it declares. Every frame has random numbers of its own. Appends to
/// `result`, whose settings are used; the cache is as in evaluate().
/// @throws InputError; Interrupted
void evaluate_sequences(const std::vector<EvaluationSequence>& sequences, const Cache& cache,
                        const std::function<Task(const std::string&)>& stage, Evaluation& result);

}  // namespace brume

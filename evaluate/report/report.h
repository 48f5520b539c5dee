#pragma once
#include <filesystem>

#include "evaluate/protocol/results.h"

namespace brume {

/// What to read first, for a terminal: each scene's methods, the best first, and what failed.
std::string short_report(const Evaluation& evaluation);

/// The whole evaluation as tables: Markdown for people, CSV for programs.
std::string markdown_report(const Evaluation& evaluation);
std::string csv_report(const Evaluation& evaluation);

/// Everything that was measured as one JSON object, results.json: docs/experiment.md describes its keys.
std::string json_report(const Evaluation& evaluation);

/// The EXR of a method's first seed, in the folder of results.
std::string picture_file(const SceneResult& scene, const MethodResult& method);

/// Writes everything into a folder: tables, plots, strips and the EXRs of the first seed. @throws InputError
void write_report(const Evaluation& evaluation, const std::filesystem::path& folder);

}  // namespace brume

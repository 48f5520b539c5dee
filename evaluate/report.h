#pragma once
#include <filesystem>

#include "evaluate/protocol.h"

namespace brume {

/// The whole evaluation as tables: Markdown for people, CSV and JSON for programs.
std::string markdown_report(const Evaluation& evaluation);
std::string csv_report(const Evaluation& evaluation);
std::string json_report(const Evaluation& evaluation);

/// What Table 1 of the gradient-kernel paper prints for a scene, spp and filter.
struct PaperNumbers {
  double rms = 0, seconds = 0;
};
std::optional<PaperNumbers> paper_numbers(const std::string& scene, const std::string& filter, int spp);

/// Writes everything into a folder: tables, plots, strips and the EXRs of the first seed. @throws InputError
void write_report(const Evaluation& evaluation, const std::filesystem::path& folder);

}  // namespace brume

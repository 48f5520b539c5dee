#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include "apps/cli/command.h"
#include "base/output_file.h"
#include "volume/vdb_io.h"

namespace brume::app {

void add_halve(CLI::App& app, Common& common, Commands& commands) {
  struct Options {
    std::string input, output, grid;
  };
  const auto options = std::make_shared<Options>();
  const Verb command = add_command(app, common, "halve", "write a volume at half its resolution");
  command("file", options->input, "OpenVDB file")->required();
  command("-o,--output", options->output, "VDB file to write; grid density, saved as half")->required();
  command("--grid", options->grid, "density grid; without it as in a scene");
  commands[command] = [options, &common] {
    const auto& [input, output, grid] = *options;
    const std::filesystem::path inputs[] = {input};
    check_writable(output, inputs, ".vdb");
    const uint64_t voxels = write_halved_density(input, grid, output, {common.threads, {}, &interrupted});
    print(fmt::format("{}: {} active voxels\n", output, voxels));
    return static_cast<int>(kDone);
  };
}

}  // namespace brume::app

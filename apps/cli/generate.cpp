#include <fmt/format.h>

#include <memory>

#include "apps/cli/command.h"
#include "base/output_file.h"
#include "volume/procedural.h"
#include "volume/vdb_io.h"

namespace brume::app {

void add_generate(CLI::App& app, Common& common, Commands& commands) {
  struct Options {
    std::string kind, output;
    int resolution = 256;
    uint64_t seed = 1;
    bool half = false;
  };
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  const Verb command = add_command(app, common, "generate", "write a procedural volume");
  command("kind", o.kind, "cloud or smoke")->required()->check(CLI::IsMember({"cloud", "smoke"}));
  command("-o,--output", o.output, "VDB file to write; grid density, z up, about 2 units high or wide")->required();
  command("--resolution", o.resolution, "voxels along the longest side")
      ->check(CLI::Range(8, 4096))
      ->capture_default_str();
  command("--seed", o.seed, "another seed, another volume")->capture_default_str();
  command("--half", o.half, "save 16-bit values");
  commands[command] = [options, &common] {
    const Options& chosen = *options;
    check_writable(chosen.output, {}, ".vdb");
    const ProceduralVolume v = chosen.kind == "cloud" ? procedural_cloud(chosen.resolution, chosen.seed)
                                                      : procedural_smoke(chosen.resolution, chosen.seed);
    write_density(chosen.output, v.box, v.voxel_size, v.density, chosen.half,
                  make_task(common, "generate " + chosen.kind), v.is_zero);
    print(fmt::format("{}\n", chosen.output));
    return static_cast<int>(kDone);
  };
}

}  // namespace brume::app

#include <fmt/format.h>

#include "app/command.h"
#include "base/output_file.h"
#include "volume/procedural.h"
#include "volume/vdb_io.h"

namespace brume::app {

void add_generate(CLI::App& app, Common& common, Commands& commands) {
  static struct {
    std::string kind, output;
    int resolution = 256;
    uint64_t seed = 1;
    bool half = false;
  } o;
  CLI::App* command = add_command(app, common, "generate", "write a procedural volume");
  command->add_option("kind", o.kind, "cloud or smoke")->required()->check(CLI::IsMember({"cloud", "smoke"}));
  command->add_option("-o,--output", o.output, "VDB file to write; grid density, z up, about 2 units high or wide")
      ->required();
  command->add_option("--resolution", o.resolution, "voxels along the longest side")
      ->check(CLI::Range(8, 2048))
      ->capture_default_str();
  command->add_option("--seed", o.seed, "another seed, another volume")->capture_default_str();
  command->add_flag("--half", o.half, "save 16-bit values");
  commands[command] = [&common] {
    check_writable(o.output, {}, ".vdb");
    const ProceduralVolume v =
        o.kind == "cloud" ? procedural_cloud(o.resolution, o.seed) : procedural_smoke(o.resolution, o.seed);
    write_density(o.output, v.box, v.voxel_size, v.density, o.half, make_task(common, "generate " + o.kind));
    print(fmt::format("{}\n", o.output));
    return static_cast<int>(kDone);
  };
}

}  // namespace brume::app

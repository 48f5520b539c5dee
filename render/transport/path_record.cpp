#include "render/transport/path_record.h"

#include <type_traits>

namespace brume {

static_assert(std::is_standard_layout_v<PathRecord> && sizeof(PathRecord) % sizeof(float) == 0);

std::vector<RecordLayout::Field> PathRecord::fields() {
  // In the order of the members.
  return {{"film", 2},       {"lens", 2},        {"time", 1},        {"flight_1", 1},
          {"flight_2", 1},   {"direction_1", 3}, {"direction_2", 3}, {"light_1", 1},
          {"light_uv_1", 2}, {"position_1", 3},  {"position_2", 3},  {"surface_gradient", 3},
          {"gradient_1", 3}, {"albedo", 3},      {"density_1", 1},   {"light_transmittance_1", 1},
          {"normal", 3},     {"flags", 1},       {"unscattered", 3}, {"single", 3},
          {"indirect", 3}};
}

}  // namespace brume

#include "workflows/version.h"

#include <fmt/format.h>

#include "commit.h"

namespace brume {

std::string version_number() {
  return BRUME_VERSION;
}

std::string version_commit() {
  return BRUME_COMMIT;
}

std::string version_text() {
  return fmt::format("brume {} ({})", BRUME_VERSION, BRUME_COMMIT);
}

void stamp(Layers& layers) {
  layers.header["software"] = std::string("brume");
  layers.header["version"] = version_number();
  layers.header["commit"] = version_commit();
}

}  // namespace brume

#include "apps/view/view_bundle.h"

namespace brume {

const std::string_view view_script, view_style;

}  // namespace brume

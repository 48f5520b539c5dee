#include "evaluate/report/page_bundle.h"

namespace brume {

const std::string_view page_script, page_style;

}  // namespace brume

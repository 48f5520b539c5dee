#pragma once
#include <string_view>

namespace brume {

/// The front end of the page, bundled by apps/page/build.mjs; empty in a program that was built without Node.
extern const std::string_view page_script, page_style;

}  // namespace brume

#pragma once
#include <string_view>

namespace brume {

/// The page of `brume view`, bundled by apps/page/build.mjs; empty in a program that was built without Node.
extern const std::string_view view_script, view_style;

}  // namespace brume

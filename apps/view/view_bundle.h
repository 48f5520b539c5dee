#pragma once
#include <string_view>

namespace brume {

/// The page of `brume view`, bundled from apps/page/src/view; empty where Node.js was missing.
extern const std::string_view view_script, view_style;

}  // namespace brume

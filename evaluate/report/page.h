#pragma once
#include <string>

#include "evaluate/protocol/results.h"

namespace brume {

/// Whether this program was built with Node and so has a page to write.
bool page_is_built_in();

/// An evaluation as one HTML file that needs nothing beside it: the front end, what results.json says, and as half
/// floats the references and every method's first seed (docs/page.md).
/// @throws std::logic_error where the page is not built in
std::string results_page(const Evaluation& evaluation);

}  // namespace brume

#pragma once
#include <string>

#include "render/transport/plan.h"

namespace brume {

class Guides;

/// The plan and what each part costs in memory, for a person.
std::string explain(const Plan& plan, const Scene& scene, const SceneMedia& media, const Lights& lights,
                    const Surfaces* surfaces, const Guides* guides);

}  // namespace brume

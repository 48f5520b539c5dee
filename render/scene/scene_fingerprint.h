#pragma once
#include <map>

#include "render/scene/scene.h"

namespace brume {

/// What the contents of files were hashed to, so that each is read once.
using FileHashes = std::map<std::filesystem::path, uint64_t>;

/// Fills in Scene::hash and Scene::settings from everything that decides the picture; files count by their contents.
/// Sample count, seed and frame are left out: the parts of one render share a hash.
/// @param known  looked at and added to; null: every file is read
void add_fingerprint(Scene& scene, FileHashes* known = nullptr);

/// The same for two scenes that differ only in where the camera stands, in film but for its colours, sample count,
/// seed, and in how paths are traced: then all that paths can meet, and the light of it, is the same. Files count by
/// their names.
std::string world_of(const Scene& scene);

}  // namespace brume

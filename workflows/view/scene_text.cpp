#include "workflows/view/scene_text.h"

#include <algorithm>
#include <filesystem>
#include <limits>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <variant>

#include "image/guide_names.h"
#include "image/light_layers.h"
#include "render/scene/light_groups.h"
#include "workflows/view/viewed_layers.h"

namespace brume {
namespace {

const std::vector<ViewSceneText::Layer> kTracedLayers = {
    {kViewedPicture, "picture", 3, "", "W/(m^2 sr)"},
    {"noisy", "noisy", 3, "path traced", "W/(m^2 sr)"},
    {"clean_direct", "direct, clean", 3, "path traced", "W/(m^2 sr)"},
    {"clean_indirect", "indirect, clean", 3, "path traced", "W/(m^2 sr)"},
    {"direct", "direct, noisy", 3, "path traced", "W/(m^2 sr)"},
    {"indirect", "indirect, noisy", 3, "path traced", "W/(m^2 sr)"},
    {"clean_error", "estimated error", 1, "path traced", "W/(m^2 sr)"},
    {"sample_count", "samples", 1, "path traced", "a pixel"},
};

/// What scenes ask for that guides do not predict (docs/guides.md, limits).
std::vector<std::string> left_out_of(const Scene& scene, bool has_media) {
  std::vector<std::string> left_out;
  if (!has_media)
    left_out.emplace_back("nothing here scatters: without a medium no picture is predicted, it is path traced");
  for (const SurfaceSettings& surface : scene.surfaces) {
    if (surface.role == "shadow_catcher") left_out.emplace_back("shadow catchers");
    if (surface.material == "dielectric") left_out.emplace_back("light focused by glass");
  }
  std::sort(left_out.begin(), left_out.end());
  left_out.erase(std::unique(left_out.begin(), left_out.end()), left_out.end());
  return left_out;
}

std::string title_of(const SceneTable& table) {
  for (const char* key : {"file", "type", "shape"})
    if (const SceneKey* const k = table.find(key))
      if (const auto* const text = std::get_if<std::string>(&k->value); text && !text->empty())
        return k->type == SceneKey::Type::kFile ? std::filesystem::path(*text).filename().string() : *text;
  return table.path;
}

bool is_enabled(const SceneTable& table) {
  const SceneKey* const key = table.find("enabled");
  return !key || std::get<bool>(key->value);
}

/// What media and emission fill, by the spheres around them; a cube around the camera's target where there is none.
std::pair<dvec3, dvec3> filled_box(const PreparedScene& prepared) {
  dvec3 lo(std::numeric_limits<double>::infinity()), hi = -lo;
  const auto enclose = [&](const Medium::Sphere& sphere) {
    lo = glm::min(lo, sphere.centre - sphere.radius + prepared.world_shift());
    hi = glm::max(hi, sphere.centre + sphere.radius + prepared.world_shift());
  };
  for (const Medium& m : prepared.context().media) enclose(m.bounding_sphere());
  for (const EmissionField& e : prepared.context().emissions) enclose(e.bounding_sphere());
  if (lo.x < hi.x) return {lo, hi};
  const dvec3 target = prepared.scene().camera.look_at;
  return {target - 1.0, target + 1.0};
}

/// The scene's tables; those of volumes with the grids of their files and how thick they are.
std::vector<ViewSceneText::Table> tables_of(ViewedScene& scene) {
  const auto shows_volume = [](const SceneTable& table) {
    return table.path.starts_with("volumes.") && is_enabled(table);
  };
  const std::span<const Medium> media = scene.prepared().context().media;
  const auto shown = std::count_if(scene.tables().begin(), scene.tables().end(), shows_volume);
  const bool one_medium_each = static_cast<size_t>(shown) == media.size();
  std::vector<ViewSceneText::Table> tables;
  size_t volume = 0;
  for (const SceneTable& table : scene.tables()) {
    ViewSceneText::Table& entry = tables.emplace_back();
    entry.keys = table;
    entry.title = title_of(table);
    if (!table.path.starts_with("volumes.")) continue;
    if (const SceneKey* const file = table.find("file")) entry.grids = scene.grids(std::get<std::string>(file->value));
    if (one_medium_each && is_enabled(table)) entry.depth = depths_along_axes(media[volume++].thickest());
  }
  return tables;
}

}  // namespace

std::vector<ViewSceneText::Layer> guide_layers_in(const Layers& frame) {
  std::vector<ViewSceneText::Layer> layers;
  for (const auto& [channel, plane] : frame.channels()) {
    if (!is_guide(channel)) continue;
    const std::string name = channel.substr(0, channel.rfind('.'));
    if (layers.empty() || layers.back().name != name) {
      const auto [guide, meaning] = find_guide(name);
      layers.push_back(guide
                           ? ViewSceneText::Layer{name, meaning, 0, std::string(guide->list), std::string(guide->unit)}
                           : ViewSceneText::Layer{name, name, 0, "other guides", ""});
    }
    ++layers.back().channels;
  }
  std::erase_if(layers, [](const auto& layer) { return layer.channels != 1 && layer.channels != 3; });
  return layers;
}

ViewSceneText scene_text_of(ViewedScene& scene, const std::vector<ViewSceneText::Layer>& guides) {
  const PreparedScene& prepared = scene.prepared();
  const PathContext& context = prepared.context();
  ViewSceneText text;
  text.name = scene.title();
  text.frames = scene.frames();
  std::tie(text.lo, text.hi) = filled_box(prepared);
  text.layers = kTracedLayers;
  text.light_groups = light_groups_of(prepared.scene()).names;
  for (const std::string& group : text.light_groups)
    text.layers.push_back({light_layer(group), group, 3, "light groups", "W/(m^2 sr)"});
  text.layers.insert(text.layers.end(), guides.begin(), guides.end());
  text.notes = scene.notes();
  text.left_out = left_out_of(prepared.scene(), prepared.medium() || !context.emissions.empty());
  text.tables = tables_of(scene);
  return text;
}

}  // namespace brume

#include "render/world/volume_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <span>

#include "base/error.h"
#include "base/text.h"
#include "volume/emission.h"
#include "volume/tracking.h"
#include "volume/vdb_io.h"

namespace brume {
namespace {

// Optical depth where the volume is thickest but for a quarter of what is seen of it: a cloud that is white inside and
// a smoke that is not yet black; thinner where it burns, so that the flames are seen.
constexpr double kDepth = 12, kDepthOfSmoke = 4;
constexpr int kWidth = 800, kHeight = 600;
constexpr double kFov = 32, kMargin = 1.08;  // degrees along the height
constexpr double kHottest = 2200;            // [K] where a file's temperatures are no kelvin
constexpr double kLeastKelvin = 100;         // a hottest voxel above this is taken as kelvin
constexpr double kFlameRadiance = 3;         // through a tenth of the volume's size
constexpr double kSmallestVoxel = 1e-4, kLargestVoxel = 1e3;

std::string triple(const dvec3& v) {
  return fmt::format("[{:.6g}, {:.6g}, {:.6g}]", v.x, v.y, v.z);
}

constexpr std::array kTemperature = {"temperature", "temp"};
constexpr std::array kFlame = {"flame", "flames", "heat"};

bool holds_one_of(const VdbSummary& file, std::span<const char* const> names) {
  return std::any_of(file.grids.begin(), file.grids.end(), [&](const GridSummary& grid) {
    return std::find(names.begin(), names.end(), grid.name) != names.end();
  });
}

/// The grid of one of these names that has anything in it.
const GridSummary* find_grid(const VdbSummary& file, std::span<const char* const> names) {
  for (const char* name : names)
    for (const GridSummary& g : file.grids)
      if (g.name == name && g.has_range && g.maximum > 0 && g.active_voxels + g.active_tiles > 0) return &g;
  return nullptr;
}

bool made_by_houdini(const VdbSummary& file) {
  const auto tells = [](const std::map<std::string, std::string>& metadata) {
    return std::any_of(metadata.begin(), metadata.end(),
                       [](const auto& entry) { return entry.second.find("Houdini") != std::string::npos; });
  };
  return tells(file.metadata) ||
         std::any_of(file.grids.begin(), file.grids.end(), [&](const GridSummary& g) { return tells(g.metadata); });
}

/// Optical depths at an extinction of 1 per density, of rays along the view that meet anything, in order.
std::vector<double> depths(const Medium& medium, const dvec3& middle, double radius, const dvec3& view) {
  constexpr int kRays = 48;
  const Frame frame(view);
  std::vector<double> found;
  for (int y = 0; y < kRays; ++y)
    for (int x = 0; x < kRays; ++x) {
      const dvec2 at = ((dvec2(x, y) + 0.5) / static_cast<double>(kRays) * 2.0 - 1.0) * radius;
      const dvec3 start = middle + frame.x * at.x + frame.y * at.y - view * radius;
      const double depth = optical_depth(medium, medium.to_local(Ray{start, view}), 2 * radius);
      if (depth > 0) found.push_back(depth);
    }
  std::sort(found.begin(), found.end());
  return found;
}

/// From the middle of a medium's box, so that all of it is in the picture.
double framing_distance(const Medium& medium, const dvec3& middle, const dvec3& view, const dvec3& up) {
  const dvec3 right = glm::normalize(glm::cross(view, up)), above = glm::cross(right, view);
  const double tall = std::tan(0.5 * kFov * kPi / 180), wide = tall * kWidth / kHeight;
  const auto [lo, hi] = medium.support();
  double distance = 0;
  for (int k = 0; k < 8; ++k) {
    const dvec3 corner = medium.to_world({k & 1 ? hi.x : lo.x, k & 2 ? hi.y : lo.y, k & 4 ? hi.z : lo.z}) - middle;
    const double needed = std::max(std::abs(glm::dot(corner, right)) / wide, std::abs(glm::dot(corner, above)) / tall);
    distance = std::max(distance, needed - glm::dot(corner, view));
  }
  return distance;
}

using Assume = std::function<void(const std::string&)>;

/// Lines of a volume that burns by its grid of temperatures; empty where it is too cold.
std::string black_body_of(const GridSummary& temperature, double radius, const Assume& assume) {
  const double scale =
      temperature.maximum > kLeastKelvin ? 1.0 : std::stod(fmt::format("{:.3g}", kHottest / temperature.maximum));
  const double kelvin = scale * temperature.maximum;
  const double emitted =
      luminance(EmissionRamp::of_blackbody(0, scale, temperature.maximum, 1, true)(temperature.maximum));
  if (!(emitted > 0)) {
    assume(fmt::format(
        "grid '{}' holds at most {:.4g} K, which does not glow; volumes.0.temperature_scale makes it hotter",
        temperature.name, kelvin));
    return {};
  }
  const double intensity = std::stod(fmt::format("{:.2g}", kFlameRadiance / (0.1 * radius * emitted)));
  assume(fmt::format(
      "fire from grid '{}': volumes.0.temperature_scale = {} makes its hottest voxel {:.4g} K, blackbody_intensity = {}",
      temperature.name, scale, kelvin, intensity));
  return fmt::format("temperature_grid = \"{}\"\ntemperature_scale = {}\nblackbody_intensity = {}\n", temperature.name,
                     scale, intensity);
}

/// Lines of a volume that burns by its grid of flames.
std::string flames_of(const GridSummary& flame, double radius, const Assume& assume) {
  const double intensity = std::stod(fmt::format("{:.2g}", kFlameRadiance / (0.1 * radius)));
  assume(fmt::format("fire from grid '{}': volumes.0.flame_intensity = {}", flame.name, intensity));
  return fmt::format("flame_grid = \"{}\"\nflame_intensity = {}\n", flame.name, intensity);
}

}  // namespace

std::string VolumeScene::text(const std::string& file) const {
  return before_file + file + after_file;
}

VolumeScene scene_for_volume(const std::filesystem::path& file, const Task& task) {
  VdbSummary summary = read_vdb_contents(file, task);
  if (holds_one_of(summary, kTemperature) || holds_one_of(summary, kFlame)) summary = read_vdb_info(file, task);
  VolumeScene scene;
  scene.density = std::make_shared<const ScalarField>(load_scalar(file, {}, task));
  const ScalarField& density = *scene.density;
  if (density.bricks.empty())
    throw InputError(fmt::format(
        "{}: its grid '{}' is empty, there is nothing to render{}; name another with volumes.0.grid in a scene",
        file.string(), density.summary.name, density.notes.empty() ? "" : " (" + join(density.notes, "; ") + ")"));
  const auto assume = [&](const std::string& text) { scene.assumptions.push_back(text); };

  const Medium medium(density.bricks, density.world_from_index, 1, dvec3(1), 0);
  const Medium::Sphere bounds = medium.bounding_sphere();
  const double voxel = medium.voxel_size();
  if (voxel < kSmallestVoxel || voxel > kLargestVoxel)
    assume(fmt::format("voxels of {:.3g} units are taken as they are; extinction and camera follow the volume's size",
                       voxel));
  const bool y_up = made_by_houdini(summary);
  const dvec3 up = y_up ? dvec3(0, 1, 0) : dvec3(0, 0, 1);
  // x to the right, a little from above.
  const auto turned = [&](double right, double back, double above) {
    return glm::normalize(y_up ? dvec3(right, above, back) : dvec3(right, -back, above));
  };
  const dvec3 away = turned(0.25, 1, 0.12), sun = turned(-0.9, 0.25, 0.6);
  const double distance = kMargin * framing_distance(medium, bounds.centre, -away, up);

  const GridSummary* const temperature = find_grid(summary, kTemperature);
  const GridSummary* const flame = temperature ? nullptr : find_grid(summary, kFlame);
  const bool burns = temperature || flame;
  const std::vector<double> all = depths(medium, bounds.centre, bounds.radius, -away);
  if (all.empty())
    throw InputError(
        fmt::format("{}: no ray meets the density of grid '{}'; is it finer than a thousandth of its bounds?",
                    file.string(), density.summary.name));
  const double typical = all[all.size() * 3 / 4], wanted = burns ? kDepthOfSmoke : kDepth;
  const double sigma_t = std::stod(fmt::format("{:.2g}", wanted / typical));

  assume(fmt::format("grid '{}', {} up, seen from {}", density.summary.name, y_up ? "y" : "z",
                     triple(bounds.centre + distance * away)));
  assume(
      fmt::format("volumes.0.sigma_t = {} for an optical depth of about {:.3g}; albedo, g, sun and sky are a guess too",
                  sigma_t, sigma_t * typical));
  scene.before_file = fmt::format(
      "# Made for {}: every value is a guess to begin with.\n"
      "name = \"{}\"\n\n"
      "[camera]\nposition = {}\nlook_at = {}\nup = {}\nfov = {}\nfov_axis = \"y\"\n\n"
      "[film]\nwidth = {}\nheight = {}\n\n"
      "[environment]\nradiance = {}\nup = {}\n\n"
      "[[volumes]]\nfile = \"",
      file.filename().string(), file.stem().string(), triple(bounds.centre + distance * away), triple(bounds.centre),
      triple(up), kFov, kWidth, kHeight, burns ? "[0.05, 0.06, 0.08]" : "[0.2, 0.26, 0.36]", triple(up));
  std::string& text = scene.after_file;
  text = fmt::format("\"\ngrid = \"{}\"\nsigma_t = {}\nalbedo = {}\ng = {}\n", density.summary.name, sigma_t,
                     burns ? "0.6" : "0.98", burns ? "0.2" : "0.45");
  if (temperature) text += black_body_of(*temperature, bounds.radius, assume);
  if (flame) text += flames_of(*flame, bounds.radius, assume);
  text += fmt::format("\n[[lights]]\ntype = \"sun\"\ndirection = {}\nirradiance = {}\n", triple(sun),
                      burns ? "[0.8, 0.7, 0.55]" : "[3.4, 3.0, 2.4]");
  return scene;
}

}  // namespace brume

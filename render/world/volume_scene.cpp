#include "render/world/volume_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "base/error.h"
#include "base/text.h"
#include "base/toml_text.h"
#include "render/world/visible_density.h"
#include "render/world/volume_fields.h"
#include "render/world/volume_files.h"
#include "render/world/volume_fire.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

// Optical depth where the volume is thickest but for a quarter of what is seen of it: a cloud that is white inside and
// a smoke that is not yet black; thinner where it burns, so that the flames are seen.
constexpr double kDepth = 12, kDepthOfSmoke = 4;
constexpr double kMargin = 1.08;
constexpr double kFlameRadiance = 3;  // through a tenth of the volume's size
constexpr double kSmallestVoxel = 1e-4, kLargestVoxel = 1e3;
constexpr double kRounding = 1e-4;  // of the volume's size, for the camera's place

std::string number(double v) {
  return fmt::format("{}", v == 0 ? 0.0 : v);
}

/// To so many leading digits.
double short_number(double v, int digits) {
  return std::stod(fmt::format("{:.{}g}", v, digits));
}

std::string triple(const dvec3& v) {
  return fmt::format("[{}, {}, {}]", number(v.x), number(v.y), number(v.z));
}

/// Rounded to the decimal place that a length reaches.
dvec3 rounded(const dvec3& v, double length) {
  const int places = static_cast<int>(std::ceil(-std::log10(length)));
  const double step = places < 0 ? std::pow(10.0, -places) : 0;
  dvec3 result;
  for (int a = 0; a < 3; ++a)
    result[a] = step > 0 ? step * std::round(v[a] / step) : std::stod(fmt::format("{:.{}f}", v[a], places));
  return result;
}

/// A volume that has been looked at.
struct Look {
  std::shared_ptr<const ScalarField> density;
  VisibleDensity seen;
  double voxel = 0;
  Fire fire;
};

/// Makes the text of a scene out of the files that it shows.
class Guess {
 public:
  Guess(const fs::path& pattern, std::span<const std::string> assignments, const Task& task)
      : pattern_(pattern), assignments_(assignments), said_(assignments), task_(task) {}

  VolumeScene of_file() {
    const VolumeFile file = volume_file(pattern_, std::nullopt, said_, assignments_, task_);
    look_at(file);
    return scene(file);
  }

  VolumeScene of_frames(std::span<const int> frames) {
    sequence_ = true;
    const std::vector<VolumeFile> files = volume_files(pattern_, frames, said_, assignments_, task_);
    const VolumeFile* main = nullptr;
    for (const VolumeFile* file : files_that_matter(files)) {
      look_at(*file);
      if (looks_.back().seen.points.empty())
        looks_.pop_back();
      else if (!main)
        main = file;
    }
    return scene(main ? *main : files.front());
  }

 private:
  void look_at(const VolumeFile& file) {
    const VolumeSettings& volume = file.plan.volumes[0];
    if (looks_.empty()) set_axes(file);
    ScalarOptions options{.grid = file.grid, .convert_level_set = volume.convert_level_set};
    for (const auto& row : volume.remap) options.remap.emplace_back(row[0], row[1]);
    options.limit = volume.max_density;
    options.paging = paging_of(volume);
    Look& look = looks_.emplace_back();
    try {
      look.density = std::make_shared<const ScalarField>(load_scalar(file.path, options, task_));
      look.fire = find_fire(file, said_, task_);
    } catch (const InputError&) {
      if (!sequence_) throw;
      return;  // told when the frame is rendered
    }
    const ScalarField& density = *look.density;
    if (density.bricks.empty()) return;
    const Medium medium(density.bricks,
                        volume.object_to_world * density.world_from_index * translation(volume.index_offset), 1,
                        dvec3(1), 0);
    look.voxel = medium.voxel_size();
    look.seen = visible_density(medium, -away_, up_, look.fire.burns() ? kDepthOfSmoke : kDepth, task_);
  }

  /// Which way is up, and from where the camera looks.
  void set_axes(const VolumeFile& file) {
    const CameraSettings& camera = file.plan.camera;
    y_up_ = said_("camera.up") ? std::abs(camera.up.y) > std::abs(camera.up.z) : made_by(file.contents, "Houdini");
    up_ = said_("camera.up") && glm::length(camera.up) > 0 ? glm::normalize(camera.up)
          : y_up_                                          ? dvec3(0, 1, 0)
                                                           : dvec3(0, 0, 1);
    away_ = turned(0.25, 1, 0.12);
    if (said_("camera.position") && said_("camera.look_at") && camera.position != camera.look_at)
      away_ = glm::normalize(camera.position - camera.look_at);
    right_ = glm::cross(-away_, up_);
    right_ = glm::length(right_) > 1e-6 ? glm::normalize(right_) : Frame(-away_).x;
    above_ = glm::cross(right_, -away_);
  }
  /// x to the right, a little from above.
  dvec3 turned(double right, double back, double above) const {
    return glm::normalize(y_up_ ? dvec3(right, above, back) : dvec3(right, -back, above));
  }

  /// @param main  the file whose extinction is taken
  VolumeScene scene(const VolumeFile& main) {
    VolumeScene made;
    if (looks_.empty() || !looks_[0].density || looks_[0].density->bricks.empty()) {
      const bool told = !looks_.empty() && looks_[0].density && !looks_[0].density->notes.empty();
      throw InputError(
          fmt::format("{}: its {} is empty, there is nothing to render{}; name another with -D volumes.0.grid=NAME",
                      main.path.string(), main.grid.empty() ? "list of grids" : grid_text(main.grid),
                      told ? " (" + join(looks_[0].density->notes, "; ") + ")" : ""));
    }
    if (looks_[0].seen.points.empty())
      throw InputError(fmt::format("{}: no ray meets the density of {}; is it finer than a thousandth of its bounds?",
                                   main.path.string(), grid_text(main.grid)));
    assume_ = [&](const std::string& text) { made.assumptions.push_back(text); };
    const VolumeSettings& volume = main.plan.volumes[0];
    if (!sequence_ && !volume.convert_level_set && volume.remap.empty() && !(volume.max_density > 0))
      made.density = looks_[0].density;
    measure();
    if (!sequence_ || looks_.size() == 1)
      assume_(fmt::format("{}, {} up", grid_text(main.grid), y_up_ ? "y" : "z"));
    else
      assume_(fmt::format("{}, {} up; one camera and one extinction for all frames, by {} of them",
                          grid_text(main.grid), y_up_ ? "y" : "z", looks_.size()));
    for (const std::string& note : main.notes) assume_(note);
    if (const double voxel = looks_[0].voxel; voxel < kSmallestVoxel || voxel > kLargestVoxel)
      assume_(fmt::format(
          "voxels of {:.3g} units are taken as they are; extinction and camera follow the volume's size", voxel));
    const bool burns = std::any_of(looks_.begin(), looks_.end(), [](const Look& look) { return look.fire.burns(); });
    made.before_file = fmt::format("# Made for {}: every value is a guess to begin with.\nname = {}\n\n{}\n{}\n{}",
                                   toml_comment(pattern_.filename().string()), toml_string(pattern_.stem().string()),
                                   camera_text(main.plan, made), film_text(main.plan), environment_text(burns)) +
                       "\n[[volumes]]\nfile = ";
    made.after_file = volume_text(main, burns) + sun_text(burns);
    return made;
  }

  /// The middle and the size of what is seen in all looks.
  void measure() {
    const dvec3 view = -away_;
    dvec3 lo(std::numeric_limits<double>::infinity()), hi = -lo;
    for (const Look& look : looks_)
      for (const dvec3& p : look.seen.points) {
        const dvec3 at(glm::dot(p, right_), glm::dot(p, above_), glm::dot(p, view));
        lo = glm::min(lo, at);
        hi = glm::max(hi, at);
      }
    const dvec3 middle = 0.5 * (lo + hi);
    radius_ = 0.5 * glm::length(hi - lo);
    middle_ = rounded(right_ * middle.x + above_ * middle.y + view * middle.z, kRounding * radius_);
  }

  /// Of the picture at a distance of 1, or of a parallel camera's: half its width and height.
  static dvec2 half_picture(const Scene& plan, double extent) {
    const CameraSettings& camera = plan.camera;
    const double aspect = camera.pixel_aspect * plan.film.width / plan.film.height;
    const bool along_x = camera.fov_axis == "x" || (camera.fov_axis == "shorter" && aspect <= 1);
    dvec2 half = along_x ? dvec2(extent, extent / aspect) : dvec2(extent * aspect, extent);
    for (int a = 0; a < 2; ++a)  // a shifted picture shows as much less to one side
      if (const double left = 1 - 2 * std::abs(camera.shift[a]); left > 0.05) half[a] *= left;
    return half;
  }

  /// The least factor of `half` that holds all points; their distance to the eye counts for a perspective camera.
  double needed(const dvec3& middle, const dvec2& half, bool perspective) const {
    const dvec3 view = -away_;
    double most = 0;
    for (const Look& look : looks_)
      for (const dvec3& point : look.seen.points) {
        const dvec3 p = point - middle;
        const double across = std::max(std::abs(glm::dot(p, right_)) / half.x, std::abs(glm::dot(p, above_)) / half.y);
        most = std::max(most, perspective ? across - glm::dot(p, view) : across);
      }
    return most;
  }

  std::string camera_text(const Scene& plan, VolumeScene& made) const {
    const CameraSettings& camera = plan.camera;
    std::string text = "[camera]\n";
    if (!said_.camera_moves_or_is_given()) {
      const dvec3 middle = said_("camera.look_at") ? camera.look_at : middle_;
      const bool parallel = camera.type == "orthographic";
      const double distance =
          kMargin * (parallel ? 2 * radius_ + glm::distance(middle, middle_)
                              : needed(middle, half_picture(plan, std::tan(0.5 * camera.fov * kPi / 180)), true));
      const dvec3 position =
          said_("camera.position") ? camera.position : rounded(middle + distance * away_, kRounding * radius_);
      text += fmt::format("position = {}\nlook_at = {}\n", triple(position), triple(middle));
      if (!said_("camera.position")) made.camera_assumption = fmt::format("seen from {}", triple(position));
      if (parallel)
        text += fmt::format("type = \"orthographic\"\nwidth = {}\n",
                            said_("camera.width")
                                ? number(camera.width)
                                : number(short_number(kMargin * needed(middle, half_picture(plan, 0.5), false), 5)));
    }
    return text + fmt::format("up = {}\nfov = {}\nfov_axis = \"{}\"\n",
                              said_("camera.up") ? triple(camera.up) : triple(up_), number(camera.fov),
                              camera.fov_axis);
  }

  static std::string film_text(const Scene& plan) {
    return fmt::format("[film]\nwidth = {}\nheight = {}\n", plan.film.width, plan.film.height);
  }

  std::string environment_text(bool burns) const {
    std::string text = "[environment]\n";
    if (!own_sky()) text += fmt::format("radiance = {}\n", burns ? "[0.05, 0.06, 0.08]" : "[0.2, 0.26, 0.36]");
    return text + fmt::format("up = {}\n", triple(y_up_ ? dvec3(0, 1, 0) : dvec3(0, 0, 1)));
  }
  /// A sky that is said is not changed by a factor, and no second sun is added.
  bool own_sky() const { return said_.any({"environment.file", "environment.sky"}); }

  std::string volume_text(const VolumeFile& main, bool burns) const {
    const VolumeSettings& volume = main.plan.volumes[0];
    std::string text = fmt::format("\ngrid = {}\n", toml_string(main.grid));
    if (volume.convert_level_set) text += "convert_level_set = true\n";
    if (!said_.extinction()) {
      // Said alone, density is a factor on what is guessed.
      const double typical = looks_[0].seen.typical_depth,
                   sigma_t = short_number((burns ? kDepthOfSmoke : kDepth) / typical, 2);
      assume_(fmt::format(
          "volumes.0.sigma_t = {} for an optical depth of about {:.3g}; albedo, g, sun and sky are a guess too",
          sigma_t, sigma_t * volume.sigma_t.x * typical));
      text += fmt::format("sigma_t = {}\n", sigma_t);
    } else {
      assume_("albedo, g, sun and sky, as far as they are not said");
    }
    if (!said_.any({"volumes.0.sigma_a", "volumes.0.sigma_s", "volumes.0.preset"}))
      text += fmt::format("albedo = {}\n", burns ? "0.6" : "0.98");
    return text + fmt::format("g = {}\n", burns ? "0.2" : "0.45") + fire_text(volume);
  }

  std::string fire_text(const VolumeSettings& volume) const {
    const Look* hottest = nullptr;
    for (const Look& look : looks_)
      if (!look.fire.temperature.empty() && (!hottest || look.fire.hottest > hottest->fire.hottest)) hottest = &look;
    if (hottest) return black_body_text(hottest->fire, volume);
    for (const Look& look : looks_)
      if (!look.fire.flame.empty()) return flames_text(look.fire.flame);
    for (const Look& look : looks_)
      if (!look.fire.why_none.empty()) {
        assume_(look.fire.why_none);
        break;
      }
    return "";
  }
  /// A grid that not every frame of a sequence may have.
  std::string glowing(const std::string& grid, GridUse use) const {
    std::vector<std::string> ignored;
    const bool usual = usual_grid({{grid, "float", ""}}, use, ignored) != nullptr;
    return sequence_ && usual ? "\"auto\"" : toml_string(grid);
  }

  std::string black_body_text(const Fire& fire, const VolumeSettings& volume) const {
    const double scale = kelvin_per_unit(fire.hottest, volume, said_);
    const double emitted = emitted_luminance(fire.hottest, volume, said_);
    const double intensity = short_number(kFlameRadiance / (0.1 * radius_ * emitted), 2);
    const bool given = said_("volumes.0.blackbody_intensity");
    const double kelvin = volume.temperature_offset + scale * fire.hottest;
    const std::string hottest =
        said_("volumes.0.temperature_scale")
            ? fmt::format("its hottest voxel has {:.4g} K", kelvin)
            : fmt::format("volumes.0.temperature_scale = {} makes its hottest voxel {:.4g} K", scale, kelvin);
    assume_(fmt::format("fire from {}: {}{}", grid_text(fire.temperature), hottest,
                        given ? "" : fmt::format(", blackbody_intensity = {}", intensity)));
    return fmt::format("temperature_grid = {}\ntemperature_scale = {}\n",
                       glowing(fire.temperature, GridUse::kTemperature), scale) +
           (given ? "" : fmt::format("blackbody_intensity = {}\n", intensity));
  }

  std::string flames_text(const std::string& flame) const {
    const double intensity = short_number(kFlameRadiance / (0.1 * radius_), 2);
    if (said_("volumes.0.flame_intensity")) {
      assume_(fmt::format("fire from {}", grid_text(flame)));
      return fmt::format("flame_grid = {}\n", glowing(flame, GridUse::kFlame));
    }
    assume_(fmt::format("fire from {}: volumes.0.flame_intensity = {}", grid_text(flame), intensity));
    return fmt::format("flame_grid = {}\nflame_intensity = {}\n", glowing(flame, GridUse::kFlame), intensity);
  }

  std::string sun_text(bool burns) const {
    const dvec3 to_sun = turned(-0.9, 0.25, 0.6);
    if (own_sky() && !said_.any({"lights.0.type", "lights.0.direction", "lights.0.irradiance"})) return "";
    dvec3 direction;
    for (int a = 0; a < 3; ++a) direction[a] = short_number(to_sun[a], 6);
    return fmt::format("\n[[lights]]\ntype = \"sun\"\ndirection = {}\nirradiance = {}\n", triple(direction),
                       burns ? "[0.8, 0.7, 0.55]" : "[3.4, 3.0, 2.4]");
  }

  const fs::path& pattern_;
  const std::span<const std::string> assignments_;
  const Said said_;
  const Task& task_;
  bool sequence_ = false, y_up_ = false;
  dvec3 up_{0, 0, 1}, away_{0, -1, 0}, right_{1, 0, 0}, above_{0, 0, 1}, middle_{0};
  double radius_ = 0;
  std::vector<Look> looks_;
  std::function<void(const std::string&)> assume_;
};

}  // namespace

std::string VolumeScene::text(const std::string& file) const {
  return before_file + toml_string(file) + after_file;
}

std::vector<std::string> VolumeScene::all_assumptions() const {
  std::vector<std::string> all = assumptions;
  if (!camera_assumption.empty())
    all.insert(all.begin() + std::min<std::ptrdiff_t>(1, std::ssize(all)), camera_assumption);
  return all;
}

VolumeScene scene_for_volume(const fs::path& file, std::span<const std::string> assignments, const Task& task) {
  return Guess(file, assignments, task).of_file();
}

VolumeScene scene_for_volumes(const fs::path& pattern, std::span<const int> frames,
                              std::span<const std::string> assignments, const Task& task) {
  return Guess(pattern, assignments, task).of_frames(frames);
}

}  // namespace brume

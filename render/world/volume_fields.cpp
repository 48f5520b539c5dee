#include "render/world/volume_fields.h"

#include <fmt/format.h>

#include "base/error.h"

namespace brume {
namespace {

constexpr const char* kAuto = "auto";

/// The grid's name for a loader, to which "auto" leaves it.
std::string name_or_none(const std::string& name) {
  return name == kAuto ? "" : name;
}

/// What `read` gives, or where "auto" finds nothing an empty field that says so.
template <class Field, class Read>
Field read_if_there(const std::string& name, const Read& read) {
  try {
    return read();
  } catch (const NoSuchGrid& error) {
    if (name != kAuto) throw;
    Field none;
    none.notes.push_back(fmt::format("{}: \"auto\" finds none, and is taken as \"none\"", error.what()));
    return none;
  }
}

}  // namespace

const std::filesystem::path& file_of(const VolumeSettings& v, GridUse use) {
  const auto or_density = [&](const std::filesystem::path& own) -> const std::filesystem::path& {
    return own.empty() ? v.file : own;
  };
  switch (use) {
    case GridUse::kTemperature:
      return or_density(v.temperature_file);
    case GridUse::kFlame:
      return or_density(v.flame_file);
    case GridUse::kColour:
      return or_density(v.albedo_file);
    case GridUse::kVelocity:
      return or_density(v.velocity_file);
    case GridUse::kDensity:
      break;
  }
  return v.file;
}

Paging paging_of(const VolumeSettings& v) {
  return v.paging == "always" ? Paging::kAlways : v.paging == "never" ? Paging::kNever : Paging::kAuto;
}

ScalarField load_field(const VolumeSettings& v, const std::string& name, GridUse use, const Task& task) {
  const ScalarOptions options{.grid = name_or_none(name),
                              .use = use,
                              .needs_flames = use == GridUse::kTemperature && name == kAuto,
                              .paging = paging_of(v)};
  return read_if_there<ScalarField>(name, [&] { return load_scalar(file_of(v, use), options, task); });
}

VectorField load_colour_field(const std::filesystem::path& file, const std::string& name, const Task& task) {
  return read_if_there<VectorField>(name, [&] { return load_colour(file, name_or_none(name), task); });
}

bool VolumeFields::carried() {
  if (asked_) return velocities_.has_value();
  asked_ = true;
  if (v_.time.between == "blend") return false;
  const auto blended = [&](const std::string& why) {
    notes_.push_back(fmt::format(
        "{}: {}: what is between its frames is a mixture of them where they are, which fades instead of moving",
        v_.file.string(), why));
    return false;
  };
  if (v_.velocity_grid == "none") return blended("velocity_grid is none");
  const std::string name = name_or_none(v_.velocity_grid);
  try {
    velocities_ = {load_velocity(file_of(v_, GridUse::kVelocity), name, task_),
                   load_velocity(file_of(*v_.moment.later, GridUse::kVelocity), name, task_)};
  } catch (const NoSuchGrid& error) {
    if (v_.velocity_grid != kAuto) throw;
    return blended(error.what());
  }
  for (StoredVelocity& velocity : *velocities_) {
    notes_.insert(notes_.end(), velocity.notes.begin(), velocity.notes.end());
    velocity.notes.clear();
  }
  return true;
}

void VolumeFields::tell_misfit(const BetweenFrames& density) {
  const double misfit = density.misfit(task_);
  if (!(misfit > 1)) return;
  notes_.push_back(fmt::format(
      "{}: carried along its velocities a frame misses the next one by {:.2g} times as much as standing still: velocity_scale = {} is not the file's unit per frame; about {:.3g} fits best",
      v_.file.string(), misfit, v_.velocity_scale, v_.velocity_scale * density.best_factor(task_)));
}

ScalarField VolumeFields::density(const ScalarOptions& options) {
  ScalarField first = load_scalar(v_.file, options, task_);
  if (!v_.moment.later) return first;
  const ScalarField second = load_scalar(v_.moment.later->file, options, task_);
  if (!carried()) return BetweenFrames(first, second, time()).density(task_);
  const BetweenFrames both(first, (*velocities_)[0], second, (*velocities_)[1], time(), notes_, task_);
  tell_misfit(both);
  if (blurred_) velocity_ = both.velocity(task_);
  return both.density(task_);
}

ScalarField VolumeFields::between(const ScalarField& first, const ScalarField& second) {
  if (!carried()) return BetweenFrames(first, second, time()).intensity(task_);
  std::vector<std::string> told;  // of the density, as a rule
  return BetweenFrames(first, (*velocities_)[0], second, (*velocities_)[1], time(), told, task_).intensity(task_);
}

ScalarField VolumeFields::temperature() {
  const auto of = [&](const VolumeSettings& v) {
    return load_field(v, v.temperature_grid, GridUse::kTemperature, task_);
  };
  return v_.moment.later ? between(of(v_), of(*v_.moment.later)) : of(v_);
}

ScalarField VolumeFields::flame() {
  const auto of = [&](const VolumeSettings& v) { return load_field(v, v.flame_grid, GridUse::kFlame, task_); };
  return v_.moment.later ? between(of(v_), of(*v_.moment.later)) : of(v_);
}

VectorField VolumeFields::colour() {
  const auto of = [&](const VolumeSettings& v) {
    return load_colour_field(file_of(v, GridUse::kColour), v.albedo_grid, task_);
  };
  if (!v_.moment.later) return of(v_);
  return colour_between(
      of(v_), of(*v_.moment.later),
      [&](const ScalarField& first, const ScalarField& second) { return between(first, second); }, task_);
}

Displacement VolumeFields::displacement(const ScalarField& field, double open, double close) {
  if (velocity_) return displacement_over(*velocity_, field, {1, open, close}, notes_, task_);
  const bool later = v_.moment.later && v_.moment.share >= 0.5;
  return load_displacement(file_of(later ? *v_.moment.later : v_, GridUse::kVelocity), name_or_none(v_.velocity_grid),
                           field, {v_.velocity_scale, open, close}, notes_, task_);
}

}  // namespace brume

#include "render/world/lights.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/error.h"
#include "image/cube_map.h"
#include "image/picture_io.h"
#include "render/world/mesh.h"
#include "render/world/sky.h"

namespace brume {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

// Suns below this many degrees are exactly parallel: directions in single precision tell no more.
constexpr double kParallel = 1e-5;

// A unit vector around an axis: 1 - cos of its angle uniform in [0, one_minus_cos].
dvec3 sample_cone(const dvec3& axis, double one_minus_cos, const dvec2& u) {
  const double h = u.x * one_minus_cos, s = std::sqrt(std::max(0.0, h * (2.0 - h)));
  const SinCos phi = portable_sincos_2pi(u.y);
  return glm::normalize(Frame(axis).to_world({s * phi.cos, s * phi.sin, 1.0 - h}));
}

}  // namespace

Sun::Sun(const LightSettings& s)
    : InfiniteLight(s.visible_to_camera),
      axis_(glm::normalize(s.direction)),
      irradiance_(s.irradiance),
      delta_(s.angular_diameter < kParallel) {
  const double radius = 0.5 * s.angular_diameter * kPi / 180.0, half = std::sin(0.5 * radius);
  one_minus_cos_ = 2.0 * half * half;
  // The disc's projected solid angle is pi sin^2: then a facing plane gets exactly the irradiance asked for.
  if (!delta_) radiance_ = irradiance_ / (kPi * std::sin(radius) * std::sin(radius));
}

LightSample Sun::sample(const dvec2& u) const {
  if (delta_) return {axis_, irradiance_, 1.0, kFar, true};
  return {sample_cone(axis_, one_minus_cos_, u), radiance_, 1.0 / (2.0 * kPi * one_minus_cos_), kFar, false};
}

SphereLight::SphereLight(const LightSettings& s, const dvec3& world_shift)
    : FiniteLight(s), centre_(s.position - world_shift), radiance_(s.radiance), radius_(s.radius) {}

double SphereLight::importance(const dvec3& p) const {
  // Inside or near, as strong as at its own surface.
  const dvec3 to = centre_ - p;
  return kPi * luminance(radiance_) * std::min(1.0, radius_ * radius_ / glm::dot(to, to));
}

double SphereLight::pdf(const dvec3& p) const {
  const dvec3 to = centre_ - p;
  const double sin2 = radius_ * radius_ / glm::dot(to, to);
  if (!(sin2 < 1)) return 1.0 / (4.0 * kPi);  // from inside, every direction meets it
  // 1 - cos without cancellation: sin^2 / (1 + cos).
  return (1.0 + std::sqrt(1.0 - sin2)) / (2.0 * kPi * sin2);
}

LightSample SphereLight::sample(const dvec3& p, const dvec2& u) const {
  const double density = pdf(p);
  const dvec3 to = centre_ - p;
  const double one_minus_cos = 1.0 / (2.0 * kPi * density);
  const dvec3 axis = glm::dot(to, to) > 0 ? glm::normalize(to) : dvec3(0, 0, 1);
  const dvec3 wi = sample_cone(axis, one_minus_cos, u);
  const double t = intersect({p, wi});
  // A direction at the very rim may miss by rounding; the tangent point is then the one meant.
  return {wi, radiance_, density, t > 0 ? t : std::sqrt(std::max(0.0, glm::dot(to, to) - radius_ * radius_)), false};
}

double SphereLight::intersect(const Ray& ray) const {
  const dvec3 o = ray.o - centre_;
  const double b = glm::dot(o, ray.d), length2 = glm::dot(o, o);
  const dvec3 closest = o - b * ray.d;  // Hearn and Baker: no cancellation for far and tiny spheres
  const double discriminant = radius_ * radius_ - glm::dot(closest, closest);
  if (discriminant < 0) return -1;
  const double root = std::sqrt(discriminant);
  return length2 > radius_ * radius_ ? -b - root : -b + root;
}

RectangleLight::RectangleLight(const LightSettings& s, const dvec3& world_shift)
    : FiniteLight(s),
      corner_(s.position - world_shift - 0.5 * (s.edge_x + s.edge_y)),
      x_(s.edge_x),
      y_(s.edge_y),
      radiance_(s.radiance),
      two_sided_(s.two_sided) {
  const dvec3 n = glm::cross(x_, y_);
  area_ = glm::length(n);
  normal_ = n / area_;
}

LightSample RectangleLight::sample(const dvec3& p, const dvec2& u) const {
  const dvec3 to = corner_ + u.x * x_ + u.y * y_ - p;
  const double distance = glm::length(to);
  if (!(distance > 0)) return {};
  const dvec3 wi = to / distance;
  const Ray ray{p, wi};
  if (!(std::abs(glm::dot(wi, normal_)) > 0)) return {};
  return {wi, radiance(ray, distance), pdf(ray, distance), distance, false};
}

double RectangleLight::intersect(const Ray& ray) const {
  const double facing = glm::dot(ray.d, normal_);
  if (facing == 0) return -1;
  const double t = glm::dot(corner_ - ray.o, normal_) / facing;
  if (!(t > 0)) return -1;
  // Coordinates along the edges, which need not be perpendicular.
  const dvec3 q = ray.at(t) - corner_;
  const double a = glm::dot(glm::cross(q, y_), normal_) / area_, b = glm::dot(glm::cross(x_, q), normal_) / area_;
  return a >= 0 && a <= 1 && b >= 0 && b <= 1 ? t : -1;
}

double RectangleLight::importance(const dvec3& p) const {
  const dvec3 to = corner_ + 0.5 * (x_ + y_) - p;
  return luminance(radiance_) * kPi * std::min(1.0, area_ / (kPi * glm::dot(to, to)));
}

PointLight::PointLight(const LightSettings& s, const dvec3& world_shift)
    : position_(s.position - world_shift), intensity_(s.intensity) {
  if (s.type != "spot") return;
  axis_ = glm::normalize(s.direction);
  cosine_ = s.cosine_falloff;
  cos_outer_ = std::cos(0.5 * s.cone_angle * kPi / 180.0);
  cos_inner_ = std::cos(0.5 * s.cone_angle * (1.0 - s.cone_softness) * kPi / 180.0);
}

dvec3 PointLight::intensity_towards(const dvec3& d) const {
  if (cos_outer_ < -1) return intensity_;
  const double c = glm::dot(d, axis_);
  if (c <= cos_outer_) return dvec3(0);
  const dvec3 inside = cosine_ ? intensity_ * c : intensity_;
  if (c >= cos_inner_) return inside;
  const double f = (c - cos_outer_) / (cos_inner_ - cos_outer_);
  return inside * (f * f * (3.0 - 2.0 * f));
}

LightSample PointLight::sample(const dvec3& p, const dvec2&) const {
  const dvec3 to = position_ - p;
  const double distance = glm::length(to);
  if (!(distance > 0)) return {};
  const dvec3 wi = to / distance;
  return {wi, intensity_towards(-wi) / (distance * distance), 1.0, distance, true};
}

double PointLight::importance(const dvec3& p) const {
  const dvec3 to = position_ - p;
  const double d2 = glm::dot(to, to);
  // A spot keeps a share outside of its cone too, so that the choice never rests on rounding.
  const double shape = cos_outer_ < -1 || glm::dot(-to, axis_) >= cos_outer_ * std::sqrt(d2) ? 1.0 : 1e-3;
  return d2 > 0 ? shape * luminance(intensity_) / d2 : 0.0;
}

MeshLight::MeshLight(const TriangleMesh& mesh, const dvec3& radiance, bool two_sided)
    : mesh_(&mesh), radiance_(radiance), two_sided_(two_sided) {
  cdf_.reserve(mesh.triangles.size());
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    area_ += mesh.area(i);
    cdf_.push_back(area_);
    const dvec3 facing = mesh.area(i) * mesh.normal(i);
    for (int axis = 0; axis < 3; ++axis)
      for (const bool back : {false, true})
        if (two_sided_ || back == (facing[axis] < 0))
          projected_[static_cast<size_t>(2 * axis + back)] += std::abs(facing[axis]);
  }
  for (double& c : cdf_) c /= area_;
  for (const dvec3& v : mesh.positions) centre_ += v;
  centre_ /= static_cast<double>(mesh.positions.size());
  for (const dvec3& v : mesh.positions) extent_ = std::max(extent_, glm::distance(centre_, v));
}

double MeshLight::projected_area(const dvec3& direction) const {
  double sum = 0;
  for (int axis = 0; axis < 3; ++axis)
    sum +=
        direction[axis] * direction[axis] * projected_[static_cast<size_t>(2 * axis + (direction[axis] > 0 ? 1 : 0))];
  return sum;
}

LightSample MeshLight::sample(const dvec3& p, const dvec2& u) const {
  const size_t i =
      std::min(static_cast<size_t>(std::upper_bound(cdf_.begin(), cdf_.end(), u.x) - cdf_.begin()), cdf_.size() - 1);
  const double before = i > 0 ? cdf_[i - 1] : 0.0;
  const double within = std::clamp((u.x - before) / (cdf_[i] - before), 0.0, 1.0), root = std::sqrt(within);
  const auto [a, b, c] = mesh_->corners(i);
  const dvec3 at = a * (1.0 - root) + b * (root * (1.0 - u.y)) + c * (root * u.y);
  const dvec3 to = at - p;
  const double distance = glm::length(to);
  if (!(distance > 0)) return {};
  const dvec3 wi = to / distance;
  const double cos_theta = glm::dot(wi, mesh_->normal(i));
  if (cos_theta == 0) return {};
  const bool shines = two_sided_ || cos_theta < 0;
  return {wi, shines ? radiance_ : dvec3(0), pdf(distance, cos_theta), distance, false};
}

double MeshLight::importance(const dvec3& p) const {
  const double d = std::max(glm::distance(p, centre_), extent_);
  return luminance(radiance_) * area_ / (d * d);
}

Environment::Environment(const EnvironmentSettings& s, const Task& task)
    : InfiniteLight(s.visible_to_camera), radiance_(s.radiance), mean_(s.radiance) {
  if (s.sky == "preetham") {
    set_picture(preetham_sky(s), s);
    return;
  }
  if (s.file.empty()) return;
  const std::string name = s.file.string();
  UsablePicture read = read_usable_picture(s.file, task);
  notes_ = std::move(read.notes);
  Layers picture = std::move(read.layers);
  if (is_cube_map(picture)) {
    picture = lat_long_of_cube(picture, name, task);
    notes_.push_back(
        fmt::format("{}: is a cube map: taken as the lat-long picture of {} x {} whose middle is its +Z face", name,
                    picture.width(), picture.height()));
  }
  if (picture.width() != 2 * picture.height())
    notes_.push_back(fmt::format("{}: is {} x {}; a lat-long picture is twice as wide as high", name, picture.width(),
                                 picture.height()));
  set_picture(picture, s);
}

void Environment::set_picture(const Layers& picture, const EnvironmentSettings& s) {
  width_ = picture.width();
  height_ = picture.height();
  const std::string name = s.file.string();
  const auto rgb = picture.rgb(layer::beauty);
  picture_.resize(static_cast<size_t>(width_) * height_);
  for (int y = 0; y < height_; ++y)
    for (int x = 0; x < width_; ++x) {
      vec3& texel = picture_[static_cast<size_t>(y) * width_ + x];
      for (int c = 0; c < 3; ++c) {
        const double v = (*rgb[static_cast<size_t>(c)])(x, y) * s.radiance[c];
        texel[c] = static_cast<float>(std::min(v, static_cast<double>(std::numeric_limits<float>::max())));
      }
    }

  if (!(glm::length(s.up) > 0)) throw InputError("[environment] up is zero; expected a direction");
  const dvec3 up = glm::normalize(s.up);
  // The picture's middle faces +y where up is z, and -z where up is y, as tools with those axes expect.
  const dvec3 reference = std::abs(up.z) > 0.5 ? dvec3(0, 1, 0) : dvec3(0, 0, -1);
  const dvec3 right = glm::normalize(glm::cross(reference, up)), forward = glm::cross(up, right);
  picture_from_world_ = glm::transpose(dmat3(right, forward, up));
  rotation_ = s.sky == "none" ? s.rotation / 360.0 : 0.0;  // a sky is where its sun is

  // Texels weighted by the largest neighbour, because the look-up is bilinear and sampling should not miss its slopes.
  cdf_.resize(picture_.size());
  row_cdf_.resize(static_cast<size_t>(height_));
  double total = 0;
  mean_ = dvec3(0);
  double solid_angle = 0;
  for (int y = 0; y < height_; ++y) {
    const double band = std::cos(kPi * y / height_) - std::cos(kPi * (y + 1) / height_);
    double row = 0;
    for (int x = 0; x < width_; ++x) {
      double weight = 0;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          const int ny = std::clamp(y + dy, 0, height_ - 1), nx = (x + dx + width_) % width_;
          weight = std::max(weight, static_cast<double>(luminance(picture_[static_cast<size_t>(ny) * width_ + nx])));
        }
      row += weight;
      cdf_[static_cast<size_t>(y) * width_ + x] = row;
      mean_ += dvec3(picture_[static_cast<size_t>(y) * width_ + x]) * band;
      solid_angle += band;
    }
    for (int x = 0; x < width_; ++x) {
      double& value = cdf_[static_cast<size_t>(y) * width_ + x];
      value = row > 0 ? value / row : (x + 1.0) / width_;
    }
    total += row * band;
    row_cdf_[static_cast<size_t>(y)] = total;
  }
  mean_ /= solid_angle;
  const vec3* brightest = &*std::max_element(picture_.begin(), picture_.end(),
                                             [](const vec3& a, const vec3& b) { return luminance(a) < luminance(b); });
  const auto row_of = static_cast<int>((brightest - picture_.data()) / width_);
  const double band_of = std::cos(kPi * row_of / height_) - std::cos(kPi * (row_of + 1) / height_);
  const double share = luminance(dvec3(*brightest)) * band_of / (solid_angle * luminance(mean_));
  if (share > 0.5 && width_ * height_ > 64)
    notes_.push_back(fmt::format("{}: one texel holds {:.0f} % of the light; a [[lights]] sun in its place is exact",
                                 name, 100 * share));
  for (double& value : row_cdf_) value = total > 0 ? value / total : 1.0;
  if (!(total > 0)) {
    picture_.clear();  // a black picture lights nothing
    radiance_ = mean_ = dvec3(0);
  }
}

dvec2 Environment::to_picture(const dvec3& d) const {
  const dvec3 p = picture_from_world_ * d;
  double u = 0.5 + std::atan2(p.x, p.y) / (2.0 * kPi) + rotation_;
  u -= std::floor(u);
  return {std::min(u, 1.0 - 1e-16), std::acos(std::clamp(p.z, -1.0, 1.0)) / kPi};
}

dvec3 Environment::from_picture(const dvec2& uv) const {
  double u = uv.x - 0.5 - rotation_;
  u -= std::floor(u);
  const SinCos theta = portable_sincos_2pi(0.5 * uv.y), phi = portable_sincos_2pi(u);
  return glm::transpose(picture_from_world_) * dvec3(theta.sin * phi.sin, theta.sin * phi.cos, theta.cos);
}

dvec3 Environment::radiance(const dvec3& d) const {
  if (picture_.empty()) return radiance_;
  const dvec2 uv = to_picture(d);
  const double x = uv.x * width_ - 0.5, y = std::clamp(uv.y * height_ - 0.5, 0.0, height_ - 1.0);
  const double fx = x - std::floor(x), fy = y - std::floor(y);
  const int x0 = (static_cast<int>(std::floor(x)) + width_) % width_, x1 = (x0 + 1) % width_;
  const int y0 = static_cast<int>(y), y1 = std::min(y0 + 1, height_ - 1);
  const auto texel = [&](int tx, int ty) { return dvec3(picture_[static_cast<size_t>(ty) * width_ + tx]); };
  return (texel(x0, y0) * (1 - fx) + texel(x1, y0) * fx) * (1 - fy) +
         (texel(x0, y1) * (1 - fx) + texel(x1, y1) * fx) * fy;
}

double Environment::pdf(const dvec3& d) const {
  if (picture_.empty()) return 1.0 / (4.0 * kPi);
  const dvec2 uv = to_picture(d);
  const int x = std::min(static_cast<int>(uv.x * width_), width_ - 1),
            y = std::min(static_cast<int>(uv.y * height_), height_ - 1);
  const double* row = &cdf_[static_cast<size_t>(y) * width_];
  const double p_row = row_cdf_[static_cast<size_t>(y)] - (y > 0 ? row_cdf_[static_cast<size_t>(y) - 1] : 0.0);
  const double p_texel = row[x] - (x > 0 ? row[x - 1] : 0.0);
  const double band = std::cos(kPi * y / height_) - std::cos(kPi * (y + 1) / height_);
  return p_row * p_texel * width_ / (2.0 * kPi * band);
}

LightSample Environment::sample(const dvec2& u) const {
  if (picture_.empty()) {
    const double z = 1.0 - 2.0 * u.x, r = std::sqrt(std::max(0.0, (1.0 - z) * (1.0 + z)));
    const SinCos phi = portable_sincos_2pi(u.y);
    return {{r * phi.cos, r * phi.sin, z}, radiance_, 1.0 / (4.0 * kPi), kFar, false};
  }
  const auto pick = [](const double* begin, int count, double xi, double& within) {
    const int i = std::min(static_cast<int>(std::upper_bound(begin, begin + count, xi) - begin), count - 1);
    const double before = i > 0 ? begin[i - 1] : 0.0;
    within = std::clamp((xi - before) / (begin[i] - before), 0.0, 1.0 - 1e-12);
    return i;
  };
  double fy, fx;
  const int y = pick(row_cdf_.data(), height_, u.y, fy);
  const int x = pick(&cdf_[static_cast<size_t>(y) * width_], width_, u.x, fx);
  // Uniform in solid angle within the texel: cos theta is linear.
  const double top = std::cos(kPi * y / height_), bottom = std::cos(kPi * (y + 1) / height_);
  const double v = std::acos(std::clamp(top + fy * (bottom - top), -1.0, 1.0)) / kPi;
  const dvec3 d = glm::normalize(from_picture({(x + fx) / width_, v}));
  return {d, radiance(d), pdf(d), kFar, false};
}

namespace {

// Importance is zero at one point only by accident, at two only for want of power.
bool shines(const Light& light) {
  return light.importance(dvec3(0)) > 0 || light.importance(dvec3(1, 2, 3)) > 0;
}

}  // namespace

Lights::Lights(const Scene& scene, const dvec3& world_shift, const Task& task) {
  auto environment = std::make_unique<Environment>(scene.environment, task);
  environment_ = environment.get();
  if (!environment->black()) infinite_.push_back(environment_);
  all_.push_back(std::move(environment));
  std::vector<LightSettings> settings = scene.lights;
  if (scene.environment.sky == "preetham" && scene.environment.sky_sun)
    settings.push_back(preetham_sun(scene.environment));
  for (const LightSettings& s : settings) {
    if (s.type == "sun") {
      auto light = std::make_unique<Sun>(s);
      suns_.push_back(light.get());
      infinite_.push_back(light.get());
      all_.push_back(std::move(light));
    } else if (s.type == "sphere" || s.type == "rectangle") {
      std::unique_ptr<FiniteLight> light;
      if (s.type == "sphere")
        light = std::make_unique<SphereLight>(s, world_shift);
      else
        light = std::make_unique<RectangleLight>(s, world_shift);
      finite_.push_back(light.get());
      all_.push_back(std::move(light));
    } else {
      auto light = std::make_unique<PointLight>(s, world_shift);
      points_.push_back(light.get());
      all_.push_back(std::move(light));
    }
  }
}

size_t Lights::add_mesh(const TriangleMesh& mesh, const dvec3& radiance, bool two_sided) {
  auto light = std::make_unique<MeshLight>(mesh, radiance, two_sided);
  meshes_.push_back(light.get());
  all_.push_back(std::move(light));
  return meshes_.size() - 1;
}

void Lights::finish(const std::string& mode) {
  if (mode == "none") return;
  for (const auto& light : all_) {
    const bool sky = light.get() == environment_;
    // Phase sampling finds a constant sky without noise; a shadow ray per event would only cost.
    if (sky && (environment_->black() || (environment_->constant() && mode != "all"))) continue;
    if (!shines(*light)) continue;
    sampled_.push_back(light.get());
    same_everywhere_ = same_everywhere_ && dynamic_cast<const InfiniteLight*>(light.get()) != nullptr;
  }
  if (!same_everywhere_) return;
  double total = 0;
  for (const Light* light : sampled_) total += light->importance(dvec3(0));
  for (const Light* light : sampled_) share_.push_back(light->importance(dvec3(0)) / total);
}

bool Lights::any_delta() const {
  return std::any_of(all_.begin(), all_.end(), [](const auto& light) { return light->delta(); });
}

LightSample Lights::sample(const dvec3& p, double choice, const dvec2& u) const {
  size_t i = 0;
  double share = 1;
  if (same_everywhere_) {
    while (i + 1 < share_.size() && choice >= share_[i]) choice -= share_[i++];
    share = share_[i];
  } else {
    double total = 0;
    for (const Light* light : sampled_) total += light->importance(p);
    double left = choice * total, importance = 0;
    for (; i < sampled_.size(); ++i) {
      importance = sampled_[i]->importance(p);
      if (left < importance || i + 1 == sampled_.size()) break;
      left -= importance;
    }
    share = importance / total;
  }
  LightSample s = sampled_[i]->sample(p, u);
  s.pdf *= share;
  s.light = sampled_[i];
  s.index = i;
  return s;
}

LightSample Lights::sample_visible(const dvec3& p, double choice, const dvec2& u) const {
  LightSample s = sample(p, choice, u);
  if (s.pdf > 0 && blocked({p, s.wi}, s.distance, s.light)) s.radiance = dvec3(0);
  return s;
}

std::pair<const FiniteLight*, double> Lights::nearest(const Ray& ray, double t_max, bool seen, double t_min) const {
  const double behind = t_min * (1 + 1e-9);  // of the light that was met at t_min
  std::pair<const FiniteLight*, double> found{nullptr, t_max};
  for (const FiniteLight* light : finite_) {
    if (seen && !light->visible()) continue;
    const double t = light->intersect(ray);
    if (t > behind && t < found.second) found = {light, t};
  }
  return found;
}

bool Lights::blocked(const Ray& shadow, double distance, const Light* from) const {
  for (const FiniteLight* light : finite_) {
    if (light == from || !light->solid()) continue;
    const double t = light->intersect(shadow);
    if (t > 0 && t < distance) return true;
  }
  return false;
}

double Lights::choice_probability(const Light& light, const dvec3& p) const {
  double total = 0, own = 0;
  for (size_t i = 0; i < sampled_.size(); ++i) {
    if (same_everywhere_) {
      if (sampled_[i] == &light) return share_[i];
      continue;
    }
    const double importance = sampled_[i]->importance(p);
    total += importance;
    if (sampled_[i] == &light) own = importance;
  }
  return total > 0 ? own / total : 0.0;
}

bool Lights::any() const {
  return !environment_->black() ||
         std::any_of(all_.begin() + 1, all_.end(), [](const auto& light) { return shines(*light); });
}

std::vector<std::string> Lights::notes() const {
  std::vector<std::string> notes = environment_->notes();
  for (size_t i = 1; i < all_.size(); ++i)
    if (!shines(*all_[i])) notes.push_back(fmt::format("light {} has no power: it lights nothing", i - 1));
  return notes;
}

}  // namespace brume

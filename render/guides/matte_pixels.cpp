#include "render/guides/matte_pixels.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <tuple>

#include "base/golden_ratio.h"
#include "base/parallel_for.h"
#include "render/guides/media_line.h"
#include "render/guides/pixel_rays.h"
#include "render/scene/matte_names.h"

namespace brume {
namespace {

constexpr int kTimes = 9;  // of the shutter, where anything moves
constexpr double kStep = 0.7,
                 kSteps = 1.05;   // of one ray, and of several, whose steps lie between one another [voxels]
constexpr double kOpaque = 1e-6;  // transmittance behind which nothing is looked for
constexpr double kUneven = 0.05, kEdge = 0.3;  // differences of what a medium hides in a pixel
constexpr double kSmall = 4, kLarge = 12;      // pixels: larger ones begin with more rays [voxels]

/// Points on a pixel: (i / count, i * other / count), Fibonacci numbers.
struct Pattern {
  int count, other;
};
constexpr Pattern kOne{1, 1}, kFive{5, 3}, kMore{21, 13}, kMost{89, 55};

/// Media of one name.
struct NamedMedium {
  uint32_t thing;
  bool holdout;
  std::vector<GuideMedia> at;  ///< by time of the shutter
};

class Mattes {
 public:
  Mattes(const Scene& scene, const SceneMedia& media, const PathContext& context, const Camera& camera,
         const Task& task)
      : names_(scene), context_(context) {
    const std::vector<Medium>& all = media.media();
    moving_ = std::any_of(all.begin(), all.end(), [](const Medium& m) { return m.moves(); });
    chromatic_ = std::any_of(all.begin(), all.end(), [](const Medium& m) { return m.chromatic(); });
    for (size_t i = 0; i < scene.surfaces.size(); ++i)
      surfaces_.push_back(thing(names_.surfaces[i], names_.surface_materials[i]));
    for (size_t m = 0; m < all.size(); ++m) add(all[m], media.origins()[m], task);
    // Of media that move a pixel has several rays wherever they are.
    if (media_.empty() || (media_.size() > 1 && !moving_))
      whole_ = std::make_unique<GuideMedia>(all, std::span<const EmissionField>(), 0.5, task);
    rays_.emplace(context, camera, whole_ ? *whole_ : media_[0].at[0], moving_, /*sketch=*/false);
    const bool grids =
        std::none_of(all.begin(), all.end(), [](const Medium& m) { return m.homogeneous().has_value(); });
    if (all.empty()) return;
    const double size = pixel_size(camera, whole_ ? *whole_ : media_[0].at[0]);
    const bool alone = !context.surfaces && grids && rays_->across() == 1;
    first_ = alone ? kOne : size < kSmall ? kFive : size < kLarge ? kMore : kMost;
  }

  MatteRecord record(const ivec2& corner, const ivec2& size, const Task& task) const;

 private:
  class Row;

  /// In the middle of the media [voxels].
  static double pixel_size(const Camera& camera, const GuideMedia& media) {
    const dvec3 middle = 0.5 * (media.lo() + media.hi());
    const dvec2 pixel = 0.5 * dvec2(camera.film_size());
    const Ray a = camera.ray(pixel), b = camera.ray(pixel + dvec2(1, 0));
    const double distance = glm::distance(a.o, middle);
    return glm::distance(a.at(distance), b.at(distance)) / media.voxel();
  }

  uint32_t thing(const std::string& object, const std::string& material) {
    const auto [found, fresh] = numbers_.try_emplace({object, material}, static_cast<uint32_t>(things_.size()));
    if (fresh) things_.push_back({object, material});
    return found->second;
  }

  void add(const Medium& medium, const SceneMedia::Origin& origin, const Task& task) {
    const bool air = origin.volume >= names_.volumes.size();  // which the environment adds to the scene's volumes
    const std::string name = air ? "air" : names_.volumes[origin.volume],
                      material = air ? "air" : names_.volume_materials[origin.volume];
    const auto name_of = [&](size_t list) { return names_.instances[list]; };
    const auto push = [&](const Medium& one, const std::string& called) {
      NamedMedium& to = media_.emplace_back(NamedMedium{thing(called, material), one.holdout(), {}});
      const int times = moving_ ? kTimes : 1;
      for (int i = 0; i < times; ++i)
        to.at.emplace_back(std::span(&one, 1), std::span<const EmissionField>(), (i + 0.5) / times, task);
    };
    if (!medium.instances()) return push(medium, origin.instances.empty() ? name : name_of(origin.instances[0]));
    std::map<std::string, std::vector<Instance>> by_name;
    for (size_t i = 0; i < medium.instances()->size(); ++i)
      by_name[name_of(origin.instances[i])].push_back((*medium.instances())[i]);
    const auto [lo, hi] = medium.support();
    for (auto& [called, some] : by_name) {
      Medium part = medium;
      if (by_name.size() > 1)
        part.set_instances(*instances_.emplace_back(std::make_unique<Instances>(std::move(some), lo, hi)));
      push(part, called);
    }
  }

  const MatteNames names_;
  const PathContext& context_;
  bool moving_ = false, chromatic_ = false;
  std::vector<MatteRecord::Thing> things_;
  std::map<std::pair<std::string, std::string>, uint32_t> numbers_;
  std::vector<uint32_t> surfaces_;  // things
  std::vector<std::unique_ptr<Instances>> instances_;
  std::vector<NamedMedium> media_;
  std::unique_ptr<GuideMedia> whole_;  // where it is not the first one of them
  std::optional<PixelRays> rays_;
  Pattern first_ = kFive;
};

/// The pixels of a row, with the memory that they use.
class Mattes::Row {
 public:
  explicit Row(const Mattes& all) : all_(all), colours_(all.chromatic_ ? 3 : 1), coverage_(all.things_.size()) {
    const size_t times = all.media_.empty() ? 0 : all.media_[0].at.size();
    for (size_t time = 0; time < times; ++time) {
      std::vector<MediaLine>& lines = lines_.emplace_back();
      for (const NamedMedium& m : all.media_)
        for (int c = 0; c < colours_; ++c) lines.emplace_back(m.at[time], colours_ == 3 ? c : kGrey, /*detailed=*/true);
    }
    parts_.resize(all.media_.size());
    hidden_.resize(all.media_.size());
    range_.resize(all.media_.size());
    sigma_.resize(lines_.empty() ? 0 : lines_[0].size());
  }

  void pixel(const ivec2& at, std::vector<MatteRecord::Share>& shares) {
    const bool edge = all_.rays_->shows_edge(at);
    Pattern pattern = edge ? kMost : all_.first_;
    while (trace(at, pattern)) pattern = pattern.count < kMore.count && !sharp() ? kMore : kMost;
    for (size_t i = 0; i < coverage_.size(); ++i)
      if (const auto share = static_cast<float>(coverage_[i] / pattern.count); share > 0)
        shares.push_back({static_cast<uint32_t>(i), share});
  }

 private:
  /// Whether surfaces of a pixel end, or media as surfaces do.
  bool sharp() const { return !alike_ || differs(kEdge); }
  /// Whether what any medium hides differs by more from ray to ray.
  bool differs(double by) const {
    return std::any_of(range_.begin(), range_.end(), [&](const Range& r) { return r.most - r.least > by; });
  }

  /// @return whether more rays would tell more
  bool trace(const ivec2& at, const Pattern& pattern) {
    std::fill(coverage_.begin(), coverage_.end(), 0.0);
    alike_ = true;
    std::fill(range_.begin(), range_.end(), Range());
    for (int i = 0; i < pattern.count; ++i) ray(at, i, pattern);
    if (pattern.count == kMost.count) return false;
    return pattern.count == kMore.count ? sharp() : !alike_ || differs(kUneven);
  }

  void ray(const ivec2& at, int i, const Pattern& pattern) {
    // Of the lens and the shutter a sequence of their own, by the powers of the root of x^4 = x + 1 (Roberts' R3).
    const auto turn = [&](double step) {
      const double v = 0.5 + i * step;
      return v - std::floor(v);
    };
    const dvec2 film(dvec2(i, i * pattern.other % pattern.count) + 0.5);
    CameraSample s;
    s.film = dvec2(at) + film / static_cast<double>(pattern.count);
    if (all_.rays_->blurred()) {
      s.lens = {turn(0.8191725133961645), turn(0.6710436067037893)};
      s.time = turn(0.5497004779019703);
    }
    const Ray ray = all_.rays_->ray(s);
    const std::optional<SurfaceHit> hit = all_.rays_->first_hit(ray);
    double end = hit ? hit->t : kFar;
    const FiniteLight* light = nullptr;  // that ends the ray
    double passed = 0;
    do std::tie(light, passed) = all_.context_.lights->nearest(ray, end, /*seen=*/true, passed);
    while (light && !light->solid());
    if (light) end = passed;
    std::fill(hidden_.begin(), hidden_.end(), 0.0);
    const double left = march(ray, end, s.time, pattern.count == 1 ? kStep : kSteps, turn(kGoldenRatio));
    for (size_t m = 0; m < hidden_.size(); ++m) {
      range_[m].least = std::min(range_[m].least, hidden_[m]);
      range_[m].most = std::max(range_[m].most, hidden_[m]);
      if (!all_.media_[m].holdout) coverage_[all_.media_[m].thing] += hidden_[m];
    }
    int64_t surface = light ? -2 : -1;
    if (hit && !light) {
      surface = hit->surface;
      if (all_.context_.surfaces->settings(hit->surface).role != "holdout")
        coverage_[all_.surfaces_[hit->surface]] += left;
    }
    if (i == 0) surface_ = surface;
    alike_ = alike_ && surface == surface_;
  }

  /// Adds what media hide. @param step  [voxels]   @param late  share of a step by which the first one is shortened
  /// @return what is left of the light from behind
  double march(const Ray& ray, double t_max, double time, double step, double late) {
    if (lines_.empty()) return 1;
    const auto now = std::min(static_cast<size_t>(time * static_cast<double>(lines_.size())), lines_.size() - 1);
    std::vector<MediaLine>& lines = lines_[now];
    bounds_.clear();
    for (size_t m = 0; m < parts_.size(); ++m) {
      all_.media_[m].at[now].intervals(ray, t_max, parts_[m]);
      for (const auto& [from, to] : parts_[m]) bounds_.insert(bounds_.end(), {from, to});
      if (parts_[m].empty()) continue;
      for (int c = 0; c < colours_; ++c) lines[m * colours_ + c].follow(ray);
    }
    std::sort(bounds_.begin(), bounds_.end());
    bounds_.erase(std::unique(bounds_.begin(), bounds_.end()), bounds_.end());
    double left[3] = {1, 1, 1};
    for (size_t b = 0; b + 1 < bounds_.size() && mean(left) > kOpaque; ++b) {
      const double from = bounds_[b], to = bounds_[b + 1], middle = 0.5 * (from + to);
      active_.clear();
      double voxel = std::numeric_limits<double>::infinity();
      for (size_t m = 0; m < parts_.size(); ++m)
        for (const auto& [begin, end] : parts_[m])
          if (begin <= middle && middle <= end) {
            active_.push_back(m);
            const GuideMedia& medium = all_.media_[m].at[now];
            if (!medium.media()[0].homogeneous() || medium.instances())
              voxel = std::min(voxel, medium.grain() * medium.voxel());
            break;
          }
      if (active_.empty()) continue;
      const double length = std::min(step * voxel, to - from), steps = (to - from) / length;
      const double first = steps > 1 ? late : 0;
      for (double k = 0; k - first < steps && mean(left) > kOpaque; ++k) {
        const double begin = std::max(k - first, 0.0), end = std::min(k + 1 - first, steps);
        take(lines, from + 0.5 * (begin + end) * length, (end - begin) * length, left);
      }
    }
    return mean(left);
  }

  void take(std::vector<MediaLine>& lines, double at, double length, double* left) {
    const double share = 1.0 / colours_;
    for (int c = 0; c < colours_; ++c) {
      double sum = 0;
      for (const size_t m : active_) sum += sigma_[m * colours_ + c] = lines[m * colours_ + c].at(at).sigma_t;
      if (!(sum > 0)) continue;
      const double w = -std::expm1(-sum * length) * left[c];
      for (const size_t m : active_) hidden_[m] += share * w * (sigma_[m * colours_ + c] / sum);
      left[c] -= w;
    }
  }

  double mean(const double* left) const { return colours_ == 3 ? (left[0] + left[1] + left[2]) / 3 : left[0]; }

  const Mattes& all_;
  const int colours_;
  std::vector<double> coverage_;                               // by thing, of the pixel's rays together
  std::vector<std::vector<MediaLine>> lines_;                  // by time; of each medium in each colour
  std::vector<std::vector<std::pair<double, double>>> parts_;  // by medium
  std::vector<double> bounds_, sigma_;
  std::vector<size_t> active_;
  std::vector<double> hidden_;  // by medium, of a ray: what it takes of the light from behind
  struct Range {
    double least = 1, most = 0;
  };
  std::vector<Range> range_;  // of that, of the pixel's rays
  // What ends the first of the pixel's rays, and whether all end there.
  int64_t surface_ = -1;
  bool alike_ = true;
};

MatteRecord Mattes::record(const ivec2& corner, const ivec2& size, const Task& task) const {
  MatteRecord record{things_, {}};
  record.pixels.resize(static_cast<size_t>(size.x) * size.y);
  parallel_for(size.y, task, [&](int y) {
    Row row(*this);
    for (int x = 0; x < size.x; ++x)
      row.pixel(corner + ivec2(x, y), record.pixels[static_cast<size_t>(y) * size.x + x]);
  });
  return record;
}

}  // namespace

MatteRecord record_mattes(const Scene& scene, const SceneMedia& media, const PathContext& context, const Camera& camera,
                          const ivec2& corner, const ivec2& size, const Task& task) {
  return Mattes(scene, media, context, camera, task).record(corner, size, task);
}

}  // namespace brume

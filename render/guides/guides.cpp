#include "render/guides/guides.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/parallel_for.h"
#include "render/guides/guide_march.h"

namespace brume {
namespace {

// Times of the shutter that are marched where anything moves; the light is solved for the one in the middle.
constexpr double kSharpPeak = 0.75;  // mean cosine
constexpr int kTimes = 9;
constexpr double kMostDetail = 2, kSketch = 0.5;
constexpr double kMostKept = 150e6;  // bytes of light of all colours
constexpr int kBand = 64;            // rows that are marched before they are stored

}  // namespace

double Guides::detail(int samples) {
  if (samples <= 0) return kSketch;
  double detail = 1;
  for (int more = 8; more <= samples && detail < kMostDetail; more *= 4) detail *= std::cbrt(2.0);
  return std::min(detail, kMostDetail);
}

Guides::Guides(const PathContext& context, int samples, double pixels, const Task& task, double step)
    : context_(context), samples_(samples), pixels_(pixels), step_(step) {
  const Stopwatch watch;
  const auto moves = [](const auto& field) { return field.moves(); };
  const bool moving = std::any_of(context.media.begin(), context.media.end(), moves) ||
                      std::any_of(context.emissions.begin(), context.emissions.end(), moves);
  const int times = moving ? kTimes : 1;
  for (int i = 0; i < times; ++i) media_.emplace_back(context.media, context.emissions, (i + 0.5) / times, quiet(task));
  if (media_[0].empty()) return;
  colours_ = media_[0].coloured() ? std::vector<GuideColour>{0, 1, 2} : std::vector<GuideColour>{kGrey};
  fields_.reserve(colours_.size());
  fields_.push_back(solved(colours_[0], task));
  if (static_cast<double>(fields_[0].bytes()) * static_cast<double>(colours_.size()) <= kMostKept)
    for (size_t i = 1; i < colours_.size(); ++i) fields_.push_back(solved(colours_[i], task));
  seconds_ = watch.seconds();
}

LightFields Guides::solved(GuideColour colour, const Task& task) const {
  return {media_, *context_.lights, context_.surfaces, colour, detail(samples_), pixels_, task};
}

template <class Visit>
void Guides::for_each_march(const Camera& camera, bool sketch, const Task& task, const Visit& visit) const {
  if (media_[0].empty()) return;
  const auto march = [&](const LightFields& fields, GuideColour colour) {
    visit(GuideMarch(context_, media_, fields, colour, camera, step_, sketch, task));
  };
  for (size_t i = 0; i < colours_.size(); ++i)
    if (i < fields_.size())
      march(fields_[i], colours_[i]);
    else
      march(solved(colours_[i], task), colours_[i]);
}

void Guides::record(const Camera& camera, const ivec2& corner, Layers& frame, const Task& task, bool sketch,
                    DeepRecord* deep) const {
  if (deep && media_[0].empty()) record_surfaces(camera, corner, {frame.width(), frame.height()}, *deep, task);
  for_each_march(camera, sketch, task, [&](const GuideMarch& march) { march.record(corner, frame, task, deep); });
}

void Guides::record_watched(const Camera& camera, Layers& frame, const Task& task,
                            const std::function<void(const ivec2& from, const ivec2& to)>& done) const {
  if (media_[0].empty()) return;
  if (fields_.size() < colours_.size()) {  // one colour after the other: a pixel is there with the last one
    size_t colour = 0;
    for_each_march(camera, /*sketch=*/false, task, [&](const GuideMarch& march) {
      const bool last = ++colour == colours_.size();
      GuideMarch::record({&march}, ivec2(0), frame, task, last ? done : GuideMarch::Marched());
    });
    return;
  }
  std::vector<std::unique_ptr<GuideMarch>> all;
  std::vector<const GuideMarch*> colours;
  for (size_t i = 0; i < colours_.size(); ++i) {
    all.push_back(std::make_unique<GuideMarch>(context_, media_, fields_[i], colours_[i], camera, step_,
                                               /*sketch=*/false, task));
    colours.push_back(all.back().get());
  }
  GuideMarch::record(colours, ivec2(0), frame, task, done);
}

void Guides::record_stored(const Camera& camera, const ivec2& corner, Layers& frame, const Task& task,
                           const std::function<bool(const std::string& channel)>& stored, DeepRecord* deep) const {
  if (deep && media_[0].empty()) record_surfaces(camera, corner, {frame.width(), frame.height()}, *deep, task);
  for_each_march(camera, /*sketch=*/false, task, [&](const GuideMarch& march) {
    for (int y0 = 0; y0 < frame.height(); y0 += kBand) {
      Layers band(frame.width(), std::min(kBand, frame.height() - y0));
      march.record(corner + ivec2(0, y0), band, quiet(task), deep);
      for (const auto& [name, plane] : band.channels()) {
        if (stored(name)) {
          frame.store_rows(name, y0, plane, task);
          continue;
        }
        Plane& whole = frame.add(name);
        // Rows of zeros are there already, and take no memory.
        for (int y = 0; y < plane.height(); ++y)
          if (std::any_of(plane.row(y), plane.row(y) + plane.width(), [](float v) { return v != 0; }))
            std::copy_n(plane.row(y), plane.width(), whole.row(y0 + y));
      }
    }
  });
}

void Guides::record_surfaces(const Camera& camera, const ivec2& corner, const ivec2& size, DeepRecord& deep,
                             const Task& task) const {
  const PixelRays rays(context_, camera, media_[0], /*moving=*/false, /*sketch=*/false);
  parallel_for(size.y, task, [&](int y) {
    DeepPixels pixels;
    std::vector<DeepRay> seen;
    for (int x = 0; x < size.x; ++x) {
      const ivec2 at = corner + ivec2(x, y);
      const int across = rays.shows_edge(at) ? PixelRays::kMostAcross : rays.across();
      seen.assign(static_cast<size_t>(across * across), {});
      for (int i = 0; i < across * across; ++i) {
        const CameraSample sample = rays.sample(at, i, across);
        const Ray ray = rays.ray(sample);
        const std::optional<SurfaceHit> hit = rays.first_hit(ray);
        const auto [light, distance] = context_.lights->nearest(ray, hit ? hit->t : kFar, /*seen=*/true);
        DeepRay& to = seen[static_cast<size_t>(i)];
        to.end_z = rays.depth(sample, ray.at(light ? distance : hit ? hit->t : 0));
        if (light) {
          to.end = DeepRay::End::kLight;
          to.light = vec3(light->radiance(ray, distance));
        } else if (!hit) {
          for (const InfiniteLight* sky : context_.lights->infinite())
            if (sky->visible()) to.light += vec3(sky->radiance(ray.d));
        } else if (context_.surfaces->settings(hit->surface).role != "holdout") {
          to.end = DeepRay::End::kSurface;
          to.surface = hit->surface;
        }
      }
      deep.store(at, kGrey, pixels.of_rays(seen, vec3(0), deep.most(kGrey)));
    }
  });
}

size_t Guides::bytes() const {
  size_t sum = 0;
  for (const LightFields& f : fields_) sum += f.bytes();
  return sum;
}

std::string Guides::explain() const {
  if (media_[0].empty()) return "none: nothing scatters or glows";
  const LightFields& f = fields_[0];
  const ivec3 n = f.lattice().n;
  std::string names;
  for (const auto& light : f.lights()) names += (names.empty() ? "" : ", ") + light->layer_name();
  return fmt::format("light of {} on {} x {} x {} nodes, {:.3g} voxels apart{}{}: {:.1f} MB, solved in {:.2f} s",
                     names.empty() ? "nothing" : names, n.x, n.y, n.z, f.lattice().spacing / media_[0].voxel(),
                     f.lattice().planes ? " or farther" : "", colours_.size() > 1 ? ", for red, green and blue" : "",
                     static_cast<double>(bytes()) / 1e6, seconds_);
}

std::vector<std::string> Guides::left_out() const {
  std::vector<std::string> texts;
  if (media_[0].empty()) return {"everything: they are of media"};
  const GuideMedia& media = media_[0];
  const Surfaces* const surfaces = context_.surfaces;
  bool glass = false, metal = false, catcher = false;
  for (uint32_t i = 0; surfaces && i < surfaces->count(); ++i) {
    const SurfaceSettings& s = surfaces->settings(i);
    glass = glass || (s.material == "dielectric" && s.shadow != "straight");
    metal = metal || s.material == "conductor";
    catcher = catcher || s.role == "shadow_catcher";
  }
  for (const auto& light : fields_[0].lights())
    if (light->channel <= 0 && (light->name == "others" || light->name.starts_with("mesh")))
      texts.push_back(fmt::format("the phase function's peak for light of '{}': it is scattered by its mean cosine",
                                  light->layer_name()));
  if (glass)
    texts.push_back("light of suns and lamps through glass, bent or straight (unless its shadow is \"straight\")");
  if (metal) texts.push_back("suns and lamps that metals throw onto other things as sharp caustics");
  if (catcher) texts.push_back("shadow catchers");
  if (surfaces && !media.media().empty())
    texts.push_back("surfaces that stop light which the media have scattered before it is scattered again");
  if (media_.size() > 1)
    texts.push_back("motion in light scattered more often: it is that of the middle of the shutter");
  for (size_t m = 0; m < media.media().size(); ++m)
    if (media.mean_cosine(m) > kSharpPeak) {
      texts.push_back("glory and other spikes of phase functions after more than one scattering");
      break;
    }
  return texts;
}

}  // namespace brume

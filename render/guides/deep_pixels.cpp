#include "render/guides/deep_pixels.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace brume {
namespace {

constexpr float kBoundOfOne = 1.28e-2f;  // over the most parts: of transmittance
constexpr double kSameDepth = 0.02;      // of the distance: hits of one surface in one pixel that are one point
constexpr size_t kKnots = 6;             // for each part that there may be
constexpr float kCells = 40;             // between depths of few digits, for each part that there may be
constexpr float kNothing = 1e-6f;        // transmittance: of a volume less would be a wall in single precision

/// Depths with few digits: some times as many as the pixel may have parts between where its volumes begin and end, and
/// within twice a depth.
class DepthGrid {
 public:
  DepthGrid(std::span<const std::vector<DeepPart>> pixels, size_t most) : fineness_(static_cast<float>(most)) {
    float first = kDeepBackground, last = 0;
    for (const std::vector<DeepPart>& parts : pixels)
      for (const DeepPart& part : parts) {
        if (part.z == part.z_back) continue;
        first = std::min(first, part.z);
        last = std::max(last, part.z_back);
      }
    widest_ = (last - first) / (kCells * fineness_);
  }
  float before(float z) const { return step(z) * std::floor(z / step(z)); }
  float behind(float z) const { return step(z) * std::ceil(z / step(z)); }
  float nearest(float z) const { return step(z) * std::round(z / step(z)); }

 private:
  float step(float z) const {
    const float step = std::min(widest_, std::abs(z) / (2 * kCells * fineness_));
    return std::bit_cast<float>(std::bit_cast<int32_t>(std::max(step, 1e-30f)) & 0x7f800000);
  }

  float fineness_, widest_ = 0;
};

/// Of a part, up to a place inside: transmittance, and the share of its light. @param before  transmittance
struct Inside {
  float left, share;
};
Inside inside(const DeepPart& part, float before, float z) {
  const float f = (z - part.z) / (part.z_back - part.z), taken = before - part.left;
  if (!(taken > 0)) return {before, f};
  if (taken < 0.02f * before) return {before - f * taken, f};
  const float left = before * std::exp2(f * std::log2(std::max(part.left, 1e-12f) / before));
  return {left, std::min((before - left) / taken, 1.0f)};
}

}  // namespace

void DeepSteps::light_up(float end, float w, const vec3& light) {
  for (; unlit < steps.size() && steps[unlit].end <= end; ++unlit)
    if (w > 0) steps[unlit].light += light * (steps[unlit].w / w);
}

/// Hits of one surface at nearly the same depth are one point at their mean, then the nearest of all where they are too
/// many.
void DeepPixels::join_hits(std::span<const DeepRay> rays, size_t most) {
  hits_.clear();
  for (size_t i = 0; i < rays.size(); ++i)
    if (rays[i].end != DeepRay::End::kNothing) hits_.push_back({rays[i].end_z, i, 1});
  std::sort(hits_.begin(), hits_.end(),
            [](const Hit& a, const Hit& b) { return std::pair(a.z, a.ray) < std::pair(b.z, b.ray); });
  const auto alike = [&](const Hit& a, const Hit& b) {
    const DeepRay &one = rays[a.ray], &other = rays[b.ray];
    return one.end == other.end && one.surface == other.surface && b.z - a.z < kSameDepth * std::abs(b.z);
  };
  // Groups of hits that follow one another; `count` is the first one's, 0 of the others.
  size_t groups = hits_.empty() ? 0 : 1, first = 0;
  for (size_t i = 1; i < hits_.size(); ++i) {
    if (alike(hits_[first], hits_[i])) {
      ++hits_[first].count;
      hits_[i].count = 0;
    } else {
      first = i;
      ++groups;
    }
  }
  const auto next_group = [&](size_t i) { return i + hits_[i].count; };
  for (; groups > std::max<size_t>(most, 1); --groups) {
    size_t nearest = 0;
    double gap = 1e300;
    for (size_t i = 0; next_group(i) < hits_.size(); i = next_group(i))
      if (const double own = hits_[next_group(i)].z - hits_[next_group(i) - 1].z; own < gap) gap = own, nearest = i;
    Hit& behind = hits_[next_group(nearest)];
    hits_[nearest].count += behind.count;
    behind.count = 0;
  }
  for (size_t i = 0; i < hits_.size(); i = next_group(i)) {
    double mean = 0;
    for (size_t k = i; k < next_group(i); ++k) mean += hits_[k].z / static_cast<double>(hits_[i].count);
    for (size_t k = i; k < next_group(i); ++k) hits_[k].z = mean;
  }
}

std::vector<DeepPart> DeepPixels::of_rays(std::span<const DeepRay> rays, const vec3& mirrored, size_t most) {
  const bool media = std::any_of(rays.begin(), rays.end(), [](const DeepRay& r) { return !r.media.steps.empty(); });
  join_hits(rays, media ? (most - 1) / 2 : most);
  float mirrors = 0;
  for (const DeepRay& ray : rays) mirrors += ray.mirrors;
  profiles_.resize(rays.size());
  for (size_t i = 0; i < rays.size(); ++i) {
    const DeepRay& ray = rays[i];
    std::vector<DeepPart>& profile = profiles_[i];
    profile.clear();
    const auto hit = std::find_if(hits_.begin(), hits_.end(), [&](const Hit& h) { return h.ray == i; });
    const bool ends = hit != hits_.end();
    const float end = ends ? static_cast<float>(hit->z) : kDeepBackground;
    for (const DeepSteps::Step& s : ray.media.steps) {
      const auto depth = [&](float t) { return std::min(static_cast<float>(ray.z + ray.z_per_step * t), end); };
      profile.push_back({depth(s.begin), depth(s.end), s.left, s.light});
    }
    const vec3 light = ray.light + (ray.mirrors > 0 ? mirrored * (ray.mirrors / mirrors) : vec3(0));
    if (ray.end == DeepRay::End::kSurface)
      profile.push_back({end, end, ray.held, light});
    else if (light != vec3(0))
      profile.push_back({end, end, ray.left, light});
  }
  return mean(profiles_, most);
}

/// Of the ends of all parts, as many as one pixel has, and not many more than will be needed; both sides of each point.
/// Ends of volumes are rounded to few digits, which pack well.
void DeepPixels::make_knots(std::span<const std::vector<DeepPart>> pixels, size_t most) {
  places_.clear();
  size_t all = 0;
  for (const std::vector<DeepPart>& parts : pixels) all += parts.size();
  const size_t every = std::max(pixels.size(), all / (kKnots * most));
  const DepthGrid grid(pixels, most);
  for (size_t pixel = 0; pixel < pixels.size(); ++pixel) {
    const std::vector<DeepPart>& parts = pixels[pixel];
    for (size_t i = 0; i < parts.size(); ++i) {
      const DeepPart& p = parts[i];
      if (p.z == p.z_back) {
        places_.emplace_back(p.z, false);
        places_.emplace_back(p.z, true);
        continue;
      }
      const bool follows = i > 0 && parts[i - 1].z_back == p.z,
                 precedes = i + 1 < parts.size() && parts[i + 1].z == p.z_back;
      if (!follows) places_.emplace_back(grid.before(p.z), false);
      if (!precedes)
        places_.emplace_back(grid.behind(p.z_back), false);
      else if ((i + pixel * every / pixels.size()) % every == 0)
        places_.emplace_back(grid.nearest(p.z_back), false);
    }
  }
  std::sort(places_.begin(), places_.end());
  places_.erase(std::unique(places_.begin(), places_.end()), places_.end());
}

void DeepPixels::add_up(std::span<const std::vector<DeepPart>> pixels) {
  knots_.clear();
  for (const auto& [z, behind] : places_) knots_.push_back({z, behind, 0, vec3(0)});
  const float share = 1.0f / static_cast<float>(pixels.size());
  for (const std::vector<DeepPart>& parts : pixels) {
    size_t i = 0;
    float left = 1;
    vec3 light(0);
    for (DeepKnot& k : knots_) {
      for (; i < parts.size() && (parts[i].z_back < k.z || (parts[i].z_back == k.z && (k.behind || parts[i].z < k.z)));
           ++i) {
        left = parts[i].left;
        light += parts[i].light;
      }
      Inside in{left, 0};
      if (i < parts.size() && parts[i].z < k.z) in = inside(parts[i], left, k.z);
      k.left += share * in.left;
      k.light += share * (in.share > 0 ? light + in.share * parts[i].light : light);
    }
  }
}

std::vector<DeepPart> DeepPixels::mean(std::span<const std::vector<DeepPart>> pixels, size_t most) {
  make_knots(pixels, most);
  if (places_.empty()) return {};
  add_up(pixels);
  const float bound = kBoundOfOne / static_cast<float>(most);
  if (knots_.back().z == kDeepBackground) ++most;
  fit_.begin(knots_);
  std::vector<DeepPart> result;
  for (const DeepFit::Piece& p : fit_.pieces(bound, most)) {
    const DeepKnot &a = knots_[p.from], &b = knots_[p.to];
    if (result.size() >= most) {  // more points than parts
      const DeepPart& last = result.back();
      result.back() = {last.z, b.z, last.z < b.z ? std::max(p.left, kNothing) : p.left, last.light + b.light - a.light};
      continue;
    }
    result.push_back({a.z, b.z, a.z < b.z ? std::max(p.left, kNothing) : p.left, b.light - a.light});
  }
  return result;
}

DeepRecord::DeepRecord(const ivec2& corner, const ivec2& size, size_t most)
    : corner_(corner), size_(size), most_(most) {
  pixels_[0].resize(static_cast<size_t>(size.x) * size.y);
}

void DeepRecord::prepare(int colour) {
  if (colour > 0) pixels_[static_cast<size_t>(colour)].resize(pixels_[0].size());
}

void DeepRecord::store(const ivec2& pixel, int colour, std::vector<DeepPart> parts) {
  if (colour >= 0)
    for (DeepPart& part : parts)
      for (int c = 0; c < 3; ++c) part.light[c] = c == colour ? 3 * part.light[c] : 0;
  pixels_[static_cast<size_t>(std::max(colour, 0))][index(pixel - corner_)] = std::move(parts);
}

std::vector<DeepPart> DeepRecord::parts(const ivec2& pixel) const {
  const size_t i = index(pixel);
  if (pixels_[1].empty()) return pixels_[0][i];
  return DeepPixels().mean(std::vector<std::vector<DeepPart>>{pixels_[0][i], pixels_[1][i], pixels_[2][i]}, most_);
}

}  // namespace brume

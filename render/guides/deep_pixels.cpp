#include "render/guides/deep_pixels.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

namespace brume {
namespace {

constexpr float kBoundOfOne = 6.4e-3f;  // over the most parts: of transmittance, and of light as a share of the pixel's
constexpr double kSameDepth = 0.02;     // of the distance: hits of one surface in one pixel that are one point
constexpr size_t kKnots = 6;            // for each part that there may be
constexpr int kSweeps = 2;              // over the knots of a pixel with as many parts as it may have
constexpr float kNothing = 1e-6f;       // transmittance: of a volume less would be a wall in single precision
constexpr float kMostShift = 0.1f;      // of a knot's transmittance

float sum(const vec3& v) {
  return v.x + v.y + v.z;
}

/// e^x for -86 < x <= 0, relative error below 1e-5; in a form that compilers turn into vectors.
inline float fast_exp(float x) {
  const float t = x * std::numbers::log2e_v<float>;
  const int32_t whole = static_cast<int32_t>(t) - 1;
  const float f = t - static_cast<float>(whole);  // 0 .. 1
  const float power =
      1 + f * (0.69315308f + f * (0.24015361f + f * (0.05582631f + f * 0.00898934f + f * f * 0.00187758f)));
  return std::bit_cast<float>((whole + 127) << 23) * power;
}

// Of numbers that are not negative the order is that of their bits: compilers make vectors of that.
inline float larger(float a, float b) {
  return std::bit_cast<float>(std::max(std::bit_cast<int32_t>(a), std::bit_cast<int32_t>(b)));
}
float largest(const float* values, size_t count) {
  int32_t most = 0;
  for (size_t i = 0; i < count; ++i) most = std::max(most, std::bit_cast<int32_t>(values[i]));
  return std::bit_cast<float>(most);
}

/// Of a part, up to a place inside: transmittance, and the share of its light. @param before  transmittance
struct Inside {
  float left, share;
};
Inside inside(const DeepPart& part, float before, float z) {
  const float f = (z - part.z) / (part.z_back - part.z), taken = before - part.left;
  if (!(taken > 0)) return {before, f};
  if (taken < 0.02f * before) return {before - f * taken, f};
  const float left = before * std::pow(std::max(part.left, 1e-12f) / before, f);
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
void DeepPixels::make_knots(std::span<const std::vector<DeepPart>> pixels, size_t most) {
  places_.clear();
  size_t all = 0;
  for (const std::vector<DeepPart>& parts : pixels) all += parts.size();
  const size_t every = std::max(pixels.size(), all / (kKnots * most));
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
      if (!follows) places_.emplace_back(p.z, false);
      if (!precedes || (i + pixel * every / pixels.size()) % every == 0) places_.emplace_back(p.z_back, false);
    }
  }
  std::sort(places_.begin(), places_.end());
  places_.erase(std::unique(places_.begin(), places_.end()), places_.end());
}

void DeepPixels::add_up(std::span<const std::vector<DeepPart>> pixels) {
  knots_.clear();
  for (const auto& [z, behind] : places_) knots_.push_back({z, 0, 0, vec3(0), 0});
  const float share = 1.0f / static_cast<float>(pixels.size());
  for (const std::vector<DeepPart>& parts : pixels) {
    size_t i = 0;
    float left = 1;
    vec3 light(0);
    for (size_t k = 0; k < knots_.size(); ++k) {
      const auto [z, behind] = places_[k];
      for (; i < parts.size() && (parts[i].z_back < z || (parts[i].z_back == z && (behind || parts[i].z < z))); ++i) {
        left = parts[i].left;
        light += parts[i].light;
      }
      Inside in{left, 0};
      if (i < parts.size() && parts[i].z < z) in = inside(parts[i], left, z);
      knots_[k].left += share * in.left;
      knots_[k].light += share * (in.share > 0 ? light + in.share * parts[i].light : light);
    }
  }
  const float all = std::max(sum(knots_.back().light), 1e-30f);
  for (std::vector<float>* column : {&z_, &left_, &light_sums_, &above_, &errors_}) column->resize(knots_.size());
  for (size_t i = 0; i < knots_.size(); ++i) {
    Knot& k = knots_[i];
    k.log_left = std::log(std::max(k.left, kNothing));
    z_[i] = k.z;
    left_[i] = k.left;
    light_sums_[i] = k.light_sum = sum(k.light) / all;
  }
}

/// Fills above_ and errors_ for the knots inside. @return  how many
size_t DeepPixels::compare(size_t from, size_t to) {
  const Knot a = knots_[from], b = knots_[to];
  if (to - from < 2 || !(b.z > a.z)) return 0;
  const float per_z = 1 / (b.z - a.z), depth = b.log_left - a.log_left, taken = a.left - b.left;
  // Without a branch, so that compilers make vectors of what follows.
  const float takes = static_cast<float>(taken > kNothing), even = 1 - takes;
  const float per_taken = takes / std::max(taken, kNothing), light = b.light_sum - a.light_sum;
  const float *const z = &z_[from + 1], *const left = &left_[from + 1], *const sums = &light_sums_[from + 1];
  float *const above = above_.data(), *const errors = errors_.data();
  const size_t between = to - from - 1;
  for (size_t m = 0; m < between; ++m) {
    const float f = (z[m] - a.z) * per_z, exponential = a.left * fast_exp(f * depth);
    const float share = (a.left - exponential) * per_taken + even * f;
    above[m] = exponential - left[m];
    errors[m] = larger(std::abs(above[m]), std::abs(a.light_sum + share * light - sums[m]));
  }
  return between;
}

DeepPixels::Piece DeepPixels::piece(size_t from, size_t to) {
  const size_t between = compare(from, to);
  return {from, to, largest(errors_.data(), between)};
}

/// The same, and the knot where it is farthest from what lies between its ends.
DeepPixels::Piece DeepPixels::cuttable_piece(size_t from, size_t to) {
  Piece p = piece(from, to);
  const auto inside = errors_.begin() + static_cast<std::ptrdiff_t>(to - from - 1);
  p.worst = from + 1 + static_cast<size_t>(std::find(errors_.begin(), inside, p.error) - errors_.begin());
  return p;
}

/// By how much the piece's transmittance is too large where that is farthest off.
float DeepPixels::above_of(const Piece& p) {
  const size_t between = compare(p.from, p.to);
  float most = 0;
  for (size_t m = 0; m < between; ++m)
    if (std::abs(above_[m]) > std::abs(most)) most = above_[m];
  return most;
}

bool DeepPixels::is_empty(const Piece& p) const {
  const Knot &a = knots_[p.from], &b = knots_[p.to];
  return a.left - b.left < kNothing && std::abs(b.light_sum - a.light_sum) < kNothing;
}

/// Moves the knots between neighbouring pieces, one of them above the bound, towards those with the larger error, by
/// half of them, then by less.
void DeepPixels::even_out() {
  const float bound = kBoundOfOne / static_cast<float>(pieces_.size());
  for (int sweep = 0; sweep < kSweeps; ++sweep)
    for (size_t i = 0; i + 1 < pieces_.size(); ++i) {
      Piece &a = pieces_[i], &b = pieces_[i + 1];
      if (a.to != b.from || std::max(a.error, b.error) <= bound) continue;
      for (size_t part = 2; part <= 8; part *= 2) {
        const bool first = a.error > b.error;
        const size_t step = (first ? a.to - a.from : b.to - b.from) / part, knot = first ? a.to - step : a.to + step;
        if (step == 0) break;
        const float most = std::max(a.error, b.error);
        const Piece front = piece(a.from, knot);
        if (front.error >= most) continue;
        const Piece back = piece(knot, b.to);
        if (back.error >= most) continue;
        a = front;
        b = back;
        break;
      }
    }
}

/// Between pieces that are both too large, or too small, in their middles their common knot takes half of it.
void DeepPixels::share_errors() {
  // Of all pieces before the first knot moves.
  above_of_pieces_.clear();
  for (const Piece& p : pieces_) above_of_pieces_.push_back(above_of(p));
  for (size_t i = 0; i + 1 < pieces_.size(); ++i) {
    const Piece &a = pieces_[i], &b = pieces_[i + 1];
    const float above = above_of_pieces_[i], behind = above_of_pieces_[i + 1];
    if (a.to != b.from || above * behind <= 0) continue;
    float& left = knots_[a.to].left;
    const float shift = std::clamp(0.25f * (above + behind), -kMostShift * left, kMostShift * left);
    left = std::clamp(left - shift, knots_[b.to].left, knots_[a.from].left);
  }
}

std::vector<DeepPart> DeepPixels::mean(std::span<const std::vector<DeepPart>> pixels, size_t most) {
  make_knots(pixels, most);
  if (places_.empty()) return {};
  add_up(pixels);
  pieces_.clear();
  size_t parts = 0;
  const auto add = [&](size_t from, size_t to) {
    const Piece p = cuttable_piece(from, to);
    if (is_empty(p)) return;
    ++parts;
    pieces_.push_back(p);
  };
  // From point to point.
  size_t from = 0;
  for (size_t k = 1; k < knots_.size(); ++k) {
    if (!places_[k].second) continue;
    if (k - 1 > from) add(from, k - 1);
    add(k - 1, k);
    from = k;
  }
  if (from + 1 < knots_.size()) add(from, knots_.size() - 1);
  if (knots_.back().z == kDeepBackground) ++most;
  const float bound = kBoundOfOne / static_cast<float>(most);
  while (parts < most) {
    const auto worst = std::max_element(pieces_.begin(), pieces_.end(),
                                        [](const Piece& a, const Piece& b) { return a.error < b.error; });
    if (worst == pieces_.end() || worst->error <= bound) break;
    const Piece cut = *worst;
    pieces_.erase(worst);
    --parts;
    add(cut.from, cut.worst);
    add(cut.worst, cut.to);
  }
  std::sort(pieces_.begin(), pieces_.end(), [](const Piece& a, const Piece& b) { return a.from < b.from; });
  if (parts >= most) {
    even_out();
    share_errors();
  }
  std::vector<DeepPart> result;
  result.reserve(pieces_.size());
  for (const Piece& p : pieces_) {
    const Knot &a = knots_[p.from], &b = knots_[p.to];
    if (result.size() >= most) {  // more points than parts
      result.back() = {result.back().z, b.z, b.left, result.back().light + b.light - a.light};
      continue;
    }
    result.push_back({a.z, b.z, a.z < b.z ? std::max(b.left, kNothing) : b.left, b.light - a.light});
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

#include "render/guides/deep_fit.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

namespace brume {
namespace {

constexpr float kNothing = 1e-6f;       // transmittance: of a volume less would be a wall in single precision
constexpr float kStraight = 0.05f;      // optical depth below which an exponential is a parabola
constexpr float kThickest = 7;          // optical depth of a volume, whose alpha a half can tell from a wall's
constexpr float kWorthOfDigits = 1.2f;  // ratio of lengths
constexpr int kMostTries = 2;           // of bounds, where the pieces are too many

/// ln x for 1e-30 < x, error below 1e-6; in a form that compilers turn into vectors.
inline float fast_log(float x) {
  const int32_t bits = std::bit_cast<int32_t>(x) - 0x3f3504f3;  // of the root of 1/2
  const int32_t exponent = bits >> 23;
  const float m = std::bit_cast<float>((bits & 0x7fffff) + 0x3f3504f3), u = (m - 1) / (m + 1), u2 = u * u;
  return static_cast<float>(exponent) * std::numbers::ln2_v<float> +
         u * (2 + u2 * (0.66666669f + u2 * (0.3999947f + u2 * (0.2863f + u2 * 0.2345f))));
}

/// Of a mantissa.
int digits(float z) {
  return 32 - std::countr_zero(std::bit_cast<uint32_t>(z));
}

float sum(const vec3& v) {
  return v.x + v.y + v.z;
}

}  // namespace

void DeepFit::begin(std::span<const DeepKnot> knots) {
  knots_ = knots;
  const size_t count = knots.size();
  for (std::vector<float>* column : {&log_left_, &light_, &low_, &high_}) column->resize(count);
  const float all = std::max(sum(knots.back().light), 1e-30f);
  for (size_t i = 0; i < count; ++i) {
    log_left_[i] = fast_log(std::max(knots[i].left, kNothing));
    light_[i] = sum(knots[i].light) / all;
  }
}

bool DeepFit::empty_between(size_t from, size_t to) const {
  return knots_[from].left - knots_[to].left < kNothing && std::abs(light_[to] - light_[from]) < kNothing;
}

/// Sets slope_, too. @param log_left  at the begin
size_t DeepFit::end_of_volume(size_t from, float log_left, float bound) {
  const float z = knots_[from].z, light = light_[from], per_left = std::exp(-log_left), light_bound = kLight * bound;
  float least = -1e30f, most = 0, least_light = -1e30f, most_light = 1e30f;
  size_t end = from;
  for (size_t i = from + 1; i < knots_.size() && !knots_[i].behind; ++i) {
    const float length = knots_[i].z - z, per_length = 1 / length;
    // Where nothing is for longer than the volume is the next one begins behind that.
    if (end > from && length > 2 * (knots_[i - 1].z - z) && empty_between(i - 1, i)) break;
    if (end > from && log_left - log_left_[i] > kThickest) break;
    least = std::max(least, (low_[i] - log_left) * per_length);
    most = std::min(most, (high_[i] - log_left) * per_length);
    if (least > most && end > from) break;
    // What an exponential of that depth takes up to here, over its slope.
    const float depth = std::max(log_left - log_left_[i], 0.0f);
    const float taken =
        length * (depth > kStraight ? std::max(1 - knots_[i].left * per_left, 0.0f) / depth : 1 - 0.5f * depth);
    // Light at the end is the knot's.
    const float gained = light_[i] - light, per_taken = 1 / taken, slope = gained * per_taken;
    const bool fits = (slope >= least_light && slope <= most_light) || end == from;
    // Depths of few digits are worth a little length.
    if (fits && (end == from || digits(knots_[i].z) <= digits(knots_[end].z) ||
                 length > kWorthOfDigits * (knots_[end].z - z))) {
      end = i;
      slope_ = std::clamp((log_left_[i] - log_left) * per_length, std::min(least, most), most);
    }
    least_light = std::max(least_light, (gained - light_bound) * per_taken);
    most_light = std::min(most_light, (gained + light_bound) * per_taken);
    if (least_light > most_light) break;
  }
  return end;
}

std::span<const DeepFit::Piece> DeepFit::pieces(float bound) {
  const float last = knots_.back().left;
  for (size_t i = 0; i < knots_.size(); ++i) {
    low_[i] = fast_log(std::max(std::max(knots_[i].left - bound, last), kNothing));
    high_[i] = fast_log(std::max(knots_[i].left + bound, kNothing));
  }
  // What is behind the last of the medium changes nothing more.
  for (size_t i = knots_.size(); i-- > 0 && knots_[i].left - last < kNothing;) low_[i] = high_[i] = log_left_.back();
  pieces_.clear();
  float log_left = 0;
  for (size_t from = 0; from + 1 < knots_.size();) {
    if (knots_[from + 1].behind) {
      log_left = std::min(log_left, log_left_[from + 1]);
      // Not the logarithm's, which has no 0.
      if (!empty_between(from, from + 1)) pieces_.push_back({from, from + 1, knots_[from + 1].left});
      ++from;
    } else if (empty_between(from, from + 1)) {
      ++from;
    } else {
      const size_t to = end_of_volume(from, log_left, bound);
      log_left = std::max(log_left + slope_ * (knots_[to].z - knots_[from].z), std::log(kNothing));
      pieces_.push_back({from, to, std::exp(log_left)});
      from = to;
    }
  }
  return pieces_;
}

std::span<const DeepFit::Piece> DeepFit::pieces(float bound, size_t most) {
  if (pieces(bound).size() <= most) return pieces_;
  // What is sought lies between two bounds, whose numbers of pieces are known; powers of bounds lie on lines.
  float low = bound, high = 0;
  auto of_low = static_cast<float>(pieces_.size()), of_high = 0.0f;
  const auto wanted = static_cast<float>(most);
  best_.clear();
  for (int tries = 0; tries < kMostTries || best_.empty(); ++tries) {
    if (high > 0)
      bound =
          low * std::pow(high / low, std::clamp(std::log(of_low / wanted) / std::log(of_low / of_high), 0.1f, 0.9f));
    else
      bound = low * std::max(std::pow(of_low / wanted, 1.5f), 1.3f);
    const auto found = static_cast<float>(pieces(bound).size());
    if (found > wanted) {
      low = bound;
      of_low = found;
      if (bound > 1) return pieces_;
    } else {
      high = bound;
      of_high = found;
      best_ = pieces_;
      if (found == wanted) break;
    }
  }
  return best_;
}

}  // namespace brume

#include "image/deep_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "base/error.h"
#include "base/parallel_for.h"

namespace brume {
namespace {

/// -log(1 - alpha).
double optical_depth(double alpha) {
  return -std::log1p(-std::min(alpha, 1.0));
}

/// The part from..to, as shares of its length, of a volume sample, as a sample of its own.
void cut(const float* sample, size_t stride, float from, float to, float* part) {
  const double z = sample[DeepPixel::kZ], length = sample[DeepPixel::kZBack] - z, alpha = sample[DeepPixel::kAlpha];
  const DeepShare share = front_share(alpha, (static_cast<double>(to) - from) / length);
  part[DeepPixel::kZ] = from;
  part[DeepPixel::kZBack] = to;
  part[DeepPixel::kAlpha] = static_cast<float>(share.alpha * alpha);
  for (size_t c = DeepPixel::kAlpha + 1; c < stride; ++c) part[c] = static_cast<float>(share.colour * sample[c]);
}

/// Joins two samples that lie at the same place: as if they were mixed finely.
void join(const float* other, size_t stride, float* sample) {
  const double a1 = sample[DeepPixel::kAlpha], a2 = other[DeepPixel::kAlpha];
  const double alpha = a1 + a2 - a1 * a2;
  double f1 = 1, f2 = 1;
  if (a1 >= 1 && a2 >= 1) {
    f1 = f2 = 0.5;
  } else if (a1 >= 1) {
    f2 = 0;
  } else if (a2 >= 1) {
    f1 = 0;
  } else {
    // Each is seen as long as light from it is not taken by both: the ratios of what is taken to optical depth.
    const double u1 = optical_depth(a1), u2 = optical_depth(a2), u = u1 + u2;
    const double w = u > 0 ? alpha / u : 1;
    f1 = a1 > 0 ? w * u1 / a1 : w;
    f2 = a2 > 0 ? w * u2 / a2 : w;
  }
  for (size_t c = DeepPixel::kAlpha + 1; c < stride; ++c)
    sample[c] = static_cast<float>(f1 * sample[c] + f2 * other[c]);
  sample[DeepPixel::kAlpha] = static_cast<float>(alpha);
}

bool before(const float* a, const float* b) {
  return std::pair(a[DeepPixel::kZ], a[DeepPixel::kZBack]) < std::pair(b[DeepPixel::kZ], b[DeepPixel::kZBack]);
}

bool is_tidy(const DeepPixel& pixel) {
  for (size_t i = 0; i + 1 < pixel.size(); ++i) {
    const float *a = pixel.at(i), *b = pixel.at(i + 1);
    const bool apart = a[DeepPixel::kZBack] <= b[DeepPixel::kZ];
    const bool same = a[DeepPixel::kZ] == b[DeepPixel::kZ] && a[DeepPixel::kZBack] == b[DeepPixel::kZBack];
    if (!apart || same) return false;
  }
  return true;
}

constexpr const char* kOwnAlphas[] = {"AR", "AG", "AB"};

/// The channel with the alpha that a channel is composited by.
std::string alpha_of(const DeepPicture& picture, const std::string& channel) {
  const size_t dot = channel.rfind('.');
  const std::string layer = dot == std::string::npos ? "" : channel.substr(0, dot + 1),
                    own = channel.substr(layer.size());
  const size_t colour = own.size() == 1 ? std::string("RGB").find(own) : std::string::npos;
  for (const std::string& in : {layer, std::string()}) {
    if (colour != std::string::npos && picture.find(in + kOwnAlphas[colour])) return in + kOwnAlphas[colour];
    if (own.starts_with('A') && picture.find(channel)) return channel;
    if (picture.find(in + "A")) return in + "A";
  }
  return {};
}

}  // namespace

DeepPicture::DeepPicture(const PixelWindow& data_window, const PixelWindow& display_window,
                         std::span<const uint32_t> counts)
    : data(data_window), display(display_window), begin(counts.size() + 1, 0) {
  std::partial_sum(counts.begin(), counts.end(), begin.begin() + 1,
                   [](size_t sum, uint32_t count) { return sum + count; });
}

size_t DeepPicture::most_samples() const {
  size_t most = 0;
  for (size_t i = 0; i + 1 < begin.size(); ++i) most = std::max(most, begin[i + 1] - begin[i]);
  return most;
}

DeepPicture::Channel& DeepPicture::add(const std::string& name, Channel::Type type) {
  Channel& channel = channels[name];
  channel.type = type;
  channel.values.resize(samples());
  return channel;
}

const DeepPicture::Channel* DeepPicture::find(const std::string& name) const {
  const auto found = channels.find(name);
  return found == channels.end() ? nullptr : &found->second;
}

DeepShare front_share(double alpha, double share) {
  share = std::clamp(share, 0.0, 1.0);
  if (alpha >= 1) return {1, share > 0 ? 1.0 : 0.0};
  if (!(alpha > 0)) return {share, share};
  const double part = -std::expm1(share * std::log1p(-alpha)) / alpha;
  return {part, part};
}

void make_tidy(DeepPixel& pixel) {
  const size_t stride = pixel.stride;
  const auto sort = [&](const std::vector<float>& values) {
    std::vector<size_t> order(values.size() / stride);
    std::iota(order.begin(), order.end(), size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
      return before(values.data() + a * stride, values.data() + b * stride);
    });
    std::vector<float> sorted;
    sorted.reserve(values.size());
    for (const size_t i : order)
      sorted.insert(sorted.end(), values.begin() + static_cast<std::ptrdiff_t>(i * stride),
                    values.begin() + static_cast<std::ptrdiff_t>((i + 1) * stride));
    return sorted;
  };
  for (size_t i = 0; i < pixel.size(); ++i) {
    float* const s = pixel.at(i);
    s[DeepPixel::kZBack] = std::max(s[DeepPixel::kZ], s[DeepPixel::kZBack]);
  }
  if (is_tidy(pixel)) return;
  // Volumes are cut at the ends and points of all samples.
  std::vector<float> ends;
  for (size_t i = 0; i < pixel.size(); ++i)
    ends.insert(ends.end(), {pixel.at(i)[DeepPixel::kZ], pixel.at(i)[DeepPixel::kZBack]});
  std::sort(ends.begin(), ends.end());
  ends.erase(std::unique(ends.begin(), ends.end()), ends.end());
  std::vector<float> parts;
  for (size_t i = 0; i < pixel.size(); ++i) {
    const float* const s = pixel.at(i);
    const float z = s[DeepPixel::kZ], z_back = s[DeepPixel::kZBack];
    if (z == z_back) {
      parts.insert(parts.end(), s, s + stride);
      continue;
    }
    float from = z;
    for (auto end = std::upper_bound(ends.begin(), ends.end(), z); end != ends.end() && *end <= z_back; ++end) {
      parts.resize(parts.size() + stride);
      cut(s, stride, from, *end, parts.data() + parts.size() - stride);
      from = *end;
    }
  }
  parts = sort(parts);
  pixel.values.clear();
  for (size_t i = 0; i < parts.size() / stride; ++i) {
    const float* const s = parts.data() + i * stride;
    float* const last = pixel.values.empty() ? nullptr : pixel.at(pixel.size() - 1);
    if (last && last[DeepPixel::kZ] == s[DeepPixel::kZ] && last[DeepPixel::kZBack] == s[DeepPixel::kZBack])
      join(s, stride, last);
    else
      pixel.values.insert(pixel.values.end(), s, s + stride);
  }
}

std::vector<double> composited(const DeepPixel& pixel, float before) {
  std::vector<double> sums(pixel.stride - DeepPixel::kAlpha, 0.0);
  double transmittance = 1;
  for (size_t i = 0; i < pixel.size(); ++i) {
    const float* const s = pixel.at(i);
    const double z = s[DeepPixel::kZ], z_back = s[DeepPixel::kZBack], alpha = s[DeepPixel::kAlpha];
    if (!(z < before)) break;
    const DeepShare share = z_back <= before ? DeepShare{1, 1} : front_share(alpha, (before - z) / (z_back - z));
    for (size_t c = 1; c < sums.size(); ++c) sums[c] += transmittance * share.colour * s[DeepPixel::kAlpha + c];
    transmittance *= 1 - share.alpha * alpha;
  }
  sums[0] = 1 - transmittance;
  return sums;
}

void recolour(DeepPicture& picture, const Layers& from, const Layers& to) {
  for (const char* const name : {"R", "G", "B"}) {
    float* const values = picture.channels.at(name).values.data();
    const std::string alpha_name = alpha_of(picture, name);
    const float* const alpha = picture.channels.at(alpha_name).values.data();
    const Plane &old_flat = from.at(name), &new_flat = to.at(name), &cover = from.at(alpha_name);
    for (int y = 0; y < from.height(); ++y)
      for (int x = 0; x < from.width(); ++x) {
        const auto [first, end] = picture.range(static_cast<size_t>(y) * from.width() + x);
        const float before = old_flat(x, y), after = new_flat(x, y), factor = after / before;
        if (before > 0 && std::isfinite(factor))
          for (size_t i = first; i < end; ++i) values[i] *= factor;
        else if (cover(x, y) > 0)
          for (size_t i = first; i < end; ++i) values[i] = alpha[i] * after / cover(x, y);
      }
  }
}

Layers flattened(const DeepPicture& picture, float before) {
  const DeepPicture::Channel* const z = picture.find("Z");
  if (!z) throw InputError("deep pixels without a channel Z; expected the depth of each sample");
  const DeepPicture::Channel* const z_back = picture.find("ZBack");
  Layers flat(picture.width(), picture.height());
  flat.header = picture.header;
  flat.origin = picture.data.lo;
  flat.display_origin = picture.display.lo;
  flat.display = picture.display.hi - picture.display.lo;
  // Channels by the alpha that they are composited by.
  std::map<std::string, std::vector<std::string>> groups;
  for (const auto& [name, channel] : picture.channels) {
    if (name == "Z" || name == "ZBack" || channel.type == DeepPicture::Channel::Type::kUint) continue;
    const std::string alpha = alpha_of(picture, name);
    if (alpha.empty())
      throw InputError(fmt::format("deep pixels whose channel {} has no alpha; expected A, or AR, AG and AB", name));
    std::vector<std::string>& group = groups[alpha];
    if (alpha != name) group.push_back(name);
  }
  for (const auto& [alpha, names] : groups) {
    std::vector<const float*> from = {z->values.data(), (z_back ? z_back : z)->values.data(),
                                      picture.find(alpha)->values.data()};
    std::vector<Plane*> to = {&flat.add(alpha)};
    for (const std::string& name : names) {
      from.push_back(picture.find(name)->values.data());
      to.push_back(&flat.add(name));
    }
    parallel_for(flat.height(), {}, [&](int y) {
      DeepPixel pixel{from.size(), {}};
      for (int x = 0; x < flat.width(); ++x) {
        const auto [first, end] = picture.range(static_cast<size_t>(y) * flat.width() + x);
        pixel.values.clear();
        for (size_t i = first; i < end; ++i)
          for (const float* const channel : from) pixel.values.push_back(channel[i]);
        make_tidy(pixel);
        const std::vector<double> sums = composited(pixel, before);
        for (size_t c = 0; c < to.size(); ++c) (*to[c])(x, y) = static_cast<float>(sums[c]);
      }
    });
  }
  if (!flat.find("A") && flat.find("AR") && flat.find("AG") && flat.find("AB")) {
    Plane& mean = flat.add("A");
    for (int y = 0; y < flat.height(); ++y)
      for (int x = 0; x < flat.width(); ++x)
        mean(x, y) = (flat.at("AR")(x, y) + flat.at("AG")(x, y) + flat.at("AB")(x, y)) / 3;
  }
  return flat;
}

Layers flattened(const DeepPicture& picture) {
  return flattened(picture, std::numeric_limits<float>::infinity());
}

}  // namespace brume

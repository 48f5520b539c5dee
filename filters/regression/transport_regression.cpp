#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <optional>

#include "base/error.h"
#include "base/text.h"
#include "base/vec.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/regression/lattice_regression.h"
#include "filters/regression/local_lines.h"
#include "filters/regression/mixing.h"
#include "filters/regression/regression.h"
#include "filters/regression/stacking.h"
#include "filters/regression/transport_columns.h"

namespace brume {
namespace {

struct TransportRegression {
  float window = 16;
  float ridge = 2e-3f, ridge_per_pixel = 1;
  float stacking_window = 28, caution = 5000;
  float limit = 8;
  float weight_power = 1.2f;
  float frames = 2;
};

// Windows of local means of noise, error and bias, of what returns the light taken from outliers, and of what single
// pixels miss [px].
constexpr double kNoiseWindow = 10, kErrorWindow = 6, kBiasWindow = 24, kReturnWindow = 32, kMissedWindow = 1;
constexpr double kGlobalRidge = 1e-4;
// Ridges per pixel of the fits to the whole frame, one after another: what few samples can tell of many columns first.
constexpr double kRidgesOfFrame[] = {1e4, 100, 1};
// Standard errors that must be proven before a result is moved, by what pixels show; Gaussian windows of local means of
// what a result misses [px], and of the brightness that errors are relative to.
constexpr double kSureOfMedia = 3, kSureOfSurfaces = 2;
constexpr double kLocalMeans[] = {1, 2, 4}, kLightWindow = 1.5;
// An outlier is this many times what the other half shows, and more.
constexpr float kAgreement = 3;
// What both halves show is a point, a lamp or a star, where within this radius [px] no more pixels than these have a
// quarter of it.
constexpr int kPointRadius = 3, kPointPixels = 4;
constexpr float kPointShare = 0.25f;
constexpr int kLevelRadius = 1;
// From neighbours that are more times as bright, as in a highlight, less is taken over.
constexpr float kBrighter = 2;
// Brightness below this share of the mean counts as that much where a division is at stake.
constexpr float kDark = 0.1f;
// Squared error over what the halves' difference and what both miss show of it, measured on scenes where the truth is
// known (docs/transport_regression.md).
constexpr float kNoiseShare = 1.6f, kBiasShare = 1.5f;

/// x += factor * y
void add_to(Plane& x, float factor, const Plane& y, const Task& task) {
  for_each_row(x.height(), quiet(task), [&](int j) {
    for (int i = 0; i < x.width(); ++i) x(i, j) += factor * y(i, j);
  });
}

double sum_of(const Plane& plane) {
  double sum = 0;
  for (int y = 0; y < plane.height(); ++y)
    for (const float v : plane.pixels(y)) sum += static_cast<double>(v);
  return sum;
}

/// Local weighted means: of targets / base where both are summed first.
std::vector<Plane> local_ratio(const std::vector<const Plane*>& targets, const Plane& base, const Plane& weight,
                               double window, const Task& task) {
  return lattice_regression({{{{&base}}, targets, &weight}}, {window, 0, 0}, task);
}

/// share * samples / (brightness + a share of its mean)^power within the mask, both relative to their means.
/// @param samples  of each pixel, relative to the mean; empty: alike
Plane weight_of(const Plane& level, const Plane& mask, float power, float share, const Plane& samples,
                const Task& task) {
  double sum = 0, count = 0;
  for (int y = 0; y < level.height(); ++y)
    for (int x = 0; x < level.width(); ++x)
      if (mask(x, y) > 0) {
        sum += static_cast<double>(std::max(0.0f, level(x, y)));
        ++count;
      }
  const float scale = sum > 0 ? static_cast<float>(count / sum) : 0.0f;
  return make_plane(level.width(), level.height(), quiet(task), [&](int x, int y) {
    if (!(mask(x, y) > 0)) return 0.0f;
    const float pixel = samples.empty() ? share : share * samples(x, y);
    return pixel * std::pow(scale * std::max(0.0f, level(x, y)) + kDark, -power);
  });
}

/// Half images whose outliers are drawn in, and what was taken from their mean: `taken` belongs to the neighbourhood,
/// `points`, which both halves show, to where it was.
struct Limited {
  Rgb a, b, taken, points;
};

/// Draws samples' means that lie far above a first fit to `limit` deviations from it. Deviations are those of the
/// neighbourhood, relative to the fit, themselves robust. Points are drawn in, too: no fit explains them, and one that
/// is bright enough would make all of its neighbourhood seem unexplained.
Limited limit_outliers(const RgbPlanes& a, const RgbPlanes& b, const Rgb& fit, const Plane& level, const Plane& mask,
                       double limit, bool halves, const Task& task) {
  const int width = level.width(), height = level.height();
  double sum = 0, count = std::max(1e-30, sum_of(mask));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (mask(x, y) > 0) sum += static_cast<double>(std::max(0.0f, level(x, y)));
  const float floor = static_cast<float>(static_cast<double>(kDark) * sum / count) + 1e-30f;
  const auto excess = [&](const RgbPlanes& half) {
    return make_plane(width, height, quiet(task), [&](int x, int y) {
      if (!(mask(x, y) > 0)) return 0.0f;
      const float l = luminance(vec3((*half[0])(x, y), (*half[1])(x, y), (*half[2])(x, y)));
      return (l - level(x, y)) / (std::max(0.0f, level(x, y)) + floor);
    });
  };
  const Plane ua = excess(a), ub = excess(b);
  // The frame's deviation: squares drawn in at `limit` times what the last round found.
  double deviation = 1e15;
  for (int round = 0; round < 30; ++round) {
    double squares = 0;
    const double top = limit * deviation;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (const Plane* u : {&ua, &ub}) {
          const double v = std::min(std::abs(static_cast<double>((*u)(x, y))), top);
          squares += v * v;
        }
    const double next = std::sqrt(squares / (2 * count));
    if (next > 0.999 * deviation) break;
    deviation = next;
  }
  const float top = static_cast<float>(limit * deviation);
  const Plane square = make_plane(width, height, quiet(task), [&](int x, int y) {
    const float va = std::min(std::abs(ua(x, y)), top), vb = std::min(std::abs(ub(x, y)), top);
    return 0.5f * (va * va + vb * vb);
  });
  const Plane one(width, height, 1.0f);
  const Plane local = std::move(local_ratio({&square}, one, mask, kNoiseWindow, task)[0]);
  Limited out;
  for (size_t c = 0; c < 3; ++c) {
    out.a[c] = *a[c];
    out.b[c] = *b[c];
    out.taken[c] = Plane(width, height);
    out.points[c] = Plane(width, height);
  }
  const auto is_point = [&](int x, int y) {
    const float agreed = std::min(ua(x, y), ub(x, y));
    int like_it = 0;
    const Box box = Box{x, y, x + 1, y + 1}.grown(kPointRadius, width, height);
    for (int v = box.y0; v < box.y1; ++v)
      for (int u = box.x0; u < box.x1; ++u) like_it += std::min(ua(u, v), ub(u, v)) > kPointShare * agreed;
    return like_it <= kPointPixels;
  };
  for_each_row(height, quiet(task), [&](int y) {
    for (int x = 0; x < width; ++x) {
      if (!(mask(x, y) > 0)) continue;
      const float most = static_cast<float>(limit) * std::sqrt(std::max(0.5f * local(x, y), 0.0f) +
                                                               0.5f * top * top / static_cast<float>(limit * limit));
      // What both halves show is no outlier.
      const bool point = halves && std::min(ua(x, y), ub(x, y)) > most && is_point(x, y);
      const auto draw = [&](const Plane& u, const Plane& other, Rgb& half) {
        const float bound = halves ? std::max(most, kAgreement * other(x, y)) : most;
        if (!(u(x, y) > (point ? most : bound))) return;
        const float share = 1 - std::min(1.0f, bound / u(x, y)), all = point ? 1 - most / u(x, y) : share;
        for (size_t c = 0; c < 3; ++c) {
          const float missed = half[c](x, y) - fit[c](x, y);
          half[c](x, y) -= all * missed;
          out.taken[c](x, y) += 0.5f * share * missed;
          out.points[c](x, y) += 0.5f * (all - share) * missed;
        }
      };
      draw(ua, ub, out.a);
      draw(ub, ua, out.b);
    }
  });
  return out;
}

/// Two pictures from one, for frames without halves: each has the pixels of one colour of a chessboard, and between
/// them what the fit says there and the mean of what it misses at the four neighbours, less where the fit
/// is much brighter there. Their noise is independent where the noise of neighbouring pixels is.
HalfPair chessboard_halves(const Rgb& data, const Rgb& fit, const Plane& mask, const Task& task) {
  const int width = mask.width(), height = mask.height();
  constexpr int kNext[4][2] = {{-1, 0}, {1, 0}, {0, -1}, {0, 1}};
  HalfPair out{data, data};
  for_each_row(height, quiet(task), [&](int y) {
    for (int x = 0; x < width; ++x) {
      if (!(mask(x, y) > 0)) continue;
      Rgb& half = (x + y) % 2 == 0 ? out.b : out.a;
      const auto share_of = [&](size_t c, int u, int v) {
        const float here = std::abs(fit[c](x, y)), there = std::abs(fit[c](u, v));
        return there > kBrighter * here ? kBrighter * here / there : 1.0f;
      };
      for (size_t c = 0; c < 3; ++c) {
        float missed = 0, count = 0;
        for (const auto& [dx, dy] : kNext) {
          const int u = x + dx, v = y + dy;
          if (u < 0 || v < 0 || u >= width || v >= height || !(mask(u, v) > 0)) continue;
          missed += share_of(c, u, v) * (data[c](u, v) - fit[c](u, v));
          ++count;
        }
        half[c](x, y) = fit[c](x, y) + (count > 0 ? missed / count : 0.0f);
      }
    }
  });
  return out;
}

/// Returns light to the neighbourhood it was taken from, in proportion to the picture.
void give_back(const Rgb& taken, Rgb& picture, const Plane& mask, const Task& task) {
  for (size_t c = 0; c < 3; ++c) {
    const Plane base = make_plane(mask.width(), mask.height(), quiet(task),
                                  [&](int x, int y) { return std::max(0.0f, picture[c](x, y)); });
    // With the weight 1 / base the fitted factor is the ratio of the sums.
    const double typical = sum_of(base) / std::max(1.0, sum_of(mask));
    const float least = static_cast<float>(1e-3 * typical) + 1e-30f;
    const Plane weight = make_plane(mask.width(), mask.height(), quiet(task), [&](int x, int y) {
      return mask(x, y) > 0 ? 1.0f / std::max(base(x, y), least) : 0.0f;
    });
    const std::vector<Plane> back = local_ratio({&taken[c]}, base, weight, kReturnWindow, task);
    for_each_row(mask.height(), quiet(task), [&](int y) {
      for (int x = 0; x < mask.width(); ++x) picture[c](x, y) += back[0](x, y);
    });
  }
}

/// Keeps surfaces within the values of the 3 x 3 pixels around them: without halves nothing tells what edges of bright
/// highlights make of a fit.
void keep_within_neighbours(const RgbPlanes& data, const Plane& solid, Rgb& picture, const Task& task) {
  for (size_t c = 0; c < 3; ++c) {
    const Plane low = window_minimum(*data[c], 1, task), high = window_maximum(*data[c], 1, task);
    for_each_row(solid.height(), quiet(task), [&](int y) {
      for (int x = 0; x < solid.width(); ++x)
        if (solid(x, y) > 0) picture[c](x, y) = std::clamp(picture[c](x, y), low(x, y), high(x, y));
    });
  }
}

/// What both halves miss of their own data in a region, each averaged over a few pixels, multiplied: a square of the
/// bias, as the halves' noise is independent. Mean over colours.
Plane missed_by_both(const HalfPair& result, const HalfPair& data, const Plane& region, const Task& task) {
  const int width = region.width(), height = region.height();
  const Plane around = gaussian_blur(region, kMissedWindow, task);
  const auto missed = [&](const Plane& half, const Plane& of) {
    return gaussian_blur(
        make_plane(width, height, quiet(task), [&](int x, int y) { return region(x, y) * (half(x, y) - of(x, y)); }),
        kMissedWindow, task);
  };
  Plane product(width, height);
  for (size_t c = 0; c < 3; ++c) {
    const Plane a = missed(data.a[c], result.a[c]), b = missed(data.b[c], result.b[c]);
    for_each_row(height, quiet(task), [&](int y) {
      for (int x = 0; x < width; ++x)
        if (region(x, y) > 0) product(x, y) += a(x, y) * b(x, y) / (3 * around(x, y) * around(x, y));
    });
  }
  return product;
}

/// Squared error at each pixel, mean over colours: the noise that the halves' difference shows, and the bias that both
/// halves miss of their own data as far as it is beyond that estimate's standard error.
/// @param regions  what is averaged in one says nothing about another
Plane squared_error(const HalfPair& result, const HalfPair& data, const std::vector<MixingRegion>& regions,
                    const Task& task) {
  const int width = result.a[0].width(), height = result.a[0].height();
  const Plane noise = make_plane(width, height, quiet(task), [&](int x, int y) {
    float sum = 0;
    for (size_t c = 0; c < 3; ++c) {
      const float d = result.a[c](x, y) - result.b[c](x, y);
      sum += d * d / 12;
    }
    return sum;
  });
  const Plane one(width, height, 1.0f);
  Plane sum(width, height);
  for (const MixingRegion& region : regions) {
    const Plane bias = missed_by_both(result, data, region.share, task);
    const Plane square = make_plane(width, height, quiet(task), [&](int x, int y) { return bias(x, y) * bias(x, y); });
    const auto local = [&](const Plane& plane, double window) {
      return std::move(local_ratio({&plane}, one, region.share, window, task)[0]);
    };
    const Plane n = local(noise, kErrorWindow), m = local(bias, kBiasWindow), m2 = local(square, kBiasWindow);
    // Neighbours that are averaged together count as one.
    const auto independent = static_cast<float>(kBiasWindow * kBiasWindow / (kMissedWindow * kMissedWindow));
    for_each_row(height, quiet(task), [&](int y) {
      for (int x = 0; x < width; ++x) {
        const float error = std::sqrt(std::max(0.0f, m2(x, y) - m(x, y) * m(x, y)) / independent);
        sum(x, y) +=
            region.share(x, y) * (kNoiseShare * std::max(0.0f, n(x, y)) + kBiasShare * std::max(0.0f, m(x, y) - error));
      }
    });
  }
  return sum;
}

void say_what_is_missing(const FilterFrame& frame, bool guided, bool halves) {
  if (!frame.notes) return;
  const bool foreign = !frame.layers.text(kForeignRenderer).empty();
  if (!guided)
    frame.notes->push_back(
        fmt::format("the frame has no guides: two to four times the error of a frame with them, and more than other "
                    "filters leave. {}",
                    foreign ? "Make them with: brume guides --like FRAME.exr --scene SCENE.toml -o GUIDES.exr"
                            : "Record them with: brume render SCENE -o OUT.exr --layers direct,indirect,guides"));
  if (!halves)
    frame.notes->push_back(fmt::format(
        "{} to judge by: fits are judged by pixels left out, which takes the noise of neighbouring pixels to "
        "be independent",
        frame.layers.number("samplesPerPixel").value_or(frame.samples) == 1 ? "one sample per pixel makes no two halves"
                                                                            : "the frame has no half images"));
}

Plane brightness(const HalfPair& fit, const Task& task) {
  return make_plane(fit.a[0].width(), fit.a[0].height(), quiet(task), [&](int x, int y) {
    const auto at = [&](size_t c) { return 0.5f * (fit.a[c](x, y) + fit.b[c](x, y)); };
    return luminance(vec3(at(0), at(1), at(2)));
  });
}

Rgb mean(const HalfPair& fit, const Task& task) {
  Rgb m;
  for (size_t c = 0; c < 3; ++c)
    m[c] = make_plane(fit.a[c].width(), fit.a[c].height(), quiet(task),
                      [&](int x, int y) { return 0.5f * (fit.a[c](x, y) + fit.b[c](x, y)); });
  return m;
}

struct Halves {
  RgbPlanes a, b;
};

/// A frame of the sequence, or the one to clean.
struct Picture {
  TransportColumns known;
  float share;  // of its pixels against those of the frame to clean
  bool halves;  // or the whole signal twice
  Halves seen;
  HalfPair left;  // of `seen`, outliers drawn in: what no fit explains so far
  Plane samples, weight, level;

  Picture(const FilterFrame& frame, const Plane& one, float share_, const Task& task)
      : known(frame, one, task),
        share(share_),
        halves(frame.half_a[0] != nullptr && (frame.samples == 0 || frame.samples >= 2)),
        seen{halves ? frame.half_a : frame.signal, halves ? frame.half_b : frame.signal} {
    if (frame.samples > 0 && frame.sample_count)
      samples = make_plane(frame.width(), frame.height(), quiet(task),
                           [&](int x, int y) { return static_cast<float>(frame.samples_at(x, y) / frame.samples); });
  }
  /// Takes what a fit explains of a colour.
  void explain(size_t c, const Plane& a, const Plane& b, const Task& task) {
    add_to(left.a[c], -1, a, task);
    add_to(left.b[c], -1, b, task);
  }
};

/// The frame to clean first, then those nearby. They stay where they are: columns point into them.
using Pictures = std::deque<Picture>;

/// @throws InputError for a frame with other guides
Pictures pictures_of(const TransportRegression& p, const FilterFrame& frame, const Plane& one, const Task& task) {
  Pictures pictures;
  pictures.emplace_back(frame, one, 1.0f, task);
  for (const NearbyFrame& other : frame.nearby) {
    const float apart = static_cast<float>(other.distance) / p.frames;
    const float samples =
        frame.samples > 0 && other.frame->samples > 0 ? static_cast<float>(other.frame->samples / frame.samples) : 1.0f;
    pictures.emplace_back(*other.frame, one, samples * std::exp(-0.5f * apart * apart), task);
    if (pictures.back().known.names != pictures[0].known.names)
      throw InputError(
          fmt::format("the frame at {:+} of the sequence: its guides are {}, those of the frame to clean {}; record "
                      "the same layers "
                      "in every frame",
                      other.distance, join(pictures.back().known.names), join(pictures[0].known.names)));
  }
  return pictures;
}

/// What becomes of a fit to a picture: its colour c of both halves.
using TakeFit = std::function<void(size_t picture, size_t c, Plane a, Plane b)>;

/// Fits both halves of the frame to clean and of those nearby with the same coefficients, each colour by itself; those
/// with the same columns together.
/// @param targets  of each picture
void regress(const Pictures& pictures, ColourColumns TransportColumns::*which, const std::vector<Halves>& targets,
             const LatticeWindow& window, const TakeFit& take, const Task& task) {
  const auto solve = [&](const std::vector<size_t>& colours) {
    const auto pixels = [&](size_t i) {
      LatticePixels known{(pictures[i].known.*which).of[colours[0]], {}, &pictures[i].weight};
      for (const size_t c : colours) {
        known.targets.push_back(targets[i].a[c]);
        known.targets.push_back(targets[i].b[c]);
      }
      return known;
    };
    const auto hand_on = [&](size_t i, std::vector<Plane> found) {
      for (size_t k = 0; k < colours.size(); ++k)
        take(i, colours[k], std::move(found[2 * k]), std::move(found[2 * k + 1]));
    };
    LatticeProblem problem{pixels(0), (pictures[0].known.*which).free};
    for (size_t i = 1; i < targets.size(); ++i) problem.nearby.push_back(pixels(i));
    const auto nearby = [&](size_t i, std::vector<Plane> found) { hand_on(i + 1, std::move(found)); };
    hand_on(0, lattice_regression(problem, window, task, nearby));
  };
  if ((pictures[0].known.*which).coloured)
    for (size_t c = 0; c < 3; ++c) solve({c});
  else
    solve({0, 1, 2});
}

/// What the fits of `count` pictures leave.
std::vector<Halves> left_of(const Pictures& pictures, size_t count) {
  std::vector<Halves> left;
  for (size_t i = 0; i < count; ++i) left.push_back({view(pictures[i].left.a), view(pictures[i].left.b)});
  return left;
}

/// Fits to what the ones before leave, one after another.
struct Fits {
  Pictures& pictures;
  const Task& task;
  HalfPair sum;                      // of all so far, of the frame to clean
  std::vector<HalfPair> candidates;  // the sum after each

  Fits(Pictures& of, const Task& task_) : pictures(of), task(task_) {
    for (Rgb* half : {&sum.a, &sum.b})
      for (Plane& plane : *half) plane = Plane(of[0].known.mask.width(), of[0].known.mask.height());
  }
  void refine(ColourColumns TransportColumns::*which, const LatticeWindow& window) {
    const auto take = [&](size_t i, size_t c, Plane a, Plane b) {
      Picture& q = pictures[i];
      q.explain(c, a, b, task);
      if (i > 0) return;
      add_to(sum.a[c], 1, a, task);
      add_to(sum.b[c], 1, b, task);
    };
    regress(pictures, which, left_of(pictures, pictures.size()), window, take, task);
    candidates.push_back(sum);
  }
  /// The same, after which only the candidates stay.
  void refine_aside(ColourColumns TransportColumns::*which, const std::vector<LatticeWindow>& windows) {
    std::vector<HalfPair> left;
    for (const Picture& q : pictures) left.push_back(q.left);
    HalfPair before = sum;
    for (const LatticeWindow& window : windows) refine(which, window);
    sum = std::move(before);
    for (size_t i = 0; i < left.size(); ++i) pictures[i].left = std::move(left[i]);
  }
};

/// Half images of the frame to clean whose outliers are drawn in to a first fit, the same of those nearby in `left`,
/// and weights.
Limited limited_pictures(Pictures& pictures, float power, double limit, const Task& task) {
  std::vector<Halves> seen;
  for (Picture& q : pictures) {
    q.weight = weight_of(q.known.bright, q.known.mask, power, q.share, q.samples, task);
    seen.push_back(q.seen);
  }
  TransportColumns& own = pictures[0].known;
  for (ColourColumns* columns : {&own.predicted, &own.shape, &own.all}) columns->standardise(pictures[0].weight, task);
  for (Picture& q : pictures) q.known.scale_like(own);
  std::vector<HalfPair> fits(pictures.size());
  const auto keep = [&](size_t i, size_t c, Plane a, Plane b) {
    fits[i].a[c] = std::move(a);
    fits[i].b[c] = std::move(b);
  };
  regress(pictures, &TransportColumns::all, seen, {0, kGlobalRidge, 0}, keep, task);
  Limited own_data;
  for (size_t i = 0; i < pictures.size(); ++i) {
    Picture& q = pictures[i];
    Limited limited = limit_outliers(q.seen.a, q.seen.b, mean(fits[i], task), brightness(fits[i], task), q.known.mask,
                                     limit, q.halves, task);
    q.left = q.halves ? HalfPair{std::move(limited.a), std::move(limited.b)}
                      : chessboard_halves(limited.a, fits[i].a, q.known.mask, task);
    fits[i] = {};
    if (i == 0) own_data = {q.left.a, q.left.b, std::move(limited.taken), std::move(limited.points)};
  }
  return own_data;
}

/// Weights from what the fits say of the brightness, averaged over a few pixels: they must not follow what a guide
/// holds of noise.
void weigh_by_fits(Pictures& pictures, float power, const std::vector<HalfPair>& before, const Task& task) {
  for (size_t i = 0; i < pictures.size(); ++i) {
    Picture& q = pictures[i];
    HalfPair fit = before[i];
    for (size_t c = 0; c < 3; ++c) {
      add_to(fit.a[c], -1, q.left.a[c], task);
      add_to(fit.b[c], -1, q.left.b[c], task);
    }
    q.level = box_mean(brightness(fit, task), kLevelRadius, task);
    q.weight = weight_of(q.level, q.known.mask, power, q.share, q.samples, task);
    q.known.few.add(q.level);
    q.known.medium.add(q.level);
  }
  TransportColumns& own = pictures[0].known;
  own.few.standardise(pictures[0].weight, task);
  own.medium.standardise(pictures[0].weight, task);
  for (Picture& q : pictures) q.known.scale_like(own);
}

/// The fits of the frame to clean, and the mean over all frames of what their fits miss.
HalfPair mean_over_frames(const Pictures& pictures, const HalfPair& fits, const Task& task) {
  float shares = 0;
  for (const Picture& q : pictures) shares += q.share;
  HalfPair mean = fits;
  for (const Picture& q : pictures)
    for (size_t c = 0; c < 3; ++c) {
      add_to(mean.a[c], q.share / shares, q.left.a[c], task);
      add_to(mean.b[c], q.share / shares, q.left.b[c], task);
    }
  return mean;
}

/// Fits of the frame to clean: first what is predicted, then wide windows with many columns, and narrower and narrower
/// ones with fewer, each to what the one before leaves. Lets go of the frames nearby.
/// @param over_frames  is given mean_over_frames() where there are frames nearby
std::vector<HalfPair> cascade(Pictures& pictures, const TransportRegression& p, float power,
                              std::optional<HalfPair>& over_frames, const Task& task) {
  Fits fits(pictures, task);
  std::vector<HalfPair> before;
  for (const Picture& q : pictures) before.push_back(q.left);
  const auto window = [&](double deviation) {
    return LatticeWindow{deviation, static_cast<double>(p.ridge), static_cast<double>(p.ridge_per_pixel)};
  };
  const double middle = static_cast<double>(p.window);
  fits.refine(&TransportColumns::predicted, {0, kGlobalRidge, 0});
  fits.refine_aside(&TransportColumns::shape,
                    {window(2 * middle), window(middle), window(middle / 2), window(middle / 4)});
  task.report(0.35);
  for (Picture& q : pictures) q.known.all.free = 0;
  for (const double ridge : kRidgesOfFrame) fits.refine(&TransportColumns::all, {0, kGlobalRidge, ridge});
  weigh_by_fits(pictures, power, before, task);
  before.clear();
  fits.refine(&TransportColumns::all, window(2 * middle));
  fits.refine(&TransportColumns::all, window(middle));
  task.report(0.5);
  fits.refine(&TransportColumns::medium, window(middle / 2));
  fits.refine(&TransportColumns::few, window(middle / 4));
  task.report(0.6);
  if (pictures.size() == 1) return std::move(fits.candidates);
  over_frames = mean_over_frames(pictures, fits.sum, task);
  // What the frame shows that those nearby do not, as where a light changes.
  while (pictures.size() > 1) pictures.pop_back();
  fits.refine(&TransportColumns::all, window(middle));
  return std::move(fits.candidates);
}

/// The result plus what it misses, averaged over a Gaussian window of so many pixels.
HalfPair with_local_mean(const HalfPair& result, const HalfPair& data, double window, const Task& task) {
  const auto corrected = [&](const Rgb& half, const Rgb& of) {
    Rgb out;
    for (size_t c = 0; c < 3; ++c) {
      out[c] = make_plane(half[c].width(), half[c].height(), quiet(task),
                          [&](int x, int y) { return of[c](x, y) - half[c](x, y); });
      out[c] = gaussian_blur(out[c], window, task);
      add_to(out[c], 1, half[c], task);
    }
    return out;
  };
  return {corrected(result.a, data.a), corrected(result.b, data.b)};
}

/// Edges and materials of surfaces, and what shows none.
std::vector<MixingRegion> regions_of(const TransportColumns& known, const Task& task) {
  std::vector<MixingRegion> regions;
  for (const Plane& share : known.solids) regions.push_back({share, kSureOfSurfaces});
  regions.push_back({make_plane(known.mask.width(), known.mask.height(), quiet(task),
                                [&](int x, int y) {
                                  return known.mask(x, y) * (known.solid.empty() ? 1.0f : 1 - known.solid(x, y));
                                }),
                     kSureOfMedia});
  return regions;
}

/// Moves what the fits say together to what single fits, the data and their local means say where those prove better.
/// @param candidates   the data last
/// @param over_frames  of a sequence, the data with the noise of its frames' mean
void improve(HalfPair& result, const std::vector<HalfPair>& candidates, const std::optional<HalfPair>& over_frames,
             const TransportColumns& known, const Task& task) {
  const int width = known.mask.width(), height = known.mask.height();
  const HalfPair& data = candidates.back();
  // Relative errors, as CIE-Lab sees them.
  const Plane light = gaussian_blur(brightness(result, task), kLightWindow, task);
  double sum = 0;
  for (int y = 0; y < height; ++y)
    for (const float v : light.pixels(y)) sum += std::abs(static_cast<double>(v));
  const float scale = sum > 0 ? static_cast<float>(static_cast<double>(width) * height / sum) : 0.0f;
  const Plane weight = make_plane(width, height, quiet(task), [&](int x, int y) {
    return known.mask(x, y) > 0 ? std::pow(scale * std::abs(light(x, y)) + 0.05f, -4.0f / 3) : 0.0f;
  });
  const MixingFrame frame{view(data.a), view(data.b), weight, regions_of(known, task)};
  std::vector<Proposal> proposals;
  for (const HalfPair& candidate : candidates)
    proposals.emplace_back([&candidate](const HalfPair&, HalfPair&) -> const HalfPair& { return candidate; });
  if (over_frames)
    proposals.emplace_back([&over_frames](const HalfPair&, HalfPair&) -> const HalfPair& { return *over_frames; });
  const HalfPair& averaged = over_frames ? *over_frames : data;
  for (const double window : kLocalMeans)
    proposals.emplace_back([&averaged, window, &task](const HalfPair& now, HalfPair& room) -> const HalfPair& {
      return room = with_local_mean(now, averaged, window, task);
    });
  const Plane moved = mix(result, proposals, frame, task);
  task.report(0.9);
  const HalfPair lines = local_lines(data, pointers(known.features), moved, task);
  proposals.emplace_back([&lines](const HalfPair&, HalfPair&) -> const HalfPair& { return lines; });
  mix(result, proposals, frame, task);
}

void run(const TransportRegression& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const int width = frame.width(), height = frame.height();
  const Plane one(width, height, 1.0f);
  Pictures pictures = pictures_of(p, frame, one, task);
  Picture& own = pictures[0];
  const TransportColumns& known = own.known;
  say_what_is_missing(frame, known.guided, own.halves);
  const double samples = std::max(1.0, frame.samples);
  const double limit = static_cast<double>(p.limit) * std::max(1.0, std::pow(samples / 16, 0.25));
  // Noise grows with light that paths find; direct light holds background, too, so that its brightness says nothing.
  const float power = frame.name == layer::direct ? 0.0f : p.weight_power;
  Limited limited = limited_pictures(pictures, power, limit, task);
  task.report(0.2);

  std::optional<HalfPair> over_frames;
  std::vector<HalfPair> candidates = cascade(pictures, p, power, over_frames, task);
  own.left = {};
  // The data are a candidate themselves: with many samples nothing is nearer to the truth.
  candidates.push_back({std::move(limited.a), std::move(limited.b)});
  const HalfPair& data = candidates.back();

  const std::vector<Plane> maps =
      stacking_weights(candidates, view(data.a), view(data.b), own.weight,
                       {static_cast<double>(p.stacking_window), static_cast<double>(p.caution)}, task);
  HalfPair chosen = blend(candidates, maps, task);
  task.report(0.7);
  improve(chosen, candidates, over_frames, known, task);
  Rgb clean = mean(chosen, task);
  give_back(limited.taken, clean, known.mask, task);
  for (size_t c = 0; c < 3; ++c) add_to(clean[c], 1, limited.points[c], task);
  if (!own.halves && !known.solid.empty()) keep_within_neighbours(frame.signal, known.solid, clean, task);
  for (size_t c = 0; c < 3; ++c)
    for_each_row(height, quiet(task), [&](int y) {
      for (int x = 0; x < width; ++x)
        (*out[c])(x, y) = known.mask(x, y) > 0 ? clean[c](x, y) : (*frame.signal[c])(x, y);
    });
  task.report(1);
  if (!frame.products) return;
  Plane error = squared_error(chosen, data, regions_of(known, task), task);
  (*frame.products)[layer::clean_error.channel(0)] = std::move(error);
}

/// Squares, of the parts together, to a root mean square error.
void settle(Layers& layers) {
  Plane& error = *layers.find(layer::clean_error.channel(0));
  for (int y = 0; y < error.height(); ++y)
    for (float& v : error.pixels(y)) v = std::sqrt(std::max(0.0f, v));
}

const FilterEntry entry =
    declare<TransportRegression>(
        "transport_regression",
        "Local linear regression of direct and indirect light, apart, on noise-free guides that the renderer computes "
        "from the volume.")
        .merit(108, "first of all, where the renderer's guides are recorded (`--layers direct,indirect,guides`)")
        .source(
            "our own, docs/transport_regression.md; local regression on features: Bitterli et al. 2016; stacking: "
            "Breiman 1996")
        .notes(
            "The light that no path has to find is computed without noise (`guide.*`); what is left to the data are a "
            "few coefficients in every window. Each half image is fitted, in one window for the frame, then what that "
            "leaves in narrower and narrower ones, and the halves say how much of each fit, and of the data, is best "
            "where. Frames without guides are cleaned with the features they have, at two to four times the error: "
            "nfor does better there.")
        .statistics(Statistics::kNone, Statistics::kHalves)
        .no_variance()
        .guides()
        .can_use(layer::transmittance, layer::gradient, layer::gradient_transmittance_weighted, layer::albedo,
                 layer::normal, layer::depth)
        .parts()
        .whole_frame()
        .seeded()
        .paper("")
        .produces(layer::clean_error)
        .settles(settle)
        .param("window", &TransportRegression::window, {2, 100}, "px",
               "deviation of the middle one of the Gaussian windows; the others are twice, half and a quarter of it",
               {12, 16, 24})
        .param("ridge", &TransportRegression::ridge, {0, 100}, "1", "pull of scaled coefficients towards 0",
               {0.002, 0.02})
        .param("ridge-per-pixel", &TransportRegression::ridge_per_pixel, {0, 1000}, "1",
               "the same, over the window's effective number of pixels", {1, 10})
        .param("stacking-window", &TransportRegression::stacking_window, {2, 200}, "px",
               "deviation of the Gaussian in which fits are weighed against each other")
        .param("caution", &TransportRegression::caution, {0, 1e6}, "1",
               "pull of these weights towards the frame's, in pixels")
        .param(
            "limit", &TransportRegression::limit, {1, 1e9}, "1",
            "deviations above a first fit to which outliers are drawn in, at up to 16 samples per pixel; their light "
            "is given to the neighbourhood")
        .param("weight-power", &TransportRegression::weight_power, {0, 2}, "1",
               "in what cleans all but the direct light, pixels weigh as their brightness to minus this power: 2 is "
               "constant relative noise, 4/3 what CIE-Lab sees")
        .param("frames", &TransportRegression::frames, {0.1, 100}, "frames",
               "of a sequence: deviation of the Gaussian over frames that share coefficients")
        .sequences(3)
        .scratch(80)
        .apron([](const TransportRegression&) { return 1 << 20; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume

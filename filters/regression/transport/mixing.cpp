#include "filters/regression/transport/mixing.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <numeric>

#include "base/math.h"
#include "base/parallel_for.h"
#include "filters/inputs/half_pair.h"

namespace brume {
namespace {

// Deviations of the Gaussians over which gains are measured [px], each over means of blocks of so many pixels.
struct Window {
  double deviation;
  int block;
};
constexpr Window kWindows[] = {{3, 2}, {6, 4}, {12, 8}, {28, 16}};  // each block twice as wide as the one before
constexpr int kRounds = 3;
constexpr float kLargeValue = 1.5f;   // of the largest value over the pixels of a window, taken off a gain
constexpr double kFirefly = 0.999;    // quantile of gains at which single pixels are cut: none decides alone
constexpr double kShareWindow = 1.5;  // over which shares are smoothed [px]
// Where a round gains less than this share of the noise in a tile of so many pixels, or of a tile's usual noise if that
// is more, there is no other, nor in those around it.
constexpr float kWorthwhile = 0.05f;
constexpr int kTile = 64, kTilesAround = 1;

/// Between the middles of blocks, linearly.
struct BlockPlace {
  int first, second;
  float share;  // of the second

  BlockPlace(int pixel, int block, int count) {
    const float at = (static_cast<float>(pixel) + 0.5f) / static_cast<float>(block) - 0.5f;
    first = std::clamp(static_cast<int>(std::floor(at)), 0, count - 1);
    second = std::min(first + 1, count - 1);
    share = std::clamp(at - static_cast<float>(first), 0.0f, 1.0f);
  }
  float of(const float* blocks) const { return blocks[first] + share * (blocks[second] - blocks[first]); }
};

/// A row of blocks between two; whether any is above 0.
bool row_between(const Plane& blocks, const BlockPlace& y, std::vector<float>& row) {
  const float *top = blocks.row(y.first), *bottom = blocks.row(y.second);
  bool any = false;
  for (size_t i = 0; i < row.size(); ++i) {
    row[i] = top[i] + y.share * (bottom[i] - top[i]);
    any |= row[i] > 0;
  }
  return any;
}

/// What a step towards a candidate would change at each pixel: of its gain the part linear in the step, and of its loss
/// the part quadratic in it.
struct Step {
  Plane gain, loss;
  float most = 0;  ///< gains are cut at plus and minus this

  Step(const HalfPair& from, const HalfPair& to, const MixingFrame& frame, const Task& task)
      : gain(frame.weight.width(), frame.weight.height()), loss(frame.weight.width(), frame.weight.height()) {
    for_each_row(gain.height(), quiet(task), [&](int y) {
      const float* const weight = frame.weight.row(y);
      for (int x0 = 0; x0 < gain.width(); x0 += kAtOnce) {
        const int x1 = std::min(x0 + kAtOnce, gain.width());
        if (std::any_of(weight + x0, weight + x1, [](float w) { return w > 0; }))
          for (size_t c = 0; c < 3; ++c) add_colour(from, to, frame, c, y, x0, x1);
      }
    });
    most = largest_but_fireflies(task);
  }

 private:
  static constexpr int kAtOnce = 64;

  void add_colour(const HalfPair& from, const HalfPair& to, const MixingFrame& frame, size_t c, int y, int x0, int x1) {
    const float *from_a = from.a[c].row(y), *from_b = from.b[c].row(y), *to_a = to.a[c].row(y), *to_b = to.b[c].row(y),
                *data_a = frame.half_a[c]->row(y), *data_b = frame.half_b[c]->row(y), *weight = frame.weight.row(y);
    float* __restrict g = gain.row(y), * __restrict l = loss.row(y);
    for (int x = x0; x < x1; ++x) {
      const float ta = from_a[x], tb = from_b[x], da = to_a[x] - ta, db = to_b[x] - tb, w = weight[x] * (1.0f / 3);
      g[x] += w * (0.5f * ((data_b[x] - ta) * da + (data_a[x] - tb) * db) + 0.25f * (tb - ta) * (db - da));
      l[x] += w * (0.25f * (da + db) * (da + db));
    }
  }

  /// The quantile kFirefly of the gains' sizes, up to a hundredth of it: their bits are counted without the last ones.
  float largest_but_fireflies(const Task& task) const {
    constexpr int kDropped = 16, kStrips = 16;
    std::array<std::vector<uint32_t>, kStrips> counts;
    parallel_for(kStrips, quiet(task), [&](int strip) {
      std::vector<uint32_t>& count = counts[static_cast<size_t>(strip)];
      count.resize(1u << (32 - kDropped - 1));
      for (int y = strip * gain.height() / kStrips; y < (strip + 1) * gain.height() / kStrips; ++y)
        for (const float v : gain.pixels(y))
          if (v != 0) ++count[std::bit_cast<uint32_t>(std::abs(v)) >> kDropped];
    });
    for (size_t strip = 1; strip < kStrips; ++strip)
      for (size_t i = 0; i < counts[0].size(); ++i) counts[0][i] += counts[strip][i];
    const uint64_t total = std::accumulate(counts[0].begin(), counts[0].end(), uint64_t{0});
    if (total == 0) return 0;
    const auto rank = static_cast<uint64_t>(kFirefly * static_cast<double>(total - 1));
    uint32_t bits = 0;
    for (uint64_t below = counts[0][0]; below <= rank; below += counts[0][bits]) ++bits;
    return std::bit_cast<float>((bits << kDropped) + (1u << (kDropped - 1)));
  }
};

/// The best step that was found for each pixel of a region so far.
struct Best {
  Plane gain, share;
  std::vector<int> proposal;

  Best(int width, int height)
      : gain(width, height), share(width, height), proposal(static_cast<size_t>(width) * height, -1) {}
  int& of(int x, int y) { return proposal[static_cast<size_t>(y) * gain.width() + x]; }
  int of(int x, int y) const { return proposal[static_cast<size_t>(y) * gain.width() + x]; }
};

/// What is averaged over windows, as means over blocks; what lies beyond the picture's edge counts as nothing.
struct Measures {
  enum { kShare, kGain, kSquare, kFourth, kLoss, kCount };  ///< the gain's powers and the loss times the region's share
  std::array<Plane, kCount> of;

  int width() const { return of[0].width(); }
  int height() const { return of[0].height(); }

  /// Over blocks of two by two pixels.
  Measures(const Step& step, const Plane& region, const Task& task)
      : Measures((region.width() + 1) / 2, (region.height() + 1) / 2) {
    fold(region.height(), task, [&](int y, Sums& sums) {
      const float *const share = region.row(y), *const gain = step.gain.row(y), *const loss = step.loss.row(y);
      const float most = step.most;
      const size_t count = static_cast<size_t>(region.width());
      float *n = sums[kShare].data(), *g1 = sums[kGain].data(), *g2 = sums[kSquare].data(), *g4 = sums[kFourth].data(),
            *l = sums[kLoss].data();
      for (size_t x = 0; x < count; ++x) {
        const float w = share[x], g = std::min(std::max(gain[x], -most), most), square = w * g * g;
        n[x] += w;
        g1[x] += w * g;
        g2[x] += square;
        g4[x] += square * g * g;
        l[x] += w * loss[x];
      }
    });
  }
  /// Over blocks twice as wide.
  Measures(const Measures& fine, const Task& task) : Measures((fine.width() + 1) / 2, (fine.height() + 1) / 2) {
    fold(fine.height(), task, [&](int y, Sums& sums) {
      for (size_t i = 0; i < kCount; ++i) {
        const float* const row = fine.of[i].row(y);
        for (size_t x = 0; x < static_cast<size_t>(fine.width()); ++x) sums[i][x] += row[x];
      }
    });
  }
  Measures blurred(double deviation, const Task& task) const {
    Measures out(0, 0);
    for (size_t i = 0; i < kCount; ++i) out.of[i] = gaussian_blur(of[i], deviation, task);
    return out;
  }

 private:
  using Sums = std::array<std::vector<float>, kCount>;  // over two rows of a finer grid

  Measures(int width, int height) { of.fill(Plane(width, height)); }
  /// @param add  called as add(y, sums) for two rows of a finer grid
  template <class Add>
  void fold(int rows, const Task& task, const Add& add) {
    for_each_row(height(), quiet(task), [&](int block) {
      Sums sums;
      for (std::vector<float>& row : sums) row.assign(2 * static_cast<size_t>(width()), 0.0f);
      for (int y = 2 * block; y < std::min(rows, 2 * block + 2); ++y) add(y, sums);
      for (size_t i = 0; i < kCount; ++i) {
        float* const to = of[i].row(block);
        for (size_t x = 0; x < static_cast<size_t>(width()); ++x) to[x] = 0.25f * (sums[i][2 * x] + sums[i][2 * x + 1]);
      }
    });
  }
};

/// What a step is sure to gain, and its best length, at each block.
struct SureGain {
  Plane gain, share;
  std::atomic<bool> any = false;

  SureGain(const Measures& m, double sure, double pixels, const Task& task)
      : gain(m.width(), m.height()), share(m.width(), m.height()) {
    for_each_pixel(gain.width(), gain.height(), quiet(task), [&](int x, int y) {
      const auto mean = [&](size_t i) { return m.of[i](x, y) / m.of[Measures::kShare](x, y); };
      const float n = m.of[Measures::kShare](x, y);
      if (!(n > 1e-6f) || !(m.of[Measures::kGain](x, y) > 0)) return;
      const float b = mean(Measures::kGain), count = static_cast<float>(pixels) * n;
      const float variance = std::max(0.0f, mean(Measures::kSquare) - b * b);
      const float largest = std::sqrt(std::sqrt(mean(Measures::kFourth) * count));
      const float low = b - static_cast<float>(sure) * std::sqrt(variance / count) - kLargeValue * largest / count;
      if (!(low > 0)) return;
      const float a = std::max(mean(Measures::kLoss), 1e-30f);
      share(x, y) = std::min(1.0f, low / a);
      gain(x, y) = share(x, y) * (2 * low - share(x, y) * a);
      any = true;
    });
  }
};

void consider(int proposal, const Step& step, const MixingRegion& region, Best& best, const Task& task) {
  Measures measures(step, region.share, task);
  for (const Window& window : kWindows) {
    if (window.block > 2) measures = Measures(measures, task);
    const double s = window.deviation;
    // So many pixels count as much as the window.
    const SureGain sure(measures.blurred(s / window.block, task), region.sure, 4 * kPi * s * s, task);
    if (!sure.any) continue;
    std::vector<BlockPlace> along;
    for (int x = 0; x < region.share.width(); ++x) along.emplace_back(x, window.block, sure.gain.width());
    for_each_row(region.share.height(), quiet(task), [&](int y) {
      const BlockPlace down(y, window.block, sure.gain.height());
      std::vector<float> gains(static_cast<size_t>(sure.gain.width())), shares(gains.size());
      if (!row_between(sure.gain, down, gains)) return;
      row_between(sure.share, down, shares);
      for (int x = 0; x < region.share.width(); ++x) {
        if (!(region.share(x, y) > 0)) continue;
        const BlockPlace& at = along[static_cast<size_t>(x)];
        const float found = at.of(gains.data());
        if (!(found > best.gain(x, y))) continue;
        best.gain(x, y) = found;
        best.share(x, y) = at.of(shares.data());
        best.of(x, y) = proposal;
      }
    });
  }
}

/// A box of the frame while steps are taken in it.
class MixedBox {
 public:
  /// @param result  within the box    @param weight  of squared errors, within the box
  MixedBox(const Box& box, HalfPair result, Plane weight, const MixingFrame& frame)
      : box_(box), result_(std::move(result)), weight_(std::move(weight)), moved_(box.width(), box.height()) {
    const auto part = [&](const Plane& of) { return Plane::view(of, box.x0, box.y0, box.width(), box.height()); };
    for (size_t c = 0; c < 3; ++c) {
      data_.a[c] = part(*frame.half_a[c]);
      data_.b[c] = part(*frame.half_b[c]);
    }
    for (const MixingRegion& region : frame.regions)
      if (any_above_0(region.share, box)) regions_.push_back({part(region.share), region.sure});
  }
  const Box& box() const { return box_; }
  const Plane& weight() const { return weight_; }
  HalfPair& result() { return result_; }
  /// 1 where the result was moved, elsewhere 0.
  const Plane& moved() const { return moved_; }

  /// Takes the best steps once, and leaves only candidates that were taken.
  /// @param usual_noise  of a tile; found where it is below 0
  /// @return  the weight where another round may be worth its time, elsewhere 0; empty: nowhere
  Plane round(std::vector<const Proposal*>& proposals, const Plane& weight, double& usual_noise, const Task& task) {
    const MixingFrame here{view(data_.a), view(data_.b), weight, regions_};
    const std::vector<Best> best = best_steps(proposals, here, task);
    Plane next = worth_another_round(best, here, usual_noise, task);
    std::vector<bool> taken(proposals.size());
    for (const Best& b : best)
      for (const int m : b.proposal)
        if (m >= 0) taken[static_cast<size_t>(m)] = true;
    result_ = moved_by(best, taken, proposals, here, task);
    std::vector<const Proposal*> left;
    for (size_t m = 0; m < proposals.size(); ++m)
      if (taken[m]) left.push_back(proposals[m]);
    proposals = std::move(left);
    return next;
  }

 private:
  /// The best step for each pixel, region by region.
  std::vector<Best> best_steps(const std::vector<const Proposal*>& proposals, const MixingFrame& frame,
                               const Task& task) {
    std::vector<Best> best(regions_.size(), Best(box_.width(), box_.height()));
    for (size_t m = 0; m < proposals.size(); ++m) {
      task.check();
      const Step step(result_, (*proposals[m])(result_, box_, room_), frame, task);
      for (size_t r = 0; r < regions_.size(); ++r) consider(static_cast<int>(m), step, regions_[r], best[r], task);
    }
    return best;
  }

  /// Takes the steps, each region by itself, with shares that are smooth over a few pixels.
  HalfPair moved_by(const std::vector<Best>& best, const std::vector<bool>& taken,
                    const std::vector<const Proposal*>& proposals, const MixingFrame& frame, const Task& task) {
    const int width = box_.width(), height = box_.height();
    HalfPair next = result_;
    for (size_t m = 0; m < proposals.size(); ++m) {
      if (!taken[m]) continue;
      const HalfPair& candidate = (*proposals[m])(result_, box_, room_);
      for (size_t r = 0; r < regions_.size(); ++r) {
        const Plane& region = regions_[r].share;
        Plane share = make_plane(width, height, quiet(task), [&](int x, int y) {
          return best[r].of(x, y) == static_cast<int>(m) ? region(x, y) * best[r].share(x, y) : 0.0f;
        });
        if (!any_above_0(share)) continue;
        share = gaussian_blur(share, kShareWindow, task);
        const Plane around = gaussian_blur(region, kShareWindow, task);
        for_each_row(height, quiet(task), [&](int y) {
          for (int x = 0; x < width; ++x) {
            if (!(share(x, y) > 0) || !(region(x, y) > 0) || !(frame.weight(x, y) > 0)) continue;
            const float s = region(x, y) * share(x, y) / around(x, y);
            moved_(x, y) = 1;
            for (size_t c = 0; c < 3; ++c) {
              next.a[c](x, y) += s * (candidate.a[c](x, y) - result_.a[c](x, y));
              next.b[c](x, y) += s * (candidate.b[c](x, y) - result_.b[c](x, y));
            }
          }
        });
      }
    }
    return next;
  }

  /// The weight near tiles in which the last round gained enough, elsewhere 0; empty where there is no such tile.
  Plane worth_another_round(const std::vector<Best>& best, const MixingFrame& frame, double& usual_noise,
                            const Task& task) const {
    const Plane& weight = frame.weight;
    const int across = (weight.width() + kTile - 1) / kTile, down = (weight.height() + kTile - 1) / kTile;
    Plane gain(across, down), noise(across, down), near(across, down);
    parallel_for(down, quiet(task), [&](int tile) {
      for (int y = tile * kTile; y < std::min(weight.height(), (tile + 1) * kTile); ++y)
        for (int x = 0; x < weight.width(); ++x) {
          if (!(weight(x, y) > 0)) continue;
          float squares = 0;
          for (size_t c = 0; c < 3; ++c) {
            const float d = result_.a[c](x, y) - result_.b[c](x, y);
            squares += d * d / 12;
          }
          noise(x / kTile, tile) += weight(x, y) * squares;
          for (size_t r = 0; r < best.size(); ++r)
            gain(x / kTile, tile) += frame.regions[r].share(x, y) * best[r].gain(x, y);
        }
    });
    if (usual_noise < 0) {
      double sum = 0, tiles = 0;
      for (int y = 0; y < down; ++y)
        for (const float v : noise.pixels(y)) sum += v, tiles += v > 0;
      usual_noise = sum / std::max(tiles, 1.0);
    }
    bool any = false;
    for (int y = 0; y < down; ++y)
      for (int x = 0; x < across; ++x) {
        if (!(gain(x, y) > kWorthwhile * std::max(noise(x, y), static_cast<float>(usual_noise)))) continue;
        any = true;
        const Box box = Box{x, y, x + 1, y + 1}.grown(kTilesAround, across, down);
        for (int v = box.y0; v < box.y1; ++v) std::fill(near.row(v) + box.x0, near.row(v) + box.x1, 1.0f);
      }
    if (!any) return {};
    return make_plane(weight.width(), weight.height(), quiet(task),
                      [&](int x, int y) { return weight(x, y) * near(x / kTile, y / kTile); });
  }

  Box box_;
  HalfPair result_, data_, room_;
  Plane weight_, moved_;
  std::vector<MixingRegion> regions_;
};

/// Boxes of whole tiles around what is above 0, none of which overlap.
std::vector<Box> boxes_around(const Plane& weight) {
  const int across = (weight.width() + kTile - 1) / kTile, down = (weight.height() + kTile - 1) / kTile;
  std::vector<Box> boxes;  // in tiles
  for (int y = 0; y < down; ++y)
    for (int x = 0; x < across; ++x)
      if (any_above_0(weight, Box{x * kTile, y * kTile, std::min(weight.width(), (x + 1) * kTile),
                                  std::min(weight.height(), (y + 1) * kTile)})) {
        // Takes in the boxes that it touches, until it touches none.
        Box own{x, y, x + 1, y + 1};
        for (size_t i = 0; i < boxes.size();) {
          const Box& b = boxes[i];
          if (b.x0 > own.x1 || own.x0 > b.x1 || b.y0 > own.y1 || own.y0 > b.y1) {
            ++i;
            continue;
          }
          own = {std::min(own.x0, b.x0), std::min(own.y0, b.y0), std::max(own.x1, b.x1), std::max(own.y1, b.y1)};
          boxes.erase(boxes.begin() + static_cast<std::ptrdiff_t>(i));
          i = 0;
        }
        boxes.push_back(own);
      }
  for (Box& b : boxes)
    b = {b.x0 * kTile, b.y0 * kTile, std::min(weight.width(), b.x1 * kTile), std::min(weight.height(), b.y1 * kTile)};
  return boxes;
}

void paste(const HalfPair& part, const Box& box, HalfPair& to) {
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < box.height(); ++y) {
      std::copy_n(part.a[c].row(y), box.width(), to.a[c].row(box.y0 + y) + box.x0);
      std::copy_n(part.b[c].row(y), box.width(), to.b[c].row(box.y0 + y) + box.x0);
    }
}

}  // namespace

void mix(HalfPair& result, const std::vector<Proposal>& proposals, const LateProposal& late, const MixingFrame& frame,
         const Task& task) {
  std::vector<const Proposal*> all;
  for (const Proposal& p : proposals) all.push_back(&p);
  const Box whole_frame{0, 0, frame.weight.width(), frame.weight.height()};
  double usual_noise = -1;
  Plane worthwhile, moved;
  {
    MixedBox whole(whole_frame, std::move(result), {}, frame);
    worthwhile = whole.round(all, frame.weight, usual_noise, task);
    result = std::move(whole.result());
    moved = whole.moved();
  }
  if (worthwhile.empty()) return;
  for (const Box& box : boxes_around(worthwhile)) {
    MixedBox part(box, cut(result, box), crop(worthwhile, box), frame);
    std::vector<const Proposal*> own = all;
    const auto rounds = [&](int most) {
      Plane weight = part.weight();
      for (int round = 0; round < most && !weight.empty() && !own.empty(); ++round)
        weight = part.round(own, weight, usual_noise, task);
    };
    rounds(kRounds - 1);
    if (!late) {
      rounds(1);
      paste(part.result(), box, result);
      continue;
    }
    Plane wanted = make_plane(box.width(), box.height(), quiet(task), [&](int x, int y) {
      return part.weight()(x, y) > 0 && (part.moved()(x, y) > 0 || moved(box.x0 + x, box.y0 + y) > 0) ? 1.0f : 0.0f;
    });
    const HalfPair lines = late(box, wanted);
    const Proposal proposal = [&](const HalfPair&, const Box&, HalfPair&) -> const HalfPair& { return lines; };
    own = all;
    own.push_back(&proposal);
    rounds(kRounds);
    paste(part.result(), box, result);
  }
}

}  // namespace brume

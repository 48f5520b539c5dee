#include "filters/regression/transport/mixing.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <numeric>
#include <optional>

#include "base/math.h"
#include "base/parallel_for.h"
#include "filters/inputs/half_pair.h"
#include "filters/kernels/mixing.h"
#include "filters/kernels/rows.h"

namespace brume {
namespace {

// Deviations of the Gaussians over which gains are measured [px], each over means of blocks of so many pixels.
struct Window {
  double deviation;
  int block;
};
constexpr Window kWindows[] = {{3, 2}, {6, 4}, {12, 8}, {28, 16}};  // each block twice as wide as the one before
constexpr int kRounds = 3;                                          // after the first one
constexpr double kFirefly = 0.999;    // quantile of gains at which single pixels are cut: none decides alone
constexpr double kShareWindow = 1.5;  // over which shares are smoothed [px]
// Where a round gains less than this share of the noise in a tile of so many pixels, or of a tile's usual noise if that
// is more, there is no other, nor in those around it.
constexpr float kWorthwhile = 0.05f;
constexpr int kTile = 32, kTilesAround = 1;

/// Where pixels lie between the middles of blocks, linearly.
struct BlockPlaces {
  std::vector<int> first, second;
  std::vector<float> share;  // of the second

  BlockPlaces(int pixels, int block, int count) {
    for (int i = 0; i < pixels; ++i) {
      const float at = (static_cast<float>(i) + 0.5f) / static_cast<float>(block) - 0.5f;
      first.push_back(std::clamp(static_cast<int>(std::floor(at)), 0, count - 1));
      second.push_back(std::min(first.back() + 1, count - 1));
      share.push_back(std::clamp(at - static_cast<float>(first.back()), 0.0f, 1.0f));
    }
  }
  kernels::BlockPlaces view() const { return {first.data(), second.data(), share.data()}; }
  /// A row of blocks between two, for a row of pixels; whether any is above 0.
  bool row_between(const Plane& blocks, int y, std::vector<float>& row) const {
    const auto i = static_cast<size_t>(y);
    const float *top = blocks.row(first[i]), *bottom = blocks.row(second[i]);
    bool any = false;
    for (size_t x = 0; x < row.size(); ++x) {
      row[x] = top[x] + share[i] * (bottom[x] - top[x]);
      any |= row[x] > 0;
    }
    return any;
  }
};

kernels::HalfRows rows_of(const HalfPair& p, int x, int y) {
  const auto at = [&](const Plane& plane) { return plane.row(y) + x; };
  return {{at(p.a[0]), at(p.a[1]), at(p.a[2]), at(p.b[0]), at(p.b[1]), at(p.b[2])}};
}

/// What a step towards a candidate would change at each pixel: of its gain the part linear in the step, and of its loss
/// the part quadratic in it.
struct Step {
  Plane gain, loss;
  float most = 0;  ///< gains are cut at plus and minus this

  Step(const HalfPair& from, const HalfPair& to, const HalfPair& data, const Plane& weight, const Task& task)
      : gain(Plane::unset(weight.width(), weight.height())), loss(Plane::unset(weight.width(), weight.height())) {
    for_each_row(gain.height(), quiet(task), [&](int y) {
      kernels::step_row(rows_of(from, 0, y), rows_of(to, 0, y), rows_of(data, 0, y), weight.row(y), gain.row(y),
                        loss.row(y), gain.width());
    });
    most = largest_but_fireflies(task);
  }

 private:
  /// The quantile kFirefly of the gains' sizes, up to a hundredth of it: their bits are counted without the last ones.
  float largest_but_fireflies(const Task& task) const {
    constexpr int kDropped = 16, kRows = 256;
    std::vector<std::vector<uint32_t>> counts(static_cast<size_t>((gain.height() + kRows - 1) / kRows));
    parallel_for(static_cast<int>(counts.size()), quiet(task), [&](int strip) {
      std::vector<uint32_t>& count = counts[static_cast<size_t>(strip)];
      count.resize(1u << (32 - kDropped - 1));
      for (int y = strip * kRows; y < std::min(gain.height(), (strip + 1) * kRows); ++y)
        for (const float v : gain.pixels(y)) count[std::bit_cast<uint32_t>(std::abs(v)) >> kDropped] += v != 0;
    });
    for (size_t strip = 1; strip < counts.size(); ++strip)
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
  bool any_of(int taken, const Box& box) const {
    for (int y = box.y0; y < box.y1; ++y) {
      const int* const row = proposal.data() + static_cast<size_t>(y) * gain.width();
      if (std::find(row + box.x0, row + box.x1, taken) != row + box.x1) return true;
    }
    return false;
  }
};

/// What is averaged over windows (kernels/mixing.h), as means over blocks; what lies beyond the picture's edge counts
/// as nothing.
struct Measures {
  std::array<Plane, kernels::kMeasures> of;

  int width() const { return of[0].width(); }
  int height() const { return of[0].height(); }

  /// Over blocks of two by two pixels.
  Measures(const Step& step, const Plane& region, const Task& task)
      : Measures((region.width() + 1) / 2, (region.height() + 1) / 2) {
    fold(region.width(), region.height(), task, [&](int y, float* const* sums) {
      kernels::measure_row(region.row(y), step.gain.row(y), step.loss.row(y), step.most, sums, region.width());
    });
  }
  /// Over blocks twice as wide.
  Measures(const Measures& fine, const Task& task) : Measures((fine.width() + 1) / 2, (fine.height() + 1) / 2) {
    fold(fine.width(), fine.height(), task, [&](int y, float* const* sums) {
      for (size_t i = 0; i < kernels::kMeasures; ++i) {
        const float* const row = fine.of[i].row(y);
        for (int x = 0; x < fine.width(); ++x) sums[i][x] += row[x];
      }
    });
  }
  Measures blurred(double deviation, const Task& task) const {
    Measures out(0, 0);
    for (size_t i = 0; i < kernels::kMeasures; ++i) out.of[i] = gaussian_blur(of[i], deviation, task);
    return out;
  }

 private:
  Measures(int width, int height) {
    for (Plane& plane : of) plane = Plane::unset(width, height);
  }
  /// @param columns, rows  of a finer grid    @param add  called as add(y, sums) for two of these rows
  template <class Add>
  void fold(int columns, int rows, const Task& task, const Add& add) {
    parallel_for((height() + kRowsPerTask - 1) / kRowsPerTask, quiet(task), [&](int band) {
      Plane room(columns + 1, static_cast<int>(kernels::kMeasures));
      std::array<float*, kernels::kMeasures> sums;
      for (size_t i = 0; i < kernels::kMeasures; ++i) sums[i] = room.row(static_cast<int>(i));
      for (int block = band * kRowsPerTask; block < std::min(height(), (band + 1) * kRowsPerTask); ++block) {
        room.fill(0);
        for (int y = 2 * block; y < std::min(rows, 2 * block + 2); ++y) add(y, sums.data());
        for (size_t i = 0; i < kernels::kMeasures; ++i) kernels::halve_row(sums[i], 0.25f, of[i].row(block), width());
      }
    });
  }
};

/// What a step is sure to gain, and its best length, at each block.
struct SureGain {
  Plane gain, share;
  std::atomic<bool> any = false;

  SureGain(const Measures& m, double sure, double pixels, const Task& task)
      : gain(Plane::unset(m.width(), m.height())), share(Plane::unset(m.width(), m.height())) {
    for_each_row(gain.height(), quiet(task), [&](int y) {
      std::array<const float*, kernels::kMeasures> means;
      for (size_t i = 0; i < means.size(); ++i) means[i] = m.of[i].row(y);
      if (kernels::sure_row(means.data(), static_cast<float>(sure), static_cast<float>(pixels), gain.row(y),
                            share.row(y), gain.width()))
        any = true;
    });
  }
};

void consider(int proposal, const Step& step, const MixingRegion& region, Best& best, const Task& task) {
  Measures measures(step, region.share, task);
  const int width = region.share.width(), height = region.share.height();
  for (const Window& window : kWindows) {
    if (window.block > 2) measures = Measures(measures, task);
    const double s = window.deviation;
    // So many pixels count as much as the window.
    const SureGain sure(measures.blurred(s / window.block, task), region.sure, 4 * kPi * s * s, task);
    if (!sure.any) continue;
    const BlockPlaces along(width, window.block, sure.gain.width()), down(height, window.block, sure.gain.height());
    for_each_row(height, quiet(task), [&](int y) {
      std::vector<float> gains(static_cast<size_t>(sure.gain.width())), shares(gains.size());
      if (!down.row_between(sure.gain, y, gains)) return;
      down.row_between(sure.share, y, shares);
      kernels::take_row(along.view(), gains.data(), shares.data(), region.share.row(y), proposal, best.gain.row(y),
                        best.share.row(y), &best.of(0, y), width);
    });
  }
}

/// Smooths shares over a few pixels, a tile of the picture at a time.
class TileBlur {
 public:
  static constexpr int kWidth = 64, kHeight = 16, kRadius = 5;  // of tiles; 3 deviations

  TileBlur() : rows_(kWidth + 2 * kRadius, kHeight + 2 * kRadius), wide_(kWidth + 2 * kRadius, 1) {
    for (int j = -kRadius; j <= kRadius; ++j) {
      taps_.push_back(static_cast<float>(std::exp(-j * j / (2 * kShareWindow * kShareWindow))));
      along_.push_back(wide_.row(0) + kRadius + j);
    }
  }
  /// Calls made(y, blurred) for each row of a tile; sums of the taps times value(x, y), which is 0 outside of the
  /// picture.
  template <class Value, class Made>
  void run(const Box& tile, int width, int height, const Value& value, const Made& made) {
    const int r = kRadius;
    rows_.fill(0);
    const Box from = tile.grown(r, width, height);
    for (int y = from.y0; y < from.y1; ++y)
      for (int x = from.x0; x < from.x1; ++x) rows_(x - tile.x0 + r, y - tile.y0 + r) = value(x, y);
    std::array<const float*, 2 * kRadius + 1> down;
    float blurred[kWidth];
    for (int y = tile.y0; y < tile.y1; ++y) {
      for (int j = 0; j <= 2 * r; ++j) down[static_cast<size_t>(j)] = rows_.row(y - tile.y0 + j);
      kernels::weighted_sum_rows(down.data(), taps_.data(), 2 * r + 1, wide_.row(0), kWidth + 2 * r);
      kernels::weighted_sum_rows(along_.data(), taps_.data(), 2 * r + 1, blurred, tile.width());
      made(y, blurred);
    }
  }

 private:
  Plane rows_, wide_;
  std::vector<float> taps_;
  std::vector<const float*> along_;
};

/// Calls visit(tile, index) for every tile of a picture, on the task's threads.
template <class Visit>
void for_each_tile(int width, int height, const Task& task, const Visit& visit) {
  const int across = (width + TileBlur::kWidth - 1) / TileBlur::kWidth,
            down = (height + TileBlur::kHeight - 1) / TileBlur::kHeight;
  parallel_for(across * down, quiet(task), [&](int i) {
    const int x0 = i % across * TileBlur::kWidth, y0 = i / across * TileBlur::kHeight;
    visit(Box{x0, y0, std::min(width, x0 + TileBlur::kWidth), std::min(height, y0 + TileBlur::kHeight)}, i);
  });
}

/// A box of the frame while steps are taken in it.
class MixedBox {
 public:
  /// @param result  within the box    @param weight  of squared errors, within the box
  MixedBox(const Box& box, HalfPair result, Plane weight, const MixingFrame& frame, const Task& task)
      : box_(box), result_(std::move(result)), weight_(std::move(weight)), moved_(box.width(), box.height()) {
    const auto part = [&](const Plane& of) { return Plane::view(of, box.x0, box.y0, box.width(), box.height()); };
    for (size_t c = 0; c < 3; ++c) {
      data_.a[c] = part(*frame.half_a[c]);
      data_.b[c] = part(*frame.half_b[c]);
    }
    for (const MixingRegion& region : frame.regions) {
      MixingRegion here{part(region.share), region.sure};
      if (!is_weighed(here.share)) continue;
      spread_.push_back(spread_of(here.share, task));
      regions_.push_back(std::move(here));
    }
  }
  HalfPair& result() { return result_; }
  /// 1 where the result was moved, elsewhere 0.
  const Plane& moved() const { return moved_; }

  /// Takes the best steps once, and leaves only candidates that were taken.
  /// @param usual_noise  of a tile; found where it is below 0
  /// @return  the weight where another round may be worth its time, elsewhere 0; empty: nowhere
  Plane round(std::vector<const Proposal*>& proposals, double& usual_noise, const Task& task) {
    const std::vector<Best> best = best_steps(proposals, task);
    Plane next = worth_another_round(best, usual_noise, task);
    std::vector<bool> taken(proposals.size());
    for (const Best& b : best)
      for (const int m : b.proposal)
        if (m >= 0) taken[static_cast<size_t>(m)] = true;
    result_ = moved_by(best, taken, proposals, task);
    std::vector<const Proposal*> left;
    for (size_t m = 0; m < proposals.size(); ++m)
      if (taken[m]) left.push_back(proposals[m]);
    proposals = std::move(left);
    return next;
  }

 private:
  bool is_weighed(const Plane& share) const {
    for (int y = 0; y < share.height(); ++y)
      for (int x = 0; x < share.width(); ++x)
        if (share(x, y) > 0 && weight_(x, y) > 0) return true;
    return false;
  }
  /// The best step for each pixel, region by region.
  std::vector<Best> best_steps(const std::vector<const Proposal*>& proposals, const Task& task) {
    std::vector<Best> best(regions_.size(), Best(box_.width(), box_.height()));
    for (size_t m = 0; m < proposals.size(); ++m) {
      task.check();
      const Step step(result_, (*proposals[m])(result_, box_, room_), data_, weight_, task);
      for (size_t r = 0; r < regions_.size(); ++r) consider(static_cast<int>(m), step, regions_[r], best[r], task);
    }
    return best;
  }

  /// A region's share over the sum of its neighbours': what blurred shares are multiplied by to stay within the region.
  static Plane spread_of(const Plane& region, const Task& task) {
    Plane spread = Plane::unset(region.width(), region.height());
    for_each_tile(region.width(), region.height(), task, [&](const Box& tile, int) {
      TileBlur().run(
          tile, region.width(), region.height(), [&](int x, int y) { return region(x, y); },
          [&](int y, const float* around) {
            for (int x = tile.x0; x < tile.x1; ++x)
              spread(x, y) = region(x, y) > 0 ? region(x, y) / around[x - tile.x0] : 0.0f;
          });
    });
    return spread;
  }

  /// Takes the steps, each region by itself, with shares that are smooth over a few pixels.
  HalfPair moved_by(const std::vector<Best>& best, const std::vector<bool>& taken,
                    const std::vector<const Proposal*>& proposals, const Task& task) {
    const int width = box_.width(), height = box_.height();
    HalfPair next = result_;
    for (size_t m = 0; m < proposals.size(); ++m) {
      if (!taken[m]) continue;
      const HalfPair& candidate = (*proposals[m])(result_, box_, room_);
      const auto proposal = static_cast<int>(m);
      for_each_tile(width, height, task, [&](const Box& tile, int) {
        std::optional<TileBlur> blur;
        for (size_t r = 0; r < regions_.size(); ++r) {
          if (!best[r].any_of(proposal, tile.grown(TileBlur::kRadius, width, height))) continue;
          if (!blur) blur.emplace();
          blur->run(
              tile, width, height,
              [&](int x, int y) {
                return best[r].of(x, y) == proposal ? regions_[r].share(x, y) * best[r].share(x, y) : 0.0f;
              },
              [&](int y, const float* share) {
                float* const result[] = {next.a[0].row(y) + tile.x0, next.a[1].row(y) + tile.x0,
                                         next.a[2].row(y) + tile.x0, next.b[0].row(y) + tile.x0,
                                         next.b[1].row(y) + tile.x0, next.b[2].row(y) + tile.x0};
                kernels::move_row(share, spread_[r].row(y) + tile.x0, weight_.row(y) + tile.x0,
                                  rows_of(result_, tile.x0, y), rows_of(candidate, tile.x0, y), result,
                                  moved_.row(y) + tile.x0, tile.width());
              });
        }
      });
    }
    return next;
  }

  /// The weight near tiles in which the last round gained enough, elsewhere 0; empty where there is no such tile.
  Plane worth_another_round(const std::vector<Best>& best, double& usual_noise, const Task& task) const {
    const int across = (weight_.width() + kTile - 1) / kTile, down = (weight_.height() + kTile - 1) / kTile;
    Plane gain(across, down), noise(across, down), near(across, down);
    parallel_for(down, quiet(task), [&](int tile) {
      for (int y = tile * kTile; y < std::min(weight_.height(), (tile + 1) * kTile); ++y)
        for (int x = 0; x < weight_.width(); ++x) {
          if (!(weight_(x, y) > 0)) continue;
          float squares = 0;
          for (size_t c = 0; c < 3; ++c) {
            const float d = result_.a[c](x, y) - result_.b[c](x, y);
            squares += d * d / 12;
          }
          noise(x / kTile, tile) += weight_(x, y) * squares;
          for (size_t r = 0; r < best.size(); ++r)
            gain(x / kTile, tile) += regions_[r].share(x, y) * best[r].gain(x, y);
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
    return make_plane(weight_.width(), weight_.height(), quiet(task),
                      [&](int x, int y) { return weight_(x, y) * near(x / kTile, y / kTile); });
  }

  Box box_;
  HalfPair result_, data_, room_;
  Plane weight_, moved_;
  std::vector<MixingRegion> regions_;
  std::vector<Plane> spread_;
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

Box shifted(const Box& box, int x, int y) {
  return {box.x0 + x, box.y0 + y, box.x1 + x, box.y1 + y};
}

/// Rounds within boxes of the frame.
struct Rounds {
  const MixingFrame& frame;
  const Task& task;
  HalfPair& result;
  double usual_noise = -1;

  /// One round within a box, and others in boxes around what that leaves to be done.
  /// @param weight  within the box
  void run(const Box& box, const Plane& weight, std::vector<const Proposal*> proposals, int rounds) {
    MixedBox part(box, cut(result, box), weight, frame, task);
    const Plane left = part.round(proposals, usual_noise, task);
    paste(part.result(), box, result);
    if (rounds == 1 || left.empty()) return;
    for (const Box& b : boxes_around(left)) run(shifted(b, box.x0, box.y0), crop(left, b), proposals, rounds - 1);
  }
};

}  // namespace

void mix(HalfPair& result, const std::vector<Proposal>& proposals, const LateProposal& late, const MixingFrame& frame,
         const Task& task) {
  std::vector<const Proposal*> all;
  for (const Proposal& p : proposals) all.push_back(&p);
  Rounds rounds{frame, task, result};
  Plane left, moved;
  {
    MixedBox whole({0, 0, frame.weight.width(), frame.weight.height()}, std::move(result), frame.weight, frame, task);
    left = whole.round(all, rounds.usual_noise, task);
    result = std::move(whole.result());
    moved = whole.moved();
  }
  if (left.empty()) return;
  for (const Box& box : boxes_around(left)) {
    const Plane weight = crop(left, box);
    std::vector<const Proposal*> own = all;
    HalfPair lines;
    const Proposal proposal = [&](const HalfPair&, const Box& part, HalfPair& room) -> const HalfPair& {
      return room = cut(lines, shifted(part, -box.x0, -box.y0));
    };
    if (late) {
      lines = late(box, make_plane(box.width(), box.height(), quiet(task), [&](int x, int y) {
                     return weight(x, y) > 0 && moved(box.x0 + x, box.y0 + y) > 0 ? 1.0f : 0.0f;
                   }));
      own.push_back(&proposal);
    }
    rounds.run(box, weight, own, kRounds);
  }
}

}  // namespace brume

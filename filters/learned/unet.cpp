#include "filters/learned/unet.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>
#include <string>

#include "base/error.h"
#include "base/lazy_zeros.h"
#include "base/parallel_for.h"
#include "filters/kernels/convolution.h"
#include "filters/learned/tza.h"

namespace brume {
namespace {

using kernels::kBeyond, kernels::kBlock;

constexpr int kLevels = 5;                 // full size, a half, ..., a sixteenth
constexpr int kUnit = 1 << (kLevels - 1);  // sizes are multiples of it [px]
// A pixel depends on those up to 94 px away in the large network, 80 in the others: 16 times the two layers at the
// bottom, twice 8, 4 and 2 times those of each level above, and those at full size.
constexpr int kOverlap = 96;

constexpr int blocks_of(int channels) {
  return (channels + kBlock - 1) / kBlock;
}

/// Channels of a picture, kBlock of them side by side, or all where they are fewer, with a pixel of zeros around.
struct FeatureMap {
  int channels, width, height;
  int pixel = kBlock;  ///< floats
  float* data = nullptr;

  size_t row_stride() const { return static_cast<size_t>((width + 2 + 2 * kBeyond) * pixel); }
  size_t block_stride() const { return static_cast<size_t>(height + 2) * row_stride(); }
  /// What is read past the last row's end lies within.
  size_t size() const { return static_cast<size_t>(blocks_of(channels)) * block_stride() + 2 * kBeyond * kBlock; }
  float* at(int block, int x, int y) const {
    return data + static_cast<size_t>(block) * block_stride() + static_cast<size_t>(y + 1) * row_stride() +
           static_cast<ptrdiff_t>(x + 1) * pixel;
  }
  void clear(int block, int x, int y, int pixels = 1) const {
    std::fill_n(at(block, x, y), static_cast<size_t>(pixels * pixel), 0.0f);
  }
};

/// 3 x 3 taps over one picture, or over two of which the first has half the size and stands for one whose pixels are
/// repeated. Of three taps in a row, two then fall on one pixel of the half size; their weights are added beforehand,
/// which saves five of nine multiplications.
class Convolution {
 public:
  /// @param halved  channels of the source of half the size, which come first; 0: there is none
  Convolution(const Tensor& weight, const Tensor& bias, int halved)
      : inputs_(weight.sizes[1]), outputs_(weight.sizes[0]), halved_(halved), bias_(bias.values) {
    bias_.resize(static_cast<size_t>(blocks()) * kBlock);
    std::vector<Matrix> matrices;
    for (int c = 0; c < inputs_;) {
      const bool half = c < halved;
      const int end = std::min(c + kBlock, half ? halved : inputs_);
      const int block = (c - (half ? 0 : halved)) / kBlock;
      half ? add_halved(block, c, end, matrices) : add_plain(block, c, end, matrices);
      c = end;
    }
    stride_ = matrices.size() * kBlock * kBlock;
    weights_.resize(static_cast<size_t>(blocks()) * stride_);
    for (int o = 0; o < outputs_; ++o)
      for (size_t m = 0; m < matrices.size(); ++m)
        for (int c = matrices[m].begin; c < matrices[m].end; ++c) {
          float& sum = weights_[static_cast<size_t>(o / kBlock) * stride_ +
                                (m * kBlock + static_cast<size_t>(c - matrices[m].begin)) * kBlock +
                                static_cast<size_t>(o % kBlock)];
          for (const int tap : matrices[m].taps) sum += weight.values[static_cast<size_t>((o * inputs_ + c) * 9 + tap)];
        }
  }

  int outputs() const { return outputs_; }
  int blocks() const { return blocks_of(outputs_); }
  bool doubles() const { return halved_ > 0; }
  /// Multiplications for each pixel.
  double cost() const { return outputs_ * (9.0 * (inputs_ - halved_) + 4.0 * halved_); }

  /// One row of the result.
  /// @param sources  as declared: the half size first
  /// @param out      of the first pixel's first block, out_stride floats before that of the next
  void make_row(const std::vector<FeatureMap>& sources, int y, float lowest, float* out, size_t out_stride) const {
    const int phases = doubles() ? 2 : 1;
    std::vector<kernels::Tap> taps;
    for (int px = 0; px < phases; ++px) {
      taps.clear();
      for (const PackedTap& tap : taps_[doubles() ? static_cast<size_t>(2 * (y % 2) + px) : 0]) {
        const FeatureMap& source = sources[tap.half ? 0 : sources.size() - 1];
        taps.push_back({source.at(tap.block, tap.offset.x, (tap.half ? y / 2 : y) + tap.offset.y),
                        (tap.half ? 1 : phases) * source.pixel, weights_.data() + tap.matrix * kBlock * kBlock,
                        tap.inputs});
      }
      kernels::convolve_row({taps.data(), taps.size(), bias_.data(), out + px * kBlock,
                             static_cast<ptrdiff_t>(phases) * kBlock, blocks(), static_cast<ptrdiff_t>(out_stride),
                             static_cast<ptrdiff_t>(stride_), sources.back().width / phases, lowest});
    }
  }

 private:
  /// Weights of some inputs: the sum of those of some of the 3 x 3 taps.
  struct Matrix {
    int begin, end;
    std::vector<int> taps;
  };
  struct PackedTap {
    bool half;
    int block;
    ivec2 offset;
    size_t matrix;
    int inputs;
  };

  void add_plain(int block, int begin, int end, std::vector<Matrix>& matrices) {
    for (int tap = 0; tap < 9; ++tap) {
      for (int phase = 0; phase < (doubles() ? 4 : 1); ++phase)
        taps_[static_cast<size_t>(phase)].push_back(
            {false, block, {tap % 3 - 1 + phase % 2, tap / 3 - 1}, matrices.size(), end - begin});
      matrices.push_back({begin, end, {tap}});
    }
  }
  void add_halved(int block, int begin, int end, std::vector<Matrix>& matrices) {
    // Which of the three taps of an even or odd pixel fall on the first, and on the second, of two neighbours.
    static const std::vector<int> kFalls[2][2] = {{{0}, {1, 2}}, {{0, 1}, {2}}};
    for (int phase = 0; phase < 4; ++phase)
      for (int side = 0; side < 4; ++side) {
        const ivec2 odd(phase % 2, phase / 2), second(side % 2, side / 2);
        taps_[static_cast<size_t>(phase)].push_back({true, block, odd + second - 1, matrices.size(), end - begin});
        Matrix& sum = matrices.emplace_back(Matrix{begin, end, {}});
        for (const int ky : kFalls[odd.y][second.y])
          for (const int kx : kFalls[odd.x][second.x]) sum.taps.push_back(3 * ky + kx);
      }
  }

  int inputs_, outputs_, halved_;
  std::vector<float> bias_, weights_;
  size_t stride_ = 0;  // floats of a block of outputs
  // For even and odd columns, in even and odd rows, where there are two sources.
  std::array<std::vector<PackedTap>, 4> taps_;
};

/// Where the steps of a network leave their results: `input`, what is kept of each level for the way up, and two
/// others.
enum Slot { kInput, kLevel1, kLevel2, kLevel3, kLevel4, kFirst, kSecond, kSlots, kNone };

struct Step {
  Convolution convolution;
  Slot from, beside, to;  ///< beside: the second source
  bool pools;             ///< the largest of 2 x 2 pixels is left
  float lowest;
};

/// A step as it is declared.
struct Kind {
  Slot beside = kNone;
  bool pools = false, rectified = true;
};

// Zeros around a map.
void clear_above_and_below(const FeatureMap& map) {
  for (int b = 0; b < blocks_of(map.channels); ++b)
    for (const int y : {-1, map.height}) map.clear(b, -1, y, map.width + 2);
}
void clear_left_and_right(const FeatureMap& map, int y) {
  for (int b = 0; b < blocks_of(map.channels); ++b)
    for (const int x : {-1, map.width}) map.clear(b, x, y);
}

/// The part of a picture from `origin` on, its planes as channels, zeros beyond its edges.
void load(const std::vector<const Plane*>& in, ivec2 origin, const FeatureMap& to, const Task& task) {
  clear_above_and_below(to);
  parallel_for(to.height, quiet(task), [&](int y) {
    to.clear(0, -1, y, to.width + 2);
    if (origin.y + y >= in[0]->height()) return;
    for (size_t c = 0; c < in.size(); ++c)
      for (int x = 0; x < std::min(to.width, in[c]->width() - origin.x); ++x)
        to.at(0, x, y)[c] = (*in[c])(origin.x + x, origin.y + y);
  });
}

/// A row of the largest of 2 x 2 pixels each.
void pool_row(const Step& step, const std::vector<FeatureMap>& sources, const FeatureMap& to, int y) {
  thread_local std::vector<float> rows[2];
  const size_t stride = static_cast<size_t>(2 * to.width + kBeyond) * kBlock;
  for (int i = 0; i < 2; ++i) {
    rows[i].resize(static_cast<size_t>(step.convolution.blocks()) * stride);
    step.convolution.make_row(sources, 2 * y + i, step.lowest, rows[i].data(), stride);
  }
  for (int b = 0; b < step.convolution.blocks(); ++b) {
    const float* above = rows[0].data() + static_cast<size_t>(b) * stride;
    const float* below = rows[1].data() + static_cast<size_t>(b) * stride;
    float* out = to.at(b, 0, y);
    for (int x = 0; x < to.width; ++x, above += 2 * kBlock, below += 2 * kBlock, out += kBlock)
      for (int c = 0; c < kBlock; ++c)
        out[c] = std::max(std::max(above[c], above[c + kBlock]), std::max(below[c], below[c + kBlock]));
  }
}

void run_step(const Step& step, const std::vector<FeatureMap>& sources, const FeatureMap& to, const Task& task) {
  clear_above_and_below(to);
  parallel_for(to.height, task, [&](int y) {
    if (step.pools)
      pool_row(step, sources, to, y);
    else
      step.convolution.make_row(sources, y, step.lowest, to.at(0, 0, y), to.block_stride());
    clear_left_and_right(to, y);
  });
}

}  // namespace

struct Unet::Network {
  std::vector<Step> steps;
  std::array<int, kSlots> channels{};  ///< of what a slot holds at the moment
  int inputs;

  Network(const std::filesystem::path& path, int channels_read)
      : inputs(channels_read), tensors_(read_tza(path)), path_(path) {
    const bool large = tensors_.contains("enc_conv1b.weight");
    channels[kInput] = inputs;
    const Slot kept[] = {kInput, kLevel1, kLevel2, kLevel3, kLevel4};
    if (!large) add("enc_conv0", kInput, kFirst);
    for (int i = 1; i < kLevels; ++i) {
      const std::string name = fmt::format("enc_conv{}", i);
      const Slot from = i == 1 && !large ? kFirst : kept[i - 1];
      if (large) add(name + "a", from, kFirst);
      add(name + (large ? "b" : ""), large ? kFirst : from, kept[i], {.pools = true});
    }
    add("enc_conv5a", kLevel4, kFirst);
    add("enc_conv5b", kFirst, kSecond);
    for (int i = kLevels - 1; i > 0; --i) {
      add(fmt::format("dec_conv{}a", i), kSecond, kFirst, {.beside = kept[i - 1]});
      add(fmt::format("dec_conv{}b", i), kFirst, kSecond);
    }
    add(large ? "dec_conv1c" : "dec_conv0", kSecond, kFirst, {.rectified = large});
    if (channels[kFirst] != 3) fail(fmt::format("makes {} channels; expected 3", channels[kFirst]));
    tensors_.clear();
  }

  FeatureMap input(int width, int height) const { return {inputs, width, height, inputs}; }

  /// The maps that a step reads and writes, without data.
  /// @param width, height  of the network's input
  template <class Visit>
  void for_each_step(int width, int height, const Visit& visit) const {
    std::array<FeatureMap, kSlots> maps{};
    maps[kInput] = input(width, height);
    for (const Step& step : steps) {
      const FeatureMap& from = maps[step.from];
      FeatureMap to{step.convolution.outputs(), from.width, from.height};
      if (step.convolution.doubles()) to.width *= 2, to.height *= 2;
      if (step.pools) to.width /= 2, to.height /= 2;
      visit(step, maps, to);
      maps[step.to] = to;
    }
  }

  /// Floats of each slot.
  std::array<size_t, kSlots> sizes(int width, int height) const {
    std::array<size_t, kSlots> sizes{};
    sizes[kInput] = input(width, height).size();
    for_each_step(width, height, [&](const Step& step, const auto&, const FeatureMap& to) {
      sizes[step.to] = std::max(sizes[step.to], to.size());
    });
    return sizes;
  }
  double bytes(int width, int height) const {
    double sum = 0;
    for (const size_t size : sizes(width, height)) sum += sizeof(float) * static_cast<double>(size);
    return sum;
  }

  using Memory = std::array<std::vector<float, LazyZeros<float>>, kSlots>;

  /// @return the last step's result
  FeatureMap evaluate(const std::vector<const Plane*>& in, const Box& tile, Memory& memory, const Task& task) const {
    const std::array<size_t, kSlots> floats = sizes(tile.width(), tile.height());
    for (size_t i = 0; i < kSlots; ++i)
      if (memory[i].size() < floats[i]) memory[i] = std::vector<float, LazyZeros<float>>(floats[i]);
    double all = 0, done = 0;
    const auto work = [](const Step& step, const FeatureMap& to) {
      return step.convolution.cost() * to.width * to.height * (step.pools ? 4 : 1);
    };
    for_each_step(tile.width(), tile.height(),
                  [&](const Step& step, const auto&, const FeatureMap& to) { all += work(step, to); });
    FeatureMap last{};
    for_each_step(tile.width(), tile.height(), [&](const Step& step, auto& maps, FeatureMap& to) {
      for (size_t i = 0; i < kSlots; ++i) maps[i].data = memory[i].data();
      to.data = memory[step.to].data();
      if (done == 0) load(in, {tile.x0, tile.y0}, maps[kInput], task);
      std::vector<FeatureMap> sources = {maps[step.from]};
      if (step.beside != kNone) sources.push_back(maps[step.beside]);
      const double before = done;
      done += work(step, to);
      run_step(step, sources, to, share(task, before / all, done / all));
      last = to;
    });
    return last;
  }

 private:
  [[noreturn]] void fail(const std::string& why) const { throw InputError(fmt::format("{}: {}", path_.string(), why)); }

  void add(const std::string& name, Slot from, Slot to, const Kind& kind = {}) {
    const auto find = [&](const std::string& array) -> const Tensor& {
      const auto found = tensors_.find(array);
      if (found == tensors_.end())
        fail(fmt::format("has no array '{}': expected a network of Open Image Denoise 2", array));
      return found->second;
    };
    const Tensor &weight = find(name + ".weight"), &bias = find(name + ".bias");
    const int read = channels[from] + (kind.beside == kNone ? 0 : channels[kind.beside]);
    if (weight.layout != "oihw" || weight.sizes[1] != read || weight.sizes[2] != 3 || weight.sizes[3] != 3)
      fail(fmt::format("array '{}.weight' is {} ({}); expected 3 x 3 taps of {} inputs", name,
                       fmt::join(weight.sizes, " x "), weight.layout, read));
    if (bias.sizes != std::vector<int>{weight.sizes[0]})
      fail(fmt::format("array '{}.bias' is {}; expected {}", name, fmt::join(bias.sizes, " x "), weight.sizes[0]));
    steps.push_back({Convolution(weight, bias, kind.beside == kNone ? 0 : channels[from]), from, kind.beside, to,
                     kind.pools, kind.rectified ? 0 : std::numeric_limits<float>::lowest()});
    channels[to] = weight.sizes[0];
  }

  std::map<std::string, Tensor> tensors_;  // while it is built
  std::filesystem::path path_;
};

Unet::Unet(const std::filesystem::path& weights, int inputs)
    : network_(std::make_unique<const Network>(weights, inputs)) {}

Unet::~Unet() = default;

Rgb Unet::evaluate(const std::vector<const Plane*>& in, const Task& task, double memory) const {
  const auto whole_units = [](int pixels) { return (pixels + kUnit - 1) / kUnit * kUnit; };
  const int width = in[0]->width(), height = in[0]->height(), padded_width = whole_units(width),
            padded_height = whole_units(height);
  int across = 1, down = 1;
  Box inner{0, 0, padded_width, padded_height}, outer = inner;
  // The longer side is cut until a tile fits, or none can be smaller.
  while (network_->bytes(outer.width(), outer.height()) > memory && std::max(inner.width(), inner.height()) > kUnit) {
    ++(inner.width() >= inner.height() ? across : down);
    inner = {0, 0, whole_units((padded_width + across - 1) / across), whole_units((padded_height + down - 1) / down)};
    outer = {0, 0, std::min(padded_width, inner.width() + 2 * kOverlap),
             std::min(padded_height, inner.height() + 2 * kOverlap)};
  }
  across = (padded_width + inner.width() - 1) / inner.width();
  down = (padded_height + inner.height() - 1) / inner.height();

  Rgb out{Plane::unset(width, height), Plane::unset(width, height), Plane::unset(width, height)};
  Network::Memory of_maps;
  for (int i = 0; i < across * down; ++i) {
    const int x = i % across * inner.width(), y = i / across * inner.height();
    const Box own{x, y, std::min(x + inner.width(), padded_width), std::min(y + inner.height(), padded_height)};
    const Box tile = own.grown(kOverlap, padded_width, padded_height);
    const double tiles = across * down;
    const FeatureMap result = network_->evaluate(in, tile, of_maps, share(task, i / tiles, (i + 1) / tiles));
    for (size_t c = 0; c < 3; ++c)
      for (int py = y; py < std::min(own.y1, height); ++py)
        for (int px = x; px < std::min(own.x1, width); ++px)
          out[c](px, py) = result.at(0, px - tile.x0, py - tile.y0)[c];
  }
  return out;
}

}  // namespace brume

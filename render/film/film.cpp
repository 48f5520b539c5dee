#include "render/film/film.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <limits>

#include "base/error.h"
#include "base/parallel_for.h"

namespace brume {
namespace {

size_t groups_of(const LayerRequest& request) {
  return request.buckets ? 8 : request.statistics ? 2 : 1;
}

size_t offset_of(const LayerName& name) {
  for (const RecordedLayer& l : recordable_layers())
    if (l.name == name) return l.offset;
  return 0;  // the beauty comes first
}

constexpr size_t kOwnValues = sizeof(PathSample) / sizeof(double);  // what follows them is of PathSample::groups

constexpr size_t kTransmitted = offsetof(PathSample, transmitted) / sizeof(double);

// Every value of a frame: the beauty, direct and indirect whose stored sum it is, what alpha is short of 1, what is
// asked for.
std::vector<size_t> value_offsets(const LayerRequest& request) {
  std::vector<size_t> offsets;
  const auto add = [&](const LayerName& name) {
    for (size_t c = 0; c < name.channels.size(); ++c) offsets.push_back(offset_of(name) + c);
  };
  add(layer::beauty);
  add(layer::direct);
  add(layer::indirect);
  offsets.push_back(kTransmitted);
  for (const RecordedLayer& l : recordable_layers())
    if (request.has(l.name) && !(l.name == layer::direct) && !(l.name == layer::indirect)) add(l.name);
  for (const LayerRequest::GroupLayer& layer : request.group_layers())
    for (size_t c = 0; c < 3; ++c) offsets.push_back(kOwnValues + layer.offset + c);
  return offsets;
}

size_t state_doubles(const LayerRequest& request) {
  return PixelSums(value_offsets(request).size(), groups_of(request), request.statistics).doubles();
}

std::string state_channel(size_t word) {
  return fmt::format("state.{:04d}", word);
}

}  // namespace

Film::Film(int width, int height, const LayerRequest& request)
    : width_(width),
      height_(height),
      tiles_((width + kTile - 1) / kTile, (height + kTile - 1) / kTile),
      request_(request),
      layers_(width, height),
      offsets_(value_offsets(request)),
      sums_(offsets_.size(), groups_of(request), request.statistics),
      state_(static_cast<size_t>(tiles_.x) * tiles_.y) {
  record(layer::beauty, 0);
  record(layer::alpha, kTransmitted, true);
  for (const RecordedLayer& l : recordable_layers())
    if (request.has(l.name)) record(l.name, l.offset);
  for (const LayerRequest::GroupLayer& layer : request.group_layers())
    record({layer.name, layer::beauty.channels, ""}, kOwnValues + layer.offset);
  own_values_ =
      static_cast<size_t>(std::count_if(offsets_.begin(), offsets_.end(), [](size_t o) { return o < kOwnValues; }));
  beauty_ = layers_.add_rgb(layer::beauty);
  for (size_t v = 0; v < offsets_.size(); ++v) {
    if (offsets_[v] == offset_of(layer::direct)) direct_ = v;
    if (offsets_[v] == offset_of(layer::indirect)) indirect_ = v;
  }
  sample_count_ = &layers_.add(layer::sample_count.channel(0));
  invalid_count_ = &layers_.add(layer::invalid_count.channel(0));
}

void Film::record(const LayerName& name, size_t offset, bool complement) {
  for (size_t i = 0; i < name.channels.size(); ++i) {
    const auto plane = [&](std::string_view which) { return &layers_.add(name.channel_of(which, i)); };
    Target target{};
    target.mean = plane("");
    if (request_.statistics) {
      target.mean_variance = plane(statistic::mean_variance);
      target.half_a = plane(statistic::half_a);
      target.half_b = plane(statistic::half_b);
    }
    if (request_.buckets)
      for (const std::string_view bucket : statistic::buckets) target.buckets.push_back(plane(bucket));
    target.value = static_cast<size_t>(std::find(offsets_.begin(), offsets_.end(), offset + i) - offsets_.begin());
    target.complement = complement;
    targets_.push_back(std::move(target));
  }
}

Film::Bounds Film::bounds(int tile) const {
  const int x0 = tile % tiles_.x * kTile, y0 = tile / tiles_.x * kTile;
  return {x0, y0, std::min(x0 + kTile, width_), std::min(y0 + kTile, height_)};
}

void Film::drop(int tile) {
  TileState& state = state_[static_cast<size_t>(tile)];
  TileState done;
  done.taken = state.taken;
  done.developed = state.developed;
  state = std::move(done);  // a vector that is assigned {} would keep its memory
}

Film::TileState& Film::opened(int tile) {
  TileState& state = state_[static_cast<size_t>(tile)];
  if (state.sums.empty()) {
    const auto pixels = static_cast<size_t>(bounds(tile).pixels());
    state.sums.assign(pixels * sums_.doubles(), 0.0);
    state.counts.assign(pixels * sums_.groups(), 0);
    state.invalid.assign(pixels, 0);
  }
  return state;
}

void Film::pack(const PathSample& sample, float* row) const {
  const double* const values = sample.values();
  for (size_t i = 0; i < own_values_; ++i) row[i] = static_cast<float>(values[offsets_[i]]);
  for (size_t i = own_values_; i < offsets_.size(); ++i)
    row[i] = static_cast<float>((&sample.groups->x)[offsets_[i] - kOwnValues]);
}

std::vector<uint32_t> Film::add(int tile, int pixel, const float* rows, uint32_t count, uint32_t first) {
  TileState& state = opened(tile);
  const size_t size = row_size(), groups = sums_.groups();
  const auto p = static_cast<size_t>(pixel);
  // Without a branch for each value, so that the compiler takes many at once.
  const auto finite = [&](const float* begin, size_t n) {
    uint32_t bad = 0;
    for (size_t i = 0; i < n; ++i) bad |= (std::bit_cast<uint32_t>(begin[i]) & 0x7fffffff) >= 0x7f800000;
    return bad == 0;
  };
  const auto add_run = [&](uint32_t begin, uint32_t end) {
    sums_.add(state.sums.data() + p * sums_.doubles(), rows + begin * size, end - begin, first + begin);
    for (uint32_t k = begin; k < end; ++k) ++state.counts[p * groups + (first + k) % groups];
  };
  std::vector<uint32_t> rejected;
  uint32_t begin = 0;
  if (!finite(rows, count * size))
    for (uint32_t k = 0; k < count; ++k) {
      if (finite(rows + k * size, size)) continue;
      add_run(begin, k);
      begin = k + 1;
      rejected.push_back(k);
    }
  add_run(begin, count);
  state.invalid[p] += static_cast<uint32_t>(rejected.size());
  return rejected;
}

void Film::develop(int tile) {
  TileState& state = opened(tile);
  const bool fresh = !state.developed;
  state.developed = true;
  const Bounds b = bounds(tile);
  const size_t groups = sums_.groups(), buckets = request_.buckets ? groups : 0;
  std::vector<double> mean(row_size()), variance(row_size()), half_a(row_size()), half_b(row_size());
  std::vector<std::vector<double>> bucket(buckets, std::vector<double>(row_size()));
  for (int y = b.y0; y < b.y1; ++y)
    for (int x = b.x0; x < b.x1; ++x) {
      const auto p = static_cast<size_t>((y - b.y0) * b.width() + x - b.x0);
      const double* const sums = state.sums.data() + p * sums_.doubles();
      const uint32_t* const counts = state.counts.data() + p * groups;
      const auto count = [&](size_t first, size_t step) {
        uint64_t n = 0;
        for (size_t g = first; g < groups; g += step) n += counts[g];
        return n;
      };
      const uint64_t n = count(0, 1);
      sums_.means(sums, 0, 1, n, mean.data());
      if (request_.statistics) {
        sums_.mean_variances(sums, n, variance.data());
        sums_.means(sums, 0, 2, count(0, 2), half_a.data());
        sums_.means(sums, 1, 2, count(1, 2), half_b.data());
      }
      for (size_t k = 0; k < buckets; ++k) sums_.means(sums, k, groups, counts[k], bucket[k].data());
      // Where a plane stays 0 nothing is written, so that it takes no memory there.
      const auto set = [x, y, fresh](Plane& plane, double v) {
        if (const auto value = static_cast<float>(v); value != 0 || !fresh) plane(x, y) = value;
      };
      for (const Target& t : targets_) {
        const auto stored = [&](double v) { return t.complement ? 1.0 - v : v; };
        set(*t.mean, stored(mean[t.value]));
        if (t.mean_variance) {
          set(*t.mean_variance, variance[t.value]);
          set(*t.half_a, stored(half_a[t.value]));
          set(*t.half_b, stored(half_b[t.value]));
        }
        for (size_t k = 0; k < t.buckets.size(); ++k) set(*t.buckets[k], stored(bucket[k][t.value]));
      }
      // The sum of the stored floats, so that the passes add up to the beauty to the last bit.
      for (size_t c = 0; c < 3; ++c)
        (*beauty_[c])(x, y) = static_cast<float>(mean[direct_ + c]) + static_cast<float>(mean[indirect_ + c]);
      (*sample_count_)(x, y) = static_cast<float>(n);
      set(*invalid_count_, state.invalid[p]);
    }
}

double Film::relative_error(double exposure, int threads) const {
  constexpr int kRadius = 3;
  constexpr double kLeastSamples = 8;       // per pixel: with fewer the error counts as unknown
  constexpr double kBorrowedSamples = 256;  // weight, in samples, of the whole picture's error in that of each window
  constexpr double kUnknown = std::numeric_limits<double>::infinity();
  const double floor = 0.01 / (exposure * exposure);
  const Plane& counts = layers_.at(layer::sample_count.channel(0));
  const auto mean = layers_.rgb(layer::beauty), mean_variance = layers_.rgb(layer::beauty, statistic::mean_variance);
  const auto width = static_cast<size_t>(width_);
  struct Sums {
    double taken = 0, light = 0, sum = 0;
    std::array<double, 3> variance{};  // by colour
    float fewest = std::numeric_limits<float>::max();
  };
  std::vector<Sums> rows(static_cast<size_t>(height_));
  const auto total = [&](const auto& member) {
    double sum = 0;
    for (Sums& row : rows) sum += member(row);
    return sum;
  };
  parallel_for(height_, {threads}, [&](int y) {
    Sums& row = rows[static_cast<size_t>(y)];
    for (int x = 0; x < width_; ++x) {
      const double n = counts(x, y);
      row.fewest = std::min(row.fewest, counts(x, y));
      row.taken += n;
      for (size_t c = 0; c < 3; ++c) {
        row.light += std::abs(n * (*mean[c])(x, y));
        row.variance[c] += n * n * (*mean_variance[c])(x, y);  // of one sample, times the samples
      }
    }
  });
  if (std::any_of(rows.begin(), rows.end(), [](const Sums& row) { return row.fewest < kLeastSamples; }))
    return kUnknown;
  const double taken = total([](const Sums& row) { return row.taken; });
  if (!(total([](const Sums& row) { return row.light; }) > 0)) return kUnknown;
  for (size_t c = 0; c < 3; ++c) {
    const double borrowed = kBorrowedSamples * total([c](const Sums& row) { return row.variance[c]; }) / taken;
    parallel_for(height_, {threads}, [&](int y) {
      // Of each column the pixels within the window, then windows of columns.
      static thread_local std::vector<double> n, light, variance;
      for (std::vector<double>* column : {&n, &light, &variance}) column->assign(width, 0.0);
      for (int v = std::max(y - kRadius, 0); v <= std::min(y + kRadius, height_ - 1); ++v) {
        const float *const k = counts.row(v), *const m = mean[c]->row(v), *const s = mean_variance[c]->row(v);
        for (size_t x = 0; x < width; ++x) {
          const double count = k[x];
          n[x] += count;
          light[x] += count * m[x];
          variance[x] += count * count * s[x];
        }
      }
      double sum = 0;
      for (int x = 0; x < width_; ++x) {
        const auto begin = static_cast<size_t>(std::max(x - kRadius, 0)),
                   end = std::min(static_cast<size_t>(x + kRadius + 1), width);
        double count = 0, l = 0, v = 0;
        for (size_t u = begin; u < end; ++u) {
          count += n[u];
          l += light[u];
          v += variance[u];
        }
        const double m = l / count;
        sum += (v + borrowed) / (count + kBorrowedSamples) / counts(x, y) / (m * m + floor);
      }
      rows[static_cast<size_t>(y)].sum += sum;
    });
  }
  const double sum = total([](const Sums& row) { return row.sum; });
  return std::sqrt(sum / (3.0 * static_cast<double>(width_) * height_));
}

template <class Put>
void Film::visit_state(int tile, const Put& put) const {
  const TileState& state = state_[static_cast<size_t>(tile)];
  if (state.sums.empty()) return;
  const size_t doubles = sums_.doubles(), groups = sums_.groups();
  for (size_t p = 0; p < static_cast<size_t>(bounds(tile).pixels()); ++p) {
    for (size_t d = 0; d < doubles; ++d) {
      const auto bits = std::bit_cast<uint64_t>(state.sums[p * doubles + d]);
      put(2 * d, p, static_cast<uint32_t>(bits));
      put(2 * d + 1, p, static_cast<uint32_t>(bits >> 32));
    }
    for (size_t g = 0; g < groups; ++g) put(2 * doubles + g, p, state.counts[p * groups + g]);
    put(2 * doubles + groups, p, state.invalid[p]);
  }
}

void Film::save_state(Layers& layers, const Task& task) const {
  std::vector<std::vector<uint32_t>*> channels;
  for (size_t w = 0; w < state_words(); ++w) channels.push_back(&layers.add_words(state_channel(w)));
  parallel_for(tile_count(), task, [&](int tile) {
    const Bounds b = bounds(tile);
    visit_state(tile, [&](size_t channel, size_t p, uint32_t word) {
      const size_t x = b.x0 + p % static_cast<size_t>(b.width()), y = b.y0 + p / static_cast<size_t>(b.width());
      (*channels[channel])[y * width_ + x] = word;
    });
  });
}

WordRows Film::state_rows() const {
  WordRows rows;
  for (size_t w = 0; w < state_words(); ++w) rows.names.push_back(state_channel(w));
  rows.fill = [this](int y, int lines, uint32_t* words) {
    std::fill_n(words, state_words() * static_cast<size_t>(lines) * width_, 0u);
    for (int column = 0; column < tiles_.x; ++column) {
      const int tile = y / kTile * tiles_.x + column;
      const Bounds b = bounds(tile);
      visit_state(tile, [&](size_t channel, size_t p, uint32_t word) {
        const size_t x = b.x0 + p % static_cast<size_t>(b.width()), line = p / static_cast<size_t>(b.width());
        words[(channel * lines + line) * width_ + x] = word;
      });
    }
  };
  return rows;
}

void Film::merge_state(const Layers& saved, const std::string& name, const Task& task) {
  const size_t doubles = sums_.doubles(), groups = sums_.groups(), words = state_words();
  if (saved.width() != width_ || saved.height() != height_)
    throw InputError(
        fmt::format("{}: is {} x {}, expected {} x {}", name, saved.width(), saved.height(), width_, height_));
  std::vector<const std::vector<uint32_t>*> channels;
  for (size_t w = 0; w < words; ++w) {
    channels.push_back(saved.find_words(state_channel(w)));
    if (!channels.back())
      throw InputError(fmt::format(
          "{}: holds no {} of the sums of its samples; expected a frame written with --part or --checkpoint, of the same layers and statistics",
          name, w == 0 ? "part" : "complete set"));
  }
  parallel_for(tile_count(), task, [&](int tile) {
    std::vector<double> sums(doubles);
    TileState& state = opened(tile);
    const Bounds b = bounds(tile);
    uint32_t taken = 0;
    for (int y = b.y0; y < b.y1; ++y)
      for (int x = b.x0; x < b.x1; ++x) {
        const auto p = static_cast<size_t>((y - b.y0) * b.width() + x - b.x0);
        const size_t at = static_cast<size_t>(y) * width_ + x;
        for (size_t d = 0; d < doubles; ++d)
          sums[d] =
              std::bit_cast<double>((*channels[2 * d])[at] | static_cast<uint64_t>((*channels[2 * d + 1])[at]) << 32);
        sums_.merge(state.sums.data() + p * doubles, sums.data());
        uint32_t n = (*channels[words - 1])[at];
        state.invalid[p] += n;
        for (size_t g = 0; g < groups; ++g) {
          state.counts[p * groups + g] += (*channels[2 * doubles + g])[at];
          n += (*channels[2 * doubles + g])[at];
        }
        taken = n;  // the same for all pixels of a tile
      }
    state.taken += taken;
  });
}

double Film::layer_bytes(int width, int height, const LayerRequest& request) {
  double channels = 4;  // beauty and alpha
  for (const RecordedLayer& l : recordable_layers())
    if (request.has(l.name)) channels += static_cast<double>(l.name.channels.size());
  channels += 3 * static_cast<double>(request.group_layers().size());
  return (channels * (1 + 3 * request.statistics + 8 * request.buckets) + 2) * sizeof(float) * width * height;
}

double Film::state_bytes(int width, int height, const LayerRequest& request) {
  return static_cast<double>(state_doubles(request) * sizeof(double) + (groups_of(request) + 1) * sizeof(uint32_t)) *
         width * height;
}

}  // namespace brume

#include "image/packed_plane.h"

#include <algorithm>
#include <bit>

#include "base/parallel_for.h"

namespace brume {
namespace {

constexpr int kPiece = 256;  // pixels

/// Calls work(begin, end) for each piece of a row.
template <class Work>
void for_each_piece(int width, const Work& work) {
  for (int x = 0; x < width; x += kPiece) work(x, std::min(x + kPiece, width));
}

}  // namespace

PackedPlane::PackedPlane(const Plane& plane, const Task& task)
    : width_(plane.width()), rows_(static_cast<size_t>(plane.height())) {
  parallel_for(plane.height(), quiet(task), [&](int y) {
    const float* const in = plane.row(y);
    Row& row = rows_[static_cast<size_t>(y)];
    for_each_piece(width_, [&](int begin, int end) {
      uint32_t differing = 0;
      for (int x = begin; x < end; ++x)
        differing |= std::bit_cast<uint32_t>(in[x]) ^ std::bit_cast<uint32_t>(in[begin]);
      row.constant.push_back(differing == 0);
      row.values.insert(row.values.end(), in + begin, in + (differing == 0 ? begin + 1 : end));
    });
    row.values.shrink_to_fit();
  });
}

Plane PackedPlane::unpacked(const Task& task) const {
  Plane plane = Plane::lazy_zeros(width_, static_cast<int>(rows_.size()));
  parallel_for(plane.height(), quiet(task), [&](int y) {
    const Row& row = rows_[static_cast<size_t>(y)];
    const float* from = row.values.data();
    size_t piece = 0;
    for_each_piece(width_, [&](int begin, int end) {
      float* const to = plane.row(y);
      if (!row.constant[piece++]) {
        std::copy_n(from, end - begin, to + begin);
        from += end - begin;
      } else if (const float value = *from++; std::bit_cast<uint32_t>(value) != 0) {
        std::fill(to + begin, to + end, value);
      }
    });
  });
  return plane;
}

}  // namespace brume

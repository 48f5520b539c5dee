#pragma once
#include <cstddef>
#include <cstdint>

namespace brume::kernels {

/// How many bits each pair of bit sets has in common: joint[i * bins + j] of set i of the first and set j of the second
/// group, sets lying `words` words apart. Empty sets, by the counts, are passed over.
void joint_counts(const uint64_t* first, const uint64_t* second, const int* first_counts, const int* second_counts,
                  int bins, size_t words, int* joint);

/// Bins a column by rounding, what lies beyond the `bins` middle ones in the outermost: bit i of set b says whether
/// number i fell into it. Sets lie `words` words apart.
void bin_bits(const float* column, size_t count, int bins, size_t words, uint64_t* sets, int* counts);

}  // namespace brume::kernels

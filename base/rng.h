#pragma once
#include <bit>
#include <cstdint>

#include "base/math.h"
#include "base/vec.h"

namespace brume {

/// A bijective mix of 64 bits. Source: Stafford's variant 13 of the MurmurHash3 finaliser.
inline uint64_t mix64(uint64_t x) {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}

inline uint64_t hash_combine(uint64_t seed, uint64_t value) {
  return mix64(seed ^ (value + 0x9e3779b97f4a7c15ull));
}

/// What one pixel sample's random numbers depend on, and nothing else: not the thread, not the tile order.
struct SampleKey {
  uint64_t seed = 0;
  uint32_t frame = 0;
  uint32_t pixel = 0;   ///< y * full width + x, so that a crop keeps its noise
  uint32_t sample = 0;  ///< index within the declared total

  uint64_t pixel_hash() const { return hash_combine(hash_combine(mix64(seed), frame), pixel); }
};

/// Independent numbers for loops of unknown length: PCG-XSH-RR, whose n-th draw is a function of (key, n).
/// Source: O'Neill 2014, PCG: A Family of Simple Fast Space-Efficient Algorithms.
class Rng {
 public:
  explicit Rng(const SampleKey& key) : Rng(hash_combine(key.pixel_hash(), key.sample)) {}
  explicit Rng(uint64_t seed) : state_(mix64(seed)), increment_(mix64(seed ^ 0xda3e39cb94b95bdbull) | 1u) {}

  uint32_t bits() {
    const uint64_t old = state_;
    state_ = old * 6364136223846793005ull + increment_;
    return std::rotr(static_cast<uint32_t>(((old >> 18u) ^ old) >> 27u), static_cast<int>(old >> 59u));
  }
  /// In the open interval (0, 1), 32 bits: 1/2 ulp away from either end, so log() is finite.
  double uniform() { return (bits() + 0.5) * 0x1p-32; }
  /// Unit exponential. Reaches 22.8, enough for the tail of optical depths.
  double exponential() { return -portable_log(uniform()); }

 private:
  uint64_t state_, increment_;
};

/// Owen-scrambled Sobol points in pairs of dimensions, each pair shuffled on its own.
///
/// Even samples form one sequence and odd samples another with its own scramble: the two half images are independent,
/// as every error estimate needs them to be.
/// Source: Burley 2020, Practical Hash-based Owen Scrambling; Laine and Karras 2011 for the hash.
class Sobol {
 public:
  explicit Sobol(const SampleKey& key)
      : index_(key.sample >> 1), seed_(hash_combine(key.pixel_hash(), key.sample & 1u)) {}

  /// Point of the pair `pair` in [0, 1)^2.
  dvec2 pair(uint32_t pair) const {
    const uint64_t h = hash_combine(seed_, pair);
    const uint64_t h2 = mix64(h);
    const uint32_t i = owen(index_, static_cast<uint32_t>(h));
    const uint32_t x = laine_karras(i, static_cast<uint32_t>(h >> 32));
    const uint32_t y = laine_karras(pascal(i), static_cast<uint32_t>(h2));
    return {reverse(x) * 0x1p-32, reverse(y) * 0x1p-32};
  }

 private:
  static uint32_t reverse(uint32_t x) {
    x = (x >> 16) | (x << 16);
    x = ((x & 0x00ff00ffu) << 8) | ((x & 0xff00ff00u) >> 8);
    x = ((x & 0x0f0f0f0fu) << 4) | ((x & 0xf0f0f0f0u) >> 4);
    x = ((x & 0x33333333u) << 2) | ((x & 0xccccccccu) >> 2);
    return ((x & 0x55555555u) << 1) | ((x & 0xaaaaaaaau) >> 1);
  }
  // The generator matrix of the second dimension, mirrored: bit j is the sum of all bits k for which the binomial
  // coefficient (k over j) is odd, those with k & j == j.
  static uint32_t pascal(uint32_t x) {
    x ^= x >> 1 & 0x55555555u;
    x ^= x >> 2 & 0x33333333u;
    x ^= x >> 4 & 0x0f0f0f0fu;
    x ^= x >> 8 & 0x00ff00ffu;
    return x ^ x >> 16;
  }
  // Owen scrambling of a number whose bits are mirrored.
  static uint32_t laine_karras(uint32_t x, uint32_t seed) {
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    return x ^ x * 0x53a22864u;
  }
  static uint32_t owen(uint32_t x, uint32_t seed) { return reverse(laine_karras(reverse(x), seed)); }

  uint32_t index_;
  uint64_t seed_;
};

}  // namespace brume

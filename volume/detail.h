#pragma once
#include <array>
#include <cstdint>

#include "base/vec.h"

namespace brume {

struct DetailFlow;

/// Noise that a density is multiplied by, so that it has structure below its voxels: 1 + amplitude * noise, where the
/// noise lies in [-1, 1] and its mean over space is 0. So no point is denser than 1 + amplitude times what is stored,
/// what is empty stays empty, and light that only knows the stored density knows the mean.
///
/// The noise is a sum of octaves, each half as wide and half as strong as the one before. An octave is a lattice of
/// signs, +1 or -1 by a hash of the place, between which it is interpolated along each axis by 3 f^2 - 2 f^3: a mean of
/// signs, so that one of them, drawn by its weight, has the noise as its expectation. Tracking looks up just that one.
///
/// Where a velocity is known the noise is carried along (Perlin and Neyret 2001, Flow noise, has the idea): three
/// noises are looked up where the flow was, or will be, a part of a period ago. They start anew each at another time,
/// unseen, for their weights rise and fall as the squares of sines, which keeps their sum and the sum of their squares.
/// Tests: tests/volume/detail_test.cpp
class Detail {
 public:
  static constexpr int kMostOctaves = 8, kMostPhases = 3;
  static constexpr double kPeriod = 12;  ///< frames of the volume, after which a carried noise starts anew
  /// Lattices of octaves are apart by these shares of a spacing, so that their points do not lie on each other's.
  static constexpr double kApart[3] = {0.382, 0.618, 0.794};

  struct Settings {
    double amplitude = 0;
    double frequency = 1;  ///< points of the first octave's lattice per voxel
    int octaves = 3;
    int64_t seed = 0;
  };
  /// @param origin  index coordinates of the local origin: the noise belongs to index space
  Detail(const Settings& settings, const ivec3& origin);
  /// Has the noise follow a velocity. @param frame  of the volume; may have a fraction
  void carry(const DetailFlow& velocity, double frame);

  /// What the density at a local point is multiplied by, where it is stored.
  double factor(const dvec3& local) const;
  /// A bound of that.
  double greatest() const { return 1 + amplitude_; }
  double amplitude() const { return amplitude_; }
  /// Points per voxel of the last octave's lattice.
  double finest() const { return frequency_ * (1 << (octaves_ - 1)); }

  // For the SIMD kernels, which compute the same noise.

  int octaves() const { return octaves_; }
  double frequency() const { return frequency_; }
  /// Of an octave; their sum is 1.
  double weight(int octave) const { return weight_[static_cast<size_t>(octave)]; }
  /// From local coordinates to the first octave's lattice, and the lattice coordinates of the local origin, in two
  /// parts: whole ones, modulo 2^32, and what is left.
  const dmat3& matrix() const { return matrix_; }
  const std::array<uint32_t, 3>& cell() const { return cell_; }
  const dvec3& offset() const { return offset_; }

  /// One of the noises that are mixed.
  struct Phase {
    double weight = 1;
    double since = 0;  ///< frames that it has been carried along
    uint32_t seed = 0;
  };
  int phases() const { return phases_; }
  const Phase& phase(int i) const { return phase_[static_cast<size_t>(i)]; }
  /// Null: the noise stands still.
  const DetailFlow* velocity() const { return velocity_; }

  /// The sign at a lattice point is the highest bit of this. By Wellons' lowbias32, a hash of 32 bits.
  static uint32_t hash(uint32_t x, uint32_t y, uint32_t z, uint32_t seed);
  static constexpr uint32_t kHashX = 0x9e3779b1u, kHashY = 0x85ebca77u, kHashZ = 0xc2b2ae3du, kHashOctave = 0x27d4eb2fu;

 private:
  double noise(const dvec3& local, uint32_t seed) const;

  double amplitude_, frequency_;
  int octaves_, phases_ = 1;
  std::array<double, kMostOctaves> weight_{};
  std::array<Phase, kMostPhases> phase_{};
  dmat3 matrix_;
  std::array<uint32_t, 3> cell_{};
  dvec3 offset_{0};
  const DetailFlow* velocity_ = nullptr;
};

}  // namespace brume

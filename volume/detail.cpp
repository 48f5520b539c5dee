#include "volume/detail.h"

#include <cmath>

#include "base/rng.h"
#include "volume/detail_flow.h"

namespace brume {
namespace {

constexpr double kWhole = 4294967296.0;  // cells after which the lattice's coordinates repeat

/// A rotation about no axis of the lattice, so that rows of voxels and rows of noise do not line up.
dmat3 turned() {
  const Frame frame(glm::normalize(dvec3(0.48, 0.61, 0.63)));
  return glm::transpose(dmat3(frame.x, frame.y, frame.z));
}

}  // namespace

Detail::Detail(const Settings& s, const ivec3& origin)
    : amplitude_(s.amplitude), frequency_(s.frequency), octaves_(s.octaves), matrix_(s.frequency * turned()) {
  double sum = 0;
  for (int o = 0; o < octaves_; ++o) sum += weight_[static_cast<size_t>(o)] = std::exp2(-o);
  for (double& share : weight_) share /= sum;
  phase_[0].seed = static_cast<uint32_t>(mix64(static_cast<uint64_t>(s.seed)));
  const dvec3 at = matrix_ * dvec3(origin);
  for (int a = 0; a < 3; ++a) {
    const double whole = std::floor(at[a]);
    offset_[a] = at[a] - whole;
    cell_[static_cast<size_t>(a)] =
        static_cast<uint32_t>(static_cast<int64_t>(whole - kWhole * std::floor(whole / kWhole)));
  }
}

void Detail::carry(const DetailFlow& velocity, double frame) {
  velocity_ = &velocity;
  phases_ = kMostPhases;
  const uint32_t seed = phase_[0].seed;
  for (int i = 0; i < phases_; ++i) {
    const double turns = frame / kPeriod + static_cast<double>(i) / phases_, cycle = std::floor(turns);
    const double sine = std::sin(kPi * (turns - cycle));
    phase_[static_cast<size_t>(i)] = {
        2.0 / 3 * sine * sine, (turns - cycle - 0.5) * kPeriod,
        static_cast<uint32_t>(mix64(seed ^ (static_cast<uint64_t>(static_cast<int64_t>(cycle) * phases_ + i) << 32)))};
  }
}

uint32_t Detail::hash(uint32_t x, uint32_t y, uint32_t z, uint32_t seed) {
  uint32_t h = x * kHashX + y * kHashY + z * kHashZ + seed;
  h ^= h >> 16;
  h *= 0x7feb352du;
  h ^= h >> 15;
  return h * 0x846ca68bu;
}

double Detail::noise(const dvec3& local, uint32_t seed) const {
  const dvec3 first = matrix_ * local + offset_;
  double sum = 0;
  for (int o = 0; o < octaves_; ++o) {
    uint32_t low[3];
    double f[3];
    for (int a = 0; a < 3; ++a) {
      const double at = first[a] * (1 << o) + o * kApart[a], whole = std::floor(at), t = at - whole;
      low[a] = static_cast<uint32_t>(static_cast<int64_t>(whole)) + (cell_[static_cast<size_t>(a)] << o);
      f[a] = t * t * (3 - 2 * t);
    }
    double mean = 0;
    for (uint32_t corner = 0; corner < 8; ++corner) {
      const uint32_t x = corner >> 2, y = corner >> 1 & 1, z = corner & 1;
      const double share = (x ? f[0] : 1 - f[0]) * (y ? f[1] : 1 - f[1]) * (z ? f[2] : 1 - f[2]);
      const uint32_t bits = hash(low[0] + x, low[1] + y, low[2] + z, seed + static_cast<uint32_t>(o) * kHashOctave);
      mean += bits >> 31 ? -share : share;
    }
    sum += weight(o) * mean;
  }
  return sum;
}

double Detail::factor(const dvec3& local) const {
  if (!velocity_) return 1 + amplitude_ * noise(local, phase_[0].seed);
  const dvec3 along = velocity_->lookup(local);
  double sum = 0;
  for (int i = 0; i < phases_; ++i) sum += phase(i).weight * noise(local - phase(i).since * along, phase(i).seed);
  return 1 + amplitude_ * sum;
}

}  // namespace brume

// No include guard: included once for every instruction set, between HWY_BEFORE_NAMESPACE and HWY_AFTER_NAMESPACE.

namespace hn = hwy::HWY_NAMESPACE;

// Lambdas that take part in a loop over vectors: called from there, what they capture would have to live in memory.
#undef BRUME_INLINE_LAMBDA
#define BRUME_INLINE_LAMBDA __attribute__((always_inline))

using D = hn::CappedTag<float, 16>;
using DI = hn::RebindToSigned<D>;
using DU = hn::RebindToUnsigned<D>;
using V = hn::Vec<D>;
using VI = hn::Vec<DI>;
using VU = hn::Vec<DU>;
using M = hn::Mask<D>;

// No fused multiply-add anywhere: with it, instruction sets would differ in the last bit.

HWY_INLINE V set(float x) {
  return hn::Set(D(), x);
}

// Highway has operators between vectors; these take a number on one side.
template <class A, class B>
concept WithNumber = (std::is_same_v<A, V> && (std::is_same_v<B, float> || std::is_same_v<B, int>)) ||
                     ((std::is_same_v<A, VI> || std::is_same_v<A, VU>)&&std::is_same_v<B, int>);
template <class A, class B>
concept Mixed = WithNumber<A, B> || WithNumber<B, A>;
template <class Like, class T>
HWY_INLINE auto lanes_like(Like, T x) {
  if constexpr (std::is_arithmetic_v<T>)
    return hn::Set(hn::DFromV<Like>(), static_cast<hn::TFromV<Like>>(x));
  else
    return x;
}
template <class A, Mixed<A> B>
HWY_INLINE auto operator+(A a, B b) {
  return lanes_like(b, a) + lanes_like(a, b);
}
template <class A, Mixed<A> B>
HWY_INLINE auto operator-(A a, B b) {
  return lanes_like(b, a) - lanes_like(a, b);
}
template <class A, Mixed<A> B>
HWY_INLINE auto operator*(A a, B b) {
  return lanes_like(b, a) * lanes_like(a, b);
}
template <class A, Mixed<A> B>
HWY_INLINE auto operator/(A a, B b) {
  return lanes_like(b, a) / lanes_like(a, b);
}
template <class A, Mixed<A> B>
HWY_INLINE auto operator<(A a, B b) {
  return lanes_like(b, a) < lanes_like(a, b);
}
template <class A, Mixed<A> B>
HWY_INLINE auto operator>(A a, B b) {
  return lanes_like(b, a) > lanes_like(a, b);
}
template <class A, Mixed<A> B>
HWY_INLINE auto operator<=(A a, B b) {
  return lanes_like(b, a) <= lanes_like(a, b);
}
template <class A, Mixed<A> B>
HWY_INLINE auto operator>=(A a, B b) {
  return lanes_like(b, a) >= lanes_like(a, b);
}
template <class A, Mixed<A> B>
HWY_INLINE auto operator==(A a, B b) {
  return lanes_like(b, a) == lanes_like(a, b);
}
template <class A, Mixed<A> B>
HWY_INLINE auto operator!=(A a, B b) {
  return lanes_like(b, a) != lanes_like(a, b);
}
HWY_INLINE V operator-(V a) {
  return hn::Neg(a);
}
HWY_INLINE VI operator&(VI a, int b) {
  return hn::And(a, hn::Set(DI(), b));
}
HWY_INLINE V sqrt(V a) {
  return hn::Sqrt(a);
}

/// A point, a direction or a colour in each lane.
struct V3 {
  V x, y, z;

  HWY_INLINE V3& operator+=(const V3& b);
};
HWY_INLINE V3 operator+(const V3& a, const V3& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
HWY_INLINE V3 operator-(const V3& a, const V3& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
HWY_INLINE V3 operator*(const V3& a, const V3& b) {
  return {a.x * b.x, a.y * b.y, a.z * b.z};
}
HWY_INLINE V3 operator*(const V3& a, V b) {
  return {a.x * b, a.y * b, a.z * b};
}
HWY_INLINE V3 operator*(V a, const V3& b) {
  return b * a;
}
HWY_INLINE V3 operator*(const V3& a, float b) {
  return a * set(b);
}
HWY_INLINE V3& V3::operator+=(const V3& b) {
  return *this = *this + b;
}
HWY_INLINE V3 set3(const float (&v)[3]) {
  return {set(v[0]), set(v[1]), set(v[2])};
}
HWY_INLINE V3 zero3() {
  return {hn::Zero(D()), hn::Zero(D()), hn::Zero(D())};
}
HWY_INLINE V dot(const V3& a, const V3& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
HWY_INLINE V length(const V3& a) {
  return hn::Sqrt(dot(a, a));
}
HWY_INLINE V max_component(const V3& a) {
  return hn::Max(hn::Max(a.x, a.y), a.z);
}
HWY_INLINE V3 min(const V3& a, const V3& b) {
  return {hn::Min(a.x, b.x), hn::Min(a.y, b.y), hn::Min(a.z, b.z)};
}
HWY_INLINE V3 max(const V3& a, const V3& b) {
  return {hn::Max(a.x, b.x), hn::Max(a.y, b.y), hn::Max(a.z, b.z)};
}
HWY_INLINE V3 floor(const V3& a) {
  return {hn::Floor(a.x), hn::Floor(a.y), hn::Floor(a.z)};
}
HWY_INLINE V3 select(M mask, const V3& yes, const V3& no) {
  return {hn::IfThenElse(mask, yes.x, no.x), hn::IfThenElse(mask, yes.y, no.y), hn::IfThenElse(mask, yes.z, no.z)};
}
HWY_INLINE V3 transform(const float (&m)[3][3], const V3& v) {
  return {dot(set3(m[0]), v), dot(set3(m[1]), v), dot(set3(m[2]), v)};
}

/// Members of three columns of floats, by slot.
template <class Columns>
HWY_INLINE V3 gather3(const Columns& columns, VI slot) {
  const D d;
  return {hn::GatherIndex(d, columns.x.data(), slot), hn::GatherIndex(d, columns.y.data(), slot),
          hn::GatherIndex(d, columns.z.data(), slot)};
}
template <class Columns>
HWY_INLINE void scatter3(const V3& v, Columns& columns, VI slot) {
  const D d;
  hn::ScatterIndex(v.x, d, columns.x.data(), slot);
  hn::ScatterIndex(v.y, d, columns.y.data(), slot);
  hn::ScatterIndex(v.z, d, columns.z.data(), slot);
}

/// The same of numbers in a row, from one on.
template <class Columns>
HWY_INLINE V3 load3(const Columns& columns, size_t first) {
  const D d;
  return {hn::LoadU(d, columns.x.data() + first), hn::LoadU(d, columns.y.data() + first),
          hn::LoadU(d, columns.z.data() + first)};
}
template <class Columns>
HWY_INLINE void store3(const V3& v, Columns& columns, size_t first) {
  const D d;
  hn::StoreU(v.x, d, columns.x.data() + first);
  hn::StoreU(v.y, d, columns.y.data() + first);
  hn::StoreU(v.z, d, columns.z.data() + first);
}

/// The lanes' numbers in memory.
using Lanes = float[hn::MaxLanes(D())];
struct Lanes3 {
  HWY_ALIGN Lanes x = {}, y = {}, z = {};

  HWY_INLINE V3 load() const { return {hn::Load(D(), x), hn::Load(D(), y), hn::Load(D(), z)}; }
  HWY_INLINE void store(const V3& v) {
    hn::Store(v.x, D(), x);
    hn::Store(v.y, D(), y);
    hn::Store(v.z, D(), z);
  }
  HWY_INLINE vec3 operator[](size_t lane) const { return {x[lane], y[lane], z[lane]}; }
  HWY_INLINE void set(size_t lane, const vec3& v) {
    x[lane] = v.x;
    y[lane] = v.y;
    z[lane] = v.z;
  }
};

/// The generator of each lane. Source: Blackman, Vigna 2021, Scrambled Linear Pseudorandom Number Generators.
struct Generator {
  VU s0, s1, s2, s3;

  /// Advances the lanes of `mask`; the others keep their state (and get a number that means nothing).
  HWY_INLINE VU next(M mask) {
    const auto rotl = [](VU v, auto k) {
      constexpr int kBits = decltype(k)::value;
      return hn::Or(hn::ShiftLeft<kBits>(v), hn::ShiftRight<32 - kBits>(v));
    };
    const VU result = rotl(s0 + s3, std::integral_constant<int, 7>()) + s0;
    const VU t = hn::ShiftLeft<9>(s1);
    VU n2 = hn::Xor(s2, s0), n3 = hn::Xor(s3, s1);
    const VU n1 = hn::Xor(s1, n2), n0 = hn::Xor(s0, n3);
    n2 = hn::Xor(n2, t);
    n3 = rotl(n3, std::integral_constant<int, 11>());
    const auto m = hn::RebindMask(DU(), mask);
    s0 = hn::IfThenElse(m, n0, s0);
    s1 = hn::IfThenElse(m, n1, s1);
    s2 = hn::IfThenElse(m, n2, s2);
    s3 = hn::IfThenElse(m, n3, s3);
    return result;
  }
  /// In [0, 1), 24 bits.
  HWY_INLINE V uniform(M mask) {
    return hn::ConvertTo(D(), hn::BitCast(DI(), hn::ShiftRight<8>(next(mask)))) * 0x1p-24f;
  }
  /// In (0, 1], 31 bits, small numbers to full precision: for probabilities that may be far below 2^-24.
  HWY_INLINE V fine_uniform(M mask) {
    const V bits = hn::ConvertTo(D(), hn::BitCast(DI(), hn::ShiftRight<1>(next(mask))));
    return (bits + 0.5f) * 0x1p-31f;
  }
  /// Unit exponential, up to 22.9.
  HWY_INLINE V exponential(M mask);
};

/// Natural logarithm of a positive normal number, relative error below 3e-7.
HWY_INLINE V log_of(V x) {
  const DI di;
  const VI bits = hn::BitCast(di, x);
  const VI shifted = bits - 0x3f3504f3;  // e such that m = x / 2^e lies in [sqrt(1/2), sqrt(2))
  const VI e = hn::ShiftRight<23>(shifted);
  const V m = hn::BitCast(D(), bits - (hn::ShiftLeft<23>(e)));
  const V f = m - 1.0f, s = f / (m + 1.0f), z = s * s;
  V p = z * (2.0f / 9) + (2.0f / 7);
  p = p * z + (2.0f / 5);
  p = p * z + (2.0f / 3);
  p = p * z + 2.0f;
  return hn::ConvertTo(D(), e) * (std::numbers::ln2_v<float>)+s * p;
}

/// e^r - 1 for |r| below 0.35, relative error below 1e-7.
HWY_INLINE V small_expm1(V r) {
  V p = (1.0f / 120) + r * ((1.0f / 720) + r * (1.0f / 5040));
  p = (1.0f / 6) + r * ((1.0f / 24) + r * p);
  return r + r * r * (0.5f + r * p);
}

/// 2^k and e^r - 1 of which e^x = 2^k e^r. Below e^-87 as there.
struct SplitExponential {
  V power, rest;
  HWY_INLINE explicit SplitExponential(V x) {
    const V within = hn::Min(hn::Max(x, set(-87.0f)), set(88.0f));
    const V k = hn::Floor(within * std::numbers::log2e_v<float> + 0.5f);
    // The high part of ln 2 has so few bits that its products with k are exact.
    rest = small_expm1(within - k * 0.693359375f - k * -2.12194440e-4f);
    power = hn::BitCast(D(), hn::ShiftLeft<23>(hn::ConvertTo(DI(), k) + 127));
  }
};

/// e^x, relative error below 3e-7; 0 below -87.
HWY_INLINE V exponential(V x) {
  const SplitExponential e(x);
  return hn::IfThenZeroElse(x < -87.0f, e.power + e.power * e.rest);
}

HWY_INLINE V Generator::exponential(M mask) {
  const VU bits = next(mask);
  // All 32 bits: small numbers keep their precision, so that the tail of optical depths is reached.
  const DI di;
  const V high = hn::ConvertTo(D(), hn::BitCast(di, hn::ShiftRight<16>(bits)));
  const V low = hn::ConvertTo(D(), hn::BitCast(di, hn::And(bits, hn::Set(DU(), 0xffffu))));
  const V u = hn::Max(high * 65536.0f + low, set(0.5f)) * 0x1p-32f;
  return -log_of(u);
}

struct SinCosV {
  V sin, cos;
};

/// sin and cos of 2 pi u for u in [0, 1), absolute error below 4e-7.
HWY_INLINE SinCosV sincos_2pi(V u) {
  const V q = hn::Floor(u * 4.0f + 0.5f);
  const V a = (u - q * 0.25f) * 6.28318531f, z = a * a;
  V s = (1.0f / 120) - z * (1.0f / 5040);
  s = (1.0f / 6) - z * s;
  s = a * (1.0f - z * s);
  V c = (1.0f / 720) - z * (1.0f / 40320);
  c = (1.0f / 24) - z * c;
  c = 0.5f - z * c;
  c = 1.0f - z * c;
  const VI quadrant = hn::ConvertTo(DI(), q);
  const auto odd = hn::RebindMask(D(), (quadrant & 1) != 0);
  const auto minus_s = hn::RebindMask(D(), (quadrant & 2) != 0);
  const auto minus_c = hn::RebindMask(D(), ((quadrant + 1) & 2) != 0);
  const V rs = hn::IfThenElse(odd, c, s), rc = hn::IfThenElse(odd, s, c);
  return {hn::IfThenElse(minus_s, -rs, rs), hn::IfThenElse(minus_c, -rc, rc)};
}

/// 1 - cos of the angle between unit vectors: where it is small, their cosine would have lost it.
HWY_INLINE V one_minus_cos(const V3& a, const V3& b) {
  const V3 d = a - b;
  return 0.5f * dot(d, d);
}

#include "volume/henyey_greenstein.h"

/// Turns local (x, y, z) into the frame around the unit vector n, and makes it a unit vector again.
HWY_INLINE V3 around(const V3& n, V x, V y, V z) {
  const V sign = hn::CopySign(set(1.0f), n.z), a = -(1.0f / (sign + n.z)), b = n.x * n.y * a;
  const V3 u{1.0f + sign * (n.x * n.x) * a, sign * b, -(sign * n.x)};
  const V3 v{b, sign + n.y * n.y * a, -n.y};
  const V3 r = u * x + v * y + n * z;
  return r * (1.0f / length(r));
}

HWY_INLINE uint32_t bits_of(M mask) {
  uint8_t bytes[8] = {};
  hn::StoreMaskBits(D(), mask, bytes);
  uint32_t bits;
  std::memcpy(&bits, bytes, sizeof bits);
  return bits;
}
HWY_INLINE M mask_of(uint32_t bits) {
  uint8_t bytes[8] = {};
  std::memcpy(bytes, &bits, sizeof bits);
  return hn::LoadMaskBits(D(), bytes);
}

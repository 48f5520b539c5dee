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

/// The generator of each lane. Source: Blackman, Vigna 2021, Scrambled Linear Pseudorandom Number Generators.
struct Generator {
  VU s0, s1, s2, s3;

  /// Advances the lanes of `mask`; the others keep their state (and get a number that means nothing).
  HWY_INLINE VU next(M mask) {
    const auto rotl = [](VU v, auto k) {
      constexpr int kBits = decltype(k)::value;
      return hn::Or(hn::ShiftLeft<kBits>(v), hn::ShiftRight<32 - kBits>(v));
    };
    const VU result = hn::Add(rotl(hn::Add(s0, s3), std::integral_constant<int, 7>()), s0);
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
    return hn::Mul(hn::ConvertTo(D(), hn::BitCast(DI(), hn::ShiftRight<8>(next(mask)))), set(0x1p-24f));
  }
  /// In (0, 1], 31 bits, small numbers to full precision: for probabilities that may be far below 2^-24.
  HWY_INLINE V fine_uniform(M mask) {
    const V bits = hn::ConvertTo(D(), hn::BitCast(DI(), hn::ShiftRight<1>(next(mask))));
    return hn::Mul(hn::Add(bits, set(0.5f)), set(0x1p-31f));
  }
  /// Unit exponential, up to 22.9.
  HWY_INLINE V exponential(M mask);
};

/// Natural logarithm of a positive normal number, relative error below 3e-7.
HWY_INLINE V log_of(V x) {
  const DI di;
  const VI bits = hn::BitCast(di, x);
  const VI shifted = hn::Sub(bits, hn::Set(di, 0x3f3504f3));  // e such that m = x / 2^e lies in [sqrt(1/2), sqrt(2))
  const VI e = hn::ShiftRight<23>(shifted);
  const V m = hn::BitCast(D(), hn::Sub(bits, hn::ShiftLeft<23>(e)));
  const V f = hn::Sub(m, set(1.0f)), s = hn::Div(f, hn::Add(m, set(1.0f))), z = hn::Mul(s, s);
  V p = hn::Add(hn::Mul(z, set(2.0f / 9)), set(2.0f / 7));
  p = hn::Add(hn::Mul(p, z), set(2.0f / 5));
  p = hn::Add(hn::Mul(p, z), set(2.0f / 3));
  p = hn::Add(hn::Mul(p, z), set(2.0f));
  return hn::Add(hn::Mul(hn::ConvertTo(D(), e), set(std::numbers::ln2_v<float>)), hn::Mul(s, p));
}

HWY_INLINE V Generator::exponential(M mask) {
  const VU bits = next(mask);
  // All 32 bits: small numbers keep their precision, so that the tail of optical depths is reached.
  const DI di;
  const V high = hn::ConvertTo(D(), hn::BitCast(di, hn::ShiftRight<16>(bits)));
  const V low = hn::ConvertTo(D(), hn::BitCast(di, hn::And(bits, hn::Set(DU(), 0xffffu))));
  const V u = hn::Mul(hn::Max(hn::Add(hn::Mul(high, set(65536.0f)), low), set(0.5f)), set(0x1p-32f));
  return hn::Neg(log_of(u));
}

struct SinCosV {
  V sin, cos;
};

/// sin and cos of 2 pi u for u in [0, 1), absolute error below 4e-7.
HWY_INLINE SinCosV sincos_2pi(V u) {
  const V q = hn::Floor(hn::Add(hn::Mul(u, set(4.0f)), set(0.5f)));
  const V a = hn::Mul(hn::Sub(u, hn::Mul(q, set(0.25f))), set(6.28318531f)), z = hn::Mul(a, a);
  V s = hn::Sub(set(1.0f / 120), hn::Mul(z, set(1.0f / 5040)));
  s = hn::Sub(set(1.0f / 6), hn::Mul(z, s));
  s = hn::Mul(a, hn::Sub(set(1.0f), hn::Mul(z, s)));
  V c = hn::Sub(set(1.0f / 720), hn::Mul(z, set(1.0f / 40320)));
  c = hn::Sub(set(1.0f / 24), hn::Mul(z, c));
  c = hn::Sub(set(0.5f), hn::Mul(z, c));
  c = hn::Sub(set(1.0f), hn::Mul(z, c));
  const VI quadrant = hn::ConvertTo(DI(), q);
  const DI di;
  const auto odd = hn::RebindMask(D(), hn::Ne(hn::And(quadrant, hn::Set(di, 1)), hn::Zero(di)));
  const auto minus_s = hn::RebindMask(D(), hn::Ne(hn::And(quadrant, hn::Set(di, 2)), hn::Zero(di)));
  const auto minus_c =
      hn::RebindMask(D(), hn::Ne(hn::And(hn::Add(quadrant, hn::Set(di, 1)), hn::Set(di, 2)), hn::Zero(di)));
  const V rs = hn::IfThenElse(odd, c, s), rc = hn::IfThenElse(odd, s, c);
  return {hn::IfThenElse(minus_s, hn::Neg(rs), rs), hn::IfThenElse(minus_c, hn::Neg(rc), rc)};
}

struct V3 {
  V x, y, z;
};
HWY_INLINE V dot(const V3& a, const V3& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}
HWY_INLINE V3 transform(const float (&m)[3][3], const V3& v) {
  const auto row = [&](int r) {
    return hn::Add(hn::Add(hn::Mul(set(m[r][0]), v.x), hn::Mul(set(m[r][1]), v.y)), hn::Mul(set(m[r][2]), v.z));
  };
  return {row(0), row(1), row(2)};
}

/// 1 - cos of the angle between unit vectors: where it is small, their cosine would have lost it.
HWY_INLINE V one_minus_cos(const V3& a, const V3& b) {
  const V3 d{hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z)};
  return hn::Mul(set(0.5f), dot(d, d));
}

/// Henyey-Greenstein, g in [0, 1), and the sampling of it: 1 - cos for a number in [0, 1). Without cancellation; see
/// volume/phase_function.h.
HWY_INLINE V phase_value(float g, V one_minus) {
  const V d = hn::Add(set((1.0f - g) * (1.0f - g)), hn::Mul(set(2.0f * g), one_minus));
  return hn::Div(set((1.0f - g * g) * 0.0795774715f), hn::Mul(d, hn::Sqrt(d)));
}
HWY_INLINE V phase_sample(float g, V xi) {
  const V s = hn::Sub(hn::Add(xi, xi), set(1.0f)), d = hn::Add(set(1.0f), hn::Mul(set(g), s));
  const V t = hn::Div(set(1.0f - g * g), d);
  const V one_minus = hn::Div(hn::Mul(set(1.0f - g), hn::Mul(hn::Sub(set(1.0f), xi), hn::Add(t, set(1.0f - g)))), d);
  return hn::Min(hn::Max(one_minus, set(0.0f)), set(2.0f));
}

/// Turns local (x, y, z) into the frame around the unit vector n, and makes it a unit vector again.
HWY_INLINE V3 around(const V3& n, V x, V y, V z) {
  const V sign = hn::CopySign(set(1.0f), n.z);
  const V a = hn::Neg(hn::Div(set(1.0f), hn::Add(sign, n.z))), b = hn::Mul(hn::Mul(n.x, n.y), a);
  const V3 u{hn::Add(set(1.0f), hn::Mul(hn::Mul(sign, hn::Mul(n.x, n.x)), a)), hn::Mul(sign, b),
             hn::Neg(hn::Mul(sign, n.x))};
  const V3 v{b, hn::Add(sign, hn::Mul(hn::Mul(n.y, n.y), a)), hn::Neg(n.y)};
  V3 r{hn::Add(hn::Add(hn::Mul(u.x, x), hn::Mul(v.x, y)), hn::Mul(n.x, z)),
       hn::Add(hn::Add(hn::Mul(u.y, x), hn::Mul(v.y, y)), hn::Mul(n.y, z)),
       hn::Add(hn::Add(hn::Mul(u.z, x), hn::Mul(v.z, y)), hn::Mul(n.z, z))};
  const V scale = hn::Div(set(1.0f), hn::Sqrt(dot(r, r)));
  return {hn::Mul(r.x, scale), hn::Mul(r.y, scale), hn::Mul(r.z, scale)};
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

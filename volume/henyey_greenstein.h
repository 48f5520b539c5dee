// No include guard: phase_function.h includes it for doubles, vector_math.h for the lanes of every instruction set.
// Both have a sqrt() of theirs.

/// Henyey-Greenstein phase function [1/sr] of 1 - cos, g in [0, 1). Nothing cancels: the denominator, 1 + g^2 - 2 g
/// cos, is written as a sum of two non-negative terms.
template <class Number, class T>
inline T henyey_greenstein(Number g, T one_minus_cos) {
  const T d = (1 - g) * (1 - g) + 2 * g * one_minus_cos;
  return (1 - g * g) * static_cast<Number>(0.25 / std::numbers::pi) / (d * sqrt(d));
}

/// 1 - cos of the angle whose cosine has the cumulative probability xi, without a division by g.
/// Derived in docs/estimators.md.
template <class Number, class T>
inline T sample_henyey_greenstein(Number g, T xi) {
  const T s = xi + xi - 1, d = 1 + g * s;
  const T t = (1 - g * g) / d;
  return (1 - g) * ((1 - xi) * (t + (1 - g))) / d;
}

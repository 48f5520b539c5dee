// No include guard: included once for every instruction set, between HWY_BEFORE_NAMESPACE and HWY_AFTER_NAMESPACE.

/// exp(-d) for d >= 0, relative error 3e-7; 0 beyond 80 and for NaN. Without a branch, so that loops become vectors.
HWY_INLINE float exp_minus(float d) {
  constexpr float kFarthest = 80.0f;
  const float x = (d < kFarthest ? d : kFarthest) * -1.44269504f;
  const float shifted = x + 12582912.0f;  // 1.5 * 2^23: adding it rounds to an integer
  const float f = x - (shifted - 12582912.0f);
  float p = 1.5403530e-4f;
  p = p * f + 1.3333558e-3f;
  p = p * f + 9.6181291e-3f;
  p = p * f + 5.5504109e-2f;
  p = p * f + 2.4022651e-1f;
  p = p * f + 6.9314718e-1f;
  p = p * f + 1.0f;
  const float w = std::bit_cast<float>(std::bit_cast<int32_t>(p) + (std::bit_cast<int32_t>(shifted) << 23));
  return d < kFarthest ? w : 0.0f;
}

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/lab.cpp"
#include "filters/kernels/lab.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "image/color.h"

HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;

constexpr float kThreshold = 216.0f / 24389.0f, kSlope = 24389.0f / 27.0f / 116.0f, kOffset = 16.0f / 116.0f;

// Cube root of a positive number: a guess from the exponent, then Newton on x^-1/3, which needs no division until the
// end.
V cube_root(D d, V x) {
  const hn::RebindToUnsigned<D> du;
  // 0x54a21d2a - bits / 3 guesses x^-1/3 within 3 %; the division by 3 is done in float.
  const hn::RebindToSigned<D> di;
  const auto third = hn::ConvertTo(di, hn::ConvertTo(d, hn::BitCast(di, x)) * hn::Set(d, 1.0f / 3.0f));
  V r = hn::BitCast(d, hn::BitCast(du, hn::Set(di, 0x54a21d2a)) - hn::BitCast(du, third));
  const V one = hn::Set(d, 1.0f);
  for (int i = 0; i < 3; ++i) {
    const V residual = hn::NegMulAdd(x * r, r * r, one);
    r = hn::MulAdd(r * hn::Set(d, 1.0f / 3.0f), residual, r);
  }
  const V root = x * (r * r);
  // One step on the root itself removes what the products have rounded.
  const V error = hn::NegMulAdd(root * root, root, x);
  return hn::MulAdd(error, r * r * hn::Set(d, 1.0f / 3.0f), root);
}

V forward(D d, V t) {
  const V safe = hn::Max(t, hn::Set(d, kThreshold));
  return hn::IfThenElse(hn::Gt(t, hn::Set(d, kThreshold)), cube_root(d, safe),
                        hn::MulAdd(t, hn::Set(d, kSlope), hn::Set(d, kOffset)));
}

V backward(D d, V f) {
  const V linear = (f - hn::Set(d, kOffset)) * hn::Set(d, 1.0f / kSlope);
  return hn::IfThenElse(hn::Gt(f, hn::Set(d, 6.0f / 29.0f)), f * f * f, linear);
}

V product(D d, const dmat3& m, int row, V a, V b, V c) {
  const auto k = [&](int column) { return hn::Set(d, static_cast<float>(m[column][row])); };
  return hn::MulAdd(c, k(2), hn::MulAdd(b, k(1), a * k(0)));
}

void LabFromRgbRow(const std::array<const float*, 3>& rgb, float exposure, const dmat3& xyz_from_rgb,
                   const std::array<float*, 3>& lab, int width) {
  const D d;
  const V e = hn::Set(d, exposure);
  for (int x = 0; x < width; x += static_cast<int>(hn::Lanes(d))) {
    const V r = hn::LoadU(d, rgb[0] + x) * e, g = hn::LoadU(d, rgb[1] + x) * e, b = hn::LoadU(d, rgb[2] + x) * e;
    const V fx = forward(d, product(d, xyz_from_rgb, 0, r, g, b));
    const V fy = forward(d, product(d, xyz_from_rgb, 1, r, g, b));
    const V fz = forward(d, product(d, xyz_from_rgb, 2, r, g, b));
    hn::StoreU(hn::MulAdd(fy, hn::Set(d, 116.0f), hn::Set(d, -16.0f)), d, lab[0] + x);
    hn::StoreU((fx - fy) * hn::Set(d, 500.0f), d, lab[1] + x);
    hn::StoreU((fy - fz) * hn::Set(d, 200.0f), d, lab[2] + x);
  }
}

void RgbFromLabRow(const std::array<const float*, 3>& lab, float exposure, const dmat3& m,
                   const std::array<float*, 3>& rgb, int width) {
  const D d;
  const V scale = hn::Set(d, 1.0f / exposure);
  for (int x = 0; x < width; x += static_cast<int>(hn::Lanes(d))) {
    const V fy = (hn::LoadU(d, lab[0] + x) + hn::Set(d, 16.0f)) * hn::Set(d, 1.0f / 116.0f);
    const V fx = hn::MulAdd(hn::LoadU(d, lab[1] + x), hn::Set(d, 1.0f / 500.0f), fy);
    const V fz = hn::NegMulAdd(hn::LoadU(d, lab[2] + x), hn::Set(d, 1.0f / 200.0f), fy);
    const V X = backward(d, fx), Y = backward(d, fy), Z = backward(d, fz);
    for (int c = 0; c < 3; ++c) hn::StoreU(product(d, m, c, X, Y, Z) * scale, d, rgb[static_cast<size_t>(c)] + x);
  }
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(LabFromRgbRow);
HWY_EXPORT(RgbFromLabRow);

void lab_from_rgb_row(const std::array<const float*, 3>& rgb, float exposure, const std::array<float*, 3>& lab,
                      int width, const dmat3& xyz_from_rgb) {
  HWY_DYNAMIC_DISPATCH(LabFromRgbRow)(rgb, exposure, xyz_from_rgb, lab, width);
}

void rgb_from_lab_row(const std::array<const float*, 3>& lab, float exposure, const std::array<float*, 3>& rgb,
                      int width, const dmat3& xyz_from_rgb) {
  HWY_DYNAMIC_DISPATCH(RgbFromLabRow)(lab, exposure, glm::inverse(xyz_from_rgb), rgb, width);
}

}  // namespace brume::kernels
#endif

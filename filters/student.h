#pragma once

namespace brume {

/// t with P(|T| <= t) = confidence for Student's t with any number of degrees of freedom > 0; the normal quantile above
/// 200. By bisection on the regularised incomplete beta function, to 1e-6 relative.
double student_quantile(double confidence, double degrees_of_freedom);

}  // namespace brume

#pragma once

namespace brume {

/// t with P(|T| <= t) = confidence for Student's t with any number of degrees of freedom > 0.
double student_quantile(double confidence, double degrees_of_freedom);

/// P(|T| >= |t|).
double student_two_sided(double t, double degrees_of_freedom);

}  // namespace brume

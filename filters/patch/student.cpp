#include "filters/patch/student.h"

#include <boost/math/distributions/students_t.hpp>
#include <cmath>

namespace brume {

double student_quantile(double confidence, double degrees_of_freedom) {
  const boost::math::students_t distribution(degrees_of_freedom);
  return boost::math::quantile(boost::math::complement(distribution, 0.5 * (1 - confidence)));
}

double student_two_sided(double t, double degrees_of_freedom) {
  const boost::math::students_t distribution(degrees_of_freedom);
  return 2 * boost::math::cdf(boost::math::complement(distribution, std::abs(t)));
}

}  // namespace brume

// Order statistics of values without NaN, and sums that do not wait for each other.
#pragma once

#include "arrays.hpp"
#include "lanes.hpp"

namespace doppelgait::robust {

// Quantile of one value or more; between two values it lies on a straight line.
double quantile(const double* values, Index n, double share);
inline double median(const double* values, Index n) { return quantile(values, n, 0.5); }

// Sum of products in eight parts at every level.
inline double dot(const double* one, const double* other, Index n) {
  constexpr Index parts = 8 / kHalfWidth;
  Double sum[parts] = {};
  const Index whole = n / 8 * 8;
  for (Index k = 0; k < whole; k += 8) {
    for (Index part = 0; part < parts; ++part) {
      const Index at = k + part * kHalfWidth;
      sum[part] = fused(load<Double>(one + at), load<Double>(other + at), sum[part]);
    }
  }
  double s[8];
  std::memcpy(s, sum, sizeof s);
  for (Index k = whole; k < n; ++k) s[k - whole] = fused(one[k], other[k], s[k - whole]);
  return ((s[0] + s[1]) + (s[2] + s[3])) + ((s[4] + s[5]) + (s[6] + s[7]));
}

}  // namespace doppelgait::robust

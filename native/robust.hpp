// Order statistics of values without NaN, and sums that do not wait for each other.
#pragma once

#include "arrays.hpp"
#include "lanes.hpp"

namespace doppelgait::robust {

// Quantile of one value or more; between two values it lies on a straight line.
double quantile(const double* values, Index n, double share);
inline double median(const double* values, Index n) { return quantile(values, n, 0.5); }

// A sum over n places in 32 parts, at every level: add(sum, place) adds to numbers or vectors.
template <typename Add>
inline double sum_of(Index n, Add add) {
  constexpr Index parts = 32 / kHalfWidth;
  Double sums[parts] = {};
  Index k = 0;
  for (; k + 32 <= n; k += 32) {
    for (Index part = 0; part < parts; ++part) sums[part] = add(sums[part], k + part * kHalfWidth);
  }
  double s[32];
  std::memcpy(s, sums, sizeof s);
  for (Index part = 0; part < 32; part += kHalfWidth) {
    if (k + part + kHalfWidth <= n) store(s + part, add(load<Double>(s + part), k + part));
  }
  for (Index left = (n - k) % kHalfWidth; left > 0; --left) s[n - k - left] = add(s[n - k - left], n - left);
  for (Index half = 16; half > 0; half /= 2) {
    for (Index part = 0; part < half; ++part) s[part] += s[part + half];
  }
  return s[0];
}

inline double dot(const double* one, const double* other, Index n) {
  return sum_of(n, [=](auto sum, Index k) {
    using V = decltype(sum);
    return fused(load<V>(one + k), load<V>(other + k), sum);
  });
}

}  // namespace doppelgait::robust

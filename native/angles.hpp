// Angles of directions in float64, from products and sums alone: the same bytes on every system.
#pragma once

#include "lanes.hpp"

namespace doppelgait {

// Angle of the point (x, y) in radians, 0 for the origin, for doubles and for vectors of them. After two reflections
// |z| is below tan(pi / 8), where atan(z) = z + z^3 (A0 + A1 z^2 + ...), interpolated in 11 Chebyshev nodes (5e-18
// before rounding).
template <typename V>
inline V angle_of(V y, V x) {
  constexpr double coefficients[] = {-0.019176887119062364, 0.03923165829558727,  -0.050854497379402626,
                                     0.0585814891280221,    -0.06664511447381948, 0.07692183190826087,
                                     -0.09090904578123903,  0.11111111015256361,  -0.14285714284666542,
                                     0.1999999999999552,    -0.3333333333333333};
  constexpr double half_pi = 1.57079632679489662;
  const V zero{}, a = x < zero ? -x : x, b = y < zero ? -y : y;
  const auto steep = a < b;
  const V low = steep ? a : b, high = steep ? b : a;
  const auto wide = low > 0.414213562373095049 * high;
  const V z = (wide ? low - high : low) / ((wide ? low + high : high) + (high == zero ? zero + 1.0 : zero));
  const V u = z * z;
  V tail = zero + coefficients[0];
  for (int n = 1; n < 11; ++n) tail = fused(tail, u, zero + coefficients[n]);
  V angle = fused(z * u, tail, z) + (wide ? zero + 0.5 * half_pi : zero);
  angle = steep ? half_pi - angle : angle;
  angle = x < zero ? 2.0 * half_pi - angle : angle;
  return y < zero ? -angle : angle;
}

}  // namespace doppelgait

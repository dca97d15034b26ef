// Elementary functions from products and sums alone: the same bytes on every system.
#pragma once

#include <cstdint>
#include <type_traits>

#include "lanes.hpp"

namespace doppelgait {

// Cosine and sine of an angle within an eighth of a turn, with errors of 4e-9 and 1.2e-10 before rounding.
inline void small_phasor(Float angle, Float& cosine, Float& sine) {
  const Float square = angle * angle;
  const Float even = 0.0416666456f + square * (-0.0013887316f + square * 0.0000244332f);
  const Float odd = -0.1666665524f + square * (0.0083321603f + square * -0.0001951528f);
  cosine = 1.0f - (0.5f * square - square * square * even);
  sine = angle + angle * square * odd;
}

// Cosine and sine of turns, at most half of one.
inline void phasor(Float turns, Float& cosine, Float& sine) {
  const Float quarter = round_even(4.0f * turns);
  Float x, y;
  small_phasor((turns - 0.25f * quarter) * 6.28318530717959f, x, y);
  const Int count = __builtin_convertvector(quarter, Int), odd = (count & 1) != 0;
  cosine = bits_of<Float>(bits_of<Int>(odd ? y : x) ^ (((count + 1) & 2) << 30));
  sine = bits_of<Float>(bits_of<Int>(odd ? x : y) ^ ((count & 2) << 30));
}

// Cosines and sines of any numbers of turns, rounded to single precision after whole turns; whole vectors are written.
inline void compute_phasors(const double* turns, std::int64_t n, float* cosines, float* sines) {
  for (std::int64_t i = 0; i < n; i += kWidth) {
    const Double a = load<Double>(turns + i), b = load<Double>(turns + i + kHalfWidth);
    Float cosine, sine;
    phasor(narrow(a - round_even(a), b - round_even(b)), cosine, sine);
    store(cosines + i, cosine);
    store(sines + i, sine);
  }
}

// Cosine and sine of an angle within an eighth of a turn, after a number of quarter turns, of a number in double
// precision or of a vector of them. The series of sine and cosine end below 1e-16.
template <typename V>
inline void phasor(V angle, V quarter, V& cosine, V& sine) {
  constexpr double odd[] = {1.0 / 355687428096000.0, -1.0 / 1307674368000.0, 1.0 / 6227020800.0, -1.0 / 39916800.0,
                            1.0 / 362880.0,          -1.0 / 5040.0,          1.0 / 120.0,        -1.0 / 6.0};
  constexpr double even[] = {1.0 / 20922789888000.0, -1.0 / 87178291200.0, 1.0 / 479001600.0, -1.0 / 3628800.0,
                             1.0 / 40320.0,          -1.0 / 720.0,         1.0 / 24.0,        -0.5};
  const V square = angle * angle, zero{};
  V x = zero + even[0], y = zero + odd[0];
  for (int k = 1; k < 8; ++k) {
    x = fused(square, x, zero + even[k]);
    y = fused(square, y, zero + odd[k]);
  }
  x = fused(square, x, zero + 1.0);
  y = fused(angle * square, y, angle);
  const V left = quarter - 4.0 * round_even(0.25 * quarter);  // -2 to 2 quarters
  const V one = left * left;
  const V re = one == 1.0 ? y : x, im = one == 1.0 ? x : y;
  cosine = (left == 1.0) | (one == 4.0) ? -re : re;
  sine = (left == -1.0) | (one == 4.0) ? -im : im;
}

// Cosine and sine of any number of turns.
template <typename V>
inline void phasor(V turns, V& cosine, V& sine) {
  const V quarter = round_even(4.0 * turns);
  phasor(6.28318530717958648 * (turns - 0.25 * quarter), quarter, cosine, sine);
}

template <typename V>
using Bits = std::conditional_t<std::is_same_v<V, double>, std::uint64_t, Long>;

constexpr double kPi = 3.14159265358979323846;
constexpr double kLn2High = 0.693147180369123816490, kLn2Low = 1.90821492927058770002e-10;

// 2^k from k in the last bits of a double that was rounded by adding kRounder: so large a double has no fraction.
constexpr double kRounder = 1.5 * 4503599627370496.0;
template <typename V>
inline V scale(V value, V rounded) {
  return bits_of<V>(bits_of<Bits<V>>(value) + (bits_of<Bits<V>>(rounded) << 52));
}

// (e^r - 1 - r) / r^2; Taylor's series ends below 1e-17 for |r| <= ln(2) / 2.
template <typename V>
inline V exponential_bend(V r) {
  const V zero{};
  V sum = zero + 1.0 / 6227020800.0;
  double factor = 1.0 / 479001600.0;
  for (int k = 12; k >= 2; factor *= k, --k) sum = fused(r, sum, zero + factor);
  return sum;
}

// e^x, 0 below -700.
template <typename V>
inline V exponential(V x) {
  const V zero{}, within = x > -700.0 ? x : zero - 700.0;
  const V rounded = within * 1.44269504088896341 + kRounder, whole = rounded - kRounder;
  const V r = fused(whole, zero - kLn2Low, fused(whole, zero - kLn2High, within));
  return x > -700.0 ? scale(fused(r, fused(r, exponential_bend(r), zero + 1.0), zero + 1.0), rounded) : zero;
}

// Natural logarithm of the fraction m of a normal number above 0, from sqrt(1/2) to sqrt(2), and its exponent: with
// s = (m - 1) / (m + 1), 2 s (1 + s^2 / 3 + ...) = (m - 1) - s (m - 1 - 2 s^2 / 3 - ...).
template <typename V>
inline V logarithm(V x, V& exponent) {
  constexpr std::uint64_t root_half = 0x3FE6A09E667F3BCD;  // bits of sqrt(1/2)
  constexpr double shift = 4503599627370496.0;             // 2^52: small whole numbers stand in its last bits
  const Bits<V> offset = bits_of<Bits<V>>(x) - root_half + (std::uint64_t{1024} << 52);
  exponent = bits_of<V>((offset >> 52) | std::uint64_t{0x4330000000000000}) - (shift + 1024.0);
  const V more = bits_of<V>((offset & 0xFFFFFFFFFFFFF) + root_half) - 1.0, s = more / (more + 2.0), square = s * s,
          zero{};
  V sum = zero + 1.0 / 23.0;
  for (int k = 21; k > 1; k -= 2) sum = fused(square, sum, zero + 1.0 / k);
  return fused(-s, fused(-2.0 * square, sum, more), more);
}

// Natural logarithm of a normal number above 0.
template <typename V>
inline V logarithm(V x) {
  V exponent, zero{};
  const V fraction = logarithm(x, exponent);
  return fused(exponent, zero + kLn2High, fused(exponent, zero + kLn2Low, fraction));
}

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

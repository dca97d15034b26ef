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

// Cosine and sine of any number of turns in double precision, or of a vector of them. Within an eighth of a turn the
// series of sine and cosine end below 1e-16.
template <typename V>
inline void phasor(V turns, V& cosine, V& sine) {
  constexpr double odd[] = {1.0 / 355687428096000.0, -1.0 / 1307674368000.0, 1.0 / 6227020800.0, -1.0 / 39916800.0,
                            1.0 / 362880.0,          -1.0 / 5040.0,          1.0 / 120.0,        -1.0 / 6.0};
  constexpr double even[] = {1.0 / 20922789888000.0, -1.0 / 87178291200.0, 1.0 / 479001600.0, -1.0 / 3628800.0,
                             1.0 / 40320.0,          -1.0 / 720.0,         1.0 / 24.0,        -0.5};
  const V quarter = round_even(4.0 * turns), angle = 6.28318530717958648 * (turns - 0.25 * quarter);
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

template <typename V>
using Bits = std::conditional_t<std::is_same_v<V, double>, std::uint64_t, Long>;

constexpr double kPi = 3.14159265358979323846;
constexpr double kLn2High = 0.693147180369123816490, kLn2Low = 1.90821492927058770002e-10;

// e^x, 0 below -700; Taylor's series ends below 1e-17 for |x| <= ln(2) / 2.
template <typename V>
inline V exponential(V x) {
  constexpr double rounder = 1.5 * 4503599627370496.0;  // so large a double has no fraction: adding it rounds
  const V zero{}, within = x > -700.0 ? x : zero - 700.0;
  const V rounded = within * 1.44269504088896341 + rounder, whole = rounded - rounder;
  const V r = fused(whole, zero - kLn2Low, fused(whole, zero - kLn2High, within));
  V sum = zero + 1.0 / 6227020800.0;
  double factor = 1.0 / 479001600.0;
  for (int k = 12; k >= 0; factor *= k > 0 ? k : 1.0, --k) sum = fused(r, sum, zero + factor);
  const V power = bits_of<V>(bits_of<Bits<V>>(sum) + (bits_of<Bits<V>>(rounded) << 52));
  return x > -700.0 ? power : zero;
}

// Natural logarithm of a normal number above 0: with s = (m - 1) / (m + 1) of its fraction m, 2 s (1 + s^2 / 3 + ...).
template <typename V>
inline V logarithm(V x) {
  constexpr std::uint64_t root_half = 0x3FE6A09E667F3BCD;  // bits of sqrt(1/2)
  constexpr double shift = 4503599627370496.0;             // 2^52: small whole numbers stand in its last bits
  const Bits<V> offset = bits_of<Bits<V>>(x) - root_half + (std::uint64_t{1024} << 52);
  const V exponent = bits_of<V>((offset >> 52) | std::uint64_t{0x4330000000000000}) - (shift + 1024.0);
  const V m = bits_of<V>((offset & 0xFFFFFFFFFFFFF) + root_half), s = (m - 1.0) / (m + 1.0), square = s * s, zero{};
  V sum = zero + 1.0 / 23.0;
  for (int k = 21; k > 1; k -= 2) sum = fused(square, sum, zero + 1.0 / k);
  const V twice = 2.0 * s;
  return fused(exponent, zero + kLn2High, fused(exponent, zero + kLn2Low, fused(twice * square, sum, twice)));
}

}  // namespace doppelgait

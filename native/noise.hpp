// Counter-based complex Gaussian receiver noise (E-18), white or correlated over range (E-18c).
//
// Every value is a function of (key, frame, bin), so that any block of frames and bins, in any order and by any worker,
// has the same values. All steps are exact integer operations or single IEEE operations.
#pragma once

#include <cstdint>

#include "elementary.hpp"

namespace doppelgait::noise {

struct Words {
  Word at[4];
};

template <int... lane>
inline Word join_words(Word even, Word odd, std::integer_sequence<int, lane...>) {
  return __builtin_shufflevector(even, odd, (lane % 2 ? kWidth + lane - 1 : lane)...);
}

// Philox4x32-10 (Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC11). Even and odd
// lanes are computed by themselves in words of 64 bits, whose high halves mean nothing: one product has both halves.
inline Words philox(const Words& counter, std::uint64_t key) {
  Long c[2][4];
  for (int word = 0; word < 4; ++word) {
    c[0][word] = bits_of<Long>(counter.at[word]);
    c[1][word] = c[0][word] >> 32;
  }
  auto k0 = static_cast<std::uint32_t>(key), k1 = static_cast<std::uint32_t>(key >> 32);
  for (int round = 0; round < 10; ++round, k0 += 0x9E3779B9, k1 += 0xBB67AE85) {
    for (auto& x : c) {
      const Long first = multiply_words(x[0], 0xD2511F53), second = multiply_words(x[2], 0xCD9E8D57);
      x[0] = (second >> 32) ^ x[1] ^ k0, x[1] = second;
      x[2] = (first >> 32) ^ x[3] ^ k1, x[3] = first;
    }
  }
  Words drawn;
  for (int word = 0; word < 4; ++word) {
    constexpr auto lanes = std::make_integer_sequence<int, kWidth>();
    drawn.at[word] = join_words(bits_of<Word>(c[0][word]), bits_of<Word>(c[1][word]), lanes);
  }
  return drawn;
}

// Exponential variable of mean 1: -ln u with u = (w + 1/2) / 2^32. ln(1 + f) = f + f^2 (L0 + L1 f + ...) with the least
// maximum relative error over the reduced range, found by Lawson's iteration (4e-9 before rounding).
inline Float exponential(Word word) {
  constexpr std::int32_t root_half = 0x3F3504F3;  // bits of sqrt(1/2)
  const Float value = __builtin_convertvector(word, Float) + 0.5f;
  const Int offset = bits_of<Int>(value) - root_half;
  const Float exponent = __builtin_convertvector((offset >> 23) - 32, Float);
  const Float f = bits_of<Float>((offset & 0x7FFFFF) + root_half) - 1.0f;
  const Float tail =
      0.2000197321f +
      f * (-0.1660908163f + f * (0.1418182850f + f * (-0.1324298978f + f * (0.1290443838f + f * -0.0762178078f))));
  const Float series = f + f * f * (-0.4999998808f + f * (0.3333332539f + f * (-0.2500158250f + f * tail)));
  return -(exponent * 0.693147180559945f + series);
}

// Uniformly distributed point of the unit circle, with an error below 2^-23.
inline void direction(Word word, Float& x, Float& y) {
  const Float angle = __builtin_convertvector((Int)(word << 2), Float) * (0.785398163397448f / 2147483648.0f);
  Float cosine, sine;
  small_phasor(angle, cosine, sine);
  const Int swap = (word & (1u << 30)) != 0;
  const Int sign = (Int)(word & (1u << 31));
  x = bits_of<Float>(bits_of<Int>(swap ? sine : cosine) ^ sign);
  y = bits_of<Float>(bits_of<Int>(swap ? cosine : sine) ^ sign);
}

}  // namespace doppelgait::noise

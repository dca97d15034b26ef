// Numbers side by side in a vector of the processor: a lane is a pulse, a column or a bin, never a term of a sum, so
// that no result depends on the width. Products and sums are fused where the source says so.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <utility>

#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

namespace doppelgait {

#if defined(__AVX512F__)
constexpr int kWidth = 16;
#elif defined(__AVX2__)
constexpr int kWidth = 8;
#else
constexpr int kWidth = 4;
#endif

typedef float Float __attribute__((vector_size(4 * kWidth)));
typedef std::int32_t Int __attribute__((vector_size(4 * kWidth)));
typedef std::uint32_t Word __attribute__((vector_size(4 * kWidth)));
typedef std::uint64_t Long __attribute__((vector_size(4 * kWidth)));
typedef double Double __attribute__((vector_size(4 * kWidth)));  // half as many
constexpr int kHalfWidth = kWidth / 2;
typedef float HalfFloat __attribute__((vector_size(4 * kHalfWidth)));  // as many as in a Double

template <typename Vector, typename T>
inline Vector load(const T* from) {
  Vector value;
  std::memcpy(&value, from, sizeof value);
  return value;
}

template <typename Vector, typename T>
inline void store(T* to, Vector value) {
  std::memcpy(to, &value, sizeof value);
}

inline Double load_double(const double* from) { return load<Double>(from); }
template <typename T>
inline Double load_double(const T* from) {
  return __builtin_convertvector(load<HalfFloat>(from), Double);
}

template <typename To, typename From>
inline To bits_of(From value) {
  static_assert(sizeof(To) == sizeof(From));
  To bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
}

inline Float spread(float value) { return value - Float{}; }
inline Double spread(double value) { return value - Double{}; }

// A number in single precision, or half a vector of them.
inline void store_narrow(float* to, double value) { *to = static_cast<float>(value); }
inline void store_narrow(float* to, Double value) { store(to, __builtin_convertvector(value, HalfFloat)); }

template <int... lane>
inline Float join(HalfFloat a, HalfFloat b, std::integer_sequence<int, lane...>) {
  return __builtin_shufflevector(a, b, lane...);
}

// Two vectors of double precision side by side in single precision.
inline Float narrow(Double first, Double second) {
  constexpr auto lanes = std::make_integer_sequence<int, kWidth>();
  return join(__builtin_convertvector(first, HalfFloat), __builtin_convertvector(second, HalfFloat), lanes);
}

// Keeps what was loaded in a register: gcc would load it again for every use.
inline Float in_register(Float value) {
#if defined(__x86_64__)
  asm("" : "+v"(value));
#elif defined(__aarch64__)
  asm("" : "+w"(value));
#endif
  return value;
}

// A function of every lane.
template <typename V, typename Function>
inline V map_lanes(V value, Function function) {
  for (std::size_t lane = 0; lane < sizeof value / sizeof value[0]; ++lane) value[lane] = function(value[lane]);
  return value;
}

// a b + c, rounded once. Level 1 has no such instruction and rounds twice: its last bits differ.
template <typename V>
inline V fused(V a, V b, V c) {
#if defined(__FMA__) || defined(__aarch64__)
  return std::fma(a, b, c);
#else
  return a * b + c;
#endif
}

// The nearest whole number, of two the even one.
inline double round_even(double value) { return std::nearbyint(value); }
template <typename V>
inline V round_even(V value) {
  return map_lanes(value, [](auto number) { return std::nearbyint(number); });
}

inline double square_root(double value) { return std::sqrt(value); }
template <typename V>
inline V square_root(V value) {
  return map_lanes(value, [](auto number) { return std::sqrt(number); });
}

// The least number of all lanes.
template <typename V>
inline double least(V value) {
  double least = value[0];
  for (int lane = 1; lane < kHalfWidth; ++lane) least = std::min(least, value[lane]);
  return least;
}

// Whether a comparison holds in any lane.
typedef decltype(Double{} < Double{}) Mask;
inline bool any(bool mask) { return mask; }
#if !defined(__AVX2__)
inline bool any(Mask mask) {
  for (int lane = 0; lane < kHalfWidth; ++lane) {
    if (mask[lane]) return true;
  }
  return false;
}
#endif

// Numbers at whole places.
inline double gather(const double* from, double place) { return from[static_cast<std::int64_t>(place)]; }
template <typename V>
inline V gather(const double* from, V places) {
  return map_lanes(places, [from](double place) { return gather(from, place); });
}

// Products of the low words of all lanes with one word.
template <typename V>
inline V multiply_words(V a, std::uint32_t b) {
  return (a & 0xFFFFFFFF) * b;
}

// The same by one instruction, which compilers do not find.
#if defined(__AVX512F__)
inline Float fused(Float a, Float b, Float c) { return (Float)_mm512_fmadd_ps((__m512)a, (__m512)b, (__m512)c); }
inline Double fused(Double a, Double b, Double c) {
  return (Double)_mm512_fmadd_pd((__m512d)a, (__m512d)b, (__m512d)c);
}
inline Float round_even(Float value) { return (Float)_mm512_roundscale_ps((__m512)value, 8); }
inline Double round_even(Double value) { return (Double)_mm512_roundscale_pd((__m512d)value, 8); }
inline Float square_root(Float value) { return (Float)_mm512_sqrt_ps((__m512)value); }
inline Double square_root(Double value) { return (Double)_mm512_sqrt_pd((__m512d)value); }
inline Double load_double(const float* from) { return (Double)_mm512_cvtps_pd(_mm256_loadu_ps(from)); }
inline double least(Double value) { return _mm512_reduce_min_pd((__m512d)value); }
inline bool any(Mask mask) { return _mm512_test_epi64_mask((__m512i)mask, (__m512i)mask) != 0; }
inline Long multiply_words(Long a, std::uint32_t b) { return (Long)_mm512_mul_epu32((__m512i)a, _mm512_set1_epi64(b)); }
#elif defined(__AVX2__)
inline Float fused(Float a, Float b, Float c) { return (Float)_mm256_fmadd_ps((__m256)a, (__m256)b, (__m256)c); }
inline Double fused(Double a, Double b, Double c) {
  return (Double)_mm256_fmadd_pd((__m256d)a, (__m256d)b, (__m256d)c);
}
inline Float round_even(Float value) { return (Float)_mm256_round_ps((__m256)value, 8); }
inline Double round_even(Double value) { return (Double)_mm256_round_pd((__m256d)value, 8); }
inline Float square_root(Float value) { return (Float)_mm256_sqrt_ps((__m256)value); }
inline Double square_root(Double value) { return (Double)_mm256_sqrt_pd((__m256d)value); }
inline Double load_double(const float* from) { return (Double)_mm256_cvtps_pd(_mm_loadu_ps(from)); }
inline bool any(Mask mask) { return _mm256_movemask_pd((__m256d)mask) != 0; }
inline Long multiply_words(Long a, std::uint32_t b) {
  return (Long)_mm256_mul_epu32((__m256i)a, _mm256_set1_epi64x(b));
}
#elif defined(__SSE4_1__)
inline Float round_even(Float value) { return (Float)_mm_round_ps((__m128)value, 8); }
inline Double round_even(Double value) { return (Double)_mm_round_pd((__m128d)value, 8); }
inline Float square_root(Float value) { return (Float)_mm_sqrt_ps((__m128)value); }
inline Double square_root(Double value) { return (Double)_mm_sqrt_pd((__m128d)value); }
#elif defined(__aarch64__)
inline Float fused(Float a, Float b, Float c) {
  return (Float)vfmaq_f32((float32x4_t)c, (float32x4_t)a, (float32x4_t)b);
}
inline Double fused(Double a, Double b, Double c) {
  return (Double)vfmaq_f64((float64x2_t)c, (float64x2_t)a, (float64x2_t)b);
}
#endif

inline Float fused(Float a, Float b, float c) { return fused(a, b, spread(c)); }
inline Float fused(Float a, float b, float c) { return fused(a, spread(b), spread(c)); }

inline Double fused(Double a, Double b, double c) { return fused(a, b, spread(c)); }
inline Double fused(Double a, double b, Double c) { return fused(a, spread(b), c); }
inline Double fused(Double a, double b, double c) { return fused(a, spread(b), spread(c)); }

template <typename V>
inline V round_down(V value) {
  const V nearest = round_even(value), less = nearest - 1.0;
  return nearest > value ? less : nearest;
}

template <typename V>
inline V larger(V a, double b) {
  return a > V{} + b ? a : V{} + b;
}

// Every third number of three vectors, from number k on, and the number k of three.
template <int k, int... lane>
inline Double take_third(Double a, Double b, Double c, std::integer_sequence<int, lane...>) {
  constexpr int n = kHalfWidth;
  const Double from_two = __builtin_shufflevector(a, b, (3 * lane + k < 2 * n ? 3 * lane + k : 0)...);
  return __builtin_shufflevector(from_two, c, (3 * lane + k < 2 * n ? lane : 3 * lane + k - n)...);
}

// Lanes of two vectors in turn, from a lane on.
template <int first, int... lane>
inline Float take_turns(Float a, Float b, std::integer_sequence<int, lane...>) {
  return __builtin_shufflevector(a, b, (first + lane / 2 + lane % 2 * kWidth)...);
}

// Vectors become lanes: mixing the first half of the vectors with the second moves one bit of the places.
inline void transpose(Float (&rows)[kWidth]) {
  constexpr int half = kWidth / 2;
  constexpr auto lanes = std::make_integer_sequence<int, kWidth>();
  for (int round = 1; round < kWidth; round *= 2) {
    Float mixed[kWidth];
    for (int i = 0; i < half; ++i) {
      mixed[2 * i] = take_turns<0>(rows[i], rows[i + half], lanes);
      mixed[2 * i + 1] = take_turns<half>(rows[i], rows[i + half], lanes);
    }
    for (int i = 0; i < kWidth; ++i) rows[i] = mixed[i];
  }
}

// Coordinates in turn become those of points side by side.
inline void take_thirds(const double (&from)[3], double (&to)[3]) { std::copy(from, from + 3, to); }
inline void take_thirds(const Double (&from)[3], Double (&to)[3]) {
  constexpr auto lanes = std::make_integer_sequence<int, kHalfWidth>();
  to[0] = take_third<0>(from[0], from[1], from[2], lanes);
  to[1] = take_third<1>(from[0], from[1], from[2], lanes);
  to[2] = take_third<2>(from[0], from[1], from[2], lanes);
}

// Coordinates of points side by side that lie behind each other.
template <typename V>
inline void load_points(const double* from, V (&to)[3]) {
  constexpr int n = sizeof(V) / sizeof(double);
  take_thirds({load<V>(from), load<V>(from + n), load<V>(from + 2 * n)}, to);
}

// Call body(zero, place) for n places side by side, with a vector of zeros or, for few places, with the number 0.0.
// Places may be repeated: what the body reads, it must not change.
template <typename Body>
inline void side_by_side(std::int64_t n, Body body) {
  if (n < kHalfWidth) {
    for (std::int64_t place = 0; place < n; ++place) body(0.0, place);
  } else {
    for (std::int64_t place = 0; place < n; place += kHalfWidth) {
      body(Double{}, place < n - kHalfWidth ? place : n - kHalfWidth);
    }
  }
}

// A sum over n places in 32 parts, at every level: add(sum, place) adds to numbers or vectors.
template <typename Add>
inline double sum_of(std::int64_t n, Add add) {
  constexpr std::int64_t parts = 32 / kHalfWidth;
  Double sums[parts] = {};
  std::int64_t k = 0;
  for (; k + 32 <= n; k += 32) {
    for (std::int64_t part = 0; part < parts; ++part) sums[part] = add(sums[part], k + part * kHalfWidth);
  }
  double s[32];
  std::memcpy(s, sums, sizeof s);
  for (std::int64_t part = 0; part < 32; part += kHalfWidth) {
    if (k + part + kHalfWidth <= n) store(s + part, add(load<Double>(s + part), k + part));
  }
  for (std::int64_t left = (n - k) % kHalfWidth; left > 0; --left) s[n - k - left] = add(s[n - k - left], n - left);
  for (std::int64_t half = 16; half > 0; half /= 2) {
    for (std::int64_t part = 0; part < half; ++part) s[part] += s[part + half];
  }
  return s[0];
}

inline double dot(const double* one, const double* other, std::int64_t n) {
  return sum_of(n, [=](auto sum, std::int64_t k) {
    using V = decltype(sum);
    return fused(load<V>(one + k), load<V>(other + k), sum);
  });
}

}  // namespace doppelgait

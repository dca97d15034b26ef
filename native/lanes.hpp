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
#elif defined(__ARM_NEON)
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
inline Double load_double(const float* from) { return __builtin_convertvector(load<HalfFloat>(from), Double); }

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
inline void store_narrow(float* to, Double value) {
#if defined(__AVX512F__)
  store(to, (HalfFloat)_mm512_cvtpd_ps((__m512d)value));
#elif defined(__AVX2__)
  store(to, (HalfFloat)_mm256_cvtpd_ps((__m256d)value));
#else
  store(to, __builtin_convertvector(value, HalfFloat));
#endif
}

inline Double widen(HalfFloat value) {
#if defined(__AVX512F__)
  return (Double)_mm512_cvtps_pd((__m256)value);
#elif defined(__AVX2__)
  return (Double)_mm256_cvtps_pd((__m128)value);
#else
  return __builtin_convertvector(value, Double);
#endif
}

// Two vectors of double precision side by side in single precision.
inline Float narrow(Double first, Double second) {
#if defined(__AVX512F__)
  const __m256 low = _mm512_cvtpd_ps((__m512d)first), high = _mm512_cvtpd_ps((__m512d)second);
  return (Float)_mm512_insertf32x8(_mm512_castps256_ps512(low), high, 1);
#elif defined(__AVX2__)
  return (Float)_mm256_set_m128(_mm256_cvtpd_ps((__m256d)second), _mm256_cvtpd_ps((__m256d)first));
#else
  const HalfFloat low = __builtin_convertvector(first, HalfFloat), high = __builtin_convertvector(second, HalfFloat);
  return Float{low[0], low[1], high[0], high[1]};
#endif
}

inline double least(Double value) {
#if defined(__AVX512F__)
  return _mm512_reduce_min_pd((__m512d)value);
#else
  double least = value[0];
  for (int lane = 1; lane < kHalfWidth; ++lane) least = std::min(least, value[lane]);
  return least;
#endif
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

// a b + c, rounded once. Level 1 has no such instruction and rounds twice: its last bits differ.
inline float fused(float a, float b, float c) {
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA)
  return __builtin_fmaf(a, b, c);
#else
  return a * b + c;
#endif
}

inline double fused(double a, double b, double c) {
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA)
  return __builtin_fma(a, b, c);
#else
  return a * b + c;
#endif
}

inline Float fused(Float a, Float b, Float c) {
#if defined(__AVX512F__)
  return (Float)_mm512_fmadd_ps((__m512)a, (__m512)b, (__m512)c);
#elif defined(__FMA__)
  return (Float)_mm256_fmadd_ps((__m256)a, (__m256)b, (__m256)c);
#elif defined(__ARM_NEON)
  return (Float)vfmaq_f32((float32x4_t)c, (float32x4_t)a, (float32x4_t)b);
#else
  return a * b + c;
#endif
}

inline Float fused(Float a, Float b, float c) { return fused(a, b, spread(c)); }
inline Float fused(Float a, float b, float c) { return fused(a, spread(b), spread(c)); }

inline Double fused(Double a, Double b, Double c) {
#if defined(__AVX512F__)
  return (Double)_mm512_fmadd_pd((__m512d)a, (__m512d)b, (__m512d)c);
#elif defined(__FMA__)
  return (Double)_mm256_fmadd_pd((__m256d)a, (__m256d)b, (__m256d)c);
#elif defined(__aarch64__)
  return (Double)vfmaq_f64((float64x2_t)c, (float64x2_t)a, (float64x2_t)b);
#else
  return a * b + c;
#endif
}

inline Double fused(Double a, Double b, double c) { return fused(a, b, spread(c)); }
inline Double fused(Double a, double b, Double c) { return fused(a, spread(b), c); }
inline Double fused(Double a, double b, double c) { return fused(a, spread(b), spread(c)); }

// The nearest whole number, of two the even one.
inline double round_even(double value) { return std::nearbyint(value); }
inline Double round_even(Double value) {
#if defined(__AVX512F__)
  return (Double)_mm512_roundscale_pd((__m512d)value, 8);
#elif defined(__AVX2__)
  return (Double)_mm256_round_pd((__m256d)value, 8);
#elif defined(__SSE4_1__)
  return (Double)_mm_round_pd((__m128d)value, 8);
#else
  for (int lane = 0; lane < kHalfWidth; ++lane) value[lane] = std::nearbyint(value[lane]);
  return value;
#endif
}

template <typename V>
inline V round_down(V value) {
  const V nearest = round_even(value), less = nearest - 1.0;
  return nearest > value ? less : nearest;
}

inline Float round_even(Float value) {
#if defined(__AVX512F__)
  return (Float)_mm512_roundscale_ps((__m512)value, 8);
#elif defined(__AVX2__)
  return (Float)_mm256_round_ps((__m256)value, 8);
#elif defined(__SSE4_1__)
  return (Float)_mm_round_ps((__m128)value, 8);
#else
  for (int lane = 0; lane < kWidth; ++lane) value[lane] = std::nearbyint(value[lane]);
  return value;
#endif
}

inline Float square_root(Float value) {
#if defined(__AVX512F__)
  return (Float)_mm512_sqrt_ps((__m512)value);
#elif defined(__AVX2__)
  return (Float)_mm256_sqrt_ps((__m256)value);
#elif defined(__x86_64__)
  return (Float)_mm_sqrt_ps((__m128)value);
#else
  for (int lane = 0; lane < kWidth; ++lane) value[lane] = std::sqrt(value[lane]);
  return value;
#endif
}

inline double square_root(double value) { return std::sqrt(value); }
inline Double square_root(Double value) {
#if defined(__AVX512F__)
  return (Double)_mm512_sqrt_pd((__m512d)value);
#elif defined(__AVX2__)
  return (Double)_mm256_sqrt_pd((__m256d)value);
#elif defined(__x86_64__)
  return (Double)_mm_sqrt_pd((__m128d)value);
#else
  for (int lane = 0; lane < kHalfWidth; ++lane) value[lane] = std::sqrt(value[lane]);
  return value;
#endif
}

template <typename V>
inline V larger(V a, double b) {
  return a > V{} + b ? a : V{} + b;
}

// Products of the low words of all lanes with one word.
inline Long multiply_words(Long a, std::uint32_t b) {
#if defined(__AVX512F__)
  return (Long)_mm512_mul_epu32((__m512i)a, _mm512_set1_epi64(b));
#elif defined(__AVX2__)
  return (Long)_mm256_mul_epu32((__m256i)a, _mm256_set1_epi64x(b));
#else
  return (a & 0xFFFFFFFF) * b;
#endif
}

// Every third number of three vectors, from number k on, and the number k of three.
template <int k, int... lane>
inline Double take_third(Double a, Double b, Double c, std::integer_sequence<int, lane...>) {
  constexpr int n = kHalfWidth;
  const Double from_two = __builtin_shufflevector(a, b, (3 * lane + k < 2 * n ? 3 * lane + k : 0)...);
  return __builtin_shufflevector(from_two, c, (3 * lane + k < 2 * n ? lane : 3 * lane + k - n)...);
}
template <int k>
inline Double take_third(Double a, Double b, Double c) {
  return take_third<k>(a, b, c, std::make_integer_sequence<int, kHalfWidth>());
}
template <int k>
inline double take_third(double a, double b, double c) {
  return k == 0 ? a : k == 1 ? b : c;
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

// Coordinates of points side by side that lie behind each other.
template <typename V>
inline void load_points(const double* from, V (&to)[3]) {
  constexpr int n = sizeof(V) / sizeof(double);
  const V a = load<V>(from), b = load<V>(from + n), c = load<V>(from + 2 * n);
  to[0] = take_third<0>(a, b, c);
  to[1] = take_third<1>(a, b, c);
  to[2] = take_third<2>(a, b, c);
}

// Numbers at whole places.
inline double gather(const double* from, double places) { return from[static_cast<std::int64_t>(places)]; }
inline Double gather(const double* from, Double places) {
#if defined(__AVX512F__)
  return (Double)_mm512_i32gather_pd(_mm512_cvttpd_epi32((__m512d)places), from, 8);
#elif defined(__AVX2__)
  return (Double)_mm256_i32gather_pd(from, _mm256_cvttpd_epi32((__m256d)places), 8);
#else
  for (int lane = 0; lane < kHalfWidth; ++lane) places[lane] = gather(from, places[lane]);
  return places;
#endif
}

// Whether a comparison holds in any lane.
inline bool any(bool mask) { return mask; }
inline bool any(decltype(Double{} < Double{}) mask) {
#if defined(__AVX512F__)
  return _mm512_test_epi64_mask((__m512i)mask, (__m512i)mask) != 0;
#elif defined(__AVX2__)
  return _mm256_movemask_pd((__m256d)mask) != 0;
#else
  for (int lane = 0; lane < kHalfWidth; ++lane) {
    if (mask[lane]) return true;
  }
  return false;
#endif
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

}  // namespace doppelgait

// Passes over planes of samples and other rows of single-precision numbers.
#include "arrays.hpp"

namespace doppelgait::planes {
namespace {

// Multiplies complex numbers by factors. The products may replace the numbers.
void multiply(Line<const float> re, const float* im, const float* factor_re, const float* factor_im, float* out_re,
              float* out_im) {
  Index i = 0;
  for (; i + kWidth <= re.size; i += kWidth) {
    const Float x = load<Float>(re.data + i), y = load<Float>(im + i);
    const Float u = load<Float>(factor_re + i), v = load<Float>(factor_im + i);
    store(out_re + i, x * u - y * v);
    store(out_im + i, x * v + y * u);
  }
  for (; i < re.size; ++i) {
    const float x = re[i], y = im[i];
    out_re[i] = x * factor_re[i] - y * factor_im[i];
    out_im[i] = x * factor_im[i] + y * factor_re[i];
  }
}

// The largest re^2 + im^2 of every column.
void strongest_power(Plane<float> re, Plane<float> im, Line<float> out) {
  require(re.count == im.count && re.width >= out.size && im.width >= out.size, "planes and result do not fit");
  std::fill(out.data, out.data + out.size, 0.0f);
  for (Index n = 0; n < re.count; ++n) {
    const float *x = re[n], *y = im[n];
    for (Index i = 0; i < out.size; ++i) out[i] = std::max(out[i], x[i] * x[i] + y[i] * y[i]);
  }
}

// Multiplies planes by complex factors, one row of them for every row or for all.
void turn_planes(Rows<float> re, Rows<float> im, Rows<const float> u, Rows<const float> v) {
  require_shape(re.count, re.width, "planes do not fit", im);
  require_shape(u.count == 1 ? 1 : re.count, re.width, "factors do not fit", u, v);
  for (Index n = 0; n < re.count; ++n) {
    const Index k = u.count == 1 ? 0 : n;
    multiply({re[n], re.width}, im[n], u[k], v[k], re[n], im[n]);
  }
}

// The largest magnitude in the first n columns. Magnitudes are in the order of their bits.
float find_largest_part(Plane<float> rows, Index n) {
  require(n <= rows.width, "the rows are shorter");
  std::uint32_t largest = 0;
  for (Index row = 0; row < rows.count; ++row) {
    const float* line = rows[row];
    for (Index i = 0; i < n; ++i) largest = std::max(largest, bits_of<std::uint32_t>(line[i]) & 0x7FFFFFFF);
  }
  return bits_of<float>(largest);
}

// Rounds the first n columns to whole steps between two codes, in place or not; counts the values beyond the limit.
Index quantise_parts(Plane<float> from, Index n, double step, double lowest, double highest, double limit,
                     Rows<float> to) {
  require(from.count == to.count && n <= from.width && n <= to.width, "values and result do not fit");
  const double scale = 1.0 / step;
  const auto quantise = [=](auto value, auto low, auto high) {
    const auto nearest = round_even(value * scale), code = nearest < low ? low : nearest;
    return (code > high ? high : code) * step;
  };
  float largest = static_cast<float>(limit);  // the largest number that is not beyond
  if (largest > limit) largest = std::nextafter(largest, -INFINITY);
  Index n_beyond = 0;
  for (Index row = 0; row < from.count; ++row) {
    const float* line = from[row];
    Index i = 0;
    Int beyond = {};
    for (; i + kWidth <= n; i += kWidth) {
      const Float values = load<Float>(line + i);
      beyond -= bits_of<Float>(bits_of<Int>(values) & 0x7FFFFFFF) > largest;
      const Double a = load_double(line + i), b = load_double(line + i + kHalfWidth);
      const Double low = spread(lowest), high = spread(highest);
      store(to[row] + i, narrow(quantise(a, low, high), quantise(b, low, high)));
    }
    for (int lane = 0; lane < kWidth; ++lane) n_beyond += beyond[lane];
    for (; i < n; ++i) {
      n_beyond += std::fabs(line[i]) > largest;
      to[row][i] = static_cast<float>(quantise(double{line[i]}, lowest, highest));
    }
  }
  return n_beyond;
}

// Rotates sample n of pulse i by common[i] + sum_k weights[n, k] phases[k, i] turns, in place or not.
void rotate_parts(Plane<float> from_re, Plane<float> from_im, Line<const double> common, Rows<const double> phases,
                  Rows<const double> weights, Rows<float> to_re, Rows<float> to_im) {
  const auto fits = [&](const auto& plane) { return plane.count == weights.count && plane.width >= common.size; };
  require(fits(from_re) && fits(from_im) && fits(to_re) && fits(to_im), "planes, weights and phases do not fit");
  require(phases.count == weights.width && phases.width == common.size, "phases and weights do not fit");
  constexpr Index kPulses = 512;  // their phases stay in the first-level cache
  double turns[kPulses] = {};
  float cosines[kPulses], sines[kPulses];
  for (Index begin = 0; begin < common.size; begin += kPulses) {
    const Index size = std::min(kPulses, common.size - begin);
    for (Index n = 0; n < weights.count; ++n) {
      std::copy(common.data + begin, common.data + begin + size, turns);
      for (Index k = 0; k < phases.count; ++k) {
        const double *more = phases[k] + begin, share = weights[n][k];
        for (Index i = 0; i < size; ++i) turns[i] += share * more[i];
      }
      compute_phasors(turns, size, cosines, sines);
      multiply({from_re[n] + begin, size}, from_im[n] + begin, cosines, sines, to_re[n] + begin, to_im[n] + begin);
    }
  }
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "strongest_power", &strongest_power);
  define(module, "turn_planes", &turn_planes);
  define(module, "find_largest_part", &find_largest_part);
  define(module, "quantise_parts", &quantise_parts);
  define(module, "rotate_parts", &rotate_parts);
}

}  // namespace doppelgait::planes

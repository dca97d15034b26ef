// Sums of complex tones with quadratic phase: of frequency-swept radars, and along the limbs of bodies (E-08h).
#include "arrays.hpp"

namespace doppelgait::tones {
namespace {

template <typename V>
struct Phasor {
  Phasor operator*(const Phasor& by) const { return {fused(re, by.re, -(im * by.im)), fused(re, by.im, im * by.re)}; }

  V re, im;
};

template <typename V>
Phasor<V> turned(V turns) {
  Phasor<V> z;
  phasor(turns, z.re, z.im);
  return z;
}

// A tone z of some sweeps, its step w from sample to sample, and the step's step q: z <- z w, w <- w q.
struct Tone {
  Tone(const double* amplitude, const double* phases)
      : w(turned(load<Double>(phases + kWidth))), q(turned(load<Double>(phases + 2 * kWidth))) {
    z = turned(load<Double>(phases));
    const Double size = load<Double>(amplitude);
    z = {size * z.re, size * z.im};
  }

  void add(double* re, double* im) {
    store(re, load<Double>(re) + z.re);
    store(im, load<Double>(im) + z.im);
    z = z * w;
    w = w * q;
  }

  Phasor<Double> z, w, q;
};

void add_tones(Rows<const double> sizes, Rows<const double> starts, Rows<const double> slopes, Rows<const double> bends,
               Rows<Complex> sweeps) {
  require_shape(sweeps.count, sizes.width, "tones and sweeps do not fit", sizes, starts, slopes, bends);
  const Index n_samples = sweeps.width;
  const double first = -0.5 * static_cast<double>(n_samples - 1);
  std::vector<double> re(n_samples * kWidth), im(n_samples * kWidth);
  double phases[3 * kWidth] = {}, amplitudes[kWidth] = {};
  for (Index begin = 0; begin < sweeps.count; begin += kWidth) {  // kWidth sweeps, as two vectors
    const Index used = std::min<Index>(kWidth, sweeps.count - begin);
    std::fill(re.begin(), re.end(), 0.0);
    std::fill(im.begin(), im.end(), 0.0);
    for (Index scatterer = 0; scatterer < sizes.width; ++scatterer) {
      for (Index lane = 0; lane < used; ++lane) {
        const double slope = slopes[begin + lane][scatterer], bend = bends[begin + lane][scatterer];
        phases[lane] = starts[begin + lane][scatterer] + first * (slope + bend * first);
        phases[kWidth + lane] = slope + bend * (2.0 * first + 1.0);
        phases[2 * kWidth + lane] = 2.0 * bend;
        amplitudes[lane] = sizes[begin + lane][scatterer];
      }
      Tone a(amplitudes, phases), b(amplitudes + kHalfWidth, phases + kHalfWidth);
      for (Index n = 0; n < n_samples; ++n) {
        a.add(&re[n * kWidth], &im[n * kWidth]);
        b.add(&re[n * kWidth + kHalfWidth], &im[n * kWidth + kHalfWidth]);
      }
    }
    for (Index lane = 0; lane < used; ++lane) {
      for (Index n = 0; n < n_samples; ++n) {
        sweeps[begin + lane][n] =
            Complex(static_cast<float>(re[n * kWidth + lane]), static_cast<float>(im[n * kWidth + lane]));
      }
    }
  }
}

// Means of a profile along a line, times exp(2 pi i (a t + b t^2)) at t from -1/2 to 1/2, for many a and b.
void line_fields(Line<const double> turns, Line<const double> bends, Line<const double> profile_re,
                 Line<const double> profile_im, Line<double> real, Line<double> imaginary) {
  const Index n = profile_re.size;
  for (const Index size : {bends.size, real.size, imaginary.size}) require(size == turns.size, "fields do not fit");
  require(n > 0 && profile_im.size == n, "both parts of a profile need one length");
  const double step = 1.0 / static_cast<double>(n), first = 0.5 * step - 0.5;
  side_by_side(turns.size, [&](auto zero, Index i) {
    using V = decltype(zero);
    const V a = load<V>(&turns[i]), b = load<V>(&bends[i]);
    Phasor<V> wave = turned(first * (a + b * first)), advance = turned(step * (a + b * (2.0 * first + step)));
    const Phasor<V> bend = turned(2.0 * step * step * b);
    V re = zero, im = zero;
    for (Index j = 0; j < n; ++j) {
      re = fused(zero + profile_re[j], wave.re, fused(zero - profile_im[j], wave.im, re));
      im = fused(zero + profile_re[j], wave.im, fused(zero + profile_im[j], wave.re, im));
      wave = wave * advance;
      advance = advance * bend;
    }
    store(&real[i], step * re);
    store(&imaginary[i], step * im);
  });
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "add_tones", &add_tones);
  define(module, "line_fields", &line_fields);
}

}  // namespace doppelgait::tones

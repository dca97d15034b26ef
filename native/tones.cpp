// Sums of complex tones with quadratic phase, for frequency-swept radars.
#include <algorithm>
#include <vector>

#include "arrays.hpp"
#include "elementary.hpp"

namespace doppelgait::tones {
namespace {

struct Phasor {
  Double re, im;

  Phasor operator*(const Phasor& by) const { return {fused(re, by.re, -(im * by.im)), fused(re, by.im, im * by.re)}; }
};

// A tone z of some sweeps, its step w from sample to sample, and the step's step q: z <- z w, w <- w q.
struct Tone {
  Tone(const double* amplitude, const double* phases) {
    Phasor* parts[] = {&z, &w, &q};
    for (int n = 0; n < 3; ++n) phasor(load<Double>(phases + n * kWidth), parts[n]->re, parts[n]->im);
    const Double size = load<Double>(amplitude);
    z = {size * z.re, size * z.im};
  }

  void add(double* re, double* im) {
    store(re, load<Double>(re) + z.re);
    store(im, load<Double>(im) + z.im);
    z = z * w;
    w = w * q;
  }

  Phasor z, w, q;
};

void add_tones(Rows<const double> sizes, Rows<const double> starts, Rows<const double> slopes, Rows<const double> bends,
               Rows<Complex> sweeps) {
  for (const auto& rows : {sizes, starts, slopes, bends}) {
    require(rows.count == sweeps.count && rows.width == sizes.width, "tones and sweeps do not fit");
  }
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

}  // namespace

void bind(nb::module_& module) {
  define(module, "add_tones", &add_tones, "amplitude", "turns", "turns_per_sample", "turns_per_sample2", "out");
}

}  // namespace doppelgait::tones

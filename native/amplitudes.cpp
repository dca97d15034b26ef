// Amplitudes of echoes: antenna pattern, integration over a frame (E-13b, E-14) and fluctuation (E-08d).
#include "arrays.hpp"

namespace doppelgait::amplitudes {
namespace {

// Multiplies path gains by the square of max(cos^p(azimuth) cos^q(elevation), floor), the angles being those from the
// boresight.
void apply_cosine_pattern(Rows<const double> azimuths, Rows<const double> elevations, double boresight_azimuth_rad,
                          double boresight_tilt_rad, double azimuth_exponent, double elevation_exponent, double floor,
                          Rows<const double> gains, Rows<double> results) {
  require_shape(results.count, results.width, "angles and gains need the same shape", azimuths, elevations, gains);
  const double cos_tilt = std::cos(boresight_tilt_rad), sin_tilt = std::sin(boresight_tilt_rad);
  for (Index i = 0; i < results.count; ++i) {
    side_by_side(results.width, [&](auto zero, Index at) {
      using V = decltype(zero);
      V level, up, ahead, left;
      phasor(load<V>(elevations[i] + at) * (0.5 / kPi), level, up);
      phasor((load<V>(azimuths[i] + at) - boresight_azimuth_rad) * (0.5 / kPi), ahead, left);
      ahead *= level;
      left *= level;
      const V forward = ahead * cos_tilt + up * sin_tilt, above = up * cos_tilt - ahead * sin_tilt;
      const V across = forward * forward + left * left, flat = 1.0 - above * above;
      const V log = azimuth_exponent * logarithm(forward * forward / across) + elevation_exponent * logarithm(flat);
      V gain = exponential(0.5 * log);
      gain = (forward > 0.0) & (flat > 0.0) & (gain > floor) ? gain : zero + floor;
      store(results[i] + at, load<V>(gains[i] + at) * gain * gain);
    });
  }
}

// sin(pi r) / r for |r| <= 1/2: Taylor's series in r^2, whose next term is below 2e-11.
template <typename V>
inline V sine_ratio(V r) {
  constexpr double terms[] = {-2.1915353447830204e-05, 0.00046630280576761234, -0.007370430945714348,
                              0.08214588661112819,     -0.5992645293207919,    2.550164039877345,
                              -5.167712780049969,      3.141592653589793};
  const V square = r * r, zero{};
  V sum = zero + terms[0];
  for (int k = 1; k < 8; ++k) sum = fused(square, sum, zero + terms[k]);
  return sum;
}

void integrate_echoes(Plane<double> ranges, Plane<double> speeds, Plane<double> rcs, Plane<double> gains,
                      double one_metre, double nearest_m, double turns_per_mps, Rows<double> amplitudes) {
  require_shape(amplitudes.count, amplitudes.width, "ranges, velocities, cross sections and gains need the same shape",
                ranges, speeds, rcs, gains);
  for (Index frame = 0; frame < ranges.count; ++frame) {
    const double *area = rcs[frame], *gain = gains[frame];
    side_by_side(ranges.width, [&](auto zero, Index at) {
      using V = decltype(zero);
      const V range = load<V>(ranges[frame] + at), x = turns_per_mps * load<V>(speeds[frame] + at);
      const V distance = range > nearest_m ? range : zero + nearest_m;
      const V whole = round_even(x), r = x - whole, ratio = sine_ratio(r);
      const V odd = whole - 2.0 * round_even(0.5 * whole);  // -1, 0 or 1
      const V loss = whole == 0.0 ? ratio * (1.0 / kPi) : ratio * r * (1.0 - 2.0 * odd * odd) / (kPi * x);
      const V level = one_metre * square_root(load<V>(area + at) * load<V>(gain + at));
      store(amplitudes[frame] + at, level * loss / (distance * distance));
    });
  }
}

// Means of squares of Gaussian processes, made from white numbers on a grid of half a correlation time, which are
// weighted by exp(-(2 t / T - j)^2 / 4) for the `2 reach + 1` nearest j. A row has some numbers of every process.
void smoothed_chi_square(Rows<const double> normal, Line<const double> times, double correlation, Index reach,
                         Rows<double> factors) {
  const Index count = normal.count, n_values = normal.width;
  require(factors.count == times.size && factors.width > 0 && n_values > 0 && n_values % factors.width == 0,
          "times, processes and factors do not fit");
  const Index n_squares = n_values / factors.width;
  require(reach >= 0 && reach < count, "there are fewer numbers than weights");
  const Index n_weights = 2 * reach + 1;
  const auto find_place = [&](Index i) { return 2.0 * times[i] / correlation + static_cast<double>(reach); };
  for (Index i = 0; i < times.size; ++i) {
    const double first = std::floor(find_place(i) + 0.5) - static_cast<double>(reach);
    require(first >= 0.0 && first <= static_cast<double>(count - n_weights), "a time is outside the numbers");
  }
  std::vector<double> weights(n_weights + kHalfWidth), values(n_values + kHalfWidth);
  Double lane;
  for (int n = 0; n < kHalfWidth; ++n) lane[n] = n;
  for (Index i = 0; i < times.size; ++i) {
    const double place = find_place(i);
    const Index first = static_cast<Index>(std::floor(place + 0.5)) - reach;
    for (Index j = 0; j < n_weights; j += kHalfWidth) {
      const Double distance = 0.5 * (place - (lane + static_cast<double>(first + j)));
      store(&weights[j], exponential(-(distance * distance)));
    }
    double power = 0.0;
    for (Index j = 0; j < n_weights; ++j) power += weights[j] * weights[j];
    const double* numbers = normal[first];
    side_by_side(n_values, [&](auto zero, Index n) {
      for (Index j = 0; j < n_weights; ++j) {
        zero = fused(load<decltype(zero)>(numbers + j * normal.stride + n), decltype(zero){} + weights[j], zero);
      }
      store(&values[n], zero);
    });
    for (Index p = 0; p < factors.width; ++p) {
      double total = 0.0;
      for (Index d = 0; d < n_squares; ++d) total += values[p * n_squares + d] * values[p * n_squares + d];
      factors[i][p] = total / (power * static_cast<double>(n_squares));
    }
  }
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "apply_cosine_pattern", &apply_cosine_pattern);
  define(module, "integrate_echoes", &integrate_echoes);
  define(module, "smoothed_chi_square", &smoothed_chi_square);
}

}  // namespace doppelgait::amplitudes

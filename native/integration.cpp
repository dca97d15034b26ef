// Amplitudes of echoes that a frame integrates (E-13b, E-14).
#include <cmath>

#include "arrays.hpp"
#include "lanes.hpp"

namespace doppelgait::integration {
namespace {

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
  for (const auto& rows : {ranges, speeds, rcs, gains}) {
    require(rows.count == amplitudes.count && rows.width == amplitudes.width,
            "ranges, velocities, cross sections, gains and amplitudes need the same shape");
  }
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

}  // namespace

void bind(nb::module_& module) {
  define(module, "integrate_echoes", &integrate_echoes, "range_m", "velocity_mps", "rcs_m2", "path_gain", "one_metre",
         "nearest_m", "turns_per_mps", "out");
}

}  // namespace doppelgait::integration

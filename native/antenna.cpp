// Two-way gain of a cosine antenna pattern for many directions.
#include <cmath>

#include "arrays.hpp"
#include "elementary.hpp"

namespace doppelgait::antenna {
namespace {

// Multiplies path gains by the square of max(cos^p(azimuth) cos^q(elevation), floor), the angles being those from the
// boresight.
void apply_cosine_pattern(Rows<const double> azimuths, Rows<const double> elevations, double boresight_azimuth_rad,
                          double boresight_tilt_rad, double azimuth_exponent, double elevation_exponent, double floor,
                          Rows<const double> gains, Rows<double> results) {
  for (const auto& rows : {azimuths, elevations, gains}) {
    require(rows.count == results.count && rows.width == results.width, "angles and gains need the same shape");
  }
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

}  // namespace

void bind(nb::module_& module) {
  define(module, "apply_cosine_pattern", &apply_cosine_pattern, "azimuth_rad", "elevation_rad", "boresight_azimuth_rad",
         "boresight_tilt_rad", "azimuth_exponent", "elevation_exponent", "floor", "path_gain", "out");
}

}  // namespace doppelgait::antenna

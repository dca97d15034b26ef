// Echoes by one and by two reflections of every scatterer.
#include <nanobind/stl/array.h>

#include <algorithm>
#include <array>
#include <complex>
#include <vector>

#include "angles.hpp"
#include "spline.hpp"

namespace doppelgait::images {
namespace {

using Rays = std::array<In2<double>, 5>;    // range, approach speed, x, y and z towards the scatterers, (I, n)
using Table = std::array<Out2<double>, 6>;  // range, speed, azimuth, elevation, gain and phase of all paths

// Columns of the table from `place` on become n images by one reflection, then n by two; gain and phase change in
// place.
void fill_images(const Rays& direct, const Rays& image, const In2<double>& reflection_re,
                 const In2<double>& reflection_im, double least_m, Index place, const Table& table) {
  const Index count = static_cast<Index>(direct[0].shape(0)), n = static_cast<Index>(direct[0].shape(1));
  Rows<const double> d[5], s[5], c[2] = {view_rows(reflection_re), view_rows(reflection_im)};
  Rows<double> to[6];
  for (int k = 0; k < 5; ++k) d[k] = view_rows(direct[k]), s[k] = view_rows(image[k]);
  for (int k = 0; k < 6; ++k) to[k] = view_rows(table[k]);
  for (const auto& rows : {d[0], d[1], d[2], d[3], d[4], s[0], s[1], s[2], s[3], s[4], c[0], c[1]}) {
    require(rows.count == count && rows.width == n, "rays and reflection do not fit");
  }
  for (const auto& rows : to) {
    require(rows.count == count && place >= 0 && rows.width - 2 * n >= place, "the table does not fit");
  }
  std::vector<double> gain(n), more_gain(n), turn(n);
  for (Index i = 0; i < count; ++i) {
    side_by_side(n, [&](auto zero, Index k) {
      using V = decltype(zero);
      const auto direct = [&](int part) { return load<V>(d[part][i] + k); };
      const auto image = [&](int part) { return load<V>(s[part][i] + k); };
      const auto write = [&](int part, V one, V two) {
        store(to[part][i] + place + k, one);
        store(to[part][i] + place + n + k, two);
      };
      write(0, 0.5 * (direct(0) + image(0)), image(0));
      write(1, 0.5 * (direct(1) + image(1)), image(1));
      // by one reflection there are two paths, seen as one in the mean of their directions
      const V near = 1.0 / larger(direct(0), 1e-12), far = 1.0 / larger(image(0), 1e-12);
      V mean[3];
      for (int axis = 0; axis < 3; ++axis) mean[axis] = direct(2 + axis) * near + image(2 + axis) * far;
      const auto elevation = [](V x, V y, V z) { return angle_of(z, square_root(x * x + y * y)); };
      write(2, angle_of(mean[1], mean[0]), angle_of(image(3), image(2)));
      write(3, elevation(mean[0], mean[1], mean[2]), elevation(image(2), image(3), image(4)));
      const V re = load<V>(c[0][i] + k), im = load<V>(c[1][i] + k), power = re * re + im * im;
      const V at_least = larger(0.5 * (direct(0) + image(0)), least_m);
      const V spreading = at_least * at_least / (larger(direct(0), least_m) * larger(image(0), least_m));
      store(gain.data() + k, 4.0 * power * spreading * spreading);
      store(more_gain.data() + k, power * power);
      store(turn.data() + k, angle_of(im, re));
    });
    double *gains = to[4][i] + place, *phases = to[5][i] + place;
    for (Index k = 0; k < n; ++k) {
      gains[k] *= gain[k];
      gains[n + k] *= more_gain[k];
      phases[k] += turn[k];
      phases[n + k] += 2.0 * turn[k];
    }
  }
}

// Ranges and approach speeds of the images of scatterers at splines of height above a plane, in columns from `one` and
// `two` on. Their direct paths are in columns from `source` on.
void image_ranges(const In2<double>& height_m, const In2<double>& moments, double step, const In1<double>& times,
                  const In2<double>& direct_m, const In2<double>& direct_mps, Index source, double radar_m, Index one,
                  Index two, const Out2<double>& range_m, const Out2<double>& velocity_mps) {
  const auto heights = view_rows(height_m), bends = view_rows(moments), direct = view_rows(direct_m);
  const auto approach = view_rows(direct_mps);
  const auto at = view_line(times);
  const auto ranges = view_rows(range_m), speeds = view_rows(velocity_mps);
  const Index n = heights.width;
  require(heights.count >= 2 && bends.count == heights.count && bends.width == n, "moments do not fit the heights");
  require(direct.count == at.size && approach.count == at.size && direct.width == approach.width && source >= 0 &&
              direct.width - n >= source,
          "direct paths do not fit");
  require(ranges.count == at.size && speeds.count == at.size && ranges.width == speeds.width && one >= 0 && two >= 0 &&
              ranges.width - n >= std::max(one, two),
          "the table does not fit");
  for (Index i = 0; i < at.size; ++i) {
    const spline::Weights w(at[i], step, heights.count);
    const double *y0 = heights[w.frame], *y1 = heights[w.frame + 1], *m0 = bends[w.frame], *m1 = bends[w.frame + 1];
    const double *near_m = direct[i] + source, *near_mps = approach[i] + source, per_s = 1.0 / step;
    double *range = ranges[i], *velocity = speeds[i];
    side_by_side(n, [=](auto zero, Index p) {
      using V = decltype(zero);
      const V here = load<V>(y0 + p), there = load<V>(y1 + p), bend = load<V>(m0 + p), more = load<V>(m1 + p);
      const V height = fused(more, w.high, fused(bend, w.low, fused(there, w.b, here * w.a)));
      const V rate = fused(there - here, per_s, fused(more, w.slope_high, bend * w.slope_low));
      const V above = height > zero ? height : zero, rising = height > zero ? rate : zero;
      const V near = load<V>(near_m + p), speed = load<V>(near_mps + p);
      const V far = square_root(fused(near, near, 4.0 * radar_m * above));
      const V closing = fused(near, speed, -2.0 * radar_m * rising) / larger(far, 1e-12);
      store(range + one + p, 0.5 * (near + far));
      store(range + two + p, far);
      store(velocity + one + p, 0.5 * (speed + closing));
      store(velocity + two + p, closing);
    });
  }
}

// Complex values between those of a rising, nearly even grid, as numpy.interp to the last bit.
void interpolate_values(Line<const double> at, Line<const double> grid, Line<const std::complex<double>> values,
                        Line<std::complex<double>> out) {
  const Index last = grid.size - 1;
  require(last > 0 && values.size == grid.size && out.size == at.size, "grid, values and results do not fit");
  std::vector<std::complex<double>> slopes(last);
  for (Index k = 0; k < last; ++k) {
    const double per = 1.0 / (grid[k + 1] - grid[k]);
    slopes[k] = {(values[k + 1].real() - values[k].real()) * per, (values[k + 1].imag() - values[k].imag()) * per};
  }
  require(grid[last] - grid[0] > 0.0 && grid[last] - grid[0] < 1e300, "the grid must rise");
  const double lowest = grid[0], highest = grid[last], per_step = static_cast<double>(last) / (highest - lowest);
  for (Index i = 0; i < at.size; ++i) {
    const double x = at[i];
    require(x >= lowest && x <= highest, "a place is outside the grid");
    Index k = std::min(static_cast<Index>((x - lowest) * per_step), last - 1);
    k -= grid[k] > x;
    k += k + 1 < last && grid[k + 1] <= x;
    const double offset = x - grid[k], *one = reinterpret_cast<const double*>(&values[k]);
    const double* slope = reinterpret_cast<const double*>(&slopes[k]);
    out[i] = x == highest ? values[last] : std::complex<double>(slope[0] * offset + one[0], slope[1] * offset + one[1]);
  }
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "interpolate_values", &interpolate_values, "at", "grid", "values", "out");
  module.def("fill_images", &fill_images, nb::arg("direct"), nb::arg("image"), nb::arg("reflection_re"),
             nb::arg("reflection_im"), nb::arg("least_m"), nb::arg("place"), nb::arg("table").noconvert(), Unlocked());
  module.def("image_ranges", &image_ranges, nb::arg("height_m"), nb::arg("moments"), nb::arg("step"), nb::arg("times"),
             nb::arg("direct_m"), nb::arg("direct_mps"), nb::arg("source"), nb::arg("radar_m"), nb::arg("one"),
             nb::arg("two"), nb::arg("range_m").noconvert(), nb::arg("velocity_mps").noconvert(), Unlocked());
}

}  // namespace doppelgait::images

// Ranges and directions of points on cubic splines (E-02 to E-04), and of their images by reflection.
#include "arrays.hpp"

namespace doppelgait::rays {
namespace {

using Frames = Rows<const double>;

// Two frames about a time: value = a y0 + b y1 + low m0 + high m1,
// slope = (y1 - y0) / step + slope_low m0 + slope_high m1
struct Frame {
  Frame(Frames values, Frames moments, double step, double time) : per_s(1.0 / step) {
    require(values.count >= 2 && step > 0.0, "a spline needs 2 frames or more");
    require_shape(values.count, values.width, "moments do not fit the values", moments);
    const double place = time / step, sixth = step / 6.0;
    const auto frame = static_cast<Index>(std::min(std::max(0.0, std::floor(place)), values.count - 2.0));  // 0 for NaN
    y0 = values[frame], y1 = values[frame + 1], m0 = moments[frame], m1 = moments[frame + 1];
    b = place - static_cast<double>(frame);
    a = 1.0 - b;
    low = (a * a * a - a) * (step * sixth);
    high = (b * b * b - b) * (step * sixth);
    slope_low = (1.0 - 3.0 * a * a) * sixth;
    slope_high = (3.0 * b * b - 1.0) * sixth;
  }

  template <typename V>
  V value(Index column) const {
    const V start = fused(load<V>(y1 + column), b, load<V>(y0 + column) * a);
    return fused(load<V>(m1 + column), high, fused(load<V>(m0 + column), low, start));
  }

  template <typename V>
  V slope(Index column) const {
    const V bend = fused(load<V>(m1 + column), slope_high, load<V>(m0 + column) * slope_low);
    return fused(load<V>(y1 + column) - load<V>(y0 + column), per_s, bend);
  }

  double per_s, a, b, low, high, slope_low, slope_high;
  const double *y0, *y1, *m0, *m1;
};

// Second derivatives of the C2 not-a-knot spline, (T, C): at both ends the third derivative is that of the next frame.
void spline_moments(Frames y, double step, Rows<double> m) {
  const Index last = y.count - 1;
  require(last >= 3 && m.count == y.count && m.width == y.width, "a spline needs 4 frames, and moments of each");
  // row = (row + weight * other) * by
  const auto combine = [&](Index row, double weight, Index other, double by = 1.0) {
    double* __restrict to = m[row];
    const double* more = m[other];
    for (Index c = 0; c < m.width; ++c) to[c] = (to[c] + weight * more[c]) * by;
  };
  const double scale = 6.0 / (step * step);
  for (Index i = 1; i < last; ++i) {
    const double *before = y[i - 1], *here = y[i], *after = y[i + 1];
    double* __restrict to = m[i];
    const double by = i == 1 || i == last - 1 ? scale / 6.0 : scale;
    for (Index c = 0; c < y.width; ++c) to[c] = by * (before[c] - 2.0 * here[c] + after[c]);
  }
  if (last > 3) {  // m(i - 1) + 4 m(i) + m(i + 1) = 6 y'': elimination, then back
    std::vector<double> factor(last, 0.25);
    combine(2, -1.0, 1);
    combine(last - 2, -1.0, last - 1);
    for (Index i = 3; i < last - 1; ++i) {
      combine(i, -factor[i - 1], i - 1);
      factor[i] = 1.0 / (4.0 - factor[i - 1]);
    }
    combine(last - 2, 0.0, last - 1, factor[last - 2]);
    for (Index i = last - 3; i > 1; --i) combine(i, -1.0, i + 1, factor[i]);
  }
  for (const Index end : {Index{0}, last}) {
    const double *near = m[end ? last - 1 : 1], *far = m[end ? last - 2 : 2];
    double* __restrict to = m[end];
    for (Index c = 0; c < m.width; ++c) to[c] = 2.0 * near[c] - far[c];
  }
}

// Values and slopes, both (I, C).
void positions_and_velocities(Frames values, Frames moments, double step, Line<const double> at, Rows<double> to,
                              Rows<double> to_slope) {
  require_shape(at.size, values.width, "value or slope does not fit", to, to_slope);
  for (Index i = 0; i < at.size; ++i) {
    const Frame frame(values, moments, step, at[i]);
    double* __restrict place = to[i];
    double* __restrict speed = to_slope[i];
    for (Index c = 0; c < to.width; ++c) {
      place[c] = frame.value<double>(c);
      speed[c] = frame.slope<double>(c);
    }
  }
}

// Values alone, (I, C).
void values_between(Frames values, Frames moments, double step, Line<const double> at, Rows<double> to) {
  require_shape(at.size, values.width, "value does not fit", to);
  for (Index i = 0; i < at.size; ++i) {
    const Frame frame(values, moments, step, at[i]);
    double* place = to[i];
    side_by_side(to.width, [=](auto zero, Index c) { store(place + c, frame.value<decltype(zero)>(c)); });
  }
}

// Points (P,) at one time, relative to the radar: their places in x, y and z and their velocities.
template <typename V>
inline void look(const Frame& frame, const double* origin, Index point, V (&r)[3], V (&v)[3]) {
  V value[3], slope[3];  // coordinates in turn
  for (Index j = 0; j < 3; ++j) {
    const Index c = 3 * point + j * static_cast<Index>(sizeof(V) / sizeof(double));
    value[j] = frame.value<V>(c);
    slope[j] = frame.slope<V>(c);
  }
  take_thirds(value, r);
  take_thirds(slope, v);
  for (int axis = 0; axis < 3; ++axis) r[axis] = r[axis] - origin[axis];
}

// Ranges from the origin (E-03) and approach speeds -dR/dt (E-04) of points, both (I, P).
void ranges_and_velocities(Frames values, Frames moments, double step, Line<const double> at, Line<const double> from,
                           Rows<double> ranges, Rows<double> speeds) {
  const Index n = ranges.width;
  require(from.size == 3 && values.width == 3 * n, "points do not fit");
  require_shape(at.size, n, "times do not fit", ranges, speeds);
  for (Index i = 0; i < at.size; ++i) {
    const Frame frame(values, moments, step, at[i]);
    double *range = ranges[i], *speed = speeds[i];
    side_by_side(n, [=](auto zero, Index p) {
      using V = decltype(zero);
      V r[3], v[3];
      look(frame, from.data, p, r, v);
      const V distance = square_root(fused(r[2], r[2], fused(r[1], r[1], r[0] * r[0]))), least = zero + 1e-12;
      store(range + p, distance);
      store(speed + p, -fused(r[2], v[2], fused(r[1], v[1], r[0] * v[0])) / (distance > least ? distance : least));
    });
  }
}

// Azimuth, elevation and aspect of points at r that move at v (E-04), aspect only where it has a place.
template <typename V>
void store_angles(const V (&r)[3], const V (&v)[3], double least_mps, double* azimuth, double* elevation,
                  double* aspect) {
  store(azimuth, angle_of(r[1], r[0]));
  store(elevation, angle_of(r[2], square_root(fused(r[1], r[1], r[0] * r[0]))));
  if (!aspect) return;
  V across{}, along{}, square{};  // of r x v and -r v: exact near 0 and pi, too
  for (int k = 0; k < 3; ++k) {
    const int next = (k + 1) % 3, last = (k + 2) % 3;
    const V turn = r[next] * v[last] - r[last] * v[next];
    across = fused(turn, turn, across);
    along = along - r[k] * v[k];
    square = fused(v[k], v[k], square);
  }
  const V angle = angle_of(square_root(across), along), least = V{} + least_mps;
  store(aspect, square_root(square) >= least ? angle : V{} + NAN);
}

// Azimuth, elevation and, where it has an array, aspect of points (E-04), all (I, P). Points slower than least_mps
// have no aspect.
void angles_of_sight(Frames values, Frames moments, double step, Line<const double> at, Line<const double> from,
                     Rows<double> azimuths, Rows<double> elevations, double least_mps,
                     std::optional<Rows<double>> aspect_rad) {
  const auto aspects = aspect_rad.value_or(elevations);
  const Index n = azimuths.width;
  require(from.size == 3 && values.width == 3 * n, "points do not fit");
  require_shape(at.size, n, "times do not fit", azimuths, elevations, aspects);
  // of a point alone, times are side by side
  const bool is_alone = n == 1 && azimuths.stride == 1 && elevations.stride == 1 && aspects.stride == 1;
  const Index step_rows = is_alone ? kHalfWidth : 1;
  for (Index i = 0; i < at.size; i += step_rows) {
    double *azimuth = azimuths[i], *elevation = elevations[i], *aspect = aspect_rad ? aspects[i] : nullptr;
    const Index some = std::min(step_rows, at.size - i);
    double places[3][kHalfWidth], speeds[3][kHalfWidth];
    for (Index k = 0; is_alone && k < some; ++k) {
      double r[3], v[3];
      look(Frame(values, moments, step, at[i + k]), from.data, 0, r, v);
      for (int axis = 0; axis < 3; ++axis) places[axis][k] = r[axis], speeds[axis][k] = v[axis];
    }
    const Frame frame(values, moments, step, at[i]);
    side_by_side(is_alone ? some : n, [&](auto zero, Index p) {
      using V = decltype(zero);
      V r[3], v[3];
      if (!is_alone) look(frame, from.data, p, r, v);
      for (int axis = 0; is_alone && axis < 3; ++axis) {
        r[axis] = load<V>(places[axis] + p);
        v[axis] = load<V>(speeds[axis] + p);
      }
      store_angles(r, v, least_mps, azimuth + p, elevation + p, aspect ? aspect + p : nullptr);
    });
  }
}

// Points (N, 3) turned about an upright axis and moved level.
void turn_and_move(Frames from, double cosine, double sine, double pivot_x, double pivot_y, double to_x, double to_y,
                   Rows<double> to) {
  require(from.width == 3 && to.width == 3 && from.count == to.count, "points do not fit");
  for (Index n = 0; n < from.count; ++n) {
    const double x = from[n][0] - pivot_x, y = from[n][1] - pivot_y;
    to[n][0] = fused(x, cosine, -(y * sine)) + to_x;
    to[n][1] = fused(x, sine, y * cosine) + to_y;
    to[n][2] = from[n][2];
  }
}

using Rays = std::array<Rows<const double>, 5>;  // range, approach speed, x, y and z towards the scatterers, (I, n)
using Table = std::array<Rows<double>, 6>;       // range, speed, azimuth, elevation, gain and phase of all paths

// Columns of the table from `place` on become n images by one reflection, then n by two; gain and phase change in
// place.
void fill_images(Rays d, Rays s, Rows<const double> reflection_re, Rows<const double> reflection_im, double least_m,
                 Index place, Table to) {
  const Index count = d[0].count, n = d[0].width;
  require_shape(count, n, "reflection does not fit", reflection_re, reflection_im);
  for (const Rays& rays : {d, s}) {
    for (const auto& rows : rays) require_shape(count, n, "rays do not fit", rows);
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
      const V re = load<V>(reflection_re[i] + k), im = load<V>(reflection_im[i] + k), power = re * re + im * im;
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
void image_ranges(Rows<const double> heights, Rows<const double> bends, double step, Line<const double> at,
                  Index source, double radar_m, Index one, Index two, Rows<double> ranges, Rows<double> speeds) {
  const Index n = heights.width;
  require_shape(at.size, ranges.width, "the table does not fit", ranges, speeds);
  require(std::min({source, one, two}) >= 0 && ranges.width - n >= std::max({source, one, two}),
          "the table has no such columns");
  for (Index i = 0; i < at.size; ++i) {
    const Frame frame(heights, bends, step, at[i]);
    double *range = ranges[i], *velocity = speeds[i];
    side_by_side(n, [=](auto zero, Index p) {
      using V = decltype(zero);
      const V height = frame.value<V>(p), rate = frame.slope<V>(p);
      const V above = height > zero ? height : zero, rising = height > zero ? rate : zero;
      const V near = load<V>(range + source + p), speed = load<V>(velocity + source + p);
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
    slopes[k] = (values[k + 1] - values[k]) * (1.0 / (grid[k + 1] - grid[k]));
  }
  require(grid[last] - grid[0] > 0.0 && grid[last] - grid[0] < 1e300, "the grid must rise");
  const double lowest = grid[0], highest = grid[last], per_step = static_cast<double>(last) / (highest - lowest);
  for (Index i = 0; i < at.size; ++i) {
    const double x = at[i];
    require(x >= lowest && x <= highest, "a place is outside the grid");
    Index k = std::min(static_cast<Index>((x - lowest) * per_step), last - 1);
    k -= grid[k] > x;
    k += k + 1 < last && grid[k + 1] <= x;
    out[i] = x == highest ? values[last] : slopes[k] * (x - grid[k]) + values[k];
  }
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "spline_moments", &spline_moments);
  define(module, "positions_and_velocities", &positions_and_velocities);
  define(module, "values_between", &values_between);
  define(module, "ranges_and_velocities", &ranges_and_velocities);
  define(module, "turn_and_move", &turn_and_move);
  define(module, "angles_of_sight", &angles_of_sight);
  define(module, "interpolate_values", &interpolate_values);
  define(module, "fill_images", &fill_images);
  define(module, "image_ranges", &image_ranges);
}

}  // namespace doppelgait::rays

// Cubic spline through uniform frames, and ranges from it (E-02 to E-04).
#include "spline.hpp"

#include <nanobind/stl/optional.h>

#include <optional>
#include <vector>

#include "angles.hpp"

namespace doppelgait::spline {
namespace {

using Frames = Rows<const double>;

// Spline of all columns.
struct Curve {
  Curve(Frames values, Frames moments, double step) : values(values), moments(moments), step(step) {
    require(values.count >= 2 && values.count == moments.count, "a spline needs 2 frames or more");
    require(values.width == moments.width && step > 0.0, "moments do not fit the values");
  }

  Frames values, moments;
  double step;
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
  const Curve curve(values, moments, step);
  require(to.count == at.size && to.width == values.width, "value does not fit");
  require(to_slope.count == at.size && to_slope.width == to.width, "slope does not fit");
  for (Index i = 0; i < at.size; ++i) {
    const Weights w(at[i], step, curve.values.count);
    const double *y0 = curve.values[w.frame], *y1 = curve.values[w.frame + 1], per_s = 1.0 / step;
    const double *m0 = curve.moments[w.frame], *m1 = curve.moments[w.frame + 1];
    double* __restrict place = to[i];
    double* __restrict speed = to_slope[i];
    for (Index c = 0; c < to.width; ++c) {
      place[c] = fused(w.high, m1[c], fused(w.low, m0[c], fused(w.b, y1[c], w.a * y0[c])));
      speed[c] = fused(y1[c] - y0[c], per_s, fused(w.slope_high, m1[c], w.slope_low * m0[c]));
    }
  }
}

// Values alone, (I, C).
void values_between(Frames values, Frames moments, double step, Line<const double> at, Rows<double> to) {
  const Curve curve(values, moments, step);
  require(to.count == at.size && to.width == values.width, "value does not fit");
  for (Index i = 0; i < at.size; ++i) {
    const Weights w(at[i], step, curve.values.count);
    const double *y0 = curve.values[w.frame], *y1 = curve.values[w.frame + 1];
    const double *m0 = curve.moments[w.frame], *m1 = curve.moments[w.frame + 1];
    double* __restrict row = to[i];
    for (Index c = 0; c < to.width; ++c) {
      row[c] = fused(w.high, m1[c], fused(w.low, m0[c], fused(w.b, y1[c], w.a * y0[c])));
    }
  }
}

// Points of a spline at one time, relative to the radar: their places in x, y and z and their velocities.
struct Sight {
  Sight(const Curve& curve, double time, const double* origin)
      : w(time, curve.step, curve.values.count),
        y0(curve.values[w.frame]),
        y1(curve.values[w.frame + 1]),
        m0(curve.moments[w.frame]),
        m1(curve.moments[w.frame + 1]),
        per_s(1.0 / curve.step),
        origin(origin) {}

  template <typename V>
  void look(Index point, V (&r)[3], V (&v)[3]) const {
    V value[3], slope[3];  // coordinates in turn
    for (Index j = 0; j < 3; ++j) {
      const Index c = 3 * point + j * static_cast<Index>(sizeof(V) / sizeof(double));
      const V here = load<V>(y0 + c), there = load<V>(y1 + c), bend = load<V>(m0 + c), more = load<V>(m1 + c);
      value[j] = fused(more, w.high, fused(bend, w.low, fused(there, w.b, here * w.a)));
      slope[j] = fused(there - here, per_s, fused(more, w.slope_high, bend * w.slope_low));
    }
    r[0] = take_third<0>(value[0], value[1], value[2]) - origin[0];
    r[1] = take_third<1>(value[0], value[1], value[2]) - origin[1];
    r[2] = take_third<2>(value[0], value[1], value[2]) - origin[2];
    v[0] = take_third<0>(slope[0], slope[1], slope[2]);
    v[1] = take_third<1>(slope[0], slope[1], slope[2]);
    v[2] = take_third<2>(slope[0], slope[1], slope[2]);
  }

  Weights w;
  const double *y0, *y1, *m0, *m1;
  double per_s;
  const double* origin;
};

// Ranges from the origin (E-03) and approach speeds -dR/dt (E-04) of points, both (I, P).
void ranges_and_velocities(Frames values, Frames moments, double step, Line<const double> at, Line<const double> from,
                           Rows<double> ranges, Rows<double> speeds) {
  const Curve curve(values, moments, step);
  const Index n = ranges.width;
  require(from.size == 3 && curve.values.width == 3 * n && speeds.width == n, "points do not fit");
  require(ranges.count == at.size && speeds.count == at.size, "times do not fit");
  for (Index i = 0; i < at.size; ++i) {
    const Sight sight(curve, at[i], from.data);
    double *range = ranges[i], *speed = speeds[i];
    side_by_side(n, [=](auto zero, Index p) {
      using V = decltype(zero);
      V r[3], v[3];
      sight.look(p, r, v);
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
void angles_of_sight(const In2<double>& values, const In2<double>& moments, double step, const In1<double>& times,
                     const In1<double>& origin, const Out2<double>& azimuth_rad, const Out2<double>& elevation_rad,
                     double least_mps, const std::optional<Out2<double>>& aspect_rad) {
  const Curve curve(view_rows(values), view_rows(moments), step);
  const auto at = view_line(times), from = view_line(origin);
  const auto azimuths = view_rows(azimuth_rad), elevations = view_rows(elevation_rad);
  const auto aspects = view_rows(aspect_rad.value_or(elevation_rad));
  const Index n = azimuths.width;
  require(from.size == 3 && curve.values.width == 3 * n && elevations.width == n && aspects.width == n,
          "points do not fit");
  require(azimuths.count == at.size && elevations.count == at.size && aspects.count == at.size, "times do not fit");
  // of a point alone, times are side by side
  const bool is_alone = n == 1 && azimuths.stride == 1 && elevations.stride == 1 && aspects.stride == 1;
  const Index step_rows = is_alone ? kHalfWidth : 1;
  for (Index i = 0; i < at.size; i += step_rows) {
    double *azimuth = azimuths[i], *elevation = elevations[i], *aspect = aspect_rad ? aspects[i] : nullptr;
    const Index some = std::min(step_rows, at.size - i);
    double places[3][kHalfWidth], speeds[3][kHalfWidth];
    for (Index k = 0; is_alone && k < some; ++k) {
      double r[3], v[3];
      Sight(curve, at[i + k], from.data).look(0, r, v);
      for (int axis = 0; axis < 3; ++axis) places[axis][k] = r[axis], speeds[axis][k] = v[axis];
    }
    const Sight sight(curve, at[i], from.data);
    side_by_side(is_alone ? some : n, [&](auto zero, Index p) {
      using V = decltype(zero);
      V r[3], v[3];
      if (!is_alone) sight.look(p, r, v);
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

}  // namespace

void bind(nb::module_& module) {
  define(module, "spline_moments", &spline_moments, "values", "step", "moments");
  define(module, "positions_and_velocities", &positions_and_velocities, "values", "moments", "step", "times", "value",
         "slope");
  define(module, "values_between", &values_between, "values", "moments", "step", "times", "value");
  define(module, "ranges_and_velocities", &ranges_and_velocities, "values", "moments", "step", "times", "origin",
         "range_m", "approach_mps");
  define(module, "turn_and_move", &turn_and_move, "points", "cosine", "sine", "pivot_x", "pivot_y", "to_x", "to_y",
         "moved");
  module.def("angles_of_sight", &angles_of_sight, nb::arg("values"), nb::arg("moments"), nb::arg("step"),
             nb::arg("times"), nb::arg("origin"), nb::arg("azimuth_rad").noconvert(),
             nb::arg("elevation_rad").noconvert(), nb::arg("least_mps"), nb::arg("aspect_rad").noconvert() = nb::none(),
             Unlocked());
}

}  // namespace doppelgait::spline

// Ellipsoids seen from the radar: nearest points, cross sections, occlusion (E-08).
#include "arrays.hpp"

namespace doppelgait::occlusion {
namespace {

constexpr int kNewtonSteps = 30;  // at most; 2 to 4 are needed from a few radii on, more only near the surface

using Places = Points<const double>;

// Bodies of ellipsoids at all times: centres and directions (I, S, 3), semi-axes (S, 3) across, upright and along.
struct Bodies {
  Bodies(Places centre, Places along, Places across, Rows<const double> semi_axes, Line<const double> radar)
      : centre(centre), along(along), across(across), semi_axes(semi_axes), radar(radar) {
    require_shape(centre.count, 3 * semi_axes.count, "ellipsoids do not fit", centre, along, across);
    require(semi_axes.width == 3 && radar.size == 3, "semi-axes or the radar do not fit");
  }

  Places centre, along, across;
  Rows<const double> semi_axes;
  Line<const double> radar;
};

// Ellipsoids side by side, and t of the point nearest to the radar: sum of a_k^2 y_k^2 / (a_k^2 + t)^2 = 1 (E-08f).
template <typename V>
struct Ellipsoid {
  Ellipsoid(const Bodies& bodies, Index time, Index s) {
    V semi_axes[3];
    load_points(bodies.centre[time] + 3 * s, centre);
    load_points(bodies.along[time] + 3 * s, along);
    load_points(bodies.across[time] + 3 * s, across);
    load_points(bodies.semi_axes[s], semi_axes);
    y_wide = y_long = V{};
    V square = V{};
    for (int k = 0; k < 3; ++k) {
      y[k] = bodies.radar[k] - centre[k];
      y_wide = fused(y[k], across[k], y_wide);
      y_long = fused(y[k], along[k], y_long);
      square = fused(y[k], y[k], square);
      size2[k] = semi_axes[k] * semi_axes[k];
    }
    square2[0] = y_wide * y_wide;
    square2[1] = larger(square - y_wide * y_wide - y_long * y_long, 0.0);
    square2[2] = y_long * y_long;
    solve();
  }

  void solve() {
    V first[3];
    for (int k = 0; k < 3; ++k) first[k] = size2[k] * square2[k];
    const V weight = first[0] + first[1] + first[2];
    const V mean = fused(first[2], size2[2], fused(first[1], size2[1], first[0] * size2[0])) / larger(weight, 1e-300);
    root = larger(square_root(weight) - mean, 0.0);
    auto active = root == root;
    for (int n = 0; n < kNewtonSteps && any(active); ++n) {
      V sum = V{}, slope = V{};
      for (int k = 0; k < 3; ++k) {
        const V p = 1.0 / (size2[k] + root), term = first[k] * p * p;
        sum = sum + term;
        slope = fused(term, p, slope);
      }
      const V step = (sum - 1.0) / (2.0 * slope + 1e-300), next = larger(root + step, 0.0);
      root = active ? next : root;
      active = active & ((step < V{} ? -step : step) > 1e-9 * root);  // the next one is of the order of its square
    }
    for (int k = 0; k < 3; ++k) inverse[k] = 1.0 / (size2[k] + root);
  }

  V centre[3], along[3], across[3];
  V y[3], y_wide, y_long;  // the radar from the centre, and along two axes
  V size2[3], square2[3];  // squares of the semi-axes and of the radar's place along them
  V root, inverse[3];      // t, 1 / (a_k^2 + t)
};

// The point (I, 3, S) of every ellipsoid that is nearest to the radar, and its cross section (I, S) at the radar's
// distance (E-08g), 0 within it.
void see_ellipsoids(Places centre, Places along, Places across, Rows<const double> semi_axes, Line<const double> radar,
                    Points<double> points, Rows<double> rcs) {
  const Bodies bodies(centre, along, across, semi_axes, radar);
  const Index n = semi_axes.count;
  require_shape(centre.count, n, "cross sections do not fit", rcs);
  require_shape(centre.count, 3 * n, "points do not fit", points);
  for (Index i = 0; i < rcs.count; ++i) {
    side_by_side(n, [&](auto zero, Index s) {
      using V = decltype(zero);
      const Ellipsoid<V> e(bodies, i, s);
      const V plain = e.size2[1] * e.inverse[1];
      const V wide = (e.size2[0] * e.inverse[0] - plain) * e.y_wide,
              far = (e.size2[2] * e.inverse[2] - plain) * e.y_long;
      V gradient2 = zero, bent = zero + 1e-300, sizes = zero + 3.14159265358979324;
      for (int k = 0; k < 3; ++k) {
        const V from_centre = fused(far, e.along[k], fused(wide, e.across[k], plain * e.y[k]));
        store(points[i] + n * k + s, e.centre[k] + from_centre);
        const V steep = e.square2[k] * e.inverse[k] * e.inverse[k];  // the sum is 1 / h^2
        gradient2 = gradient2 + steep;
        bent = fused(steep * e.size2[k], e.inverse[k], bent);
        sizes = sizes * (e.size2[k] * e.inverse[k]);
      }
      store(rcs[i] + s, e.root * gradient2 * (e.root * gradient2) * sizes / bent);
    });
  }
}

// Smooth step from 0 to 1: the polynomial of degree 5 with two continuous derivatives.
template <typename V>
V ramp(V x) {
  x = larger(x, 0.0);
  x = x < V{} + 1.0 ? x : V{} + 1.0;
  return x * x * x * (10.0 + x * (6.0 * x - 15.0));
}

// Lines of sight from points side by side, and one ellipsoid.
template <typename V>
struct Sight {
  V point[3], sight[3], length;

  // Amplitude past the ellipsoid: from the point of the line where its quadratic form is smallest.
  V amplitude_past(const double* centre, const double* along, const double* across, const double* semi_axes,
                   double edge, V hides) const {
    const double base = 1.0 / (semi_axes[1] * semi_axes[1]);
    const double wide = 1.0 / (semi_axes[0] * semi_axes[0]) - base, far = 1.0 / (semi_axes[2] * semi_axes[2]) - base;
    const double reach = std::max(std::max(semi_axes[0], semi_axes[1]), semi_axes[2]) + 2.0 * edge;
    V offset[3], both = V{}, apart2 = V{};
    for (int k = 0; k < 3; ++k) {
      offset[k] = point[k] - centre[k];
      both = fused(offset[k], sight[k], both);
      apart2 = fused(offset[k], offset[k], apart2);
    }
    const auto near = (hides != V{}) & (both <= V{} + reach) & (apart2 - both * both <= V{} + reach * reach);
    if (!any(near)) return V{} + 1.0;
    V offset_wide = V{}, offset_far = V{}, sight_wide = V{}, sight_far = V{};
    for (int k = 0; k < 3; ++k) {
      offset_wide = fused(offset[k], across[k], offset_wide);
      offset_far = fused(offset[k], along[k], offset_far);
      sight_wide = fused(sight[k], across[k], sight_wide);
      sight_far = fused(sight[k], along[k], sight_far);
    }
    const V square = base + wide * sight_wide * sight_wide + far * sight_far * sight_far;
    const V linear = base * both + wide * offset_wide * sight_wide + far * offset_far * sight_far;
    const V lowest = -linear / square, way = lowest < length ? lowest : length;
    const V near_wide = wide * fused(way, sight_wide, offset_wide), near_far = far * fused(way, sight_far, offset_far);
    V form = V{}, steepness = V{};
    for (int k = 0; k < 3; ++k) {
      const V place = fused(way, sight[k], offset[k]);
      const V slope = fused(near_far, along[k], fused(near_wide, across[k], base * place));
      form = fused(place, slope, form);
      steepness = fused(slope, slope, steepness);
    }
    const V clearance = (form - 1.0) / larger(2.0 * square_root(steepness), 1e-12);
    const V passed = 1.0 - ramp(way / edge) * (1.0 - ramp((clearance + edge) / (2.0 * edge)));
    return (near & (way > V{})) ? passed : V{} + 1.0;
  }
};

// Amplitudes (I, P) past the ellipsoids from every point (I, P, 3) to the radar (E-08e); ellipsoids that pass[p, s]
// hide nothing of a point.
void sight_amplitudes(Places points, Places centre, Places along, Places across, Rows<const double> semi_axes,
                      Rows<const bool> passes, Line<const double> radar, double edge, Rows<double> amplitude) {
  const Bodies bodies(centre, along, across, semi_axes, radar);
  const Index n = amplitude.width, n_bodies = semi_axes.count;
  require_shape(centre.count, 3 * n, "points do not fit", points);
  require(amplitude.count == centre.count && edge > 0.0, "amplitudes do not fit");
  require_shape(n, n_bodies, "passes do not fit", passes);
  std::vector<double> hides(n * n_bodies);
  for (Index s = 0; s < n_bodies; ++s) {
    for (Index p = 0; p < n; ++p) hides[n * s + p] = passes[p][s] ? 0.0 : 1.0;
  }
  for (Index i = 0; i < amplitude.count; ++i) {
    side_by_side(n, [&](auto zero, Index p) {
      using V = decltype(zero);
      Sight<V> line;
      load_points(points[i] + 3 * p, line.point);
      V square = zero;
      for (int k = 0; k < 3; ++k) {
        line.sight[k] = bodies.radar[k] - line.point[k];
        square = fused(line.sight[k], line.sight[k], square);
      }
      line.length = square_root(square);
      for (int k = 0; k < 3; ++k) line.sight[k] = line.sight[k] / larger(line.length, 1e-12);
      V through = zero + 1.0;
      for (Index s = 0; s < n_bodies; ++s) {
        through = through * line.amplitude_past(centre[i] + 3 * s, along[i] + 3 * s, across[i] + 3 * s, semi_axes[s],
                                                edge, load<V>(hides.data() + n * s + p));
      }
      store(amplitude[i] + p, through);
    });
  }
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "see_ellipsoids", &see_ellipsoids);
  define(module, "sight_amplitudes", &sight_amplitudes);
}

}  // namespace doppelgait::occlusion

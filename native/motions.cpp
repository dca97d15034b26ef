// Curves of motions: sums of harmonics, piecewise cubics and straight segments of paths.
#include <nanobind/stl/pair.h>

#include "arrays.hpp"

namespace doppelgait::motions {
namespace {

// Real parts of sums of c_k e^(2 pi j k phase), c_k as two numbers. Rows of curves use the rows of phases in turn.
void evaluate_harmonics(Rows<const double> coefficients, Rows<const double> phases, Rows<double> sums) {
  require(coefficients.count == sums.count && coefficients.width % 2 == 0 && coefficients.width >= 2, "no curves");
  require(phases.count > 0 && sums.count % phases.count == 0 && phases.width == sums.width, "phases do not fit");
  for (Index row = 0; row < sums.count; ++row) {
    const double *c = coefficients[row], *phase = phases[row % phases.count];
    double* to = sums[row];
    side_by_side(sums.width, [&](auto zero, Index at) {
      decltype(zero) re, im, x = zero, y = zero;
      phasor(load<decltype(zero)>(phase + at), re, im);
      for (Index k = coefficients.width - 2; k >= 0; k -= 2) {  // Horner's rule
        const auto turned = fused(x, re, fused(-y, im, zero + c[k]));
        y = fused(x, im, fused(y, re, zero + c[k + 1]));
        x = turned;
      }
      store(to + at, x);
    });
  }
}

// Values (order 0) or slopes (1) of piecewise cubics, each row up to its size of knots; coefficients of all pieces
// behind each other. Rows of numbers use the curves in turn; numbers beyond the ends use the outermost pieces.
void evaluate_cubics(Rows<const double> knots, Line<const Index> sizes, Rows<const double> coefficients, int order,
                     Rows<const double> numbers, Rows<double> values) {
  require(knots.count > 0 && sizes.size == knots.count, "sizes do not fit the knots");
  require(coefficients.count == 4 && coefficients.width == knots.count * (knots.width - 1), "coefficients do not fit");
  require(numbers.count == values.count && numbers.width == values.width && values.count % knots.count == 0,
          "values do not fit");
  for (Index curve = 0; curve < knots.count; ++curve) {
    require(sizes[curve] >= 2 && sizes[curve] <= knots.width, "a curve has two knots or more");
  }
  for (Index row = 0; row < values.count; ++row) {
    const Index curve = row % knots.count, first = curve * (knots.width - 1);
    const double *x = knots[curve], *from = numbers[row];
    const Index last = sizes[curve] - 2;
    Index piece = 0;
    for (Index i = 0; i < values.width; ++i) {
      if ((piece > 0 && from[i] < x[piece]) || (piece < last && !(from[i] < x[piece + 1]))) {
        piece = std::upper_bound(x + 1, x + last + 1, from[i]) - (x + 1);
      }
      const double u = from[i] - x[piece], *c = coefficients[0] + first + piece;
      const double c_1 = c[coefficients.stride], c_2 = c[2 * coefficients.stride], c_3 = c[3 * coefficients.stride];
      values[row][i] = order == 1 ? c_1 + u * (2.0 * c_2 + u * (3.0 * c_3)) : c[0] + u * (c_1 + u * (c_2 + u * c_3));
    }
  }
}

struct Limits {
  double step_s, lateral_m, speed_deviation, min_length_m, min_speed_mps;
};

// Number of steps after which a segment of the first of n points on may end; -1 if none.
Index count_steps(const double* x, const double* y, const double* speed, Index n, const Limits& limits) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  const double slowest = 1.0 - limits.speed_deviation, fastest = 1.0 + limits.speed_deviation;
  const double lateral = limits.lateral_m;
  double high = -infinity, low = infinity, total = 0.0, left = infinity, right = -infinity, before = 0.0, turned = 0.0;
  double length[kHalfWidth], direction[kHalfWidth], half_width[kHalfWidth];
  Index last = -1;
  for (Index step = 0; step < n; ++step) {
    const Index lane = step % kHalfWidth;
    if (lane == 0) {
      side_by_side(std::min<Index>(kHalfWidth, n - step), [&](auto zero, Index k) {
        using V = decltype(zero);
        const V along = load<V>(x + step + k) - *x, across = load<V>(y + step + k) - *y;
        const V square = along * along + across * across;
        store(length + k, square_root(square));
        store(direction + k, angle_of(across, along));
        store(half_width + k, angle_of(zero + lateral, square_root(larger(square - lateral * lateral, 0.0))));
      });
    }
    high = std::max(high, speed[step]);
    low = std::min(low, speed[step]);
    total += speed[step];
    if (direction[lane] - before > kPi) turned -= 2.0 * kPi;  // no jump from pi to -pi
    if (direction[lane] - before < -kPi) turned += 2.0 * kPi;
    before = direction[lane];
    const double angle = before + turned;
    if (length[lane] > lateral) {  // a nearer sample allows every direction
      left = std::min(left, angle + half_width[lane]);
      right = std::max(right, angle - half_width[lane]);
    }
    if (left < right || high * slowest > fastest * low) break;  // neither gets better later
    const double mean = total / static_cast<double>(step + 1);
    const bool steady = high <= fastest * mean && low >= slowest * mean;
    const double shortest_m = std::max(limits.min_length_m, limits.min_speed_mps * limits.step_s * step);
    if (steady && right <= angle && angle <= left && length[lane] >= shortest_m) last = step;
  }
  return last;
}

// First and last point of the first longest segment of a path with `shortest` steps or more; -1 if none.
std::pair<Index, Index> longest_stretch(Line<const double> x, Line<const double> y, Line<const double> speed,
                                        double step_s, double lateral_m, double speed_deviation, double min_length_m,
                                        double min_speed_mps, Index shortest) {
  require(x.size == y.size && x.size == speed.size, "path and speed do not fit");
  const Limits limits{step_s, lateral_m, speed_deviation, min_length_m, min_speed_mps};
  std::pair<Index, Index> best{-1, -1};
  for (Index first = 0; x.size - first > std::max<Index>(shortest, 0); ++first) {
    const Index steps = count_steps(&x[first], &y[first], &speed[first], x.size - first, limits);
    if (steps >= shortest) {
      best = {first, first + steps};
      shortest = steps + 1;
    }
  }
  return best;
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "evaluate_harmonics", &evaluate_harmonics);
  define(module, "evaluate_cubics", &evaluate_cubics);
  define(module, "longest_stretch", &longest_stretch);
}

}  // namespace doppelgait::motions

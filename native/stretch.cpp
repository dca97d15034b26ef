// Search for the longest straight segment of constant velocity in a path.
#include <nanobind/stl/pair.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "angles.hpp"
#include "arrays.hpp"

namespace doppelgait::stretch {
namespace {

struct Limits {
  double step_s, lateral_m, speed_deviation, min_length_m, min_speed_mps;
};

struct Path {
  Line<const double> x, y, speed;
};

// Number of steps after which a segment from point `first` on may end; -1 if none.
Index count_steps(const Path& path, Index first, const Limits& limits) {
  constexpr double infinity = std::numeric_limits<double>::infinity(), pi = 3.14159265358979324;
  const double slowest = 1.0 - limits.speed_deviation, fastest = 1.0 + limits.speed_deviation;
  const double *x = path.x.data + first, *y = path.y.data + first, *speed = path.speed.data + first,
               lateral = limits.lateral_m;
  double high = -infinity, low = infinity, total = 0.0, left = infinity, right = -infinity, before = 0.0, turned = 0.0;
  double length[kHalfWidth], direction[kHalfWidth], half_width[kHalfWidth];
  Index last = -1;
  for (Index step = 0; step < path.x.size - first; ++step) {
    const Index lane = step % kHalfWidth;
    if (lane == 0) {
      side_by_side(std::min<Index>(kHalfWidth, path.x.size - first - step), [&](auto zero, Index k) {
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
    if (direction[lane] - before > pi) turned -= 2.0 * pi;  // no jump from pi to -pi
    if (direction[lane] - before < -pi) turned += 2.0 * pi;
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
  const Path path{x, y, speed};
  const Limits limits{step_s, lateral_m, speed_deviation, min_length_m, min_speed_mps};
  std::pair<Index, Index> best{-1, -1};
  for (Index first = 0; path.x.size - first > std::max<Index>(shortest, 0); ++first) {
    const Index steps = count_steps(path, first, limits);
    if (steps >= shortest) {
      best = {first, first + steps};
      shortest = steps + 1;
    }
  }
  return best;
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "longest_stretch", &longest_stretch, "x", "y", "speed", "step_s", "lateral_m", "speed_deviation",
         "min_length_m", "min_speed_mps", "shortest");
}

}  // namespace doppelgait::stretch

// Weights of a cubic spline through uniform frames at one time (E-02).
#pragma once

#include <algorithm>
#include <cmath>

#include "arrays.hpp"

namespace doppelgait::spline {

// value = a y0 + b y1 + low m0 + high m1, slope = (y1 - y0) / step + slope_low m0 + slope_high m1
struct Weights {
  Weights(double time, double step, Index n_frames) {
    const double place = time / step, sixth = step / 6.0;
    frame = static_cast<Index>(std::min(std::max(0.0, std::floor(place)), n_frames - 2.0));  // 0 for NaN
    b = place - static_cast<double>(frame);
    a = 1.0 - b;
    low = (a * a * a - a) * (step * sixth);
    high = (b * b * b - b) * (step * sixth);
    slope_low = (1.0 - 3.0 * a * a) * sixth;
    slope_high = (3.0 * b * b - 1.0) * sixth;
  }

  Index frame;
  double a, b, low, high, slope_low, slope_high;
};

}  // namespace doppelgait::spline

// Correlated chi-square fluctuation of scatterers at any times (E-08d).
#include <cmath>
#include <vector>

#include "arrays.hpp"
#include "elementary.hpp"

namespace doppelgait::fluctuation {
namespace {

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
  define(module, "smoothed_chi_square", &smoothed_chi_square, "normal", "times", "correlation", "reach", "out");
}

}  // namespace doppelgait::fluctuation

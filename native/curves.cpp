// Curves of motions: sums of harmonics, and piecewise cubics.
#include <algorithm>

#include "arrays.hpp"
#include "elementary.hpp"

namespace doppelgait::curves {
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

}  // namespace

void bind(nb::module_& module) {
  define(module, "evaluate_harmonics", &evaluate_harmonics, "coefficients", "phase", "out");
  define(module, "evaluate_cubics", &evaluate_cubics, "knots", "sizes", "coefficients", "order", "numbers", "out");
}

}  // namespace doppelgait::curves

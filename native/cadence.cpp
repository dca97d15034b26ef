// Passes of the cadence-velocity diagram (E-30, E-31).
#include "arrays.hpp"

namespace doppelgait::cadence {
namespace {

constexpr Index kGroup = 64;  // rows that are worked on together: what is used again stays in the fastest cache

// Adds factor_0 row_0 + factor_1 row_1 + ..., in this order, to ``n`` vectors from ``column`` on.
template <typename Vector, int n>
inline void add_block(Rows<const double> rows, const double* factors, Index apart, Index column, double* to) {
  constexpr Index lanes = sizeof(Vector) / sizeof(double);
  Vector total[n];
  for (int i = 0; i < n; ++i) total[i] = load<Vector>(to + column + i * lanes);
  const double* from = rows.data + column;
  for (Index t = 0; t < rows.count; ++t, from += rows.stride, factors += apart) {
    for (int i = 0; i < n; ++i) total[i] = fused(load<Vector>(from + i * lanes), *factors, total[i]);
  }
  for (int i = 0; i < n; ++i) store(to + column + i * lanes, total[i]);
}

// The same to all columns; the factors lie ``apart``.
void add_rows(Rows<const double> rows, const double* factors, Index apart, double* to) {
  Index column = 0;
  for (; column + 8 * kHalfWidth <= rows.width; column += 8 * kHalfWidth)
    add_block<Double, 8>(rows, factors, apart, column, to);
  for (; column + kHalfWidth <= rows.width; column += kHalfWidth)
    add_block<Double, 1>(rows, factors, apart, column, to);
  for (; column < rows.width; ++column) add_block<double, 1>(rows, factors, apart, column, to);
}

// Weighted columns (``rows`` has a row a time) lie on circles that begin in their middle.
void lay_circular(Rows<const double> rows, Line<const double> weights, Index first, Rows<double> out) {
  require(weights.size == rows.count && rows.count <= out.width, "every column needs a weight and a place");
  require(first >= 0 && first <= rows.width - out.count, "rows beyond the last one are wanted");
  const Index centre = rows.count / 2;
  for (Index row = 0; row < out.count; ++row)
    std::fill(out[row] + rows.count - centre, out[row] + out.width - centre, 0.0);
  for (Index j = 0; j < rows.count; ++j) {
    const double *from = rows[j] + first, weight = weights[j];
    double* to = out.data + (j < centre ? out.width - centre + j : j - centre);
    for (Index row = 0; row < out.count; ++row) to[row * out.stride] = weight * from[row];
  }
}

// Lines of real rows, interpolated by a kernel: magnitudes (E-30).
void fine_magnitudes(Rows<const std::complex<double>> lines, Rows<const double> taps, Index first, Rows<double> out) {
  require(taps.count > 0 && taps.width > 1, "there are no taps");
  require(first >= 0 && first <= out.width - lines.count, "rows beyond the last one are wanted");
  const Index n_rows = lines.count, half = taps.width / 2 - 1, n_grid = (out.count - 1) / taps.count + taps.width;
  std::vector<double> values(n_grid * 2 * n_rows), total(2 * n_rows);  // real parts first, then imaginary parts
  const Rows<double> grid = {values.data(), n_grid, 2 * n_rows, 2 * n_rows};
  for (Index g = 0; g < n_grid; ++g) {
    const Index n = std::abs(g - half);
    if (n >= lines.width) continue;
    for (Index row = 0; row < n_rows; ++row) {
      grid[g][row] = lines[row][n].real();
      grid[g][n_rows + row] = g < half ? -lines[row][n].imag() : lines[row][n].imag();
    }
  }
  for (Index q = 0; q < out.count; ++q) {
    std::fill(total.begin(), total.end(), 0.0);
    const Index start = q / taps.count;
    add_rows({grid[start], taps.width, 2 * n_rows, 2 * n_rows}, taps[q % taps.count], 1, total.data());
    const double *real = total.data(), *imaginary = real + n_rows;
    double* magnitude = out[q] + first;
    for (Index k = 0; k < n_rows; ++k) magnitude[k] = std::sqrt(real[k] * real[k] + imaginary[k] * imaginary[k]);
  }
}

// Rows spread onto a coarser time grid.
void smear(Rows<const double> rows, Line<const double> weights, Line<const double> taps, Index step, Rows<double> out) {
  require(weights.size == rows.count && out.width == rows.width, "weights or sums are not as many as rows");
  require(step > 0 && step < Index{1} << 31, "step must be a number of columns");
  std::vector<double> factors(taps.size);
  for (Index c = 0; c < out.count; ++c) {
    const Index begin = step * c - taps.size, first = std::max<Index>(begin, 0), last = std::min(step * c, rows.count);
    for (Index j = first; j < last; ++j) factors[j - first] = taps[j - begin] * weights[j];
    std::fill(out[c], out[c] + out.width, 0.0);
    if (first < last) add_rows(rows.slice(first, last), factors.data(), 1, out[c]);
  }
}

// Sums of products of every row with functions of time.
void project(Rows<const double> rows, Rows<const double> basis, Rows<double> out) {
  require(basis.count == rows.count && basis.width == out.count && out.width == rows.width, "shapes do not agree");
  for (Index p = 0; p < out.count; ++p) std::fill(out[p], out[p] + out.width, 0.0);
  for (Index j = 0; j < rows.count; j += kGroup / 4) {
    const Rows<const double> some = rows.slice(j, std::min(j + kGroup / 4, rows.count));
    for (Index p = 0; p < out.count; ++p) add_rows(some, basis[j] + p, basis.stride, out[p]);
  }
}

// Every row (J, K) without its projection on orthonormal functions of time (J, P).
void remove_trend(Rows<double> rows, Rows<const double> basis) {
  std::vector<double> parts(basis.width * rows.width), factors(basis.width);
  const Rows<double> part = {parts.data(), basis.width, rows.width, rows.width};
  project(rows.read(), basis, part);
  for (Index j = 0; j < rows.count; ++j) {
    for (Index p = 0; p < basis.width; ++p) factors[p] = -basis[j][p];
    add_rows(part.read(), factors.data(), 1, rows[j]);
  }
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "lay_circular", &lay_circular);
  define(module, "fine_magnitudes", &fine_magnitudes);
  define(module, "smear", &smear);
  define(module, "remove_trend", &remove_trend);
  define(module, "project", &project);
}

}  // namespace doppelgait::cadence

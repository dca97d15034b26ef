// Passes over signature columns that several features share (E-28 to E-38).
#include <algorithm>

#include "arrays.hpp"
#include "lanes.hpp"

namespace doppelgait::columns {
namespace {

constexpr Index kLanes = 16;  // cells that are worked on together

// Sum and maximum above the floor in every column (E-28).
template <typename T>
void sum_excess(Rows<const T> values, double floor, Line<double> sums, Line<double> highest) {
  require(sums.size == values.count && highest.size == values.count, "every column needs a sum and a maximum");
  constexpr int n = kLanes / kHalfWidth;
  const Index whole = values.width / kLanes * kLanes;
  for (Index j = 0; j < values.count; ++j) {
    const T* column = values[j];
    Double parts[n] = {}, tops[n] = {};
    for (Index first = 0; first < whole; first += kLanes) {  // sums that do not wait for each other
      for (int i = 0; i < n; ++i) {
        const Double excess = load_double(column + first + i * kHalfWidth) - floor;
        const Double cell = excess <= 0.0 ? Double{} : excess;  // what is not a number stays so
        parts[i] += cell;
        tops[i] = cell > tops[i] ? cell : tops[i];
      }
    }
    double part[kLanes], top[kLanes];
    for (int i = 0; i < n; ++i) store(part + i * kHalfWidth, parts[i]);
    for (int i = 0; i < n; ++i) store(top + i * kHalfWidth, tops[i]);
    for (Index k = whole; k < values.width; ++k) {
      const double cell = std::max(static_cast<double>(column[k]) - floor, 0.0);
      part[0] += cell;
      top[0] = std::max(top[0], cell);
    }
    double total = 0.0;
    for (Index i = 0; i < kLanes / 2; ++i) total += part[i] + part[i + kLanes / 2];
    sums[j] = total;
    highest[j] = *std::max_element(top, top + kLanes);
  }
}

// Every column without the floor, clipped at 0, times its factor (E-28).
template <typename T>
void scale_excess(Rows<const T> values, double floor, Line<const double> factor, Rows<double> out) {
  require(factor.size == values.count, "every column needs a factor");
  require(out.count == values.count && out.width == values.width, "shapes do not agree");
  for (Index j = 0; j < values.count; ++j) {
    const T* column = values[j];
    double* __restrict to = out[j];
    for (Index k = 0; k < values.width; ++k) {
      const double excess = static_cast<double>(column[k]) - floor;
      to[k] = (excess <= 0.0 ? 0.0 : excess) * factor[j];
    }
  }
}

// Every column's strongest cell (of equal ones the first), and its place refined by a parabola in the logarithm.
template <typename T>
void column_peaks(Rows<const T> values, Line<T> strongest, Line<double> place) {
  require(strongest.size == values.count && place.size == values.count, "every column needs a peak and a place");
  require(values.width > 2, "a parabola needs three cells");
  const auto logarithm = [](T cell) { return std::log(std::max(static_cast<double>(cell), 1e-300)); };
  const Index n_bins = values.width, whole = n_bins / kLanes * kLanes;
  for (Index j = 0; j < values.count; ++j) {
    const T* column = values[j];
    T top[kLanes];
    std::fill(top, top + kLanes, column[0]);
    for (Index first = 0; first < whole; first += kLanes) {
      for (Index i = 0; i < kLanes; ++i) top[i] = column[first + i] > top[i] ? column[first + i] : top[i];
    }
    T most = *std::max_element(top, top + kLanes);
    for (Index k = whole; k < n_bins; ++k) most = std::max(most, column[k]);
    strongest[j] = most;
    const Index best = std::clamp<Index>(std::find(column, column + n_bins - 1, most) - column, 1, n_bins - 2);
    const double left = logarithm(column[best - 1]), centre = logarithm(column[best]);
    const double right = logarithm(column[best + 1]), bend = left - 2.0 * centre + right;
    place[j] = static_cast<double>(best) + (bend < 0.0 ? std::clamp(0.5 * (left - right) / bend, -0.5, 0.5) : 0.0);
  }
}

// Every Doppler row, averaged over time.
template <typename T>
void row_means(Rows<const T> values, Line<double> out) {
  require(out.size == values.width && values.count > 0, "every row of some columns needs a mean");
  double* __restrict mean = out.data;
  std::fill(mean, mean + out.size, 0.0);
  Index j = 0;
  for (; j + 4 <= values.count; j += 4) {  // the sum is loaded and stored once for four
    const T *a = values[j], *b = values[j + 1], *c = values[j + 2], *d = values[j + 3];
    for (Index k = 0; k < out.size; ++k) mean[k] = (((mean[k] + a[k]) + b[k]) + c[k]) + d[k];
  }
  for (; j < values.count; ++j) {
    const T* column = values[j];
    for (Index k = 0; k < out.size; ++k) mean[k] += column[k];
  }
  for (Index k = 0; k < out.size; ++k) mean[k] /= static_cast<double>(values.count);
}

// Cells of every block that reach their column's level.
template <typename T>
void count_above(Rows<const T> values, Line<const T> level, Line<const Index> edges, Rows<double> counts) {
  require(level.size == values.count && counts.width == values.width, "shapes do not agree");
  require(edges.size == counts.count + 1, "every block lies between two edges");
  for (Index b = 0; b < counts.count; ++b)
    require(edges[b] >= 0 && edges[b + 1] <= values.count, "blocks must lie within the columns");
  for (Index b = 0; b < counts.count; ++b) {
    double* __restrict block = counts[b];
    std::fill(block, block + counts.width, 0.0);
    for (Index j = edges[b]; j < edges[b + 1]; ++j) {
      const T *column = values[j], least = level[j];
      for (Index k = 0; k < counts.width; ++k) block[k] += column[k] >= least ? 1.0 : 0.0;
    }
  }
}

template <typename T>
void bind_for(nb::module_& module) {
  define(module, "sum_excess", &sum_excess<T>, "values", "floor", "sums", "highest");
  define(module, "scale_excess", &scale_excess<T>, "values", "floor", "factor", "out");
  define(module, "column_peaks", &column_peaks<T>, "values", "strongest", "place");
  define(module, "row_means", &row_means<T>, "values", "out");
  define(module, "count_above", &count_above<T>, "values", "level", "edges", "counts");
}

}  // namespace

void bind(nb::module_& module) {
  bind_for<double>(module);
  bind_for<float>(module);
}

}  // namespace doppelgait::columns

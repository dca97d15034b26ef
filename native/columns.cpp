// Passes over signature columns that array expressions would repeat in memory (E-28 to E-38).
#include "arrays.hpp"

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

// Shifts every column downwards in Doppler, circularly, by fractional bins. Keys' cubic convolution (IEEE Trans. ASSP
// 29, 1981); weights sum to 1, so that column sums are kept.
template <typename T>
void shift_columns(Rows<const T> values, Line<const double> shift, Rows<double> out) {
  const Index n_bins = values.width;
  require(out.count == values.count && out.width == n_bins, "shapes do not agree");
  require(shift.size == values.count && n_bins > 0, "every column needs a shift");
  std::vector<double> row(n_bins + 3);
  for (Index j = 0; j < values.count; ++j) {
    const double whole = std::floor(shift[j]), p = shift[j] - whole, q = 1.0 - p;
    const double before = -0.5 * p * q * q, after = -0.5 * q * p * p;
    const double here = 1.0 - 2.5 * p * p + 1.5 * p * p * p, there = 1.0 - 2.5 * q * q + 1.5 * q * q * q;
    const T* column = values[j];
    const Index first = go_round(nearest_bin(whole) - 1, n_bins);
    std::copy(column + first, column + n_bins, row.data());
    std::copy(column, column + first, row.data() + n_bins - first);
    for (Index k = 0; k < 3; ++k) row[n_bins + k] = row[k % n_bins];
    const double* from = row.data();
    double* __restrict to = out[j];
    for (Index k = 0; k < n_bins; ++k)
      to[k] = before * from[k] + here * from[k + 1] + there * from[k + 2] + after * from[k + 3];
  }
}

// Two quantiles over Doppler of the power above a threshold, as fractional bin numbers (E-35b).
template <typename T>
void power_quantiles(Rows<const T> values, double threshold, double floor, double low_share, double high_share,
                     Line<double> low, Line<double> high) {
  require(low.size == values.count && high.size == values.count, "every column needs two quantiles");
  const Index n_bins = values.width, n_blocks = (n_bins + kLanes - 1) / kLanes;
  std::vector<double> cells(n_blocks * kLanes), sums(n_blocks);
  // The cell where the sum first reaches a share of the total, and the sum of those before. Steps are blocks of cells
  // as long as a block has too little.
  const auto find_crossing = [&](Index step, auto is_short) {
    Index b = step > 0 ? 0 : n_blocks - 1;
    double before = 0.0;
    for (; b + step >= 0 && b + step < n_blocks && is_short(before + sums[b]); b += step) before += sums[b];
    Index k = step > 0 ? b * kLanes : std::min(b * kLanes + kLanes, n_bins) - 1;
    for (; k + step >= 0 && k + step < n_bins && is_short(before + cells[k]); k += step) before += cells[k];
    return std::pair(k, before);
  };
  for (Index j = 0; j < values.count; ++j) {
    const T* column = values[j];
    double *above = cells.data(), total = 0.0;
    Index k = 0;
    for (; k + kHalfWidth <= n_bins; k += kHalfWidth) {
      const Double cell = load_double(column + k);
      store(above + k, cell > threshold ? cell - floor : Double{});
    }
    for (; k < n_bins; ++k) above[k] = column[k] > threshold ? static_cast<double>(column[k]) - floor : 0.0;
    for (Index b = 0; b < n_blocks; ++b) {
      const double* x = above + b * kLanes;
      double part[4];  // sums that do not wait for each other
      for (int i = 0; i < 4; ++i) part[i] = ((x[i] + x[i + 4]) + x[i + 8]) + x[i + 12];
      sums[b] = (part[0] + part[1]) + (part[2] + part[3]);
      total += sums[b];
    }
    low[j] = high[j] = std::numeric_limits<double>::quiet_NaN();
    if (!(total > 0.0)) continue;
    const double wanted = low_share * total, beyond = (1.0 - high_share) * total;
    const auto [first, until_first] = find_crossing(1, [wanted](double sum) { return sum < wanted; });
    low[j] = static_cast<double>(first) + (wanted - until_first) / above[first] - 0.5;
    // from the other end: most power is between
    const auto [last, from_last] = find_crossing(-1, [beyond](double sum) { return sum <= beyond; });
    high[j] = static_cast<double>(last) + 0.5 - (beyond - from_last) / above[last];
  }
}

// Amplitudes of row groups without noise (E-33 step 4).
void limb_amplitudes(Rows<const double> moved, Line<const double> noise, double mean_noise, double above,
                     Line<const Index> starts, Line<const Index> stops, Rows<double> out) {
  require(noise.size == moved.count && out.count == moved.count, "every column needs its noise");
  require(stops.size == starts.size && out.width == starts.size, "every group needs a first and a last row");
  for (Index g = 0; g < starts.size; ++g)
    require(starts[g] >= 0 && stops[g] <= moved.width, "groups must lie within the rows");
  std::vector<double> counted(moved.width), cells(moved.width);
  for (Index j = 0; j < moved.count; ++j)
    for (Index k = 0; k < moved.width; ++k) counted[k] += moved[j][k];
  for (double& sum : counted) sum = sum / static_cast<double>(moved.count) - mean_noise > above ? 1.0 : 0.0;
  for (Index j = 0; j < moved.count; ++j) {
    const double* column = moved[j];
    for (Index k = 0; k < moved.width; ++k) {
      const double excess = column[k] - noise[j];
      cells[k] = counted[k] * (excess > 0.0 ? excess : 0.0);
    }
    for (Index g = 0; g < starts.size; ++g) {
      double total = 0.0;
      for (Index k = starts[g]; k < stops[g]; ++k) total += cells[k];
      out[j][g] = std::sqrt(total);
    }
  }
}

// Sums of groups of neighbouring columns and rows; incomplete groups are dropped.
void sum_groups(Rows<const double> values, Index n_columns, Index n_rows, Rows<double> out) {
  require(n_columns > 0 && n_rows > 0, "groups need columns and rows");
  require(out.count == values.count / n_columns && out.width == values.width / n_rows, "every group needs a sum");
  for (Index j = 0; j < out.count; ++j) {
    double* __restrict total = out[j];
    std::fill(total, total + out.width, 0.0);
    for (Index i = n_columns * j; i < n_columns * (j + 1); ++i) {
      for (Index m = 0; m < n_rows; ++m) {
        const double* column = values[i] + m;
        for (Index k = 0; k < out.width; ++k) total[k] += column[n_rows * k];
      }
    }
  }
}

// Sums of what is positive in groups of columns.
template <typename T>
void positive_sums(Rows<const T> values, Index n_columns, Line<double> out) {
  require(n_columns > 0 && out.size == values.count / n_columns, "every group of columns needs a sum");
  constexpr int n = kLanes / kHalfWidth;
  const Index whole = values.width / kLanes * kLanes;
  for (Index j = 0; j < out.size; ++j) {
    Double parts[n] = {};
    double rest = 0.0;
    for (Index i = n_columns * j; i < n_columns * (j + 1); ++i) {
      const T* column = values[i];
      for (Index first = 0; first < whole; first += kLanes) {  // sums that do not wait for each other
        for (int m = 0; m < n; ++m) {
          const Double cell = load_double(column + first + m * kHalfWidth);
          parts[m] += cell > 0.0 ? cell : Double{};
        }
      }
      for (Index k = whole; k < values.width; ++k) rest += std::max(static_cast<double>(column[k]), 0.0);
    }
    double part[kLanes];
    for (int m = 0; m < n; ++m) store(part + m * kHalfWidth, parts[m]);
    for (const double sum : part) rest += sum;
    out[j] = rest;
  }
}

// Widths above a level around the peaks of rows, with ends on straight lines between bins; NaN without any (E-35).
void widths_above(Rows<const double> rows, double level, Line<double> widths) {
  require(widths.size == rows.count && rows.width > 0, "every row needs a width");
  for (Index n = 0; n < rows.count; ++n) {
    const double* row = rows[n];
    const Index peak = std::max_element(row, row + rows.width) - row;
    widths[n] = row[peak] >= level ? 0.0 : std::numeric_limits<double>::quiet_NaN();
    for (const Index step : {-1, 1}) {
      Index next = peak + step;
      while (0 <= next && next < rows.width && row[next] >= level) next += step;
      widths[n] += static_cast<double>(std::abs(next - peak) - 1);
      if (0 <= next && next < rows.width) widths[n] += 1.0 - (level - row[next]) / (row[next - step] - row[next]);
    }
  }
}

// Copies chosen Doppler rows of (J, K).
template <typename T>
void copy_rows(Rows<const T> values, Line<const Index> rows, Rows<T> out) {
  require(out.count == values.count && out.width == rows.size, "every chosen row needs a place");
  for (Index n = 0; n < rows.size; ++n) require(rows[n] >= 0 && rows[n] < values.width, "there is no such row");
  for (Index j = 0; j < values.count; ++j) {
    for (Index n = 0; n < rows.size; ++n) out[j][n] = values[j][rows[n]];
  }
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "sum_excess", &sum_excess<double>, &sum_excess<float>);
  define(module, "scale_excess", &scale_excess<double>, &scale_excess<float>);
  define(module, "column_peaks", &column_peaks<double>, &column_peaks<float>);
  define(module, "row_means", &row_means<double>, &row_means<float>);
  define(module, "count_above", &count_above<double>, &count_above<float>);
  define(module, "copy_rows", &copy_rows<double>, &copy_rows<float>);
  define(module, "shift_columns", &shift_columns<double>, &shift_columns<float>);
  define(module, "power_quantiles", &power_quantiles<double>, &power_quantiles<float>);
  define(module, "positive_sums", &positive_sums<double>, &positive_sums<float>);
  define(module, "limb_amplitudes", &limb_amplitudes);
  define(module, "widths_above", &widths_above);
  define(module, "sum_groups", &sum_groups);
}

}  // namespace doppelgait::columns

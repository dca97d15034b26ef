// Column passes that array expressions would repeat in memory (E-29, E-33, E-35b).
#include <algorithm>
#include <limits>
#include <vector>

#include "arrays.hpp"
#include "lanes.hpp"

namespace doppelgait::features {
namespace {

constexpr Index kBlock = 16;  // cells whose power is summed before it is looked into

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

// Where the sum of cells first reaches a share of the total: the number of the cell, and what lies before it. Steps are
// blocks of cells as long as a block has too little.
struct Crossing {
  Index cell;
  double before;
};

template <typename Short>
Crossing find_crossing(const double* cells, const double* sums, Index n_cells, Index n_blocks, Index step,
                       Short is_short) {
  Index b = step > 0 ? 0 : n_blocks - 1;
  double before = 0.0;
  for (; b + step >= 0 && b + step < n_blocks && is_short(before + sums[b]); b += step) before += sums[b];
  Index k = step > 0 ? b * kBlock : std::min(b * kBlock + kBlock, n_cells) - 1;
  for (; k + step >= 0 && k + step < n_cells && is_short(before + cells[k]); k += step) before += cells[k];
  return {k, before};
}

// Two quantiles over Doppler of the power above a threshold, as fractional bin numbers (E-35b).
template <typename T>
void power_quantiles(Rows<const T> values, double threshold, double floor, double low_share, double high_share,
                     Line<double> low, Line<double> high) {
  require(low.size == values.count && high.size == values.count, "every column needs two quantiles");
  const Index n_bins = values.width, n_blocks = (n_bins + kBlock - 1) / kBlock;
  std::vector<double> cells(n_blocks * kBlock), sums(n_blocks);
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
      const double* x = above + b * kBlock;
      double part[4];  // sums that do not wait for each other
      for (int i = 0; i < 4; ++i) part[i] = ((x[i] + x[i + 4]) + x[i + 8]) + x[i + 12];
      sums[b] = (part[0] + part[1]) + (part[2] + part[3]);
      total += sums[b];
    }
    low[j] = high[j] = std::numeric_limits<double>::quiet_NaN();
    if (!(total > 0.0)) continue;
    const double wanted = low_share * total, beyond = (1.0 - high_share) * total;
    const Crossing first =
        find_crossing(above, sums.data(), n_bins, n_blocks, 1, [wanted](double sum) { return sum < wanted; });
    low[j] = static_cast<double>(first.cell) + (wanted - first.before) / above[first.cell] - 0.5;
    // from the other end: most power is between
    const Crossing last =
        find_crossing(above, sums.data(), n_bins, n_blocks, -1, [beyond](double sum) { return sum <= beyond; });
    high[j] = static_cast<double>(last.cell) + 0.5 - (beyond - last.before) / above[last.cell];
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
        if (n_rows == 1) {
          for (Index k = 0; k < out.width; ++k) total[k] += column[k];
        } else {
          for (Index k = 0; k < out.width; ++k) total[k] += column[n_rows * k];
        }
      }
    }
  }
}

// Sums of what is positive in groups of columns.
template <typename T>
void positive_sums(Rows<const T> values, Index n_columns, Line<double> out) {
  require(n_columns > 0 && out.size == values.count / n_columns, "every group of columns needs a sum");
  constexpr int n = kBlock / kHalfWidth;
  const Index whole = values.width / kBlock * kBlock;
  for (Index j = 0; j < out.size; ++j) {
    Double parts[n] = {};
    double rest = 0.0;
    for (Index i = n_columns * j; i < n_columns * (j + 1); ++i) {
      const T* column = values[i];
      for (Index first = 0; first < whole; first += kBlock) {  // sums that do not wait for each other
        for (int m = 0; m < n; ++m) {
          const Double cell = load_double(column + first + m * kHalfWidth);
          parts[m] += cell > 0.0 ? cell : Double{};
        }
      }
      for (Index k = whole; k < values.width; ++k) rest += std::max(static_cast<double>(column[k]), 0.0);
    }
    double part[kBlock];
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

template <typename T>
void bind_for(nb::module_& module) {
  define(module, "copy_rows", &copy_rows<T>, "values", "rows", "out");
  define(module, "shift_columns", &shift_columns<T>, "values", "shift", "out");
  define(module, "power_quantiles", &power_quantiles<T>, "values", "threshold", "floor", "low_share", "high_share",
         "low", "high");
  define(module, "positive_sums", &positive_sums<T>, "values", "n_columns", "out");
}

}  // namespace

void bind(nb::module_& module) {
  bind_for<double>(module);
  bind_for<float>(module);
  define(module, "limb_amplitudes", &limb_amplitudes, "moved", "noise", "mean_noise", "above", "starts", "stops",
         "out");
  define(module, "widths_above", &widths_above, "rows", "level", "widths");
  define(module, "sum_groups", &sum_groups, "values", "n_columns", "n_rows", "out");
}

}  // namespace doppelgait::features

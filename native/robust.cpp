// Quantiles and polynomials through points with outliers (E-29, E-34), and features of envelopes and harmonics.
#include "arrays.hpp"

namespace doppelgait::robust {
namespace {

using Values = std::vector<double>;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kDeviation = 1.4826;  // standard deviation of a normal variable over its median magnitude

// The value at a place of the sorted values and the next one: halve the interval until it has few values, sort those.
std::pair<double, double> find_neighbours(const double* values, Index n, Index place) {
  const auto search = [=](double start, auto choose) {  // choose(best, value) in any order
    Double bests = spread(start);
    Index i = 0;
    for (; i + kHalfWidth <= n; i += kHalfWidth) bests = choose(bests, load<Double>(values + i));
    double best = start;
    for (int lane = 0; lane < kHalfWidth; ++lane) best = choose(best, bests[lane]);
    for (; i < n; ++i) best = choose(best, values[i]);
    return best;
  };
  const auto find_next = [&](double limit) {
    return search(kInfinity, [limit](auto best, auto value) {
      return (value > limit + decltype(value){}) & (value < best) ? value : best;
    });
  };
  constexpr Index few = 16;
  double low = search(kInfinity, [](auto best, auto value) { return value < best ? value : best; });
  double high = search(-kInfinity, [](auto best, auto value) { return value > best ? value : best; });
  double sorted[few + 1] = {};
  if (!(high - low < kInfinity)) {  // infinite values: no interval to halve; NaN is put last
    Values all(values, values + n);
    std::sort(all.begin(), all.end(), [](double a, double b) { return a < b || (b != b && a == a); });
    return {all[place], all[std::min(place + 1, n - 1)]};
  }
  low -= high - low;
  Index n_low = 0, n_high = n;  // values up to low and up to high
  while (n_high - n_low > few) {
    const double middle = 0.5 * (low + high);
    if (!(low < middle && middle < high)) return {high, place + 1 < n_high ? high : find_next(high)};
    Index count = 0;
    for (Index i = 0; i < n; ++i) count += values[i] <= middle;
    (count > place ? high : low) = middle;
    (count > place ? n_high : n_low) = count;
  }
  Index count = 0;
  for (Index i = 0; i < n; ++i) {
    if ((values[i] > low || n_low == 0) && values[i] <= high) sorted[count++] = values[i];
  }
  std::sort(sorted, sorted + count);
  sorted[count] = find_next(high);
  return {sorted[place - n_low], sorted[place - n_low + 1]};
}

// Quantile of one value or more; between two values it lies on a straight line.
double quantile(const double* values, Index n, double share) {
  const double place = std::min(std::max(0.0, share), 1.0) * static_cast<double>(n - 1);  // 0 for NaN
  const auto below = static_cast<Index>(place);
  const auto [value, after] = find_neighbours(values, n, below);
  const double weight = place - static_cast<double>(below);
  return weight > 0.0 ? value + weight * (after - value) : value;
}

double median(const double* values, Index n) { return quantile(values, n, 0.5); }

// Solution of a positive definite system, by the lower half of the matrix; the solution replaces the right side.
void solve(double* matrix, double* right, Index n) {
  const auto at = [=](Index p, Index q) -> double& { return matrix[p * n + q]; };
  for (Index p = 0; p < n; ++p) {
    for (Index q = 0; q <= p; ++q) {
      for (Index k = 0; k < q; ++k) at(p, q) -= at(p, k) * at(q, k);
      at(p, q) = p == q ? std::sqrt(at(p, p)) : at(p, q) / at(q, q);
    }
    for (Index k = 0; k < p; ++k) right[p] -= at(p, k) * right[k];
    right[p] /= at(p, p);
  }
  for (Index p = n - 1; p >= 0; --p) {
    for (Index k = p + 1; k < n; ++k) right[p] -= at(k, p) * right[k];
    right[p] /= at(p, p);
  }
}

// Iteratively reweighted least squares with Cauchy weights. The line is that to begin with and the result. Shapes:
// basis (P, J); values, prior, divisor, line (J,); coefficients (P,).
void robust_fit(Rows<const double> basis, Line<const double> values, Line<const double> prior,
                Line<const double> divisor, double least_scale, double tuning, Index iterations, Line<double> fitted,
                Line<double> coefficients) {
  const Index n = basis.width, n_terms = basis.count;
  for (const Index size : {values.size, prior.size, divisor.size, fitted.size}) {
    require(size == n && size > 0, "a fit needs values, priors, divisors and a line for every column");
  }
  require(coefficients.size == n_terms, "coefficients do not fit the basis");
  Values residuals(n), works(n), weights(n), normal(n_terms * n_terms);
  double* __restrict residual = residuals.data();
  double* __restrict work = works.data();
  double* __restrict weight = weights.data();
  double* __restrict line = fitted.data;
  for (Index round = 0; round < iterations; ++round) {
    for (Index j = 0; j < n; ++j) residual[j] = (values[j] - line[j]) / divisor[j];
    for (Index j = 0; j < n; ++j) work[j] = std::fabs(residual[j]);
    const double inverse = 1.0 / (tuning * std::max(kDeviation * median(work, n), least_scale));
    for (Index j = 0; j < n; ++j) {
      const double r = residual[j] * inverse;
      weight[j] = prior[j] / (1.0 + r * r);
      line[j] = 0.0;
    }
    for (Index p = 0; p < n_terms; ++p) {
      const double* term = basis[p];
      for (Index j = 0; j < n; ++j) work[j] = term[j] * weight[j];
      for (Index q = 0; q <= p; ++q) normal[p * n_terms + q] = dot(work, basis[q], n);
      coefficients[p] = dot(work, values.data, n);
    }
    solve(normal.data(), coefficients.data, n_terms);
    for (Index p = 0; p < n_terms; ++p) {
      const double c = coefficients[p], *term = basis[p];
      for (Index j = 0; j < n; ++j) line[j] = fused(c, term[j], line[j]);
    }
  }
}

// Variance of the cells of the chosen rows k, in every n-th column of (J, K).
template <typename T>
double variance_of_rows(Rows<const T> columns, Line<const bool> chosen, Index every) {
  require(chosen.size == columns.width && every > 0, "chosen rows do not fit");
  every = std::min(every, std::max<Index>(columns.count, 1));
  Values sums(columns.width);
  double* __restrict sum = sums.data();
  Index n_chosen = 0;
  for (Index k = 0; k < columns.width; ++k) n_chosen += chosen[k];
  const auto average = [&](auto add) {  // add(sum, value), for some columns together
    const auto add_columns = [&](auto... column) {
      for (Index k = 0; k < columns.width; ++k) {
        double value = sum[k];
        ((value = add(value, static_cast<double>(column[k]))), ...);
        sum[k] = value;
      }
    };
    std::fill(sums.begin(), sums.end(), 0.0);
    Index j = 0, n = 0;
    for (; j + 3 * every < columns.count; j += 4 * every, n += 4) {
      add_columns(columns[j], columns[j + every], columns[j + 2 * every], columns[j + 3 * every]);
    }
    for (; j < columns.count; j += every, ++n) add_columns(columns[j]);
    double total = 0.0;
    for (Index k = 0; k < columns.width; ++k) total += chosen[k] ? sum[k] : 0.0;
    return total / static_cast<double>(n * n_chosen);
  };
  const double mean = average([](double total, double value) { return total + value; });
  return average([mean](double total, double value) { return fused(value - mean, value - mean, total); });
}

// Envelopes about the main line (E-35b), NaN where there is no power: the share of columns with power; mean and
// standard deviation of lead and lag; both quantiles of lead and of lag; the low quantile of the width; the width
// between the quantiles of both envelopes; the share of columns with a lead above the middle of its quantiles.
void edge_statistics(Line<const double> low, Line<const double> high, Line<const double> line, double direction,
                     double low_share, double high_share, Line<double> out) {
  require(high.size == low.size && line.size == low.size && out.size == 12, "envelopes do not fit");
  Values lead, lag, width, tops, ends;
  for (auto* values : {&lead, &lag, &width, &tops, &ends}) values->reserve(low.size);
  for (Index j = 0; j < low.size; ++j) {
    if (!std::isfinite(low[j])) continue;
    const double up = high[j] - line[j], down = line[j] - low[j];
    lead.push_back(direction >= 0.0 ? up : down);
    lag.push_back(direction >= 0.0 ? down : up);
    width.push_back(up + down);
    tops.push_back(high[j]);
    ends.push_back(low[j]);
  }
  const auto n = static_cast<Index>(lead.size());
  std::fill_n(out.data, 12, n ? 0.0 : std::numeric_limits<double>::quiet_NaN());
  out[0] = low.size ? static_cast<double>(n) / static_cast<double>(low.size) : 0.0;
  if (n == 0) return;
  const auto describe = [n](const Values& values, double& mean, double& deviation) {
    for (const double value : values) mean += value;
    mean /= static_cast<double>(n);
    for (const double value : values) deviation += (value - mean) * (value - mean);
    deviation = std::sqrt(deviation / static_cast<double>(n));
  };
  describe(lead, out[1], out[2]);
  describe(lag, out[3], out[4]);
  out[5] = quantile(lead.data(), n, low_share);
  out[6] = quantile(lead.data(), n, high_share);
  out[7] = quantile(lag.data(), n, low_share);
  out[8] = quantile(lag.data(), n, high_share);
  out[9] = quantile(width.data(), n, low_share);
  out[10] = quantile(tops.data(), n, high_share) - quantile(ends.data(), n, low_share);
  for (const double value : lead) out[11] += value > (out[5] + out[6]) / 2.0;
  out[11] /= static_cast<double>(n);
}

// Squared and plain peaks of three harmonics, summed over the rows of a cadence map (Q, K), the squares without the
// noise between the harmonics (E-38).
void oscillating_power(Line<const double> cadence, Rows<const double> map, double frequency_hz, double near_share,
                       double near_hz, Line<double> out) {
  const Index n_rows = map.width;
  require(map.count == cadence.size && out.size == 2, "the map does not fit");
  std::vector<Index> between;
  for (Index q = 0; q < cadence.size; ++q) {
    const double turns = cadence[q] / frequency_hz;
    if (1.0 < turns && turns < 4.0 && std::fabs(turns - std::floor(turns) - 0.5) <= 0.2) between.push_back(q);
  }
  const auto n_between = static_cast<Index>(between.size());
  Values squares(n_between), noise(n_rows), peaks(n_rows);
  for (Index k = 0; n_between && k < n_rows; ++k) {
    for (Index n = 0; n < n_between; ++n) squares[n] = map[between[n]][k] * map[between[n]][k];
    noise[k] = median(squares.data(), n_between) / 0.693147180559945309;  // of exponential variables
  }
  out[0] = out[1] = 0.0;
  for (int harmonic = 1; harmonic < 4; ++harmonic) {
    const double expected = harmonic * frequency_hz, reach = std::max(near_share * expected, near_hz);
    double* __restrict peak = peaks.data();
    std::fill(peaks.begin(), peaks.end(), 0.0);
    bool found = false;
    for (Index q = 0; q < cadence.size; ++q) {
      if (!(std::fabs(cadence[q] - expected) <= reach)) continue;
      found = true;
      const double* row = map[q];
      for (Index k = 0; k < n_rows; ++k) peak[k] = peak[k] > row[k] ? peak[k] : row[k];
    }
    for (Index k = 0; found && k < n_rows; ++k) {
      out[0] += std::max(peak[k] * peak[k] - 2.0 * noise[k], 0.0);
      out[1] += 2.0 * peak[k];
    }
  }
}

double quantile_of(Line<const double> values, double share) {
  require(values.size > 0 && share >= 0.0 && share <= 1.0, "a quantile needs values and a share from 0 to 1");
  return quantile(values.data, values.size, share);
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "quantile", &quantile_of);
  define(module, "robust_fit", &robust_fit);
  define(module, "variance_of_rows", &variance_of_rows<float>, &variance_of_rows<double>);
  define(module, "edge_statistics", &edge_statistics);
  define(module, "oscillating_power", &oscillating_power);
}

}  // namespace doppelgait::robust

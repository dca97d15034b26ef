// Sums over lags and harmonics of a signature (E-33).
#include "arrays.hpp"

namespace doppelgait::periodicity {
namespace {

using Sizes = Line<const Index>;

// Normalised square-difference autocorrelation of rows (J, K) at the lags from `first` on. The rows lie behind each
// other, so that a lag is one sum of products.
void square_difference(Rows<const double> rows, Index first, Line<double> out) {
  const Index n = rows.count, k = rows.width;
  require(first >= 0 && out.size <= n - first, "lags are longer than the record");
  double early = 0.0, late = 0.0;  // powers of the columns that have a later and an earlier one
  for (Index i = out.size - 1, before = n; i >= 0; before = first + i--) {
    const Index lag = first + i, more = (before - lag) * k;
    early += dot(rows[n - before], rows[n - before], more);
    late += dot(rows[lag], rows[lag], more);
    const double product = dot(rows[0], rows[lag], (n - lag) * k);
    out[i] = early + late > 0.0 ? 2.0 * product / (early + late) : 0.0;
  }
}

// Fourier coefficients of single periods of rows (J, K) without their means: of every period from `starts` on a row of
// means, then of real parts of its harmonics, then of imaginary parts; parts (B (1 + 2 H), K).
void period_harmonics(Rows<const double> rows, Sizes starts, Index length, double turns, Rows<double> parts) {
  const Index n_rows = rows.width, per_period = starts.size ? parts.count / starts.size : 1;
  const Index n_harmonics = per_period / 2;
  require(length > 0 && parts.width == n_rows && per_period % 2 == 1 && parts.count == per_period * starts.size,
          "periods do not fit");
  for (Index b = 0; b < starts.size; ++b) {
    require(starts[b] >= 0 && starts[b] <= rows.count - length, "a period ends after the record");
  }
  std::vector<double> centred(n_rows);
  for (Index b = 0; b < starts.size; ++b) {
    const Rows<double> part = parts.slice(b * per_period, (b + 1) * per_period);
    for (Index p = 0; p < per_period; ++p) std::fill_n(part[p], n_rows, 0.0);
    double* __restrict mean = part[0];
    const double share = 1.0 / static_cast<double>(length);
    for (Index j = starts[b]; j < starts[b] + length; ++j) {
      for (Index k = 0; k < n_rows; ++k) mean[k] = fused(rows[j][k], share, mean[k]);
    }
    for (Index j = starts[b]; j < starts[b] + length; ++j) {
      const double* column = rows[j];
      double* __restrict value = centred.data();
      for (Index k = 0; k < n_rows; ++k) value[k] = (column[k] - mean[k]) * share;
      double cosine, sine, re = 1.0, im = 0.0;
      phasor(turns * static_cast<double>(j), cosine, sine);
      for (Index h = 1; h <= n_harmonics; ++h) {
        const double before = re;
        re = before * cosine - im * sine;
        im = before * sine + im * cosine;
        double* __restrict real = part[h];
        double* __restrict imaginary = part[h + n_harmonics];
        for (Index k = 0; k < n_rows; ++k) {
          real[k] = fused(re, value[k], real[k]);
          imaginary[k] = fused(-im, value[k], imaginary[k]);
        }
      }
    }
  }
}

void check_sets(Sizes stops, Index n_rows) {
  for (Index s = 0; s < stops.size; ++s) {
    require(stops[s] >= (s ? stops[s - 1] : 0) && stops[s] <= n_rows, "sets of rows must follow each other");
  }
}

// Sets of rows (J, K) for their autocorrelation, plain and whitened: a copy in `pairs` with zeros behind it, the
// weights (K,) that make whitened rows equally strong, and the powers until each column, (2 S, J + 1).
void weigh_rows(Rows<const double> values, Sizes stops, double whitening, double weak, Rows<double> pairs,
                Line<double> weight, Rows<double> until) {
  const Index n_columns = values.count, n_rows = values.width;
  check_sets(stops, n_rows);
  require(pairs.count >= n_columns && pairs.width >= n_rows, "pairs have no place for the rows");
  require(weight.size == n_rows && until.count == 2 * stops.size && until.width == n_columns + 1,
          "weights or powers do not fit");
  const std::vector<double> none(n_rows);
  const auto before = [&](Index j) { return j > 0 ? values[j - 1] : none.data(); };
  std::fill_n(weight.data, n_rows, 0.0);
  for (Index j = 0; j < pairs.count; ++j) {
    const Index copied = j < n_columns ? n_rows : 0;
    std::copy_n(values[copied ? j : 0], copied, pairs[j]);
    std::fill(pairs[j] + copied, pairs[j] + pairs.width, 0.0);
  }
  for (Index j = 0; j < n_columns; ++j) {
    const double *column = values[j], *last = before(j);
    double* __restrict sum = weight.data;
    for (Index k = 0; k < n_rows; ++k) {
      const double white = fused(-whitening, last[k], column[k]);
      sum[k] = fused(white, white, sum[k]);
    }
  }
  for (Index s = 0, first = 0; s < stops.size; first = stops[s++]) {
    const double strongest = stops[s] > first ? *std::max_element(weight.data + first, weight.data + stops[s]) : 0.0;
    for (Index k = first; k < stops[s]; ++k) weight[k] = 1.0 / (weight[k] + weak * strongest + 1e-300);
    double *plain = until[2 * s], *equal = until[2 * s + 1];
    plain[0] = equal[0] = 0.0;
    for (Index j = 0; j < n_columns; ++j) {
      const double *column = values[j] + first, *last = before(j) + first, *by = weight.data + first;
      const Index n = stops[s] - first;
      plain[j + 1] = plain[j] + dot(column, column, n);
      equal[j + 1] = equal[j] + sum_of(n, [=](auto sum, Index k) {
                       using V = decltype(sum);
                       const V white = fused(load<V>(last + k), -whitening, load<V>(column + k));
                       return fused(white * white, load<V>(by + k), sum);
                     });
    }
  }
}

// Powers of rows whose transforms (L, pairs) were made two at a time, summed over sets: plain, and whitened with
// weights. Shapes: powers (2 S, L / 2 + 1).
void powers_of_pairs(Rows<const double> lines, Sizes stops, Line<const double> weight, double whitening,
                     Rows<std::complex<double>> powers) {
  const Index length = lines.count, width = lines.width;
  check_sets(stops, std::min(weight.size, width));
  require(length > 0 && width % 2 == 0 && powers.count == 2 * stops.size && powers.width == length / 2 + 1,
          "powers do not fit");
  std::vector<double> power(width);
  for (Index q = 0; q < powers.width; ++q) {
    const double *here = lines[q], *there = lines[(length - q) % length];
    double* __restrict to = power.data();
    for (Index n = 0; n < width; n += 2) {
      const double a = here[n], b = here[n + 1], c = there[n], d = there[n + 1];
      const double mean = 0.25 * ((a * a + b * b) + (c * c + d * d)), cross = 0.5 * (a * c - b * d);
      to[n] = mean + cross;
      to[n + 1] = mean - cross;
    }
    double cosine, sine;
    phasor(static_cast<double>(q) / static_cast<double>(length), cosine, sine);
    const double response = 1.0 + whitening * whitening - 2.0 * whitening * cosine;
    for (Index s = 0, first = 0; s < stops.size; first = stops[s++]) {
      const double *from = power.data() + first, *by = weight.data + first;
      powers[2 * s][q] =
          sum_of(stops[s] - first, [=](auto sum, Index k) { return sum + load<decltype(sum)>(from + k); });
      powers[2 * s + 1][q] = response * dot(from, by, stops[s] - first);
    }
  }
}

template <typename V>
V smaller(V a, double b) {
  return a < V{} + b ? a : V{} + b;
}

// Values at places between samples on straight lines; beyond the ends on the outermost ones.
template <typename V>
V interpolate(Line<const double> values, V place) {
  const V left = round_down(smaller(larger(place, 0.0), static_cast<double>(values.size - 2)));
  const V value = gather(values.data, left);
  return fused(place - left, gather(values.data + 1, left) - value, value);
}

// Values at multiples of places between samples, summed, by the Catmull-Rom cubic.
void sum_harmonics(Line<const double> values, Line<const double> place, Index count, Line<double> out) {
  require(values.size >= 4 && out.size == place.size, "values or places do not fit");
  side_by_side(place.size, [=](auto zero, Index n) {
    using V = decltype(zero);
    V sum = zero;
    for (Index harmonic = 1; harmonic <= count; ++harmonic) {
      const V at = static_cast<double>(harmonic) * load<V>(place.data + n);
      const V whole = round_down(smaller(larger(at, 1.0), static_cast<double>(values.size - 3)));
      const V x = at - whole, before = gather(values.data - 1, whole), left = gather(values.data, whole);
      const V right = gather(values.data + 1, whole), after = gather(values.data + 2, whole);
      const V bend = 2.0 * before - 5.0 * left + 4.0 * right - after;
      const V twist = 3.0 * (left - right) + after - before;
      sum = sum + fused(0.5 * x, fused(x, fused(x, twist, bend), right - before), left);
    }
    store(out.data + n, sum);
  });
}

// What every set of rows indicates for every frequency of a grid (E-33): autocorrelations at the period, half of it,
// one and a half and a third; powers at the frequency and at its double; logarithms. Shapes: likeness (S, J); share (S,
// Q); out (9 S, F).
void rhythm_evidence(Rows<const double> likeness, double rate_hz, Rows<const double> share, double step_hz,
                     Line<const double> grid_hz, Rows<double> out) {
  require(likeness.width >= 2 && share.width >= 2, "an autocorrelation and a spectrum have two values or more");
  require(share.count == likeness.count, "the sets do not fit");
  require_shape(9 * likeness.count, grid_hz.size, "the evidence does not fit", out);
  const auto last = static_cast<double>(likeness.width - 1), last_line = static_cast<double>(share.width - 1);
  constexpr double factors[] = {1.0, 0.5, 1.5, 1.0 / 3.0};
  for (Index s = 0; s < likeness.count; ++s) {
    const Line<const double> own_likeness = {likeness[s], likeness.width}, own_share = {share[s], share.width};
    side_by_side(grid_hz.size, [=](auto zero, Index i) {
      using V = decltype(zero);
      const V frequency = load<V>(grid_hz.data + i);
      V found[4], power[13];
      for (int row = 0; row < 4; ++row) {  // the highest value near each lag
        const V lag = factors[row] * (rate_hz / frequency), low = 0.957 * lag;
        const V step = (smaller(1.0443 * lag, last) - low) * (1.0 / 6.0);
        V best = interpolate(own_likeness, smaller(low, last));
        for (int n = 1; n < 7; ++n) {
          const V value = interpolate(own_likeness, smaller(fused(step, zero + n, low), last));
          best = value > best ? value : best;
        }
        found[row] = lag <= last ? best : zero;
      }
      V whole = zero, half = zero;
      for (int h = 1; h <= 12; ++h) {
        const V place = (0.5 * h / step_hz) * frequency;
        power[h] = place < last_line ? interpolate(own_share, place) : zero;
        (h % 2 ? half : whole) += power[h];
      }
      const V rows[] = {-logarithm(1.1 - smaller(found[0], 1.0)),
                        found[1],
                        found[2],
                        found[3],
                        power[2],
                        power[4],
                        logarithm(power[2] + 0.01),
                        logarithm(whole + 0.1),
                        logarithm(half + 0.1)};
      for (int row = 0; row < 9; ++row) store(out[9 * s + row] + i, rows[row]);
    });
  }
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "square_difference", &square_difference);
  define(module, "period_harmonics", &period_harmonics);
  define(module, "weigh_rows", &weigh_rows);
  define(module, "powers_of_pairs", &powers_of_pairs);
  define(module, "sum_harmonics", &sum_harmonics);
  define(module, "rhythm_evidence", &rhythm_evidence);
}

}  // namespace doppelgait::periodicity

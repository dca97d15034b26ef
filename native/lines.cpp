// Lines through a signature and power about them (E-33, E-34c).
#include "arrays.hpp"

namespace doppelgait::lines {
namespace {

constexpr Index kLanes = 64;  // values that are smoothed together
constexpr Index kParts = 8;   // partial sums of a column

// Smooths by a Gaussian, cut off at four standard deviations; beyond its ends the line is mirrored or constant.
void smooth(Line<const double> values, double sd, bool mirrored, Line<double> out) {
  const Index n = values.size;
  require(out.size == n && n > 0, "every value needs a smoothed one");
  require(sd > 0.0 && sd < 1e6, "the standard deviation must be positive");
  const auto reach = static_cast<Index>(4.0 * sd + 0.5);
  std::vector<double> weight(reach + 1), padded(n + 2 * reach + kLanes);
  double sum = 0.0;
  for (Index i = 0; i <= reach; ++i) {
    weight[i] = std::exp(-0.5 * static_cast<double>(i * i) / (sd * sd));
    sum += i == 0 ? weight[i] : 2.0 * weight[i];
  }
  for (Index i = -reach; i < n + reach; ++i) {
    const Index cell = go_round(i, 2 * n);
    padded[reach + i] = values[mirrored ? std::min(cell, 2 * n - 1 - cell) : std::clamp<Index>(i, 0, n - 1)];
  }
  for (Index first = 0; first < n; first += kLanes) {
    const double* centre = padded.data() + reach + first;
    double total[kLanes];
    for (Index k = 0; k < kLanes; ++k) total[k] = weight[0] * centre[k];
    for (Index i = 1; i <= reach; ++i) {
      const double *low = centre - i, *high = centre + i, factor = weight[i];
      for (Index k = 0; k < kLanes; ++k) total[k] += factor * (low[k] + high[k]);
    }
    for (Index k = first; k < std::min(first + kLanes, n); ++k) out[k] = total[k - first] / sum;
  }
}

// Sum of a column without its floor, in parts that need not wait for each other.
template <typename T>
double sum_above(const T* column, Index size, double floor) {
  constexpr int n = kParts / kHalfWidth;
  Double parts[n] = {};
  Index k = 0;
  for (; k + kParts <= size; k += kParts)
    for (int i = 0; i < n; ++i) parts[i] += load_double(column + k + i * kHalfWidth) - floor;
  double s[kParts];
  for (int i = 0; i < n; ++i) store(s + i * kHalfWidth, parts[i]);
  for (; k < size; ++k) s[0] += static_cast<double>(column[k]) - floor;
  return ((s[0] + s[1]) + (s[2] + s[3])) + ((s[4] + s[5]) + (s[6] + s[7]));
}

// Power and squared power about the main line. Cells at the edge count in part; the centroid of the squared power is
// not yet divided. ``sums``: torso, near, all, mean and standard deviation of near.
template <typename T>
void powers_about_line(Rows<const T> values, double floor, Line<const double> line, Line<const double> reaches,
                       Line<const double> range_weight, Line<double> sums, Line<double> square, Line<double> moment) {
  const Index n_columns = values.count, n_bins = values.width;
  require(line.size == n_columns && range_weight.size == n_columns, "every column needs its line and its weight");
  require(square.size == n_columns && moment.size == n_columns, "every column needs a square and a moment");
  require(reaches.size == 3 && sums.size == 5 && n_bins > 0, "three reaches have five sums");
  const double most = static_cast<double>((n_bins - 1) / 2), torso = reaches[0], near = reaches[1], body = reaches[2];
  const auto half = static_cast<Index>(std::max(std::min(most, std::ceil(near) + 1.0), 0.0)), wide = 2 * half + 1;
  std::vector<double> inner_power(n_columns), near_power(n_columns), cells(wide * kHalfWidth);
  double *inner = inner_power.data(), *outer = near_power.data(), *power = cells.data();
  side_by_side(n_columns, [=](auto zero, Index j) {
    using V = decltype(zero);
    constexpr Index lanes = sizeof(V) / sizeof(double);
    double starts[lanes];
    for (Index lane = 0; lane < lanes; ++lane) {
      const Index centre = nearest_bin(line[j + lane]);
      starts[lane] = static_cast<double>(centre - half) - line[j + lane];
      Index k = go_round(centre - half, n_bins);
      for (Index i = 0; i < wide; ++i) {
        power[i * lanes + lane] = static_cast<double>(values[j + lane][k]) - floor;
        k = k + 1 < n_bins ? k + 1 : 0;
      }
    }
    const V start = load<V>(starts), full = zero + 1.0;
    const auto clip = [=](V share) { return share > 0.0 ? (share < 1.0 ? share : full) : zero; };
    V inside = zero, about = zero, weight = zero, turn = zero;
    for (Index i = 0; i < wide; ++i) {
      const V cell = load<V>(power + i * lanes), distance = start + static_cast<double>(i);
      const V away = distance < 0.0 ? -distance : distance, beyond = away - 0.5;
      const V above = (cell > 0.0) & (away <= body) ? cell * cell : zero;
      inside += cell * clip(torso - beyond);
      about += cell * clip(near - beyond);
      weight += above;
      turn += above * distance;
    }
    store(inner + j, inside);
    store(outer + j, about);
    store(square.data + j, weight);
    store(moment.data + j, turn);
  });
  std::fill(sums.data, sums.data + sums.size, 0.0);
  for (Index j = 0; j < n_columns; ++j) {
    near_power[j] *= range_weight[j];
    sums[0] += inner[j] * range_weight[j];
    sums[1] += near_power[j];
    sums[2] += sum_above(values[j], n_bins, floor) * range_weight[j];
  }
  sums[3] = sums[1] / static_cast<double>(n_columns);
  for (const double value : near_power) sums[4] += (value - sums[3]) * (value - sums[3]);
  sums[4] = std::sqrt(sums[4] / static_cast<double>(n_columns));
}

// The strongest smooth ridge near a line (Viterbi, E-34c): a step to the next bin costs ``cost``.
template <typename T>
void follow_ridge(Rows<const T> values, double floor, Line<const double> line, Index reach, double cost,
                  Line<Index> path) {
  const Index n_columns = values.count, n_bins = values.width;
  require(line.size == n_columns && path.size == n_columns, "every column needs its line and its bin");
  require(n_columns > 0 && reach >= 0 && reach <= (n_bins - 1) / 2, "the reach must lie within the Doppler axis");
  const Index width = 2 * reach + 1;
  constexpr double none = -std::numeric_limits<double>::infinity();
  std::vector<double> score(width), before(width);
  std::vector<Index> origins(n_columns * width);
  Index last = nearest_bin(line[0]);
  for (Index j = 0; j < n_columns; ++j) {
    const Index centre = nearest_bin(line[j]), moved = centre - last;
    Index k = go_round(centre - reach, n_bins);
    for (Index i = 0; i < width; ++i) {
      Index& origin = origins[j * width + i];
      origin = std::clamp<Index>(i + moved, 0, width - 1);
      double most = none;
      for (Index step = -1; step <= 1; ++step) {
        const Index from = i + moved + step;
        if (from < 0 || from >= width) continue;
        const double here = before[from] - cost * static_cast<double>(step * step);
        if (here > most) {
          most = here;
          origin = from;
        }
      }
      if (most == none) most = before[origin] - cost;  // the line itself has jumped
      const auto cell = static_cast<double>(values[j][k]);
      k = k + 1 < n_bins ? k + 1 : 0;
      score[i] = most + std::log(std::max({cell, floor, 1e-300}));
    }
    before.swap(score);
    last = centre;
  }
  Index i = std::max_element(before.begin(), before.end()) - before.begin();
  for (Index j = n_columns - 1; j >= 0; --j) {
    path[j] = nearest_bin(line[j]) - reach + i;
    i = origins[j * width + i];
  }
}

// A path refined by the centroid of three cells above the floor; a weak cell counts a thousandth.
template <typename T>
void refine_path(Rows<const T> values, double floor, Line<const Index> path, Line<double> out) {
  require(path.size == values.count && out.size == values.count && values.width > 0, "every column needs its bin");
  for (Index j = 0; j < values.count; ++j) {
    double cells[3];
    Index k = go_round(path[j] - 1, values.width);
    for (double& above : cells) {
      const auto cell = static_cast<double>(values[j][k]);
      above = std::max(cell - floor, 1e-3 * cell) + 1e-300;
      k = k + 1 < values.width ? k + 1 : 0;
    }
    out[j] = static_cast<double>(path[j]) + (cells[2] - cells[0]) / (cells[0] + cells[1] + cells[2]);
  }
}

// The strongest cell of every column within reach of a bin.
template <typename T>
void strongest_near(Rows<const T> values, Line<const Index> bins, Index reach, Line<T> out) {
  require(bins.size == values.count && out.size == values.count, "every column needs its bin");
  require(reach >= 0 && reach < values.width, "the reach must lie within the Doppler axis");
  for (Index j = 0; j < values.count; ++j) {
    Index k = go_round(bins[j] - reach, values.width);
    out[j] = values[j][k];
    for (Index i = 0; i < 2 * reach; ++i) {
      k = k + 1 < values.width ? k + 1 : 0;
      out[j] = std::max(out[j], values[j][k]);
    }
  }
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "refine_path", &refine_path<double>, &refine_path<float>);
  define(module, "strongest_near", &strongest_near<double>, &strongest_near<float>);
  define(module, "powers_about_line", &powers_about_line<double>, &powers_about_line<float>);
  define(module, "follow_ridge", &follow_ridge<double>, &follow_ridge<float>);
  define(module, "smooth", &smooth);
}

}  // namespace doppelgait::lines

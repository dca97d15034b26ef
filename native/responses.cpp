// Sums of range responses of pulses, chirps and sweeps.
#include "arrays.hpp"

namespace doppelgait::responses {
namespace {

// Tables have columns for whole vectors of every level.
constexpr Index round_up(Index n) { return (n + 31) / 32 * 32; }

// Sums of some columns in vectors without a rest.
template <typename T>
struct Sums {
  explicit Sums(Index n) : re(n + kWidth), im(n + kWidth) {}

  void clear() {
    std::fill(re.begin(), re.end(), T{});
    std::fill(im.begin(), im.end(), T{});
  }

  std::vector<T> re, im;
};

// Echoes behind a matched filter: amplitude, phase in turns, and delay and Doppler in units of the pulse's duration.
// Delay of the first bin and spacing of the bins in pulse durations; time times bandwidth of the chirp.
struct Pulses {
  Rows<const double> amplitude, turns, delay, doppler;
  double first, step, time_bandwidth;
  Rows<Complex> out;
};

// Adds (1 - |x|) exp(j pi d x) sinc((d + b x)(1 - |x|)) for |x| < 1.
[[gnu::noinline]] void add_response(const Pulses& pulses, Index pulse, Index scatterer, Sums<double>& total) {
  const double delta = pulses.doppler[pulse][scatterer], start = pulses.first - pulses.delay[pulse][scatterer];
  const auto limit = [&](double n) { return static_cast<Index>(std::min(std::max(n, 0.0), double(pulses.out.width))); };
  const Index lowest = limit(std::floor((-1.0 - start) / pulses.step) + 1.0);
  const Index stop = limit(std::ceil((1.0 - start) / pulses.step));
  double peak_re, peak_im;
  phasor(pulses.turns[pulse][scatterer], peak_re, peak_im);
  peak_re *= pulses.amplitude[pulse][scatterer];
  peak_im *= pulses.amplitude[pulse][scatterer];
  Double lane;
  for (int n = 0; n < kHalfWidth; ++n) lane[n] = n;
  for (Index n = lowest; n < stop; n += kHalfWidth) {
    const Double x = (static_cast<double>(n) + lane) * pulses.step + start;
    const Double inside = 1.0 - (x < 0.0 ? -x : x);
    const Double g = (delta + pulses.time_bandwidth * x) * inside, angle = kPi * g;
    Double cosine, sine, re, im;
    phasor(0.5 * g, cosine, sine);
    phasor(0.5 * delta * x, re, im);
    const Double sinc = (angle < 1e-3) & (angle > -1e-3) ? 1.0 - angle * angle * (1.0 / 6.0) : sine / angle;
    const Double size = inside > 0.0 ? inside * sinc : Double{};
    store(&total.re[n], load<Double>(&total.re[n]) + size * (peak_re * re - peak_im * im));
    store(&total.im[n], load<Double>(&total.im[n]) + size * (peak_re * im + peak_im * re));
  }
}

// Three rows of a table, their weights, and the complex amplitude of an echo.
struct Tabled {
  const float* row;
  float w0, w1, w2, re, im;
};

// Responses of chirps that are longer than the frame come from a table: for every place within a bin the response at
// three Chebyshev nodes, over all bins. Scatterers outside it, or with much Doppler, are computed; all without a table.
void add_responses(Rows<const double> amplitude, Rows<const double> turns, Rows<const double> delay,
                   Rows<const double> doppler, double first, double step, double time_bandwidth, double largest_doppler,
                   Rows<Complex> out, std::optional<Rows<const float>> tabled) {
  const auto table = tabled.value_or(Rows<const float>{});
  const Pulses pulses = {amplitude, turns, delay, doppler, first, step, time_bandwidth, out};
  const Index n_bins = out.width, n_scatterers = amplitude.width, n_places = table.count / 3, width = table.stride;
  require_shape(out.count, n_scatterers, "echoes and pulses do not fit", amplitude, turns, delay, doppler);
  require(
      !tabled || (n_places > 0 && table.count % 3 == 0 && n_bins > 0 && table.width >= n_bins - 1 + round_up(n_bins)),
      "the table does not fit the bins");
  const double node = std::sqrt(0.75);
  Sums<double> total(n_bins);
  Sums<float> sums(n_bins), phasors(n_scatterers);
  std::vector<double> rests(n_scatterers + kWidth);
  std::vector<Tabled> echoes(n_scatterers);
  std::vector<Index> others;
  for (Index pulse = 0; pulse < out.count; ++pulse) {
    std::copy(turns[pulse], turns[pulse] + n_scatterers, rests.begin());
    compute_phasors(rests.data(), n_scatterers, phasors.re.data(), phasors.im.data());
    Index n_echoes = 0;
    others.clear();
    for (Index scatterer = 0; scatterer < n_scatterers; ++scatterer) {
      const double delta = doppler[pulse][scatterer];
      const double place = (delay[pulse][scatterer] - delta / time_bandwidth - first) / step;
      const double whole = std::floor(place);
      if (!(tabled && whole >= 0.0 && whole < n_bins && std::fabs(delta) <= largest_doppler)) {
        others.push_back(scatterer);
        continue;
      }
      const double fine = (place - whole) * n_places;
      const Index row = std::min(static_cast<Index>(fine), n_places - 1);
      const double u = 2.0 * (fine - row) - 1.0;
      const float size = static_cast<float>(amplitude[pulse][scatterer]);
      echoes[n_echoes++] = {table[3 * row] + n_bins - 1 - static_cast<Index>(whole),
                            static_cast<float>(u * (u - node) / 1.5),
                            static_cast<float>(1.0 - u * u / 0.75),
                            static_cast<float>(u * (u + node) / 1.5),
                            size * phasors.re[scatterer],
                            size * phasors.im[scatterer]};
    }
    for (Index n = 0; n < n_bins; n += kWidth) {
      Float re = {}, im = {};
      for (Index k = 0; k < n_echoes; ++k) {
        const Tabled& echo = echoes[k];
        const float* at = echo.row + n;
        Float x = echo.w0 * load<Float>(at);
        x = fused(load<Float>(at + width), spread(echo.w1), x);
        x = fused(load<Float>(at + 2 * width), spread(echo.w2), x);
        re = fused(x, spread(echo.re), re);
        im = fused(x, spread(echo.im), im);
      }
      store(&sums.re[n], re);
      store(&sums.im[n], im);
    }
    if (others.empty()) {
      for (Index n = 0; n < n_bins; ++n) out[pulse][n] = Complex(sums.re[n], sums.im[n]);
      continue;
    }
    total.clear();
    for (const Index scatterer : others) add_response(pulses, pulse, scatterer, total);
    for (Index n = 0; n < n_bins; ++n) {
      out[pulse][n] =
          Complex(static_cast<float>(sums.re[n] + total.re[n]), static_cast<float>(sums.im[n] + total.im[n]));
    }
  }
}

// Frequency sweeps: a scatterer is spread over kTaps half bins from a table, a row for each of kPlaces places within a
// half bin and for each of kOrders terms of the power series by which it is moved and bent there.
constexpr int kOrders = 8, kPlaces = 16, kTaps = 8;
constexpr int kRow = 24;   // a row of the table has its taps from the eighth on
constexpr int kBlock = 8;  // half bins whose responses are added together; a scatterer reaches two blocks

struct Sweep {
  double per_m, first_turns, carrier_hz, half_slope, bandwidth_hz, lag, coupling, bend, first_bin, n_samples,
      turns_round;
};

// Amplitude, phase, bend and place of all scatterers in one sweep.
struct Spread {
  explicit Spread(Index n) : n(n) {}

  // Places are taken modulo the number of samples.
  void describe(const Sweep& sweep, const double* range_m, const double* velocity_mps, const double* amplitude,
                const double* extra_rad) {
    side_by_side(n, [&](auto zero, Index at) {
      using V = decltype(zero);
      const V delay = load<V>(range_m + at) * sweep.per_m, beta = load<V>(velocity_mps + at) * sweep.per_m;
      V phase = sweep.first_turns - delay * (sweep.carrier_hz - sweep.half_slope * delay);
      if (extra_rad) phase += load<V>(extra_rad + at) * (0.5 / kPi);
      const V place = sweep.bandwidth_hz * delay * (1.0 + sweep.lag * beta) - sweep.coupling * beta - sweep.first_bin;
      const V rounds = round_down(place / sweep.n_samples);
      phase += sweep.turns_round * rounds;
      V half = 2.0 * (place - rounds * sweep.n_samples);
      half = (half >= 0.0) & (half <= 2.0 * sweep.n_samples) ? half : zero;  // rounded to below 0, or no number
      const V inside = (half - round_down(half)) * kPlaces;
      store_narrow(&size[at], load<V>(amplitude + at));
      store_narrow(&turns[at], phase - round_even(phase));
      store_narrow(&eta[at], (round_down(inside) + 0.5 - inside) * (0.5 * kPi / kPlaces));
      store_narrow(&bend[at], sweep.bend * beta * (1.0 + 0.5 * sweep.lag * beta));
      store(&halves[at], half);
    });
    // complex weights of all orders from that of order 0
    for (Index at = 0; at < n; at += kWidth) {
      Float x, y;
      phasor(load<Float>(&turns[at]), x, y);
      x *= load<Float>(&size[at]);
      y *= load<Float>(&size[at]);
      const Float shift = load<Float>(&eta[at]), twice = 2.0f * load<Float>(&bend[at]);
      Float next_x = shift * x, next_y = shift * y;
      store(&re[at], x);
      store(&im[at], y);
      for (int order = 1; order < kOrders; ++order) {
        store(&re[order * stride + at], next_x);
        store(&im[order * stride + at], next_y);
        const float share = 1.0f / static_cast<float>(order + 1);
        const Float new_x = share * fused(shift, next_x, twice * y);
        const Float new_y = share * fused(shift, next_y, -(twice * x));
        x = next_x, y = next_y, next_x = new_x, next_y = new_y;
      }
    }
  }

  // Adds one scatterer to the half bins of two blocks.
  void add(Index scatterer, const float* taps, Index first, Sums<float>& grid) const {
    for (int k = 0; k < 2 * kBlock; k += kWidth) {
      Float x[2] = {}, y[2] = {};
      const auto add_orders = [&](int half) {
        for (int order = 4 * half; order < 4 * half + 4; ++order) {
          const Float tap = in_register(load<Float>(taps + order * kRow + k));
          x[half] = fused(tap, spread(re[order * stride + scatterer]), x[half]);
          y[half] = fused(tap, spread(im[order * stride + scatterer]), y[half]);
        }
      };
      add_orders(0);
      add_orders(1);
      store(&grid.re[first + k], load<Float>(&grid.re[first + k]) + (x[0] + x[1]));
      store(&grid.im[first + k], load<Float>(&grid.im[first + k]) + (y[0] + y[1]));
    }
  }

  using Floats = std::vector<float>;
  Index n, stride = n + kWidth;
  Floats size = Floats(stride), turns = size, eta = size, bend = size;
  std::vector<double> halves = std::vector<double>(stride);
  Floats re = Floats(kOrders * stride), im = re;  // weights of all orders
};

// Adds the responses of a block of half bins to the sums, and clears the block. Responses to even half bins begin at
// `even`, those to odd ones `width` later.
void add_halves(const float* even, Index width, Index begin, Index n_columns, Sums<float>& grid, Sums<float>& sums) {
  Float u[kBlock], v[kBlock];
  for (int j = 0; j < kBlock; ++j) {
    u[j] = spread(grid.re[begin + j]);
    v[j] = spread(grid.im[begin + j]);
    grid.re[begin + j] = grid.im[begin + j] = 0.0f;
  }
  for (Index n = 0; n < n_columns; n += kWidth) {
    Float re = {}, im = {};
    for (int j = 0; j < kBlock; ++j) {
      const Float x = in_register(load<Float>(even + (j % 2) * width + n - j / 2));
      re = fused(u[j], x, re);
      im = fused(v[j], x, im);
    }
    store(&sums.re[n], load<Float>(&sums.re[n]) + re);
    store(&sums.im[n], load<Float>(&sums.im[n]) + im);
  }
}

void add_sweep_responses(Rows<const double> ranges, Rows<const double> speeds, Rows<const double> sizes,
                         std::optional<Rows<const double>> extra_rad, Line<const double> facts, Line<const float> taps,
                         Line<const float> response, Rows<const float> turns, Rows<Complex> pulses) {
  const Index n_scatterers = ranges.width, n_bins = pulses.width, n_columns = turns.width;
  require_shape(pulses.count, n_scatterers, "scatterers and sweeps do not fit", ranges, speeds, sizes,
                extra_rad.value_or(ranges));
  require(facts.size * sizeof(double) == sizeof(Sweep) && facts[9] >= 1.0 && facts[9] <= 1e6,
          "eleven facts about the sweep are needed");
  Sweep sweep;
  std::memcpy(&sweep, facts.data, sizeof sweep);
  const Index n_samples = static_cast<Index>(sweep.n_samples), n_blocks = (2 * n_samples + 7) / kBlock + 6;
  const Index width = n_samples + n_columns + 16;
  require(taps.size == kPlaces * kOrders * kRow && response.size == 2 * width && turns.count == 2 &&
              n_columns == round_up(n_bins),
          "taps, responses, turns and bins do not fit");
  Spread spread_out(n_scatterers);
  Sums<float> grid(n_blocks * kBlock), sums(n_columns);
  std::vector<char> used(n_blocks);
  for (Index pulse = 0; pulse < pulses.count; ++pulse) {
    spread_out.describe(sweep, ranges[pulse], speeds[pulse], sizes[pulse], extra_rad ? (*extra_rad)[pulse] : nullptr);
    for (Index scatterer = 0; scatterer < n_scatterers; ++scatterer) {
      const double whole = std::floor(spread_out.halves[scatterer]);
      const Index row = static_cast<Index>((spread_out.halves[scatterer] - whole) * kPlaces);
      const Index first = static_cast<Index>(whole) + 2 * kTaps - kTaps / 2 + 1, shift = first % kBlock;
      used[first / kBlock] = used[first / kBlock + 1] = true;
      spread_out.add(scatterer, taps.data + row * kOrders * kRow + kBlock - 1 - shift, first - shift, grid);
    }
    sums.clear();
    for (Index block = 0; block < n_blocks; ++block) {
      if (!used[block]) continue;
      used[block] = false;
      // half bin kBlock block is the whole bin 4 block - 8
      add_halves(response.data + n_samples + 16 - 4 * block, width, block * kBlock, n_columns, grid, sums);
    }
    for (Index n = 0; n < n_bins; ++n) {
      const float re = sums.re[n], im = sums.im[n], x = turns[0][n], y = turns[1][n];
      pulses[pulse][n] = Complex(re * x - im * y, re * y + im * x);
    }
  }
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "add_responses", &add_responses);
  define(module, "add_sweep_responses", &add_sweep_responses);
}

}  // namespace doppelgait::responses

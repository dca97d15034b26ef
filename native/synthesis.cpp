// Sum of Gaussian echoes (E-18), and the way between planes and a matrix of samples.
//
// The sample of every frame and bin is computed by itself, from the numbers of its own frame and in the order of the
// scatterers, so that no byte depends on how frames are cut into tiles.
#include "arrays.hpp"

namespace doppelgait::synthesis {
namespace {

constexpr double kSupportSigmas = 5.5;  // beyond it an envelope is below exp(-5.5^2 / 2) = 2.7e-7 of its peak
constexpr int kFrames = 32;             // frames side by side
constexpr int kRow = 2 * kFrames;       // real and imaginary parts of one bin
constexpr int kVectors = kFrames / kWidth;
constexpr int kGroup = 4;  // scatterers that are read together

// 2^x for -126 < x = a b <= 0, with a relative error of 9e-8 and exact at 0: a polynomial gives 2^(x - round(x)), and
// round(x) is added to the bits of the exponent.
inline Float power_of_two(Float a, Float b) {
  constexpr float rounder = 1.5f * (1 << 23);  // a float this large has no fraction: adding it rounds
  const Float rounded = fused(a, b, rounder);
  const Float f = fused(a, b, rounder - rounded);
  const Float high = fused(f, fused(f, 0.0013264727213551826f, 0.009671512812489076f), spread(0.05550733744824973f));
  const Float power = fused(f, fused(f, fused(f, high, 0.24022242082677556f), 0.6931469775973299f), 1.0f);
  return bits_of<Float>(bits_of<Word>(power) + (bits_of<Word>(rounded) << 23));
}

struct Geometry {
  double first_bin_m, bins_per_m, first_turn, turns_per_m, reach;
  float exponent, cut;
};

// Echoes of kFrames frames in some bins. Rows outside first..stop-1 are zero.
struct Block {
  explicit Block(Index n_bins) : n_bins(n_bins), memory((n_bins + kHalfWidth) * kRow / kWidth) {}

  float* operator[](Index n) { return reinterpret_cast<float*>(memory.data()) + n * kRow; }

  void clear() {
    if (first < stop) std::fill((*this)[first], (*this)[stop], 0.0f);
    first = n_bins, stop = 0;
  }

  Index n_bins, first = 0, stop = 0;
  std::vector<Float> memory;  // aligned, with room for whole vectors of bins
};

struct Scatterers {
  Scatterers(Plane<double> range_m, Plane<double> amplitude, std::optional<Plane<double>> extra_phase_rad)
      : range_m(range_m), amplitude(amplitude), extra_phase_rad(extra_phase_rad), silence(range_m.width) {
    require_shape(range_m.count, range_m.width,
                  "range, amplitude and extra phase of the scatterers need the same shape", amplitude,
                  extra_phase_rad.value_or(amplitude));
  }

  Plane<double> range_m, amplitude;
  std::optional<Plane<double>> extra_phase_rad;
  std::vector<double> silence;  // amplitudes outside the record
};

// Numbers of some scatterers in all frames of a block, from one row per frame.
struct Group {
  void read(const double* const* rows, Index begin, Index count) {
    typedef double Four __attribute__((vector_size(8 * kGroup)));
    for (int lane = 0; lane < kFrames; lane += 4) {
      Four row[4];
      for (int k = 0; k < 4; ++k) {
        if (count >= kGroup) {
          row[k] = load<Four>(rows[lane + k] + begin);
        } else {
          double few[kGroup] = {};
          std::copy(rows[lane + k] + begin, rows[lane + k] + begin + count, few);
          row[k] = load<Four>(few);
        }
      }
      const Four a = __builtin_shufflevector(row[0], row[1], 0, 4, 2, 6);
      const Four b = __builtin_shufflevector(row[0], row[1], 1, 5, 3, 7);
      const Four c = __builtin_shufflevector(row[2], row[3], 0, 4, 2, 6);
      const Four d = __builtin_shufflevector(row[2], row[3], 1, 5, 3, 7);
      store(at[0] + lane, __builtin_shufflevector(a, c, 0, 1, 4, 5));
      store(at[1] + lane, __builtin_shufflevector(b, d, 0, 1, 4, 5));
      store(at[2] + lane, __builtin_shufflevector(a, c, 2, 3, 6, 7));
      store(at[3] + lane, __builtin_shufflevector(b, d, 2, 3, 6, 7));
    }
  }

  double at[kGroup][kFrames];
};

// Place, turns and amplitude of an echo in some frames. Place in bins and number of turns are split in double precision
// into a whole number and a rest; only the rests go on in single precision. (All in single precision would leave an
// error floor of -80 dB.)
struct Split {
  Split() = default;
  Split(const Geometry& geometry, Double range, Double amplitude, Double extra_rad) {
    place = (range - geometry.first_bin_m) * geometry.bins_per_m;
    bin = round_even(place);
    turns = fused(range, -geometry.turns_per_m, geometry.first_turn) + extra_rad * (0.5 / kPi);
    turns -= round_even(turns);
    const Double halves = round_even(2.0 * turns);
    turns -= 0.5 * halves;
    peak = amplitude * (1.0 - 2.0 * halves * halves);
  }

  Double place, bin, turns, peak;
};

// Adds the echoes of one scatterer.
void add_echo(const Geometry& geometry, const Split (&halves)[2 * kVectors], Block& block) {
  Double nearest = spread(1e9), farthest = spread(1e9);  // with its sign reversed
  for (const Split& half : halves) {
    nearest = half.place < nearest ? half.place : nearest;
    farthest = -half.place < farthest ? -half.place : farthest;
  }
  const Index near_bin = static_cast<Index>(std::ceil(std::max(-1e9, least(nearest)) - geometry.reach));
  const Index far_bin = static_cast<Index>(std::floor(geometry.reach - std::max(-1e9, least(farthest))));
  const Index first = std::max<Index>(near_bin, 0), stop = std::min<Index>(far_bin + 1, block.n_bins);
  if (first >= stop) return;
  block.first = std::min(block.first, first);
  block.stop = std::max(block.stop, stop);

  Float x[kVectors], y[kVectors], bin[kVectors], rest[kVectors];
  for (int i = 0; i < kVectors; ++i) {
    const Split &a = halves[2 * i], &b = halves[2 * i + 1];
    // cos(2 pi v) and sin(2 pi v) / v with errors of 3e-10 and 7e-9 for |v| <= 1/4
    const Float v = narrow(a.turns, b.turns), peak = narrow(a.peak, b.peak), q = v * v;
    Float even = fused(q, fused(q, -24.98143432289362f, 60.14388953533489f), spread(-85.45356475943481f));
    even = fused(q, fused(q, fused(q, even, 64.93934647616803f), -19.739208547715332f), 1.0f);
    Float odd = fused(q, fused(q, 39.75982706857711f, -76.5811726421402f), spread(81.60247636883796f));
    odd = fused(q, fused(q, odd, -41.34168061334532f), 6.283185280154403f);
    x[i] = peak * even, y[i] = peak * v * odd;
    bin[i] = narrow(a.bin, b.bin), rest[i] = narrow(a.place - a.bin, b.place - b.bin);
  }
  const Float cut = spread(geometry.cut), exponent = spread(geometry.exponent);
  Float n = spread(static_cast<float>(first));
  float *sum = block[first], *end = block[stop];
  for (; sum < end; sum += kRow, n += 1.0f) {
    for (int i = 0; i < kVectors; ++i) {
      float *re = sum + i * kWidth, *im = re + kFrames;
      const Float distance = (n - bin[i]) - rest[i];  // the first difference is between whole numbers, hence exact
      const Float square = distance * distance;
      const Float envelope = square <= cut ? power_of_two(exponent, square) : Float{};
      store(re, fused(envelope, x[i], load<Float>(re)));
      store(im, fused(envelope, y[i], load<Float>(im)));
    }
  }
}

void fill(const Geometry& geometry, const Scatterers& all, Index first_frame, Block& block) {
  block.clear();
  if (all.range_m.count == 0) return;
  const double *range_rows[kFrames], *amplitude_rows[kFrames], *extra_rows[kFrames];
  for (Index lane = 0; lane < kFrames; ++lane) {
    const Index wanted = first_frame + lane, frame = std::min<Index>(wanted, all.range_m.count - 1);
    range_rows[lane] = all.range_m[frame];
    amplitude_rows[lane] = wanted == frame ? all.amplitude[frame] : all.silence.data();
    extra_rows[lane] = all.extra_phase_rad ? (*all.extra_phase_rad)[frame] : nullptr;
  }
  Group range_m, amplitude, extra_rad = {};
  for (Index begin = 0; begin < all.range_m.width; begin += kGroup) {
    const Index count = std::min<Index>(kGroup, all.range_m.width - begin);
    range_m.read(range_rows, begin, count);
    amplitude.read(amplitude_rows, begin, count);
    if (all.extra_phase_rad) extra_rad.read(extra_rows, begin, count);
    for (Index i = 0; i < count; ++i) {
      Split halves[2 * kVectors];
      for (int k = 0; k < 2 * kVectors; ++k) {
        const int lane = k * kHalfWidth;
        halves[k] = Split(geometry, load<Double>(range_m.at[i] + lane), load<Double>(amplitude.at[i] + lane),
                          load<Double>(extra_rad.at[i] + lane));
      }
      add_echo(geometry, halves, block);
    }
  }
}

// y_in = sum_l a_il exp(-(R_n - R_il)^2 / 2 s^2) exp(j (theta - 4 pi R_il / lambda)), zero beyond 5.5 s.
Geometry make_geometry(double first_bin_m, double bin_spacing_m, double pulse_sigma_m, double wavelength_m,
                       double phase_rad) {
  const double sigma = pulse_sigma_m / bin_spacing_m, support = kSupportSigmas * sigma;
  return {first_bin_m,
          1.0 / bin_spacing_m,
          phase_rad / (2.0 * kPi),
          2.0 / wavelength_m,
          std::max(0.0, std::min(1e9, support + 1e-3)),  // floats may round a bin at the cut to either side
          static_cast<float>(-0.5 / (std::log(2.0) * sigma * sigma)),
          static_cast<float>(support * support)};
}

inline void copy_frames(const float* from, Index count, float* to) {
  if (count < kFrames) {
    std::copy(from, from + count, to);
  } else {
    for (int lane = 0; lane < kFrames; lane += kWidth) store(to + lane, load<Float>(from + lane));
  }
}

void echo_planes(Plane<double> range_m, Plane<double> amplitude, double first_bin_m, double bin_spacing_m,
                 double pulse_sigma_m, double wavelength_m, double phase_rad, Rows<float> re, Rows<float> im,
                 std::optional<Plane<double>> extra_phase_rad) {
  const Scatterers scatterers(range_m, amplitude, extra_phase_rad);
  const auto geometry = make_geometry(first_bin_m, bin_spacing_m, pulse_sigma_m, wavelength_m, phase_rad);
  require(re.count == im.count && re.width == im.width, "both planes need the same shape");
  Block block(re.count);
  // Every number is written once. Zeros are most of them: long runs are faster than blocks of frames.
  std::vector<Index> written(re.count);
  const auto write_zeros = [&](Index n, Index stop) {
    for (const auto& plane : {re, im}) std::fill(plane[n] + written[n], plane[n] + stop, 0.0f);
  };
  for (Index column = 0; column < re.width; column += kFrames) {
    fill(geometry, scatterers, column, block);
    const Index stop = std::min<Index>(column + kFrames, re.width);
    for (Index n = block.first; n < block.stop; ++n) {
      if (written[n] < column) write_zeros(n, column);
      written[n] = stop;
      copy_frames(block[n], stop - column, re[n] + column);
      copy_frames(block[n] + kFrames, stop - column, im[n] + column);
    }
  }
  for (Index n = 0; n < re.count; ++n) write_zeros(n, re.width);
}

// Copies samples from or to planes: a few frames for all bins, in tiles that are transposed in registers.
template <typename From, typename To, typename CopyTile, typename Copy>
void exchange(From matrix, To re, To im, CopyTile copy_tile, Copy copy) {
  require(re.count == matrix.width && im.count == matrix.width && re.width >= matrix.count && im.width >= matrix.count,
          "both planes need a row for every column of the matrix, as long as it has rows");
  for (Index first = 0; first < matrix.count; first += kFrames) {
    for (Index n = 0; n < matrix.width; n += kHalfWidth) {
      const Index bins = std::min<Index>(n + kHalfWidth, matrix.width);
      for (Index frame = first; frame < std::min<Index>(first + kFrames, matrix.count); frame += kWidth) {
        const Index frames = std::min<Index>(frame + kWidth, matrix.count);
        if (frames - frame == kWidth && bins - n == kHalfWidth) {
          copy_tile(frame, n);
          continue;
        }
        for (Index i = frame; i < frames; ++i) {
          for (Index k = n; k < bins; ++k) copy(matrix[i][k], re[k][i], im[k][i]);
        }
      }
    }
  }
}

void join_planes(Plane<float> re, Plane<float> im, Rows<Complex> matrix) {
  const auto join_tile = [=](Index frame, Index n) {
    Float rows[kWidth];
    for (int i = 0; i < kWidth; ++i) rows[i] = load<Float>((i % 2 ? im : re)[n + i / 2] + frame);
    transpose(rows);
    for (int i = 0; i < kWidth; ++i) store(reinterpret_cast<float*>(matrix[frame + i] + n), rows[i]);
  };
  exchange(matrix, re, im, join_tile, [](Complex& sample, float x, float y) { sample = Complex(x, y); });
}

void split_planes(Plane<Complex> matrix, Rows<float> re, Rows<float> im) {
  const auto split_tile = [=](Index frame, Index n) {
    Float rows[kWidth];
    for (int i = 0; i < kWidth; ++i) rows[i] = load<Float>(reinterpret_cast<const float*>(matrix[frame + i] + n));
    transpose(rows);
    for (int i = 0; i < kWidth; ++i) store((i % 2 ? im : re)[n + i / 2] + frame, rows[i]);
  };
  const auto split = [](const Complex& sample, float& x, float& y) { x = sample.real(), y = sample.imag(); };
  exchange(matrix, re, im, split_tile, split);
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "echo_planes", &echo_planes);
  define(module, "join_planes", &join_planes);
  define(module, "split_planes", &split_planes);
}

}  // namespace doppelgait::synthesis

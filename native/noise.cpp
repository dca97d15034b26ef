// Counter-based complex Gaussian receiver noise (E-18), white or correlated over range (E-18c).
//
// Every value is a function of (key, frame, bin), so that any block of frames and bins, in any order and by any worker,
// has the same values. All steps are exact integer operations or single IEEE operations.
#include "arrays.hpp"

namespace doppelgait::noise {
namespace {

using Words = std::array<Word, 4>;

template <int... lane>
inline Word join_words(Word even, Word odd, std::integer_sequence<int, lane...>) {
  return __builtin_shufflevector(even, odd, (lane % 2 ? kWidth + lane - 1 : lane)...);
}

// Philox4x32-10 (Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC11). Even and odd
// lanes are computed by themselves in words of 64 bits, whose high halves mean nothing: one product has both halves.
inline Words philox(const Words& counter, std::uint64_t key) {
  Long c[2][4];
  for (int word = 0; word < 4; ++word) {
    c[0][word] = bits_of<Long>(counter[word]);
    c[1][word] = c[0][word] >> 32;
  }
  auto k0 = static_cast<std::uint32_t>(key), k1 = static_cast<std::uint32_t>(key >> 32);
  for (int round = 0; round < 10; ++round, k0 += 0x9E3779B9, k1 += 0xBB67AE85) {
    for (auto& x : c) {
      const Long first = multiply_words(x[0], 0xD2511F53), second = multiply_words(x[2], 0xCD9E8D57);
      x[0] = (second >> 32) ^ x[1] ^ k0, x[1] = second;
      x[2] = (first >> 32) ^ x[3] ^ k1, x[3] = first;
    }
  }
  Words drawn;
  for (int word = 0; word < 4; ++word) {
    constexpr auto lanes = std::make_integer_sequence<int, kWidth>();
    drawn[word] = join_words(bits_of<Word>(c[0][word]), bits_of<Word>(c[1][word]), lanes);
  }
  return drawn;
}

// Exponential variable of mean 1: -ln u with u = (w + 1/2) / 2^32. ln(1 + f) = f + f^2 (L0 + L1 f + ...) with the least
// maximum relative error over the reduced range, found by Lawson's iteration (4e-9 before rounding).
inline Float exponential(Word word) {
  constexpr std::int32_t root_half = 0x3F3504F3;  // bits of sqrt(1/2)
  const Float value = __builtin_convertvector(word, Float) + 0.5f;
  const Int offset = bits_of<Int>(value) - root_half;
  const Float exponent = __builtin_convertvector((offset >> 23) - 32, Float);
  const Float f = bits_of<Float>((offset & 0x7FFFFF) + root_half) - 1.0f;
  const Float tail =
      0.2000197321f +
      f * (-0.1660908163f + f * (0.1418182850f + f * (-0.1324298978f + f * (0.1290443838f + f * -0.0762178078f))));
  const Float series = f + f * f * (-0.4999998808f + f * (0.3333332539f + f * (-0.2500158250f + f * tail)));
  return -(exponent * 0.693147180559945f + series);
}

// Uniformly distributed point of the unit circle, with an error below 2^-23.
inline void direction(Word word, Float& x, Float& y) {
  const Float angle = __builtin_convertvector((Int)(word << 2), Float) * (0.785398163397448f / 2147483648.0f);
  Float cosine, sine;
  small_phasor(angle, cosine, sine);
  const Int swap = (word & (1u << 30)) != 0;
  const Int sign = (Int)(word & (1u << 31));
  x = bits_of<Float>(bits_of<Int>(swap ? sine : cosine) ^ sign);
  y = bits_of<Float>(bits_of<Int>(swap ? cosine : sine) ^ sign);
}
constexpr int kLanes = 256;      // frames side by side
constexpr int kSpanLanes = 128;  // where every bin needs other frames

// Noise of kLanes frames for bin after bin; real parts come first, then imaginary parts.
struct Source {
  Source(std::uint64_t key, double rms, Line<const float> factor)
      : key(key), rms(static_cast<float>(rms)), factor(factor) {
    require(factor.size > 0, "the factor needs a tap");
    memory.resize((factor.size + 1) * 2 * kLanes / kWidth);
  }

  // White noise of the last bins, from bin -1 on.
  float* white(Index n) { return reinterpret_cast<float*>(memory.data()) + (n + 1) % (factor.size + 1) * 2 * kLanes; }

  // Random words of a pair of bins; the four words of a frame lie kLanes apart. Loops of their own, not inlined: the
  // processor sees further ahead, and constants stay in registers.
  [[gnu::noinline]] void draw(Index first_frame, Index pair, Index n_frames) {
    const std::uint64_t key = this->key;  // the words may lie anywhere
    Word frame;
    for (int lane = 0; lane < kWidth; ++lane) frame[lane] = static_cast<std::uint32_t>(first_frame + lane);
    for (Index lane = 0; lane < n_frames; lane += kWidth, frame += kWidth) {
      const Words drawn = philox({{frame, Word{} + static_cast<std::uint32_t>(pair), Word{}, Word{}}}, key);
      for (int word = 0; word < 4; ++word) store(words + word * kLanes + lane, drawn[word]);
    }
  }

  // Box and Muller: w = s sqrt(-ln u) exp(j phi).
  [[gnu::noinline]] void transform(const std::uint32_t* from, Index n_frames, float* to) const {
    const Float scale = spread(rms);
    for (Index lane = 0; lane < n_frames; lane += kWidth) {
      const Float radius = scale * square_root(exponential(load<Word>(from + lane)));
      Float x, y;
      direction(load<Word>(from + kLanes + lane), x, y);
      store(to + lane, radius * x);
      store(to + kLanes + lane, radius * y);
    }
  }

  template <typename Use>
  void fill(Index first_frame, Index n_frames, Index first_bin, Index n_bins, Use use) {
    const Index n_more = factor.size - 1;
    for (Index pair = first_bin / 2; pair < (first_bin + n_bins + n_more + 1) / 2; ++pair) {
      const Index row = 2 * pair - first_bin;
      draw(first_frame, pair, n_frames);
      for (int odd = 0; odd < 2; ++odd) transform(words + 2 * odd * kLanes, n_frames, white(row + odd));
      for (Index n = std::max<Index>(row - n_more, 0); n < std::min(row + 2 - n_more, n_bins); ++n) use(n);
    }
  }

  // Sums over range: w_n = g_0 u_n + g_1 u_(n+1) + ..., added in this order.
  [[gnu::noinline]] void filter(Index n, Index n_frames, float* to) {
    for (Index k = 0; k < factor.size; ++k) {
      const float* from = white(n + k);
      const Float g = spread(factor[k]);
      for (Index begin = 0; begin < 2 * kLanes; begin += kLanes) {
        for (Index i = begin; i < begin + n_frames; i += kWidth) {
          const Float next = g * load<Float>(from + i);
          store(to + i, k == 0 ? next : load<Float>(to + i) + next);
        }
      }
    }
  }

  std::uint64_t key;
  float rms;
  Line<const float> factor;
  alignas(64) std::uint32_t words[4 * kLanes];
  std::vector<Float> memory;
};

inline void add(const float* a, const float* b, Index size, float* to) {
  Index i = 0;
  for (; i + kWidth <= size; i += kWidth) store(to + i, load<Float>(a + i) + load<Float>(b + i));
  for (; i < size; ++i) to[i] = a[i] + b[i];
}

// Writes rows with noise in the columns start..stop-1, in place or not.
void add_to_planes(Rows<const float> from_re, Rows<const float> from_im, Index start, Index stop, Index first_bin,
                   Index first_frame, Source& source, Rows<float> re, Rows<float> im) {
  alignas(64) float parts[2 * kLanes];
  for (Index column = start; column < stop; column += kLanes) {
    const Index n_frames = std::min<Index>(kLanes, stop - column);
    source.fill(first_frame + column - start, n_frames, first_bin, re.count, [&](Index n) {
      source.filter(n, n_frames, parts);
      add(from_re[n] + column, parts, n_frames, re[n] + column);
      add(from_im[n] + column, parts + kLanes, n_frames, im[n] + column);
    });
  }
}

void add_noise_block(Rows<float> re, Rows<float> im, Index start, Index stop, Index first_bin, Index first_frame,
                     std::uint64_t key, double rms, Line<const float> factor) {
  require_shape(re.count, re.width, "both planes need the same shape", im);
  require(0 <= start && stop <= re.width && first_bin >= 0, "frames and bins must lie within the planes");
  Source source(key, rms, factor);
  add_to_planes(re.read(), im.read(), start, stop, first_bin, first_frame, source, re, im);
}

void copy_noise_spans(Plane<float> from_re, Plane<float> from_im, Rows<const Index> span, Index first_bin,
                      std::uint64_t key, double rms, Line<const float> factor, Index margin, Rows<float> re,
                      Rows<float> im) {
  const Index n_bins = from_re.count, n_frames = re.width;
  require_shape(n_bins, n_frames, "planes differ", re, im);
  require_shape(n_bins, 2, "spans are pairs", span);
  require(from_im.count == n_bins && from_re.width >= n_frames && from_im.width >= n_frames, "frames differ");
  require(first_bin >= 0 && margin >= 0, "first bin and margin are not below 0");
  Index first_frame = n_frames, last_frame = 0;
  for (Index n = 0; n < n_bins; ++n) {
    const Index begin = span[n][0], stop = span[n][1];
    if (begin >= stop) continue;
    require(begin >= 0 && stop <= n_frames, "spans must lie in the planes");
    first_frame = std::min(first_frame, begin);
    last_frame = std::max(last_frame, stop);
  }
  Source source(key, rms, factor);
  // In every block of frames runs of bins get noise together: neighbours share random words and white noise.
  for (Index column = first_frame; column < last_frame; column += kSpanLanes) {
    const Index end = std::min<Index>(column + kSpanLanes, last_frame);
    for (Index row = 0; row < n_bins; ++row) {
      const Index top = row;
      while (row < n_bins && span[row][0] < std::min(span[row][1], end) && span[row][1] > column) ++row;
      if (row > top) {
        add_to_planes(from_re.slice(top, row), from_im.slice(top, row), column, end, first_bin + top, column, source,
                      re.slice(top, row), im.slice(top, row));
      }
    }
  }
  for (Index n = 0; n < n_bins; ++n) {
    if (span[n][0] >= span[n][1]) continue;
    const Index blocks = (span[n][1] - first_frame + kSpanLanes - 1) / kSpanLanes;
    const Index begin = std::min(first_frame + blocks * kSpanLanes, last_frame),
                stop = std::min(span[n][1] + margin, n_frames);
    if (begin < stop) std::copy(from_re[n] + begin, from_re[n] + stop, re[n] + begin);
    if (begin < stop) std::copy(from_im[n] + begin, from_im[n] + stop, im[n] + begin);
  }
}

template <typename T>
void add_noise_matrix(Rows<std::complex<T>> all, std::uint64_t key, double rms, Line<const float> factor) {
  Source source(key, rms, factor);
  alignas(64) float parts[kWidth * kLanes] = {};               // noise of some bins, real and imaginary parts in turn
  for (Index start = 0; start < all.count; start += kLanes) {  // these rows stay in the cache for all bins
    const Index n_frames = std::min<Index>(all.count - start, kLanes);
    source.fill(start, n_frames, 0, all.width, [&](Index n) {
      const Index bins = n % kHalfWidth + 1;
      source.filter(n, n_frames, parts + (bins - 1) * 2 * kLanes);
      if (bins < kHalfWidth && n < all.width - 1) return;
      for (Index frame = 0; frame < n_frames; frame += kWidth) {
        Float rows[kWidth];
        for (int i = 0; i < kWidth; ++i) rows[i] = load<Float>(parts + i * kLanes + frame);
        transpose(rows);
        for (Index i = 0; i < std::min<Index>(kWidth, n_frames - frame); ++i) {
          T* numbers = reinterpret_cast<T*>(all[start + frame + i] + n + 1 - bins);
          if (bins == kHalfWidth) {
            for (int k = 0; k < kWidth; ++k) numbers[k] += rows[i][k];
          } else {
            for (Index k = 0; k < 2 * bins; ++k) numbers[k] += rows[i][k];
          }
        }
      }
    });
  }
}

}  // namespace

void bind(nb::module_& module) {
  module.attr("NOISE_LANES") = kLanes;
  define(module, "add_noise_block", &add_noise_block);
  define(module, "copy_noise_spans", &copy_noise_spans);
  define(module, "add_noise_matrix", &add_noise_matrix<float>, &add_noise_matrix<double>);
}

}  // namespace doppelgait::noise

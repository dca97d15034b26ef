#include "noise.hpp"

#include <algorithm>
#include <vector>

#include "arrays.hpp"

namespace doppelgait::noise {
namespace {

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
      for (int word = 0; word < 4; ++word) store(words + word * kLanes + lane, drawn.at[word]);
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

Rows<const float> read(Rows<float> rows) { return {rows.data, rows.count, rows.width, rows.stride}; }

void add_noise_block(const Out2<float>& plane_re, const Out2<float>& plane_im, Index start, Index stop, Index first_bin,
                     Index first_frame, std::uint64_t key, double rms, const In1<float>& factor) {
  const auto re = view_rows(plane_re), im = view_rows(plane_im);
  require(re.count == im.count && re.width == im.width, "both planes need the same shape");
  require(0 <= start && stop <= re.width && first_bin >= 0, "frames and bins must lie within the planes");
  Source source(key, rms, view_line(factor));
  add_to_planes(read(re), read(im), start, stop, first_bin, first_frame, source, re, im);
}

void copy_noise_spans(const Planes<float>& source_re, const Planes<float>& source_im, const In2<Index>& spans,
                      Index first_bin, std::uint64_t key, double rms, const In1<float>& factor, Index margin,
                      const Out2<float>& plane_re, const Out2<float>& plane_im) {
  const auto from_re = view_rows(source_re), from_im = view_rows(source_im);
  const auto re = view_rows(plane_re), im = view_rows(plane_im);
  const auto span = view_rows(spans);
  const Index n_bins = from_re.count, n_frames = re.width;
  require(from_im.count == n_bins && re.count == n_bins && im.count == n_bins && span.count == n_bins, "bins differ");
  require(im.width == n_frames && from_re.width >= n_frames && from_im.width >= n_frames, "frames differ");
  require(span.width == 2 && first_bin >= 0 && margin >= 0, "spans are pairs");
  for (Index n = 0; n < n_bins; ++n) {
    require(span[n][0] >= span[n][1] || (span[n][0] >= 0 && span[n][1] <= n_frames), "spans must lie in the planes");
  }
  Index first_frame = n_frames, last_frame = 0;
  for (Index n = 0; n < n_bins; ++n) {
    const Index begin = span[n][0], stop = span[n][1];
    if (begin >= stop) continue;
    first_frame = std::min(first_frame, begin);
    last_frame = std::max(last_frame, stop);
  }
  Source source(key, rms, view_line(factor));
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
void add_noise_matrix(const Out2<std::complex<T>>& matrix, std::uint64_t key, double rms, const In1<float>& factor) {
  const auto all = view_rows(matrix);
  Source source(key, rms, view_line(factor));
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
  const auto matrix = nb::arg("matrix").noconvert();
  const auto key = nb::arg("key"), rms = nb::arg("rms"), factor = nb::arg("factor");
  module.attr("NOISE_LANES") = kLanes;
  module.def("add_noise_block", &add_noise_block, nb::arg("plane_re").noconvert(), nb::arg("plane_im").noconvert(),
             nb::arg("start"), nb::arg("stop"), nb::arg("first_bin"), nb::arg("first_frame"), key, rms, factor,
             Unlocked());
  module.def("copy_noise_spans", &copy_noise_spans, nb::arg("source_re").noconvert(), nb::arg("source_im").noconvert(),
             nb::arg("spans"), nb::arg("first_bin"), key, rms, factor, nb::arg("margin"),
             nb::arg("plane_re").noconvert(), nb::arg("plane_im").noconvert(), Unlocked());
  module.def("add_noise_matrix", &add_noise_matrix<float>, matrix, key, rms, factor, Unlocked());
  module.def("add_noise_matrix", &add_noise_matrix<double>, matrix, key, rms, factor, Unlocked());
}

}  // namespace doppelgait::noise

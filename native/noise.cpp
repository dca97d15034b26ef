#include "noise.hpp"

#include <algorithm>
#include <vector>

#include "arrays.hpp"

namespace doppelgait::noise {
namespace {

constexpr int kLanes = 128;  // frames side by side

// Random words of kLanes frames for one pair of bins; the four words of a frame lie kLanes apart.
void draw(Index first_frame, Index pair, std::uint64_t key, std::uint32_t* words) {
  Word frame;
  for (int lane = 0; lane < kWidth; ++lane) frame[lane] = static_cast<std::uint32_t>(first_frame + lane);
  for (int lane = 0; lane < kLanes; lane += kWidth, frame += kWidth) {
    const Words drawn = philox({{frame, Word{} + static_cast<std::uint32_t>(pair), Word{}, Word{}}}, key);
    for (int word = 0; word < 4; ++word) store(words + word * kLanes + lane, drawn.at[word]);
  }
}

// Box and Muller: w = s sqrt(-ln u) exp(j phi); real parts first, then imaginary parts.
void transform(const std::uint32_t* words, float rms, float* parts) {
  for (int lane = 0; lane < kLanes; lane += kWidth) {
    const Float radius = rms * square_root(exponential(load<Word>(words + lane)));
    Float x, y;
    direction(load<Word>(words + kLanes + lane), x, y);
    store(parts + lane, radius * x);
    store(parts + kLanes + lane, radius * y);
  }
}

// White noise of the last bins, and its sums over range: w_n = g_0 u_n + g_1 u_(n+1) + ..., added in this order.
struct Ring {
  Ring(Line<const float> factor, Index slots) : factor(factor), slots(slots), white(slots * 2 * kLanes) {}

  float* slot(Index n) { return white.data() + (n % slots) * 2 * kLanes; }

  void filter(Index oldest, float* parts) {
    const float* first = slot(oldest);
    for (int i = 0; i < 2 * kLanes; ++i) parts[i] = factor[0] * first[i];
    for (Index k = 1; k < factor.size; ++k) {
      const float* next = slot(oldest + k);
      for (int i = 0; i < 2 * kLanes; ++i) parts[i] += factor[k] * next[i];
    }
  }

  Line<const float> factor;
  Index slots;
  std::vector<float> white;
};

void add_to_planes(Rows<float> re, Rows<float> im, Index start, Index stop, Index first_bin, Index first_frame,
                   std::uint64_t key, float rms, Line<const float> factor) {
  const Index n_bins = re.count, n_more = factor.size - 1;
  std::uint32_t words[4 * kLanes];
  float parts[2 * kLanes];
  Ring ring(factor, factor.size);
  for (Index column = start; column < stop; column += kLanes) {
    const Index n_frames = std::min<Index>(kLanes, stop - column);
    for (Index pair = first_bin / 2; pair < (first_bin + n_bins + n_more + 1) / 2; ++pair) {
      draw(first_frame + column - start, pair, key, words);
      for (int odd = 0; odd < 2; ++odd) {
        const Index row = 2 * pair + odd - first_bin;
        if (row < 0 || row >= n_bins + n_more) continue;
        transform(words + 2 * odd * kLanes, rms, ring.slot(row));
        if (row < n_more) continue;
        ring.filter(row - n_more, parts);
        float *x = re[row - n_more] + column, *y = im[row - n_more] + column;
        for (Index i = 0; i < n_frames; ++i) x[i] += parts[i];
        for (Index i = 0; i < n_frames; ++i) y[i] += parts[kLanes + i];
      }
    }
  }
}

void add_noise_block(const Out2<float>& plane_re, const Out2<float>& plane_im, Index start, Index stop, Index first_bin,
                     Index first_frame, std::uint64_t key, double rms, const In1<float>& factor) {
  const auto re = view_rows(plane_re), im = view_rows(plane_im);
  require(re.count == im.count && re.width == im.width, "both planes need the same shape");
  require(0 <= start && stop <= re.width && first_bin >= 0, "frames and bins must lie within the planes");
  require(factor.shape(0) > 0, "the factor needs a tap");
  add_to_planes(re, im, start, stop, first_bin, first_frame, key, static_cast<float>(rms), view_line(factor));
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
  require(span.width == 2 && factor.shape(0) > 0 && first_bin >= 0 && margin >= 0, "spans are pairs, with a factor");
  for (Index n = 0; n < n_bins; ++n) {
    require(span[n][0] >= span[n][1] || (span[n][0] >= 0 && span[n][1] <= n_frames), "spans must lie in the planes");
  }
  Index first_frame = n_frames, last_frame = 0;
  for (Index n = 0; n < n_bins; ++n) {
    const Index begin = span[n][0], stop = span[n][1];
    if (begin >= stop) continue;
    const Index copied = std::min(stop + margin, n_frames);
    std::copy(from_re[n] + begin, from_re[n] + copied, re[n] + begin);
    std::copy(from_im[n] + begin, from_im[n] + copied, im[n] + begin);
    first_frame = std::min(first_frame, begin);
    last_frame = std::max(last_frame, stop);
  }
  // In every block of frames runs of bins get noise together: neighbours share random words and white noise.
  for (Index column = first_frame; column < last_frame; column += kLanes) {
    const Index end = std::min<Index>(column + kLanes, last_frame);
    for (Index row = 0; row < n_bins; ++row) {
      const Index top = row;
      while (row < n_bins && span[row][0] < std::min(span[row][1], end) && span[row][1] > column) ++row;
      if (row > top) {
        add_to_planes(re.slice(top, row), im.slice(top, row), column, end, first_bin + top, column, key,
                      static_cast<float>(rms), view_line(factor));
      }
    }
  }
}

template <typename T>
void add_noise_matrix(const Out2<std::complex<T>>& matrix, std::uint64_t key, double rms, const In1<float>& factor) {
  const auto all = view_rows(matrix);
  const auto taps = view_line(factor);
  require(taps.size > 0, "the factor needs a tap");
  const Index n_more = taps.size - 1;
  std::uint32_t words[4 * kLanes];
  float even[2 * kLanes], odd[2 * kLanes];
  Ring ring(taps, taps.size + 1);
  for (Index start = 0; start < all.count; start += kLanes) {  // these rows stay in the cache for all bins
    const Index n_rows = std::min<Index>(kLanes, all.count - start);
    for (Index pair = 0; pair < (all.width + n_more + 1) / 2; ++pair) {
      draw(start, pair, key, words);
      transform(words, static_cast<float>(rms), ring.slot(2 * pair));
      transform(words + 2 * kLanes, static_cast<float>(rms), ring.slot(2 * pair + 1));
      const Index n = 2 * pair - n_more;  // the first of two bins whose noise is now known
      if (n >= 0) ring.filter(n, even);
      if (n >= -1) ring.filter(n + 1, odd);
      for (Index i = 0; i < n_rows; ++i) {
        std::complex<T>* row = all[start + i];
        if (n >= 0) row[n] += std::complex<T>(even[i], even[kLanes + i]);
        if (n >= -1 && n < all.width - 1) row[n + 1] += std::complex<T>(odd[i], odd[kLanes + i]);
      }
    }
  }
}

// The three steps by themselves, for tests against published words and against the logarithm and the circle.
void draw_philox(const In1<std::uint32_t>& counter, std::uint64_t key, const Out1<std::uint32_t>& words) {
  const auto from = view_line(counter);
  const auto to = view_line(words);
  require(from.size == 4 && to.size == 4, "counter and words need four numbers");
  const Words drawn = philox({{Word{} + from[0], Word{} + from[1], Word{} + from[2], Word{} + from[3]}}, key);
  for (int word = 0; word < 4; ++word) to[word] = drawn.at[word][0];
}

void transform_words(const In1<std::uint32_t>& words, const Out1<float>& exponentials, const Out1<float>& x,
                     const Out1<float>& y) {
  const auto from = view_line(words);
  const auto value = view_line(exponentials), across = view_line(x), up = view_line(y);
  require(value.size == from.size && across.size == from.size && up.size == from.size, "lengths differ");
  for (Index i = 0; i < from.size; ++i) {
    const Word word = Word{} + from[i];
    Float a, b;
    direction(word, a, b);
    value[i] = exponential(word)[0];
    across[i] = a[0];
    up[i] = b[0];
  }
}

}  // namespace

void bind(nb::module_& module) {
  module.def("draw_philox", &draw_philox, nb::arg("counter"), nb::arg("key"), nb::arg("words").noconvert());
  module.def("transform_words", &transform_words, nb::arg("words"), nb::arg("exponentials").noconvert(),
             nb::arg("x").noconvert(), nb::arg("y").noconvert());
  module.attr("NOISE_LANES") = kLanes;
  module.def("add_noise_block", &add_noise_block, nb::arg("plane_re").noconvert(), nb::arg("plane_im").noconvert(),
             nb::arg("start"), nb::arg("stop"), nb::arg("first_bin"), nb::arg("first_frame"), nb::arg("key"),
             nb::arg("rms"), nb::arg("factor"), Unlocked());
  module.def("copy_noise_spans", &copy_noise_spans, nb::arg("source_re").noconvert(), nb::arg("source_im").noconvert(),
             nb::arg("spans"), nb::arg("first_bin"), nb::arg("key"), nb::arg("rms"), nb::arg("factor"),
             nb::arg("margin"), nb::arg("plane_re").noconvert(), nb::arg("plane_im").noconvert(), Unlocked());
  const auto matrix = nb::arg("matrix").noconvert();
  module.def("add_noise_matrix", &add_noise_matrix<float>, matrix, nb::arg("key"), nb::arg("rms"), nb::arg("factor"),
             Unlocked());
  module.def("add_noise_matrix", &add_noise_matrix<double>, matrix, nb::arg("key"), nb::arg("rms"), nb::arg("factor"),
             Unlocked());
}

}  // namespace doppelgait::noise

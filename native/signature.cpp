// Gated, windowed, squared short-time Fourier transform, summed over range (E-24, E-27).
//
// A lane is a column of the signature. The transform is decimation in frequency, in place: a windowed first pass,
// passes of radix 4 or 2 where the length asks for them, and a last pass of radix 16 that adds squared magnitudes.
// Lengths of 48 to 256 have two passes. Bins come out in the order of their digits and are sorted as they are stored.
#include "arrays.hpp"

namespace doppelgait::signature {
namespace {

constexpr int kLanes = 16;  // columns whose pulses are gathered together, at every level
constexpr int kGroups = kLanes / kWidth;
constexpr int kLast = 16;  // radix of the last pass
template <int... radix>
using Radices = std::integer_sequence<int, radix...>;
constexpr Radices<16, 12, 10, 8, 5, 4, 3> kFirst;  // radices of the first pass, the preferred one first
constexpr float kRootHalf = 0.70710678f, kC22 = 0.92387953f, kS22 = 0.38268343f, kS60 = 0.86602540f;
constexpr float kC72 = 0.30901699f, kS72 = 0.95105652f, kC144 = -0.80901699f, kS144 = 0.58778525f;

struct Value {
  Float re, im;
};

inline Value operator+(Value a, Value b) { return {a.re + b.re, a.im + b.im}; }
inline Value operator-(Value a, Value b) { return {a.re - b.re, a.im - b.im}; }
inline Value operator*(float a, Value b) { return {a * b.re, a * b.im}; }
inline Value fused(float a, Value b, Value c) {
  return {doppelgait::fused(spread(a), b.re, c.re), doppelgait::fused(spread(a), b.im, c.im)};
}

// -j z and (c - j s) z
inline Value rotate(Value z) { return {z.im, -z.re}; }
inline Value turn(Value z, float c, float s) {
  return {doppelgait::fused(spread(c), z.re, s * z.im), doppelgait::fused(spread(c), z.im, -(s * z.re))};
}

// Fourier transforms of few values.
inline void transform(Value& a, Value& b, Value& c) {
  const Value s = b + c, d = rotate(b - c), u = fused(-0.5f, s, a);
  a = a + s;
  b = fused(kS60, d, u);
  c = fused(-kS60, d, u);
}

inline void transform(Value& a, Value& b, Value& c, Value& d) {
  const Value even = a + c, diff = a - c, odd = b + d, turned = rotate(b - d);
  a = even + odd;
  b = diff + turned;
  c = even - odd;
  d = diff - turned;
}

inline void transform(Value& a, Value& b, Value& c, Value& d, Value& e) {  // by pairs (1, 4) and (2, 3)
  const Value s1 = b + e, d1 = rotate(b - e), s2 = c + d, d2 = rotate(c - d);
  const Value u = fused(kC72, s1, fused(kC144, s2, a)), v = fused(kC144, s1, fused(kC72, s2, a));
  const Value f = fused(kS72, d1, kS144 * d2), g = fused(kS144, d1, -kS72 * d2);
  a = a + s1 + s2;
  b = u + f;
  c = v + g;
  d = v - g;
  e = u - f;
}

template <int radix>
inline void transform(Value* z) {
  if constexpr (radix == 2) {
    const Value sum = z[0] + z[1];
    z[1] = z[0] - z[1];
    z[0] = sum;
  }
  if constexpr (radix == 3) transform(z[0], z[1], z[2]);
  if constexpr (radix == 4) transform(z[0], z[1], z[2], z[3]);
  if constexpr (radix == 5) transform(z[0], z[1], z[2], z[3], z[4]);
  if constexpr (radix == 8) {  // from those of even and odd values
    Value e[4] = {z[0], z[2], z[4], z[6]}, o[4] = {z[1], z[3], z[5], z[7]};
    transform<4>(e);
    transform<4>(o);
    o[1] = kRootHalf * (o[1] + rotate(o[1]));
    o[2] = rotate(o[2]);
    o[3] = kRootHalf * (rotate(o[3]) - o[3]);
    for (int i = 0; i < 4; ++i) z[i] = e[i] + o[i];
    for (int i = 0; i < 4; ++i) z[4 + i] = e[i] - o[i];
  }
  if constexpr (radix == 10) {  // two by five (Good and Thomas)
    Value e[5] = {z[0], z[2], z[4], z[6], z[8]}, o[5] = {z[5], z[7], z[9], z[1], z[3]};
    transform<5>(e);
    transform<5>(o);
    for (int i = 0; i < 10; ++i) z[i] = i % 2 ? e[i % 5] - o[i % 5] : e[i % 5] + o[i % 5];
  }
  if constexpr (radix == 12) {  // three by four (Good and Thomas)
    Value part[3][4];
    for (int r = 0; r < 3; ++r) {
      for (int i = 0; i < 4; ++i) part[r][i] = z[(4 * r + 3 * i) % 12];
      transform<4>(part[r]);
    }
    for (int i = 0; i < 4; ++i) {
      transform(part[0][i], part[1][i], part[2][i]);
      for (int r = 0; r < 3; ++r) z[(9 * i + 4 * r) % 12] = part[r][i];
    }
  }
  if constexpr (radix == 16) {  // four by four
    for (int r = 0; r < 4; ++r) transform(z[r], z[r + 4], z[r + 8], z[r + 12]);
    z[5] = turn(z[5], kC22, kS22);
    z[9] = kRootHalf * (z[9] + rotate(z[9]));
    z[13] = turn(z[13], kS22, kC22);
    z[6] = kRootHalf * (z[6] + rotate(z[6]));
    z[10] = rotate(z[10]);
    z[14] = kRootHalf * (rotate(z[14]) - z[14]);
    z[7] = turn(z[7], kS22, kC22);
    z[11] = kRootHalf * (rotate(z[11]) - z[11]);
    z[15] = turn(z[15], -kC22, -kS22);
    Value sorted[16];
    for (int i = 0; i < 4; ++i) {
      transform<4>(z + 4 * i);
      for (int r = 0; r < 4; ++r) sorted[i + 4 * r] = z[4 * i + r];
    }
    for (int i = 0; i < 16; ++i) z[i] = sorted[i];
  }
}

// Radices of all but the last pass; empty if the length has no passes.
template <int... first>
std::vector<int> find_radices(Index length, Radices<first...>) {
  for (const int radix : {first...}) {
    Index middle = length / kLast / radix;
    if (middle * kLast * radix != length || (middle & (middle - 1)) || middle < 1) continue;
    std::vector<int> radices = {radix};
    for (; middle % 4 == 0; middle /= 4) radices.push_back(4);
    if (middle == 2) radices.push_back(2);
    return radices;
  }
  return {};
}

bool has_passes(Index length) { return !find_radices(length, kFirst).empty(); }

struct Transform {
  Transform(Index length, Index hop, Line<const float> window);

  template <int radix>
  [[gnu::noinline]] void first_pass(int lane);  // every one has the registers for itself
  template <int radix>
  void middle_pass(Index size);
  void last_pass(Float weight, Float* power);
  void gather(const float* plane, Index n_pulses, Index start, float* to) const;
  template <int... radix>
  void add_power(int lane, Float weight, Float* power, Radices<radix...>);

  Index length, hop, spread;  // a column is one pulse further in the gathered pulses
  Line<const float> window;
  std::vector<int> radices;
  std::vector<float> cosine, sine;  // factors exp(-j 2 pi n / K)
  std::vector<Index> order;         // where the power of bins in ascending order lies
  std::vector<Index> place;
  std::vector<float> pulses_re, pulses_im;
  std::vector<Value> values;
};

Transform::Transform(Index length, Index hop, Line<const float> window)
    : length(length),
      hop(hop),
      spread(kLanes + (length - 1) / hop + 1),
      window(window),
      radices(find_radices(length, kFirst)),
      order(length),
      pulses_re(std::min(hop, length) * spread),
      pulses_im(pulses_re.size()),
      values(length) {
  const double step = 6.283185307179586 / static_cast<double>(length);
  for (Index n = 0; n < length; ++n) {
    cosine.push_back(static_cast<float>(std::cos(step * static_cast<double>(n))));
    sine.push_back(static_cast<float>(std::sin(step * static_cast<double>(n))));
    place.push_back(n % hop * spread + n / hop);
  }
  std::vector<Index> bins = {0};
  const auto append = [&bins](Index weight, Index radix) {
    std::vector<Index> longer;
    for (const Index bin : bins)
      for (Index digit = 0; digit < radix; ++digit) longer.push_back(bin + weight * digit);
    bins = longer;
  };
  Index weight = radices[0];
  for (std::size_t i = 1; i < radices.size(); weight *= radices[i++]) append(weight, radices[i]);
  append(1, radices[0]);
  append(weight, kLast);
  for (Index i = 0; i < length; ++i) order[(bins[i] + length / 2) % length] = i * kWidth;
}

// Pulses of a bin by their remainder modulo hop: columns then lie side by side. Outside the recording they are zero.
void Transform::gather(const float* plane, Index n_pulses, Index start, float* to) const {
  for (Index remainder = 0; remainder < std::min(hop, length); ++remainder, to += spread) {
    const Index first = start + remainder;
    const bool inside = first >= 0 && first + hop * (spread - 1) < n_pulses;
    if (inside && hop == 1) {
      std::copy(plane + first, plane + first + spread, to);
    } else if (inside) {
      for (Index step = 0; step < spread; ++step) to[step] = plane[first + step * hop];
    } else {
      for (Index step = 0; step < spread; ++step) {
        const Index i = first + step * hop;
        to[step] = 0 <= i && i < n_pulses ? plane[i] : 0.0f;
      }
    }
  }
}

template <int radix>
void Transform::first_pass(int lane) {
  const Index n = length / radix;
  const float *re = pulses_re.data() + lane, *im = pulses_im.data() + lane;
  const float *cosine = this->cosine.data(), *sine = this->sine.data(), *weight = window.data;
  const Index* at = place.data();
  Value* to = values.data();
  for (Index p = 0; p < n; ++p) {
    Value z[radix];
    for (int i = 0; i < radix; ++i) {
      const Index m = p + i * n;
      z[i] = {weight[m] * load<Float>(re + at[m]), weight[m] * load<Float>(im + at[m])};
    }
    transform<radix>(z);
    *to++ = z[0];
    for (int i = 1; i < radix; ++i) *to++ = turn(z[i], cosine[i * p], sine[i * p]);
  }
}

template <int radix>
void Transform::middle_pass(Index size) {  // of blocks of ``size`` runs
  const Index run = radices[0], step = length / size, apart = size / radix * run;
  for (Index begin = 0; begin < length; begin += size * run) {
    for (Index p = 0; p < size / radix; ++p) {
      for (Index i = begin + p * run; i < begin + (p + 1) * run; ++i) {
        Value z[radix];
        for (int k = 0; k < radix; ++k) z[k] = values[i + k * apart];
        transform<radix>(z);
        values[i] = z[0];
        for (int k = 1; k < radix; ++k) values[i + k * apart] = turn(z[k], cosine[k * p * step], sine[k * p * step]);
      }
    }
  }
}

void Transform::last_pass(Float weight, Float* power) {
  const Index run = radices[0];
  const Value* from = values.data();
  for (Index begin = 0; begin < length; begin += kLast * run, from += (kLast - 1) * run) {
    for (Index first = 0; first < run; ++first, ++from, power += kLast) {
      Value z[kLast];
      for (int i = 0; i < kLast; ++i) z[i] = from[i * run];
      transform<kLast>(z);
      for (int i = 0; i < kLast; ++i) {
        power[i] = doppelgait::fused(weight, doppelgait::fused(z[i].re, z[i].re, z[i].im * z[i].im), power[i]);
      }
    }
  }
}

// Adds the weighted power of columns from ``lane`` on.
template <int... radix>
void Transform::add_power(int lane, Float weight, Float* power, Radices<radix...>) {
  ((radix == radices[0] ? first_pass<radix>(lane) : void()), ...);
  Index size = length / radices[0];
  for (std::size_t i = 1; i < radices.size(); size /= radices[i++]) {
    radices[i] == 4 ? middle_pass<4>(size) : middle_pass<2>(size);
  }
  last_pass(weight, power);
}

// mu_(j,k) = sum over n of g_(j,n) |sum over m of w_m Y_(i_j + m - h, n) exp(-j 2 pi k m / K)|^2, Doppler bins in
// ascending order; g_(j,n) is the share of bin n's cell (n - 1/2 to n + 1/2) between low_j and high_j (E-24, E-27).
void gated_signature(Plane<float> re, Plane<float> im, Index n_pulses, Index first_pulse, Index hop,
                     Line<const float> window, Line<const double> low, Line<const double> high, Rows<float> out) {
  require_shape(re.count, re.width, "two planes of one shape are needed", im);
  require(n_pulses >= 0 && n_pulses <= re.width, "there are fewer pulses");
  require(window.size == out.width && has_passes(out.width),
          "the window must be as long as the transform, which must have passes");
  require(low.size == out.count && high.size == out.count, "every column needs both edges of its gate");
  const double reach = static_cast<double>(hop) * static_cast<double>(out.count + out.width + 2 * kLanes);
  require(hop >= 1 && std::abs(static_cast<double>(first_pulse)) + reach <= 1e18,
          "hop and first pulse must be numbers of pulses");
  Transform transform(out.width, hop, window);
  const auto n_bins = static_cast<double>(re.count);
  const Index* order = transform.order.data();
  std::vector<Float> power(kGroups * out.width);
  for (Index block = 0; block < out.count; block += kLanes) {
    const Index count = std::min<Index>(kLanes, out.count - block);
    const auto [low_min, low_max] = std::minmax_element(&low[block], &low[block] + count);
    const auto [high_min, high_max] = std::minmax_element(&high[block], &high[block] + count);
    std::fill(power.begin(), power.end(), Float{});
    const auto first = static_cast<Index>(std::min(n_bins, std::max(0.0, std::floor(*low_min - 0.5) + 1.0)));
    const auto stop = static_cast<Index>(std::min(n_bins, std::max(0.0, std::ceil(*high_max + 0.5))));
    for (Index n = first; n < stop; ++n) {
      transform.gather(re[n], n_pulses, first_pulse + block * hop, transform.pulses_re.data());
      transform.gather(im[n], n_pulses, first_pulse + block * hop, transform.pulses_im.data());
      const double below = static_cast<double>(n) - 0.5, above = below + 1.0;
      float weights[kLanes];  // every column has its own gate
      for (Index lane = 0; lane < kLanes; ++lane) {
        const Index j = block + std::min(lane, count - 1);
        weights[lane] = static_cast<float>(std::max(0.0, std::min(high[j], above) - std::max(low[j], below)));
      }
      for (int group = 0; group < kGroups; ++group) {
        transform.add_power(group * kWidth, load<Float>(weights + group * kWidth), power.data() + group * out.width,
                            kFirst);
      }
    }
    for (Index lane = 0; lane < count; ++lane) {
      const float* from = reinterpret_cast<float*>(power.data() + lane / kWidth * out.width) + lane % kWidth;
      float* to = out[block + lane];
      for (Index k = 0; k < out.width; ++k) to[k] = from[order[k]];
    }
  }
}

}  // namespace

void bind(nb::module_& module) {
  define(module, "gated_signature", &gated_signature);
  define(module, "has_passes", &has_passes);
}

}  // namespace doppelgait::signature

// Elementary functions of arrays, where NumPy's last digits depend on the processor; errors of at most 3 units in the
// last place.
#include <cfloat>

#include "arrays.hpp"

namespace doppelgait::elementary {
namespace {

using Numbers = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;  // of any shape
using Result = nb::ndarray<nb::numpy, double>;
constexpr double kMaxAngle = 1048576.0, kLn10 = 2.30258509299404568402, kLn10Low = -2.1707562233822494e-16;
constexpr double kLog2High = 3.01029995663611771306e-01, kLog2Low = 3.694239077158931e-13;  // of base 10
constexpr std::uint64_t kSign = std::uint64_t{1} << 63;

Result allocate(const Numbers& like) {
  auto* values = new double[like.size()];
  const nb::capsule owner(values, [](void* memory) noexcept { delete[] static_cast<double*>(memory); });
  return Result(values, like.ndim(), reinterpret_cast<const std::size_t*>(like.shape_ptr()), owner);
}

template <typename V>
V magnitude(V x) {
  return bits_of<V>(bits_of<Bits<V>>(x) & ~kSign);
}

// A number with the other sign where another one is negative.
template <typename V>
V flip(V x, V by) {
  return bits_of<V>(bits_of<Bits<V>>(x) ^ (bits_of<Bits<V>>(by) & kSign));
}

// Cosine or sine of an angle: the product of the first term of pi / 2 with a number of quarter turns is exact.
template <bool of_sine, typename V>
V rotate(V angle) {
  const V zero{}, size = magnitude(angle), quarter = round_even(size * 0.636619772367581343);
  V rest = fused(-quarter, zero + 1.57079632673412561417, size), cosine, sine;
  rest = fused(-quarter, zero + 6.077100506506192e-11, rest);
  phasor(fused(-quarter, zero + 3.5215598651832e-27, rest), quarter, cosine, sine);
  return of_sine ? flip(sine, angle) : cosine;
}

template <typename V>
V power_of_ten(V x) {
  const V zero{}, rounded = x * (1.0 / (kLog2High + kLog2Low)) + kRounder, whole = rounded - kRounder;
  const V rest = fused(whole, zero - kLog2Low, fused(whole, zero - kLog2High, x)), r = rest * kLn10;
  const V error = fused(rest, zero + kLn10Low, fused(rest, zero + kLn10, -r));
  return scale(1.0 + (fused(r * r, exponential_bend(r), error) + r), rounded);
}

template <typename V>
V decimal_logarithm(V x) {
  V exponent, zero{};
  const V fraction = logarithm(x, exponent), low = fused(exponent, zero + kLog2Low, fraction * 1.098319650216765e-17);
  return fused(exponent, zero + kLog2High, fused(fraction, zero + 1.0 / kLn10, low));
}

template <typename V>
V arctangent(V y, V x) {
  return flip(angle_of(magnitude(y), x), y);
}

// Binds a function of numbers side by side; C's function computes what is outside of `least` to `most`, or no number.
template <typename Lanes>
void define_map(nb::module_& module, const char* name, double least, double most, double (*exact)(double),
                Lanes lanes) {
  const auto map = [=](const Numbers& numbers) {
    const Result result = allocate(numbers);
    const double* from = numbers.data();
    double* to = result.data();
    const nb::gil_scoped_release unlocked;
    side_by_side(static_cast<Index>(numbers.size()), [&](auto zero, Index at) {
      const auto x = load<decltype(zero)>(from + at);
      store(to + at, lanes(x));
      if (!any((x < least) | (x > most) | (x != x))) return;
      for (Index i = at; i < at + static_cast<Index>(sizeof x / sizeof *to); ++i) {
        if (!(from[i] >= least && from[i] <= most)) to[i] = exact(from[i]);
      }
    });
    return result;
  };
  module.def(name, map, nb::arg("numbers"));
}

Result arctangents(const Numbers& y, const Numbers& x) {
  require(y.size() == x.size(), "sides differ in size");
  const Result result = allocate(y);
  side_by_side(static_cast<Index>(y.size()), [&](auto zero, Index at) {
    using V = decltype(zero);
    store(result.data() + at, arctangent(load<V>(y.data() + at), load<V>(x.data() + at)));
  });
  return result;
}

}  // namespace

void bind(nb::module_& module) {
  const auto arccosine = [](auto x) { return arctangent(square_root((1.0 - x) * (1.0 + x)), x); };
  const auto arcsine = [](auto x) { return arctangent(x, square_root((1.0 - x) * (1.0 + x))); };
  const auto power = [](double x) { return std::pow(10.0, x); };
  define_map(module, "arccosine", -1.0, 1.0, std::acos, arccosine);
  define_map(module, "arcsine", -1.0, 1.0, std::asin, arcsine);
  define_map(module, "cosine", -kMaxAngle, kMaxAngle, std::cos, [](auto x) { return rotate<false>(x); });
  define_map(module, "decimal_logarithm", DBL_MIN, DBL_MAX, std::log10, [](auto x) { return decimal_logarithm(x); });
  define_map(module, "exponential", -699.0, 700.0, std::exp, [](auto x) { return exponential(x); });
  define_map(module, "logarithm", DBL_MIN, DBL_MAX, std::log, [](auto x) { return logarithm(x); });
  define_map(module, "power_of_ten", -300.0, 300.0, power, [](auto x) { return power_of_ten(x); });
  define_map(module, "sine", -kMaxAngle, kMaxAngle, std::sin, [](auto x) { return rotate<true>(x); });
  module.def("arctangent", &arctangents, nb::arg("y"), nb::arg("x"));
}

}  // namespace doppelgait::elementary

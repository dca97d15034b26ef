// Arrays of Python as plain pointers. Functions that compute take these views and know nothing of Python.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <cmath>
#include <complex>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <type_traits>

namespace doppelgait {

namespace nb = nanobind;
using Index = std::int64_t;
using Complex = std::complex<float>;

// Rows of contiguous numbers, a fixed distance apart.
template <typename T>
struct Rows {
  T* data;
  Index count, width, stride;

  T* operator[](Index row) const { return data + row * stride; }
  Rows slice(Index first, Index stop) const { return {data + first * stride, stop - first, width, stride}; }
};

// Rows to read that may be a part of longer ones.
template <typename T>
struct Plane : Rows<const T> {};

template <typename T>
struct Line {
  T* data;
  Index size;

  T& operator[](Index i) const { return data[i]; }
};

// Read-only arrays are converted or copied where type or layout differ, arrays that are written never are.
template <typename T>
using In1 = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
template <typename T>
using In2 = nb::ndarray<const T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
template <typename T>
using In3 = nb::ndarray<const T, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
template <typename T>
using Out1 = nb::ndarray<T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
template <typename T>
using Out2 = nb::ndarray<T, nb::ndim<2>, nb::device::cpu>;
template <typename T>
using Out3 = nb::ndarray<T, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
template <typename T>
using Planes = nb::ndarray<const T, nb::ndim<2>, nb::device::cpu>;

template <typename Array>
auto view_line(const Array& array) {
  using T = std::remove_pointer_t<decltype(array.data())>;
  return Line<T>{array.data(), static_cast<Index>(array.shape(0))};
}

template <typename Array>
auto view_rows(const Array& array) {
  using T = std::remove_pointer_t<decltype(array.data())>;
  const auto count = static_cast<Index>(array.shape(0)), width = static_cast<Index>(array.shape(1));
  if (width > 1 && count > 0 && array.stride(1) != 1) throw std::invalid_argument("rows must be contiguous");
  return Rows<T>{array.data(), count, width, array.stride(0)};
}

// The bin next to a place on the Doppler axis, which goes round.
inline Index nearest_bin(double place) {
  return std::abs(place) < 1e15 ? static_cast<Index>(std::nearbyint(place)) : 0;
}
inline Index go_round(Index bin, Index n_bins) { return (bin % n_bins + n_bins) % n_bins; }

inline void require(bool fits, const char* otherwise) {
  if (!fits) throw std::invalid_argument(otherwise);
}

// What a function does without Python's lock.
using Unlocked = nb::call_guard<nb::gil_scoped_release>;

// How Python gives an argument of a function that computes.
template <typename T>
struct Argument {
  using type = T;
  static constexpr bool is_written = false;
  static T view(T value) { return value; }
};
template <typename T>
struct Argument<Line<T>> {
  using type = std::conditional_t<std::is_const_v<T>, In1<std::remove_const_t<T>>, Out1<T>>;
  static constexpr bool is_written = !std::is_const_v<T>;
  static Line<T> view(const type& array) { return view_line(array); }
};
template <typename T>
struct Argument<Rows<T>> {
  using type = std::conditional_t<std::is_const_v<T>, In2<std::remove_const_t<T>>, Out2<T>>;
  static constexpr bool is_written = !std::is_const_v<T>;
  static Rows<T> view(const type& array) { return view_rows(array); }
};
template <typename T>
struct Argument<Plane<T>> {
  using type = Planes<T>;
  static constexpr bool is_written = false;
  static Plane<T> view(const type& array) { return {view_rows(array)}; }
};
template <typename T>
struct Argument<std::optional<Rows<const T>>> {
  using type = std::optional<In2<T>>;
  static constexpr bool is_written = false;
  static std::optional<Rows<const T>> view(const type& array) {
    return array ? std::optional(view_rows(*array)) : std::nullopt;
  }
};

template <typename T>
struct Argument<std::optional<Plane<T>>> {
  using type = std::optional<Planes<T>>;
  static constexpr bool is_written = false;
  static std::optional<Plane<T>> view(const type& array) {
    return array ? std::optional(Plane<T>{view_rows(*array)}) : std::nullopt;
  }
};

template <typename T>
auto name_argument(const char* name) {
  if constexpr (Argument<T>::is_written) {
    return nb::arg(name).noconvert();
  } else {
    return nb::arg(name);
  }
}

// Binds a function of lines, rows and numbers; it runs without Python's lock.
template <typename Result, typename... Args, typename... Names>
void define(nb::module_& module, const char* name, Result (*function)(Args...), Names... names) {
  module.def(
      name,
      [function](const typename Argument<Args>::type&... args) { return function(Argument<Args>::view(args)...); },
      name_argument<Args>(names)..., Unlocked());
}

}  // namespace doppelgait

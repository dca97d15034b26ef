// Arrays of Python as plain pointers. Functions that compute take these views and know nothing of Python.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>

#include <algorithm>
#include <array>
#include <complex>
#include <limits>
#include <optional>
#include <stdexcept>
#include <vector>

#include "elementary.hpp"

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
  Rows<const T> read() const { return {data, count, width, stride}; }
  Rows slice(Index first, Index stop) const { return {data + first * stride, stop - first, width, stride}; }
};

// Rows to read that may be a part of longer ones.
template <typename T>
struct Plane : Rows<const T> {};

// Rows of points, whose coordinates lie behind each other: three dimensions in Python.
template <typename T>
struct Points : Rows<T> {};

template <typename T>
struct Line {
  T* data;
  Index size;

  T& operator[](Index i) const { return data[i]; }
};

// The bin next to a place on the Doppler axis, which goes round.
inline Index nearest_bin(double place) {
  return std::abs(place) < 1e15 ? static_cast<Index>(std::nearbyint(place)) : 0;
}
inline Index go_round(Index bin, Index n_bins) { return (bin % n_bins + n_bins) % n_bins; }

inline void require(bool fits, const char* otherwise) {
  if (!fits) throw std::invalid_argument(otherwise);
}

// Requires some rows to have one shape.
template <typename... Some>
void require_shape(Index count, Index width, const char* otherwise, const Some&... rows) {
  require(((rows.count == count && rows.width == width) && ...), otherwise);
}

// How Python gives an argument of a function that computes. Read-only arrays are converted or copied where type or
// layout differ, arrays that are written never are.
template <typename T>
struct Argument {
  using type = T;
  static constexpr bool is_written = false;
  static T view(T value) { return value; }
};

template <typename T>
struct Argument<Line<T>> {
  using type = nb::ndarray<T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
  static constexpr bool is_written = !std::is_const_v<T>;
  static Line<T> view(const type& array) { return {array.data(), static_cast<Index>(array.shape(0))}; }
};

template <typename T>
using Strided = nb::ndarray<T, nb::ndim<2>, nb::device::cpu>;

template <typename T>
struct Argument<Rows<T>> {
  using contiguous = nb::ndarray<T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
  using type = std::conditional_t<std::is_const_v<T>, contiguous, Strided<T>>;
  static constexpr bool is_written = !std::is_const_v<T>;

  template <typename Array>
  static Rows<T> view(const Array& array) {
    const auto count = static_cast<Index>(array.shape(0)), width = static_cast<Index>(array.shape(1));
    require(width <= 1 || count == 0 || array.stride(1) == 1, "rows must be contiguous");
    return {array.data(), count, width, array.stride(0)};
  }
};

template <typename T>
struct Argument<Plane<T>> {
  using type = Strided<const T>;
  static constexpr bool is_written = false;
  static Plane<T> view(const type& array) { return {Argument<Rows<const T>>::view(array)}; }
};

template <typename T>
struct Argument<Points<T>> {
  using type = nb::ndarray<T, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
  static constexpr bool is_written = !std::is_const_v<T>;
  static Points<T> view(const type& array) {
    const auto width = static_cast<Index>(array.shape(1) * array.shape(2));
    return {{array.data(), static_cast<Index>(array.shape(0)), width, width}};
  }
};

template <typename T>
struct Argument<std::optional<T>> {
  using type = std::optional<typename Argument<T>::type>;
  static constexpr bool is_written = Argument<T>::is_written;
  static std::optional<T> view(const type& array) {
    return array ? std::optional(Argument<T>::view(*array)) : std::nullopt;
  }
};

template <typename T, std::size_t n>
struct Argument<std::array<T, n>> {
  using type = std::array<typename Argument<T>::type, n>;
  static constexpr bool is_written = Argument<T>::is_written;
  static std::array<T, n> view(const type& arrays) {
    std::array<T, n> views;
    for (std::size_t i = 0; i < n; ++i) views[i] = Argument<T>::view(arrays[i]);
    return views;
  }
};

template <typename T>
auto annotate() {
  if constexpr (Argument<T>::is_written) {
    return nb::arg().noconvert();
  } else {
    return nb::arg();
  }
}

template <typename Result, typename... Args>
void define_one(nb::module_& module, const char* name, Result (*function)(Args...)) {
  module.def(
      name,
      [function](const typename Argument<Args>::type&... args) { return function(Argument<Args>::view(args)...); },
      annotate<Args>()..., nb::call_guard<nb::gil_scoped_release>());
}

// Binds functions of lines, rows and numbers under one name, by their types; they run without Python's lock.
template <typename... Functions>
void define(nb::module_& module, const char* name, Functions... functions) {
  (define_one(module, name, functions), ...);
}

}  // namespace doppelgait

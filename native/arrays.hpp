// Arrays of Python as plain pointers. Functions that compute take these views and know nothing of Python.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <complex>
#include <cstdint>
#include <stdexcept>

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

inline void require(bool fits, const char* otherwise) {
  if (!fits) throw std::invalid_argument(otherwise);
}

// What a function does without Python's lock.
using Unlocked = nb::call_guard<nb::gil_scoped_release>;

}  // namespace doppelgait

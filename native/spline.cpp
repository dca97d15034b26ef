#include "arrays.hpp"

namespace doppelgait::spline {

void bind(nb::module_&) {}

}  // namespace doppelgait::spline

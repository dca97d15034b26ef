#include "arrays.hpp"

namespace doppelgait::images {

void bind(nb::module_&) {}

}  // namespace doppelgait::images

#include "arrays.hpp"

namespace doppelgait::planes {

void bind(nb::module_&) {}

}  // namespace doppelgait::planes

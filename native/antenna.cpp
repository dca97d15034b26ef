#include "arrays.hpp"

namespace doppelgait::antenna {

void bind(nb::module_&) {}

}  // namespace doppelgait::antenna

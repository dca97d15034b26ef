#include "arrays.hpp"

namespace doppelgait::columns {

void bind(nb::module_&) {}

}  // namespace doppelgait::columns

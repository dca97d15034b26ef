#include "arrays.hpp"

namespace doppelgait::robust {

void bind(nb::module_&) {}

}  // namespace doppelgait::robust

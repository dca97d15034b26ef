#include "arrays.hpp"

namespace doppelgait::features {

void bind(nb::module_&) {}

}  // namespace doppelgait::features

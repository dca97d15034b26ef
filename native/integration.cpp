#include "arrays.hpp"

namespace doppelgait::integration {

void bind(nb::module_&) {}

}  // namespace doppelgait::integration

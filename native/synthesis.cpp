#include "arrays.hpp"

namespace doppelgait::synthesis {

void bind(nb::module_&) {}

}  // namespace doppelgait::synthesis

#include "arrays.hpp"

namespace doppelgait::fluctuation {

void bind(nb::module_&) {}

}  // namespace doppelgait::fluctuation

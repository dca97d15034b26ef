#include "arrays.hpp"

namespace doppelgait::stretch {

void bind(nb::module_&) {}

}  // namespace doppelgait::stretch

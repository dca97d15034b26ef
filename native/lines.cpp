#include "arrays.hpp"

namespace doppelgait::lines {

void bind(nb::module_&) {}

}  // namespace doppelgait::lines

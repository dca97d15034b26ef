#include "arrays.hpp"

namespace doppelgait::signature {

void bind(nb::module_&) {}

}  // namespace doppelgait::signature

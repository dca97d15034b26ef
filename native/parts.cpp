#include "arrays.hpp"

namespace doppelgait::parts {

void bind(nb::module_&) {}

}  // namespace doppelgait::parts

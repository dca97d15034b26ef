#include "arrays.hpp"

namespace doppelgait::periodicity {

void bind(nb::module_&) {}

}  // namespace doppelgait::periodicity

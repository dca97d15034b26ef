#include "arrays.hpp"

namespace doppelgait::responses {

void bind(nb::module_&) {}

}  // namespace doppelgait::responses

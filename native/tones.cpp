#include "arrays.hpp"

namespace doppelgait::tones {

void bind(nb::module_&) {}

}  // namespace doppelgait::tones

#include "arrays.hpp"

namespace doppelgait::cadence {

void bind(nb::module_&) {}

}  // namespace doppelgait::cadence

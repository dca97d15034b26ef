#include "arrays.hpp"

namespace doppelgait::occlusion {

void bind(nb::module_&) {}

}  // namespace doppelgait::occlusion

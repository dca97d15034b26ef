// One module for every level of processor; doppelgait._core chooses at import.
#include "arrays.hpp"

namespace doppelgait {

namespace antenna {
void bind(nb::module_&);
}
namespace cadence {
void bind(nb::module_&);
}
namespace columns {
void bind(nb::module_&);
}
namespace features {
void bind(nb::module_&);
}
namespace fluctuation {
void bind(nb::module_&);
}
namespace images {
void bind(nb::module_&);
}
namespace integration {
void bind(nb::module_&);
}
namespace lines {
void bind(nb::module_&);
}
namespace noise {
void bind(nb::module_&);
}
namespace occlusion {
void bind(nb::module_&);
}
namespace parts {
void bind(nb::module_&);
}
namespace periodicity {
void bind(nb::module_&);
}
namespace planes {
void bind(nb::module_&);
}
namespace responses {
void bind(nb::module_&);
}
namespace robust {
void bind(nb::module_&);
}
namespace signature {
void bind(nb::module_&);
}
namespace spline {
void bind(nb::module_&);
}
namespace stretch {
void bind(nb::module_&);
}
namespace synthesis {
void bind(nb::module_&);
}
namespace tones {
void bind(nb::module_&);
}

// The best level that this processor and its system can run: 1, 2 or 3.
int find_processor_level() {
#if defined(__x86_64__)
  __builtin_cpu_init();
  if (__builtin_cpu_supports("x86-64-v4")) return 3;
  if (__builtin_cpu_supports("x86-64-v3")) return 2;
#endif
  return 1;
}

}  // namespace doppelgait

NB_MODULE(DOPPELGAIT_MODULE, module) {
  module.attr("LEVEL") = DOPPELGAIT_LEVEL;
  module.def("find_processor_level", &doppelgait::find_processor_level);
  doppelgait::antenna::bind(module);
  doppelgait::cadence::bind(module);
  doppelgait::columns::bind(module);
  doppelgait::features::bind(module);
  doppelgait::fluctuation::bind(module);
  doppelgait::images::bind(module);
  doppelgait::integration::bind(module);
  doppelgait::lines::bind(module);
  doppelgait::noise::bind(module);
  doppelgait::occlusion::bind(module);
  doppelgait::parts::bind(module);
  doppelgait::periodicity::bind(module);
  doppelgait::planes::bind(module);
  doppelgait::responses::bind(module);
  doppelgait::robust::bind(module);
  doppelgait::signature::bind(module);
  doppelgait::spline::bind(module);
  doppelgait::stretch::bind(module);
  doppelgait::synthesis::bind(module);
  doppelgait::tones::bind(module);
}

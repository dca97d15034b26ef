// One module for every level of processor; doppelgait._core chooses at import.
#include "arrays.hpp"

#if defined(__x86_64__)
#include <cpuid.h>
#endif

namespace doppelgait {

// Every topic: its namespace binds its functions.
// clang-format off
#define DOPPELGAIT_TOPICS(DO) \
  DO(amplitudes) DO(cadence) DO(columns) DO(elementary) DO(lines) DO(motions) DO(noise) DO(occlusion) DO(periodicity) \
  DO(planes) DO(rays) DO(responses) DO(robust) DO(signature) DO(synthesis) DO(tones)
// clang-format on
#define DOPPELGAIT_DECLARE(topic) \
  namespace topic {               \
  void bind(nb::module_&);        \
  }
#define DOPPELGAIT_BIND(topic) topic::bind(module);

DOPPELGAIT_TOPICS(DOPPELGAIT_DECLARE)
void bind(nb::module_& module) { DOPPELGAIT_TOPICS(DOPPELGAIT_BIND) }

// The best level that this processor and its system can run: 1, 2 or 3.
int find_processor_level() {
#if defined(__x86_64__)
  unsigned a, b, c, d, features, extended, more = 0;
  if (!__get_cpuid(1, &a, &b, &features, &d) || !__get_cpuid_count(7, 0, &a, &extended, &c, &d)) return 1;
  __get_cpuid(0x80000001, &a, &b, &more, &d);
  constexpr unsigned v3 = 1u << 12 | 1u << 22 | 1u << 27 | 1u << 28 | 1u << 29;  // FMA, MOVBE, OSXSAVE, AVX, F16C
  constexpr unsigned v3_extended = 1u << 3 | 1u << 5 | 1u << 8;                  // BMI1, AVX2, BMI2
  constexpr unsigned v4 = 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31;  // AVX-512 F, DQ, CD, BW, VL
  if ((features & v3) != v3 || (extended & v3_extended) != v3_extended || !(more & 1u << 5)) return 1;
  unsigned saved, high;  // registers that the system keeps
  __asm__("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
  if ((saved & 0x06) != 0x06) return 1;
  return (extended & v4) == v4 && (saved & 0xE6) == 0xE6 ? 3 : 2;
#else
  return 1;
#endif
}

}  // namespace doppelgait

NB_MODULE(DOPPELGAIT_MODULE, module) {
  module.attr("LEVEL") = DOPPELGAIT_LEVEL;
  module.def("find_processor_level", &doppelgait::find_processor_level);
  doppelgait::bind(module);
}

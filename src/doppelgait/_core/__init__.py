"""Native code, for the level of this processor.

``native`` is the module of the best level: on x86-64 level 1 (v2), 2 (v3: AVX2 and fused multiply-add) or 3 (v4:
AVX-512). Levels 2 and 3 make the same bytes. ``DOPPELGAIT_LEVEL`` chooses a lower one, for tests.
"""

import os
from typing import Any

try:
    from doppelgait._core import _level1  # type: ignore[attr-defined]
except ImportError as error:
    raise ImportError(
        "doppelgait's native code is not built for this Python: install doppelgait again (pip install, or make in a "
        f"checkout); it needs a wheel or a C++ compiler ({error})"
    ) from None

native: Any = _level1
LEVEL = min(_level1.find_processor_level(), {"1": 1, "2": 2}.get(os.environ.get("DOPPELGAIT_LEVEL", ""), 3))
if LEVEL == 3:
    from doppelgait._core import _level3  # type: ignore[attr-defined]

    native = _level3
elif LEVEL == 2:
    from doppelgait._core import _level2  # type: ignore[attr-defined]

    native = _level2

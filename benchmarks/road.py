"""The road from a scene file to features: functions and modules of doppelgait that a run visits.

``python benchmarks/road.py [--list]`` simulates a walking person and a trotting dog in front of the X4 and analyses the
recording by truth, twice: the second time is counted, so that what is only loaded or compiled does not count. Kernels
are compiled and do not show.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import doppelgait as dg

PACKAGE = str(Path(dg.__file__).parent)


def run() -> None:
    """Simulate a scene of two targets and analyse the recording."""
    walk = dg.motion.boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=5.0)
    trot = dg.motion.quadruped_gait(speed_mps=1.6, duration_s=5.0)
    targets = [dg.Target(walk, label="human"), dg.Target(trot, label="dog", range_m=4.0, aspect_deg=20.0)]
    scene = dg.Scene(targets=targets, radar_position_m=(0, 0, 1))
    recording = dg.simulate(scene, dg.Radar.preset("x4"), rng=dg.rng(2018))
    dg.analyze(recording, gate="truth")


def visited() -> set[CodeType]:
    """Return the code of every function of doppelgait that one run calls."""
    found: set[CodeType] = set()

    def look(frame: FrameType, event: str, argument: Any) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(PACKAGE) and code.co_name != "<module>":
            found.add(code)

    run()
    sys.setprofile(look)
    try:
        run()
    finally:
        sys.setprofile(None)
    return {code for code in found if not code.co_name.startswith("<")}


def main() -> None:
    """Print how many functions and modules a run visits."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--list", action="store_true", help="name them")
    arguments = parser.parse_args()
    found = visited()
    print(f"{len(found)} functions in {len({code.co_filename for code in found})} modules")
    if arguments.list:
        for code in sorted(found, key=lambda code: (code.co_filename, code.co_firstlineno)):
            print(f"  {Path(code.co_filename).relative_to(PACKAGE)}:{code.co_firstlineno} {code.co_qualname}")


if __name__ == "__main__":
    main()

"""Processor time and memory of fresh processes."""

from __future__ import annotations

import math
import os
import resource
import subprocess
import sys
from typing import Any

from clock import timing

RECORDING = (
    "import doppelgait as dg; from doppelgait.processing import Analysis, Gate, signature; "
    "walk = dg.motion.boulic_walk(duration_s=5.0); scene = dg.Scene([dg.Target(walk, label='human')]); "
    "recording = dg.simulate(scene, dg.Radar.preset('x4'), rng=dg.rng(1)); "
)
SIGNATURE = (
    "gate = Gate.from_truth(recording.truth[0], recording.baseband['slow_time'].values, Analysis()); "
    "signature(recording.baseband, gate, Analysis(), wavelength_m=recording.radar.wavelength_m)"
)
PROGRAMS = {
    "python": "pass",
    "import doppelgait": "import doppelgait",
    "doppelgait --help": "import sys; sys.argv = ['doppelgait', '--help']; from doppelgait.cli.app import main; main()",
    "libraries alone": "import xarray, pydantic, scipy.fft, scipy.interpolate",
    "first signature": RECORDING + SIGNATURE,
    "first features": RECORDING + "dg.analyze(recording, gate='truth')",
}
"""What a fresh interpreter runs."""

REPORT_PEAK = (
    "import atexit, os; "
    "atexit.register(lambda: os.path.exists('/proc/self/status') and os.write(2, next("
    "l for l in open('/proc/self/status', 'rb') if l.startswith(b'VmHWM')))); "
)
"""At its end a program writes its peak memory (Linux)."""


def measure_startup(rounds: int) -> dict[str, Any]:
    """Processor seconds and peak memory (MB) of every program, interleaved; a first of several rounds only warms up."""
    seconds: dict[str, list[float]] = {name: [] for name in PROGRAMS}
    peak_mb: dict[str, float] = {}
    for number in range(rounds):
        for name, program in PROGRAMS.items():
            spent_s, peak_mb[name] = run_fresh(program)
            if number or rounds == 1:
                seconds[name].append(spent_s)
    return {"cpu_s": {name: timing(values) for name, values in seconds.items()}, "peak_mb": peak_mb}


def run_fresh(program: str) -> tuple[float, float]:
    """User and system seconds, and peak resident memory in MB of 2^20 bytes, of a program in a fresh interpreter."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-c", REPORT_PEAK + program]
    # Modules are compiled once, as a user's are; where the variable is set that would be every time.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    peaks_mb = [float(line.split()[1]) / 1024 for line in done.stderr.splitlines() if line.startswith("VmHWM")]
    spent_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return spent_s, peaks_mb[-1] if peaks_mb else math.nan

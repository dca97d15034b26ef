"""Glasgow recordings of Ancortek radars as text.

The recordings "radar signatures of human activities", published by the University of Glasgow (F. Fioranelli et al.,
2019, DOI 10.5525/gla.researchdata.848). Four lines with centre frequency (Hz), sweep time (ms), samples per sweep and
bandwidth (Hz) come first, then one complex sample of the beat per line, such as ``2048+1998i``. The published MATLAB
program (``DataProcessingExample.m``) uses the positive frequencies of the transform of a sweep as ranges and mirrors
the Doppler axis: the phase increases with range.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from doppelgait.core.documents import CELL_BYTES, check_cost
from doppelgait.core.errors import RecordingError
from doppelgait.core.plugins import plugin
from doppelgait.core.readers import Limits
from doppelgait.radar.measured import label_sweeps, read_limited, split_rows
from doppelgait.radar.recording import Recording

HEAD_BYTES = 512
HEAD = {
    "centre frequency in Hz": Limits(1e6, 1e12),
    "sweep time in ms": Limits(1e-3, 1e4),
    "samples per sweep": Limits(2, 65_536),
    "bandwidth in Hz": Limits(0, 1e11),
}
"""Numbers of the head, one a line."""
MAX_BYTES = 2**29
VOLTS_PER_CODE = 1.0 / 4096
"""Volts per converter step; the middle code 2048 indicates 12 bits, and a full scale of 1 V is assumed."""


def sniff_glasgow(path: Path, head: bytes) -> bool:
    """Return whether a file begins with four numbers and a complex sample."""
    words = head[:HEAD_BYTES].split()
    if len(words) < 5 or not words[4].endswith(b"i") or b"." in words[2]:
        return False
    try:
        return all(float(word) >= 0 for word in words[:4]) and complex(words[4].decode("ascii")[:-1] + "j") is not None
    except ValueError:  # a word that is no number, or no ASCII
        return False


@plugin("radar_reader", "glasgow", sniff=sniff_glasgow, suffixes=(".dat",))
def read_glasgow(path: Path, *, conjugate: bool = True, range_stop_m: float | None = None) -> Recording:
    """Read an Ancortek text file, such as ``1P36A01R01.dat``.
    Every sweep is transformed to a row of range bins with a Hann window.
    """
    content = read_limited(path, MAX_BYTES)
    check_cost(path, CELL_BYTES * sum(map(content.count, (b"\n", b" ", b"\t", b"\r"))), RecordingError)
    words = content.decode("ascii", "replace").replace("i", "j").split()
    carrier_hz, sweep_ms, samples_per_sweep, bandwidth_hz = _read_head(path, words)
    if not bandwidth_hz:
        raise RecordingError(f"{path}: bandwidth 0 Hz is a continuous wave; only frequency sweeps are read")
    n_samples = int(samples_per_sweep)
    try:
        values = np.fromiter(map(complex, words[4:]), np.complex128, max(len(words) - 4, 0))
    except ValueError:
        raise RecordingError(_find_fault(path, content)) from None
    samples = split_rows(path, values, n_samples, "sweep") * VOLTS_PER_CODE
    return label_sweeps(
        path,
        samples,
        name="Ancortek FMCW radar",
        carrier_hz=carrier_hz,
        bandwidth_hz=bandwidth_hz,
        n_ranges=n_samples // 2,
        range_stop_m=range_stop_m,
        frames=(len(samples), 1, sweep_ms / 1e3, 1e3 / sweep_ms),
        sweep_s=sweep_ms / 1e3,
        volts_per_unit=VOLTS_PER_CODE,
        conjugate=conjugate,
        notes=[
            "sweeps are assumed to rise, without pauses; the centre frequency is assumed to be that of the band",
            f"levels: one step of the converter is taken as {VOLTS_PER_CODE:.4g} V",
        ],
    )


def _read_head(file: Path, words: list[str]) -> list[float]:
    numbers = []
    for number, (name, limits) in enumerate(HEAD.items()):
        word = words[number] if number < len(words) else ""
        try:
            value = float(word)
        except ValueError:
            value = float("nan")
        is_whole = name != "samples per sweep" or value % 1 == 0
        # a bandwidth of 0 is that of a continuous wave
        if not (limits.above < value <= limits.most or value == limits.above == 0) or not is_whole:
            raise RecordingError(
                f"{file}: line {number + 1} holds {word[:20]!r}; it must be the {name},{limits}"
                + ("" if is_whole else ", a whole number")
            )
        numbers.append(value)
    return numbers


def _find_fault(file: Path, content: bytes) -> str:
    """Describe the first word after the head that is no complex number."""
    lines = enumerate(content.decode("ascii", "replace").splitlines(), start=1)
    for number, word in [(number, word) for number, line in lines for word in line.split()][len(HEAD) :]:
        try:
            complex(word.replace("i", "j"))
        except ValueError:
            return f"{file}: line {number} holds {word[:20]!r}; it must be a complex number such as 2048+1998i"
    return f"{file}: holds a line that is no complex number"

"""Text files of radars: continuous-wave modules and Ancortek's frequency sweeps.

``NAME_RE.txt`` and ``NAME_IM.txt`` have one integer per line. Programs for 24 GHz Doppler modules
with a 12-bit converter write them: the module fills a buffer, sends it and starts again, so that
the samples are continuous within a burst only.

The recordings "radar signatures of human activities", published by the University of Glasgow (F. Fioranelli et al.,
2019, DOI 10.5525/gla.researchdata.848), have four lines with centre frequency (Hz), sweep time (ms), samples per sweep
and bandwidth (Hz), then one complex sample of the beat per line, such as ``2048+1998i``. The published MATLAB program
(``DataProcessingExample.m``) uses the positive frequencies of the transform of a sweep as ranges and mirrors the
Doppler axis: the phase increases with range.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt

from doppelgait.core.documents import CELL_BYTES, check_cost, read_document
from doppelgait.core.errors import RecordingError, warn_caller
from doppelgait.core.plugins import plugin, read_head
from doppelgait.core.readers import Limits
from doppelgait.radar.measured import (
    POSITIVE,
    Positive,
    label_measured,
    label_sweeps,
    make_radar,
    place_frames,
    split_rows,
)
from doppelgait.radar.recording import Recording

PARTS = ("_RE", "_IM")
BITS = 12
MID_CODE = 2 ** (BITS - 1)
MAX_CODES_BYTES = 2**26
"""Maximum size of a Doppler module's file: 64 MiB is over an hour at 3000 samples/s."""
CW_FRAME_M = (0.0, 10.0)
"""Nominal range interval, m, of a continuous-wave recording's single bin."""
HEAD_BYTES = 256
OTHER_WORD = re.compile(rb"(?<!\S)(?!(?:[0-3]?\d{1,3}|40[0-8]\d|409[0-5])(?!\S))\S+")
"""A word that is no integer from 0 to 4095."""


def sniff_cw_text(path: Path, head: bytes) -> bool:
    """Return whether a path is one of two continuous-wave text files, or their common stem."""
    try:
        heads = [read_head(name)[:HEAD_BYTES].split() for name in _find_pair(path)]
    except RecordingError:
        return False
    return any(words and all(map(bytes.isdigit, words)) for words in heads)


@plugin("radar_reader", "cw-text", sniff=sniff_cw_text, suffixes=(".txt",))
def read_cw_text(
    path: Path,
    *,
    carrier_hz: Annotated[float, Limits(0)] = 24.1e9,
    sample_rate_hz: Positive = 3000.0,
    burst_pulses: Annotated[int, POSITIVE] = 128,
    burst_period_s: Annotated[float, Limits(0, 3600)] = 0.2,
    conjugate: bool = True,
    full_scale_v: Positive = 1.0,
) -> Recording:
    """Read two text files of a continuous-wave module.
    ``y = (RE - 2048 -+ j (IM - 2048)) full_scale_v / 4096``; the mean stays in, as recorded.
    """
    names = _find_pair(path)
    if burst_period_s < burst_pulses / sample_rate_hz * (1 - 1e-9):
        raise RecordingError(
            f"{path}: burst_period_s = {burst_period_s:g} is shorter than a burst of {burst_pulses} samples at "
            f"{sample_rate_hz:g} Hz, which takes {burst_pulses / sample_rate_hz:.4g} s"
        )
    codes = [_read_codes(name) for name in names]
    if codes[0].size != codes[1].size:
        raise RecordingError(
            f"{path}: {names[0].name} holds {codes[0].size} values and {names[1].name} {codes[1].size}; the numbers "
            "must be equal. One of the files is truncated or belongs to another recording"
        )
    clipped = np.isin(codes[0], (0, 2**BITS - 1)) | np.isin(codes[1], (0, 2**BITS - 1))
    if clipped.any():
        warn_caller(
            f"{path}: {100 * clipped.mean():.2g} % of the samples are clipped (0 or {2**BITS - 1}): the target was too "
            "near; expect its image and harmonics in Doppler"
        )
    scale_v = full_scale_v / 2**BITS
    rows = split_rows(names[0], np.stack(codes, axis=-1), burst_pulses, "burst", least=1)
    centred = (rows.reshape(-1, 2) - MID_CODE) * scale_v
    slow_time_s, rate_hz, attrs = place_frames(len(rows), burst_pulses, burst_period_s, sample_rate_hz)
    start_m, stop_m = CW_FRAME_M
    radar = make_radar(
        path,
        name="continuous-wave Doppler module",
        waveform="cw",
        range_start_m=start_m,
        range_stop_m=stop_m,
        carrier_hz=carrier_hz,
        prf_hz=rate_hz,
        volts_per_unit=scale_v,
    )
    notes = [
        f"the files state neither carrier nor timing: {carrier_hz / 1e9:g} GHz, {sample_rate_hz:g} samples/s in "
        f"bursts of {burst_pulses}, one every {burst_period_s:g} s",
        f"range is not measured: the one bin stands for {start_m:g} to {stop_m:g} m",
        f"levels: the middle code {MID_CODE} is 0 V and one step {scale_v:.4g} V at the converter, before "
        "which the gain is unknown",
        f"RE {'-' if conjugate else '+'} j IM is taken, so that an approaching target has positive Doppler",
    ]
    return label_measured(
        names[0],
        centred[:, :1] + (-1j if conjugate else 1j) * centred[:, 1:],
        radar=radar,
        slow_time_s=slow_time_s,
        range_m=np.array([(start_m + stop_m) / 2]),
        notes=notes,
        attrs=attrs,
    )


def _find_pair(path: Path) -> tuple[Path, Path]:
    stem = path.name
    for part in PARTS:
        stem = stem.removesuffix(f"{part}.txt")
    pair = tuple(path.with_name(f"{stem}{part}.txt") for part in PARTS)
    if not stem or (stem == path.name and not any(one.is_file() for one in pair)):
        raise RecordingError(f"{path}: no such recording; give NAME_RE.txt or NAME_IM.txt, or NAME for both of them")
    return pair[0], pair[1]


def _read_codes(path: Path) -> npt.NDArray[np.int64]:
    if not path.is_file():
        raise RecordingError(f"{path}: no such file; both NAME_RE.txt and NAME_IM.txt are needed")
    content = read_document(path, MAX_CODES_BYTES, RecordingError)
    if not content.split():
        raise RecordingError(f"{path}: holds no values")
    if fault := OTHER_WORD.search(content):
        number = content.count(b"\n", 0, fault.start()) + 1
        shown = fault[0][:20].decode("ascii", "backslashreplace")
        raise RecordingError(
            f"{path}: line {number} holds {shown!r}; every line must hold an integer from 0 to {2**BITS - 1}"
        )
    return np.fromstring(content.decode("ascii"), dtype=np.int64, sep=" ")


HEAD = {
    "centre frequency in Hz": Limits(1e6, 1e12),
    "sweep time in ms": Limits(1e-3, 1e4),
    "samples per sweep": Limits(2, 65_536),
    "bandwidth in Hz": Limits(0, 1e11),
}
MAX_SWEEPS_BYTES = 2**29
VOLTS_PER_CODE = 1.0 / 4096
"""Volts per converter step: 12 bits by the middle code 2048, and an assumed full scale of 1 V."""


def sniff_glasgow(path: Path, head: bytes) -> bool:
    """Return whether a file begins with four numbers and a complex sample."""
    words = head[: 2 * HEAD_BYTES].decode("ascii", "replace").split()
    if len(words) < 5 or not words[4].endswith("i") or "." in words[2]:
        return False
    try:
        return all(float(word) >= 0 for word in words[:4]) and _is_complex(words[4][:-1] + "j")
    except ValueError:
        return False


@plugin("radar_reader", "glasgow", sniff=sniff_glasgow, suffixes=(".dat",))
def read_glasgow(path: Path, *, conjugate: bool = True, range_stop_m: float | None = None) -> Recording:
    """Read an Ancortek text file, such as ``1P36A01R01.dat``.
    Every sweep is transformed to a row of range bins with a Hann window.
    """
    content = read_document(path, MAX_SWEEPS_BYTES, RecordingError)
    check_cost(path, CELL_BYTES * sum(map(content.count, (b"\n", b" ", b"\t", b"\r"))), RecordingError)
    text = content.decode("ascii", "replace").replace("i", "j")
    words = text.split()
    carrier_hz, sweep_ms, samples_per_sweep, bandwidth_hz = _read_head(path, words)
    if not bandwidth_hz:
        raise RecordingError(f"{path}: bandwidth 0 Hz is a continuous wave; only frequency sweeps are read")
    n_samples = int(samples_per_sweep)
    try:
        values = np.fromiter(map(complex, words[4:]), np.complex128)
    except ValueError:
        lines = [number for number, line in enumerate(text.splitlines(), start=1) for _ in line.split()]
        number, word = next((lines[at], word) for at, word in enumerate(words) if at >= 4 and not _is_complex(word))
        raise RecordingError(
            f"{path}: line {number} holds {word.replace('j', 'i')[:20]!r}; it must be a complex number such as "
            "2048+1998i"
        ) from None
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


def _is_complex(word: str) -> bool:
    try:
        return complex(word) is not None
    except ValueError:
        return False


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

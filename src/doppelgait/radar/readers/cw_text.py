"""Continuous-wave recordings as two text files of integers.

``NAME_RE.txt`` and ``NAME_IM.txt`` have one integer per line.

Programs for 24 GHz Doppler modules with a 12-bit converter write these files. The module fills a
buffer, sends it and starts again: the samples are continuous within a burst only.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import RecordingError, warn_caller
from doppelgait.core.plugins import plugin
from doppelgait.radar.measured import CW_FRAME_M, check_number, label_measured, make_cw_radar
from doppelgait.radar.recording import Recording

PARTS = ("_RE", "_IM")
BITS = 12
MID_CODE = 2 ** (BITS - 1)
MAX_BYTES = 2**26
"""Maximum size of a text file of a Doppler module: 64 MiB is more than an hour at 3000 samples/s."""
HEAD_BYTES = 256


def sniff_cw_text(path: Path, head: bytes) -> bool:
    """Return whether a path is one of two continuous-wave text files, or their common stem."""
    try:
        names = _find_pair(Path(path))
    except RecordingError:
        return False
    for name in (name for name in names if name.is_file()):
        with name.open("rb") as file:
            words = file.read(HEAD_BYTES).split()
        if words and all(word.isdigit() for word in words):
            return True
    return False


@plugin("radar_reader", "cw-text", sniff=sniff_cw_text, suffixes=(".txt",))
def read_cw_text(
    path: str | Path,
    *,
    carrier_hz: float = 24.1e9,
    sample_rate_hz: float = 3000.0,
    burst_pulses: int = 128,
    burst_period_s: float = 0.2,
    conjugate: bool = True,
    full_scale_v: float = 1.0,
) -> Recording:
    """Read two text files of a continuous-wave module.
    ``y = (RE - 2048 -+ j (IM - 2048)) full_scale_v / 4096``; the mean stays in, as recorded.
    """
    file = Path(path)
    names = _find_pair(file)
    rate_hz = check_number(file, "sample_rate_hz", sample_rate_hz, above=0, most=1e6)
    period_s = check_number(file, "burst_period_s", burst_period_s, above=0, most=3600)
    scale_v = check_number(file, "full_scale_v", full_scale_v, above=0, most=1e6) / 2**BITS
    if isinstance(burst_pulses, bool) or not isinstance(burst_pulses, int) or not 1 <= burst_pulses <= 1_000_000:
        raise RecordingError(f"{file}: burst_pulses = {burst_pulses!r} is not allowed; it must be 1 to 1000000")
    if period_s < burst_pulses / rate_hz * (1 - 1e-9):
        raise RecordingError(
            f"{file}: burst_period_s = {period_s:g} is shorter than a burst of {burst_pulses} samples at {rate_hz:g} "
            f"Hz, which takes {burst_pulses / rate_hz:.4g} s"
        )
    radar = make_cw_radar(
        file,
        name="continuous-wave Doppler module",
        carrier_hz=check_number(file, "carrier_hz", carrier_hz, above=0),
        prf_hz=rate_hz,
        volts_per_unit=scale_v,
    )
    codes = [_read_codes(name) for name in names]
    if codes[0].size != codes[1].size:
        raise RecordingError(
            f"{file}: {names[0].name} holds {codes[0].size} values and {names[1].name} {codes[1].size}; the numbers "
            "must be equal. One of the files is truncated or belongs to another recording"
        )
    clipped = np.isin(codes[0], (0, 2**BITS - 1)) | np.isin(codes[1], (0, 2**BITS - 1))
    if clipped.any():
        warn_caller(
            f"{file}: {100 * clipped.mean():.2g} % of the samples are clipped (0 or {2**BITS - 1}): the target was too "
            "near; expect its image and harmonics in Doppler"
        )
    count, rest = divmod(codes[0].size, burst_pulses)
    if not count:
        raise RecordingError(
            f"{file}: holds {codes[0].size} samples, less than one burst of {burst_pulses}; the file is cut off, or "
            "burst_pulses must be given"
        )
    if rest:
        warn_caller(f"{file}: the last burst has {rest} of {burst_pulses} samples and is left out")
    centred = [(one[: count * burst_pulses] - MID_CODE) * scale_v for one in codes]
    samples = centred[0] + (-1j if conjugate else 1j) * centred[1]
    starts_s = period_s * np.arange(samples.size // burst_pulses)
    slow_time_s = (starts_s[:, None] + np.arange(burst_pulses) / radar.prf_hz).ravel()
    start_m, stop_m = CW_FRAME_M
    notes = [
        f"the files state neither carrier nor timing: {radar.carrier_hz / 1e9:g} GHz, {radar.prf_hz:g} samples/s in "
        f"bursts of {burst_pulses}, one every {period_s:g} s",
        f"range is not measured: the one bin stands for {start_m:g} to {stop_m:g} m",
        f"levels: the middle code {MID_CODE} is 0 V and one step {radar.volts_per_unit:.4g} V at the converter, before "
        "which the gain is unknown",
        f"RE {'-' if conjugate else '+'} j IM is taken, so that an approaching target has positive Doppler",
    ]
    return label_measured(
        names[0],
        samples[:, None],
        radar=radar,
        slow_time_s=slow_time_s,
        range_m=np.array([(start_m + stop_m) / 2]),
        notes=notes,
        attrs={"burst_pulses": burst_pulses} if period_s > (burst_pulses + 0.5) / radar.prf_hz else {},
    )


def _find_pair(path: Path) -> tuple[Path, Path]:
    """Return the paths of real and imaginary part."""
    stem = path.name
    for part in PARTS:
        stem = stem.removesuffix(f"{part}.txt")
    pair = tuple(path.with_name(f"{stem}{part}.txt") for part in PARTS)
    if not stem or (stem == path.name and not any(one.is_file() for one in pair)):
        raise RecordingError(f"{path}: no such recording; give NAME_RE.txt or NAME_IM.txt, or NAME for both of them")
    return pair[0], pair[1]


def _read_codes(path: Path) -> npt.NDArray[np.int64]:
    """Read the integers of one file within the converter's range."""
    if not path.is_file():
        raise RecordingError(f"{path}: no such file; both NAME_RE.txt and NAME_IM.txt are needed")
    if path.stat().st_size > MAX_BYTES:
        raise RecordingError(f"{path}: has {path.stat().st_size:,} bytes, at most {MAX_BYTES:,} are read")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    # Check lengths first: a word with five or more digits is out of range and need not be parsed.
    if not content.strip() or content.translate(None, b"0123456789 \t\r\n\v\f") or re.search(rb"\d{5}", content):
        raise RecordingError(_find_fault(path, content))
    codes = np.fromstring(content.decode("ascii"), dtype=np.int64, sep=" ")
    if codes.max() >= 2**BITS:
        raise RecordingError(_find_fault(path, content))
    return codes


def _find_fault(path: Path, content: bytes) -> str:
    for number, line in enumerate(content.split(b"\n"), start=1):
        for word in line.split():
            if not word.isdigit() or int(word[:9]) >= 2**BITS:
                shown = word[:20].decode("ascii", "backslashreplace")
                return f"{path}: line {number} holds {shown!r}; every line must hold an integer from 0 to {2**BITS - 1}"
    return f"{path}: holds no values" if not content.split() else f"{path}: holds numbers with more than four digits"

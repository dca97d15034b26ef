"""Samples that a DCA1000 board captured from a TI sensor.

The file contains only 16-bit numbers; a second file has the settings. Their order follows TI's application report
SWRA581B, "Mmwave Radar Device ADC Raw Data Capture": xWR12xx and xWR14xx send the four receivers in parallel, one lane
each (I of all, then Q of all; an inactive receiver sends zeros); the other devices send one receiver after the other
over two lanes, two samples at a time (I, I, Q, Q).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import RecordingError
from doppelgait.core.plugins import plugin
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.radar.measured import check_number, label_sweeps, make_radar
from doppelgait.radar.readers.ti_config import (
    DEVICES,
    FOUR_LANES,
    MAX_CONFIG_BYTES,
    ChirpConfig,
    find_config,
    read_config,
)
from doppelgait.radar.recording import Recording

VOLTS_PER_CODE = 1.0 / 2**15
PAUSE = 0.01
"""Minimum pause between frames, in loops, for which frames count as bursts."""
MAX_VALUES = 500_000_000
"""Maximum number of samples of one receiver."""
BLOCK = 1 << 24
"""Number of values that are sorted at a time."""


def sniff_dca1000(path: Path) -> bool:
    """Return whether radar settings lie next to a .bin file."""
    file = Path(path)
    if file.suffix.lower() != ".bin" or not file.is_file():
        return False
    config = find_config(file)
    if config is None or config.stat().st_size > MAX_CONFIG_BYTES:
        return False
    content = config.read_bytes()
    return b"profileCfg" in content or b"slope_hz_per_s" in content


@plugin("radar_reader", "dca1000", sniff=sniff_dca1000, suffixes=(".bin",))
def read_dca1000(
    path: str | Path,
    *,
    config: str | None = None,
    device: str | None = None,
    rx: int | str | None = None,
    chirp: int = 0,
    conjugate: bool = True,
    range_stop_m: float | None = None,
) -> Recording:
    """Read the samples of one receiver, or of their sum.
    Every chirp becomes a row of range bins by a windowed (Hann) transform.
    """
    file = Path(path)
    if not file.is_file():
        raise RecordingError(f"{file}: no such file")
    settings = find_config(file) if config is None else Path(str(config))
    if settings is None:
        raise RecordingError(
            f"{file}: has no radar settings next to it; give config=FILE, or put them into {file.stem}.toml, .json or "
            ".cfg in its folder"
        )
    if not settings.is_file():
        settings = file.parent / settings
    if device is not None and device not in DEVICES:
        raise RecordingError(f"{file}: device = {device!r} is not allowed; it must be one of {', '.join(DEVICES)}")
    chirps = read_config(settings, device=device)
    receivers = list(chirps.receivers)
    if rx not in (None, "sum") and (isinstance(rx, bool) or rx not in receivers):
        said = ", ".join(map(str, receivers))
        raise RecordingError(f"{file}: rx = {rx!r} is not allowed; on are {said}, and sum is all of them")
    if isinstance(chirp, bool) or not isinstance(chirp, int) or not 0 <= chirp < chirps.chirps_per_loop:
        raise RecordingError(
            f"{file}: chirp = {chirp!r} is not allowed; a loop has {chirps.chirps_per_loop}, counted from 0"
        )
    chosen = receivers if rx == "sum" else [receivers[0] if rx is None else int(rx)]
    n_frames = _count_frames(file, settings, chirps)
    samples = _read_samples(file, chirps, n_frames, chosen, chirp)
    bandwidth_hz = chirps.slope_hz_per_s * chirps.sweep_s
    spacing_m = SPEED_OF_LIGHT_MPS / (2.0 * bandwidth_hz)
    farthest_m = (chirps.n_samples if chirps.output == "complex1x" else chirps.n_samples // 2) * spacing_m
    stop_m = farthest_m if range_stop_m is None else check_number(file, "range_stop_m", range_stop_m, above=0)
    if stop_m > farthest_m * (1 + 1e-9):
        raise RecordingError(f"{file}: range_stop_m = {stop_m:g} is not allowed; the ranges end at {farthest_m:.4g} m")
    pause_s = chirps.frame_period_s - chirps.loops * chirps.loop_s
    paused = chirps.loops > 1 and n_frames > 1 and pause_s > PAUSE * chirps.loop_s
    even_s = chirps.frame_period_s / chirps.loops
    pulse_s = chirps.loop_s if paused or (n_frames == 1 and chirps.loops > 1) else even_s
    starts_s = chirps.frame_period_s * np.arange(n_frames)
    times_s = (starts_s[:, None] + pulse_s * np.arange(chirps.loops)).ravel()
    radar = make_radar(
        file,
        name=f"TI {chirps.device} by DCA1000",
        waveform="fmcw",
        carrier_hz=chirps.start_hz + chirps.slope_hz_per_s * (chirps.adc_start_s + chirps.sweep_s / 2.0),
        bandwidth_hz=bandwidth_hz,
        prf_hz=1.0 / pulse_s,
        sweep_s=chirps.sweep_s,
        sample_rate_hz=chirps.sample_rate_hz,
        range_stop_m=stop_m,
        volts_per_unit=VOLTS_PER_CODE,
    )
    notes = [
        f"{'sum of receivers' if rx == 'sum' else 'receiver'} {', '.join(map(str, chosen))}; chirp {chirp} of "
        f"{chirps.chirps_per_loop}; {n_frames} frames of {chirps.loops}",
        f"levels: one step of the converter is taken as {VOLTS_PER_CODE:.4g} V",
        "packets that the board lost are not detected: the file does not mark them",
    ]
    return label_sweeps(
        file,
        samples,
        radar=radar,
        slow_time_s=times_s,
        conjugate=conjugate,
        notes=notes,
        attrs={"burst_pulses": chirps.loops} if paused else {},
    )


def _count_channels(chirps: ChirpConfig) -> int:
    """Count the receivers in the file, including disabled ones."""
    return 4 if chirps.device in FOUR_LANES else len(chirps.receivers)


def _count_frames(file: Path, settings: Path, chirps: ChirpConfig) -> int:
    """Count the frames of a file, which must be whole."""
    parts = 1 if chirps.output == "real" else 2
    frame_bytes = 2 * parts * _count_channels(chirps) * chirps.n_samples * chirps.chirps_per_loop * chirps.loops
    size = file.stat().st_size
    count, rest = divmod(size, frame_bytes)
    frame = (
        f"{chirps.loops} loops of {chirps.chirps_per_loop} chirps, {_count_channels(chirps)} receivers and "
        f"{chirps.n_samples} {'real' if parts == 1 else 'complex'} samples, {frame_bytes:,} bytes"
    )
    if rest or not count:
        raise RecordingError(
            f"{file}: has {size:,} bytes, which is {count} frames and {rest:,} bytes more; by {settings.name} a frame "
            f"has {frame}. The settings are of another recording, or the file is truncated: shorten it to "
            f"{count * frame_bytes:,} bytes"
        )
    if chirps.frames and count != chirps.frames:
        raise RecordingError(
            f"{file}: has {size:,} bytes, {count} frames; by {settings.name} it has {chirps.frames}, each of {frame}. "
            "Set the number of frames to 0 to read all frames of the file"
        )
    if count * chirps.loops * chirps.n_samples > MAX_VALUES:
        raise RecordingError(f"{file}: has {count} frames; at most {MAX_VALUES:,} samples of a receiver are read")
    return count


def _read_samples(
    file: Path, chirps: ChirpConfig, n_frames: int, chosen: list[int], chirp: int
) -> npt.NDArray[np.complex64] | npt.NDArray[np.float32]:
    """Return the sorted samples of a file, shape (pulses, samples), V."""
    is_real, size, four = chirps.output == "real", chirps.n_samples, chirps.device in FOUR_LANES
    numbers = np.memmap(file, dtype="<i2", mode="r").reshape(n_frames * chirps.loops, chirps.chirps_per_loop, -1)
    out: npt.NDArray[Any] = np.zeros((numbers.shape[0], size), np.float32 if is_real else np.complex64)
    step = max(1, BLOCK // numbers.shape[2])
    for begin in range(0, len(out), step):
        block = numbers[begin : begin + step, chirp].astype(np.float32)
        rows = len(block)
        for receiver in chosen:
            place = receiver if four else chirps.receivers.index(receiver)
            if is_real:
                part = block.reshape(rows, size, 4)[:, :, place] if four else block.reshape(rows, -1, size)[:, place]
                out[begin : begin + rows] += part
                continue
            if four:
                pairs = np.moveaxis(block.reshape(rows, size, 2, 4)[..., place], 2, 0)
            else:
                pairs = np.moveaxis(block.reshape(rows, -1, size // 2, 2, 2)[:, place], 2, 0).reshape(2, rows, size)
            first, second = pairs
            out.real[begin : begin + rows] += second if chirps.q_first else first
            out.imag[begin : begin + rows] += first if chirps.q_first else second
    out *= VOLTS_PER_CODE
    return out

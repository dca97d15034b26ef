"""Facts about a plain array, and its axes and radar.

They are in the TOML file of the same stem and in the options.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import Field

from doppelgait.core.config import FrozenModel, read_toml, validate
from doppelgait.core.errors import ConfigError, RecordingError
from doppelgait.core.units import SPEED_OF_LIGHT_MPS, slow_time_axis_s
from doppelgait.radar.parameters import GAUSSIAN_WIDTH, PULSE_SIGMA_S, Radar
from doppelgait.radar.presets import change_preset

FloatArray = npt.NDArray[np.float64]

CW_RANGE_STOP_M = 1.0
"""End of the nominal frame of a continuous-wave radar, m; it has a single bin and no range."""


class ArrayFacts(FrozenModel):
    """Facts about an array, from TOML or options.

    Parameters
    ----------
    prf_hz : float
        Pulses per second; by default that of ``radar``.
    carrier_hz : float
        Carrier frequency; by default that of ``radar``.
    range_start_m : float
        Range of the first bin; by default that of ``radar``. An array with one bin needs none.
    bin_spacing_m : float
        Spacing of the range bins; by default that of ``radar``. An array with one bin needs none.
    time_first : bool
        True: one row per pulse. False: one column per pulse.
    conjugate : bool
        True: the phase falls when a target approaches, so the values are conjugated.
    scale_v : float
        Volts per unit of the values.
    key : str
        Name of the matrix in the npz file.
    radar : mapping
        Parameters of the radar, or ``preset`` and what differs from it (:class:`~doppelgait.radar.parameters.Radar`).
    notes : list of str
        Notes on the recording; commands print them.
    noise_power_v2 : float
        Noise power of a sample.
    snr_frame_db : float
        SNR of the frame: time mean of the strongest bin's power over the noise power.
    seed : int
        Seed of a simulated recording.
    attributes : mapping
        Further facts about the baseband, for example ``burst_pulses``.
    """

    prf_hz: float | None = Field(default=None, ge=1e-6, le=1e6)
    carrier_hz: float | None = Field(default=None, gt=1e6, lt=1e12)
    range_start_m: float | None = Field(default=None, ge=-1e3, le=1e6)
    bin_spacing_m: float | None = Field(default=None, ge=1e-6, le=1e5)
    time_first: bool = True
    conjugate: bool | None = None
    scale_v: float | None = Field(default=None, gt=0)
    key: str | None = None
    radar: dict[str, Any] | None = None
    notes: list[str] | None = None
    noise_power_v2: float | None = Field(default=None, ge=0)
    snr_frame_db: float | None = Field(default=None, allow_inf_nan=True)
    seed: int | None = None
    attributes: dict[str, str | bool | int | float] = Field(default={})


def read_facts(path: Path, options: Mapping[str, Any]) -> ArrayFacts:
    """Read facts about an array.
    They are read from the TOML file of the same stem, if it exists; options take precedence.
    """
    sidecar = path.with_suffix(".toml")
    table: dict[str, Any] = {}
    text = ""
    try:
        if sidecar.is_file():
            table, text = read_toml(sidecar)
        return validate(ArrayFacts, {**table, **options}, where=str(sidecar if text else path), text=text)
    except ConfigError as error:
        raise RecordingError(str(error)) from None


@dataclass(frozen=True)
class Frame:
    """Axes of an array, its radar, and assumptions."""

    slow_time_s: FloatArray
    range_m: FloatArray
    radar: Radar
    notes: list[str]


def describe(path: Path, facts: ArrayFacts, shape: tuple[int, ...], axes: Mapping[str, Any]) -> Frame:
    """Determine axes and radar of a (pulses, range bins) array.
    An entry of ``facts`` takes precedence over an axis in the file, and the axis over the radar's parameter.
    """
    n_pulses, n_bins = shape
    stated = _read_stated_radar(path, facts)
    slow_time_s = None if facts.prf_hz else _read_axis(path, axes, "slow_time_s", n_pulses)
    range_m = (
        None if facts.range_start_m is not None or facts.bin_spacing_m else _read_axis(path, axes, "range_m", n_bins)
    )
    # rate, carrier and frame, in rising order of precedence
    names = ("prf_hz", "carrier_hz", "range_start_m", "bin_spacing_m")
    known = {name: float(getattr(stated, name)) for name in names} if stated is not None else {}
    if slow_time_s is not None and "prf_hz" not in known:  # of bursts, the rate inside them
        known["prf_hz"] = 1.0 / float(np.median(np.diff(slow_time_s)))
    if range_m is not None:
        known["range_start_m"] = float(range_m[0])
        known |= {"bin_spacing_m": float(np.diff(range_m).mean())} if range_m.size > 1 else {}
    known = known | {name: value for name in names if (value := getattr(facts, name)) is not None}
    if n_bins == 1:
        known = {"range_start_m": 0.0, "bin_spacing_m": CW_RANGE_STOP_M, **known}
    needed = ("prf_hz", "carrier_hz", "range_start_m", "bin_spacing_m")
    if missing := [name for name in needed if name not in known]:
        raise RecordingError(
            f"{path}: {', '.join(missing)} {'is' if len(missing) == 1 else 'are'} stated nowhere; write them into "
            f"{path.with_suffix('.toml').name} in its folder or give them as options (radar='PRESET' has all four)"
        )
    ranges = np.asarray(known["range_start_m"] + known["bin_spacing_m"] * np.arange(n_bins), dtype=np.float64)
    # notes on values that neither the array nor its TOML file nor the options state
    notes = []
    if facts.conjugate is None:
        notes.append("conjugate: not stated; a rising phase is taken as approaching")
    if facts.scale_v is None:
        notes.append("scale_v: not stated; the values are taken as V")
    if facts.radar is not None and "preset" in facts.radar:
        notes.append(f"radar = {facts.radar['preset']}: pulse, power and antennas are the preset's")
    elif facts.radar is None and n_bins == 1:
        notes.append("radar: not stated; one range bin is taken as a continuous wave, its range as nothing")
    elif facts.radar is None:
        notes.append(f"radar: not stated; an echo is taken as one range bin wide ({known['bin_spacing_m']:g} m)")
    return Frame(
        slow_time_axis_s(n_pulses, known["prf_hz"]) if slow_time_s is None else slow_time_s,
        ranges if range_m is None else range_m,
        _make_radar(path, facts, stated, known, n_bins),
        notes,
    )


def _read_axis(path: Path, axes: Mapping[str, Any], name: str, size: int) -> FloatArray | None:
    if axes.get(name) is None:
        return None
    values = axes[name]
    if values.shape != (size,) or values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise RecordingError(
            f"{path}: {name} is {values.dtype} of shape {values.shape}; it must be {size} real numbers"
        )
    if size > 1 and not (np.diff(values) > 0).all():
        raise RecordingError(f"{path}: {name} does not rise from sample to sample")
    return np.asarray(values, dtype=np.float64)


def _read_stated_radar(path: Path, facts: ArrayFacts) -> Radar | None:
    if facts.radar is None:
        return None
    table = dict(facts.radar)
    try:
        if "preset" in table:
            table = change_preset(str(table.pop("preset")), table)
        return validate(Radar, table, where="radar")
    except ConfigError as error:
        raise RecordingError(f"{path}: {error}") from None


def _make_radar(path: Path, facts: ArrayFacts, stated: Radar | None, known: Mapping[str, float], n_bins: int) -> Radar:
    """Return the stated radar updated by the recording's facts.
    Without a stated radar, it is made from these facts only.
    """
    table: dict[str, Any] = {name: known[name] for name in ("prf_hz", "carrier_hz")}
    start_m = max(known["range_start_m"], 0.0)
    if stated is None and n_bins == 1:
        table |= {"name": "continuous wave", "waveform": "cw", "range_start_m": start_m}
        table["range_stop_m"] = start_m + CW_RANGE_STOP_M
    elif stated is None:
        # an echo as wide as a range bin (E-11)
        spacing_m = known["bin_spacing_m"]
        sigma_s = spacing_m / (SPEED_OF_LIGHT_MPS * math.sqrt(math.log(2)))
        shortest_s = max(PULSE_SIGMA_S[0], GAUSSIAN_WIDTH[10] / (2.0 * known["carrier_hz"]))
        table |= {
            "name": "unknown",
            "sample_rate_hz": SPEED_OF_LIGHT_MPS / (2.0 * spacing_m),
            "range_start_m": start_m,
            "range_stop_m": start_m + n_bins * spacing_m,
            "pulse_sigma_s": min(max(sigma_s, shortest_s), PULSE_SIGMA_S[1]),
        }
    else:
        table = {**stated.model_dump(), **table}
        if facts.radar is not None and "preset" in facts.radar:  # a complete radar is taken with its own frame
            table |= {"range_start_m": start_m, "range_stop_m": start_m + n_bins * stated.bin_spacing_m}
        if stated.waveform.kind == "cw" and n_bins > 1:
            raise RecordingError(f"{path}: has {n_bins} range bins, but {stated.name} is a continuous wave with one")
    try:
        return validate(Radar, table, where=str(path))
    except ConfigError as error:
        raise RecordingError(str(error)) from None

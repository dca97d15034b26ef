"""Complex matrices in .npz and .npy files, read and written, and the chirps of Infineon's Radar SDK in .npy files.

A TOML file of the same stem and the options state facts about a matrix, its axes and its radar. Chirps of BGT60 sensors
are real, (frames, antennas, chirps, samples), as ``get_next_frame`` gives them; their settings are ``config.json`` or a
JSON file of the same stem, whose names have changed between releases.
"""

from __future__ import annotations

import inspect
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from doppelgait.core.config import FrozenModel, read_toml, validate, write_toml
from doppelgait.core.documents import parse_json
from doppelgait.core.errors import ConfigError, OutputError, RecordingError, warn_caller
from doppelgait.core.files import open_atomically
from doppelgait.core.npz import NPY_MAGIC, is_npz, load_npy, load_npz
from doppelgait.core.plugins import plugin, read_head
from doppelgait.core.units import SPEED_OF_LIGHT_MPS, FloatArray
from doppelgait.radar.measured import (
    RATE_OFF,
    check_carrier,
    check_number,
    check_shape,
    choose_number,
    label_measured,
    label_sweeps,
    make_radar,
)
from doppelgait.radar.parameters import GAUSSIAN_WIDTH, PULSE_SIGMA_S, Radar
from doppelgait.radar.presets import change_preset
from doppelgait.radar.recording import Recording, list_further_facts
from doppelgait.radar.slow_time import place_pulses

NAMES = read_toml(Path(__file__).with_name("names.toml"))[0]
CW_RANGE_STOP_M = 1.0
"""End of the nominal frame of a continuous-wave radar, m; it has a single bin and no range."""


class ArrayFacts(FrozenModel):
    """Facts about an array, from TOML or options.

    prf_hz: Pulses per second; by default that of ``radar``.
    carrier_hz: Carrier frequency; by default that of ``radar``.
    range_start_m: Range of the first bin; by default that of ``radar``.
    bin_spacing_m: Spacing of the range bins; by default that of ``radar``. One bin needs neither.
    time_first: True: one row per pulse. False: one column per pulse.
    conjugate: True: the phase falls when a target approaches, so the values are conjugated.
    scale_v: Volts per unit of the values.
    key: Name of the matrix in the npz file.
    radar: Parameters of the radar, or ``preset`` and what differs from it
        (:class:`~doppelgait.radar.parameters.Radar`).
    notes: Notes on the recording; commands print them.
    noise_power_v2: Noise power of a sample.
    snr_frame_db: SNR of the frame: time mean of the strongest bin's power over the noise power.
    seed: Seed of a simulated recording.
    attributes: Further facts about the baseband, for example ``burst_pulses``.
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


def read_facts(path: Path, options: Mapping[str, Any], stated: Mapping[str, Any] | None = None) -> ArrayFacts:
    """Read facts about an array from its TOML file; options come before them, and what the file states after."""
    sidecar = path.with_suffix(".toml") if path != IN_MEMORY else Path()
    try:
        table, text = read_toml(sidecar) if sidecar.is_file() else ({}, "")
        given = {**(stated or {}), **table, **options}
        return validate(ArrayFacts, given, where=str(sidecar if text else path), text=text)
    except ConfigError as error:
        raise RecordingError(str(error)) from None


def _describe(
    path: Path, facts: ArrayFacts, shape: tuple[int, ...], parsed: Parsed, *, is_forced: bool
) -> tuple[FloatArray, FloatArray, Radar, list[str]]:
    """Return slow time, ranges, radar and notes: facts come before axes in the file, these before the radar."""
    n_pulses, n_bins = shape
    stated = None
    if facts.radar is not None:
        table = dict(facts.radar)
        try:
            preset = table.pop("preset", None)
            table = table if preset is None else change_preset(str(preset), table)
            stated = validate(Radar, table, where="radar")
            if preset is not None:
                check_carrier(str(preset), stated, facts.carrier_hz)
        except ConfigError as error:
            raise RecordingError(f"{path}: {error}") from None
    axes = parsed.axes
    slow_time_s = _read_axis(path, axes, "slow_time_s", n_pulses)
    stamps_hz = None
    if slow_time_s is not None:
        stamps_hz = place_pulses(slow_time_s, where=str(path), stated_hz=facts.prf_hz).rate_hz
        forced_hz = facts.prf_hz if is_forced and facts.prf_hz is not None else stamps_hz
        if abs(forced_hz / stamps_hz - 1.0) > RATE_OFF:
            warn_caller(f"{path}: prf_hz = {forced_hz:g} is taken, but slow_time_s says {stamps_hz:.6g} Hz")
            slow_time_s = None
    range_m = (
        None if facts.range_start_m is not None or facts.bin_spacing_m else _read_axis(path, axes, "range_m", n_bins)
    )
    # rate, carrier and frame, in rising order of precedence
    names = ("prf_hz", "carrier_hz", "range_start_m", "bin_spacing_m")
    known = {"range_start_m": 0.0, "bin_spacing_m": CW_RANGE_STOP_M} if n_bins == 1 else {}
    known |= {name: float(getattr(stated, name)) for name in names} if stated is not None else {}
    if stamps_hz is not None and "prf_hz" not in known:  # of bursts, the rate inside them
        known["prf_hz"] = stamps_hz
    if range_m is not None:
        known["range_start_m"] = float(range_m[0])
        known |= {"bin_spacing_m": float(np.diff(range_m).mean())} if range_m.size > 1 else {}
    known |= {name: value for name in names if (value := getattr(facts, name)) is not None}
    if missing := [name for name in names if name not in known]:
        reasons = "".join(f": {parsed.hints[name]}" for name in missing if name in parsed.hints)
        raise RecordingError(
            f"{path}: {', '.join(missing)} {'is' if len(missing) == 1 else 'are'} stated nowhere{reasons}; "
            f"give {' and '.join(f'{name}=...' for name in missing)}"
            + ("" if path == IN_MEMORY else f" or write it into {path.with_suffix('.toml').name} in its folder")
            + " (a preset has all four: radar='NAME', in a file radar = { preset = \"NAME\" })"
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
    radar = _make_radar(path, facts, stated, known, n_bins)
    slow_time_s = radar.frame_time_s(np.arange(n_pulses)) if slow_time_s is None else slow_time_s
    return slow_time_s, ranges if range_m is None else range_m, radar, notes


def _read_axis(path: Path, axes: Mapping[str, Any], name: str, size: int) -> FloatArray | None:
    if (values := axes.get(name)) is None:
        return None
    if values.dtype.kind in "mM":
        values = (values - np.array(0, values.dtype)) / np.timedelta64(1, "s")
    if values.shape != (size,) or values.dtype.kind not in "fiu":
        raise RecordingError(
            f"{path}: {name} is {values.dtype} of shape {values.shape}; it must be {size} real numbers"
        )
    if fault := np.flatnonzero(~np.isfinite(values)).tolist():
        raise RecordingError(
            f"{path}: {name}[{fault[0]}] is {values[fault[0]]}, as {len(fault)} of {size} are; leave these rows out"
        )
    if name == "range_m" and not (np.diff(values) > 0).all():
        raise RecordingError(f"{path}: {name} does not rise from bin to bin")
    return np.asarray(values, dtype=np.float64)


def _make_radar(path: Path, facts: ArrayFacts, stated: Radar | None, known: Mapping[str, float], n_bins: int) -> Radar:
    """Return the stated radar updated by the recording's facts, or one of these only."""
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
    return make_radar(path, **table)


MATRIX = "baseband"
PARTS = ("i", "q")
AXES = ("slow_time_s", "range_m")

Arrays = Mapping[str, npt.NDArray[Any] | None]


def sniff_arrays(path: Path, head: bytes) -> bool:
    """Return whether a file is ``.npy`` or npz."""
    return is_npz(head) or (head.startswith(NPY_MAGIC) and find_infineon_config(path, head) is None)


@dataclass(frozen=True)
class Parsed:
    """Values of a file, its axes, the facts that it states, and notes."""

    values: npt.NDArray[Any]
    axes: Arrays = field(default_factory=dict)
    stated: Mapping[str, Any] = field(default_factory=dict)
    notes: Sequence[str] = ()
    hints: Mapping[str, str] = field(default_factory=dict)  # reasons why a fact is not stated
    is_timed: bool = False  # the axis of times has the rate of the options


def array_reader(name: str, **facts: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Register the reader of a format without a radar's facts, which options and a TOML file state."""

    # ``parse`` gets the options that it names, all with ``**options``; it may also return a finished recording
    def register(parse: Callable[..., Parsed | Recording]) -> Callable[..., Parsed | Recording]:
        own = inspect.signature(parse, eval_str=True)
        first, *declared = own.parameters.values()
        further = {option.name: option for option in declared if option.kind is KEYWORD}
        names = {*further, *(OPTIONS if len(further) < len(declared) else ())}

        def read(path: Path, **options: Any) -> Recording:
            parsed = parse(path, **{name: value for name, value in options.items() if name in names})
            if isinstance(parsed, Recording):
                return parsed
            return label_array(path, parsed, {key: options[key] for key in options if key in ArrayFacts.model_fields})

        shared = {key: inspect.Parameter(key, KEYWORD, default=None, annotation=OPTIONS[key]) for key in OPTIONS}
        read.__signature__ = own.replace(parameters=[first, *(shared | further).values()])  # type: ignore[attr-defined]
        read.__doc__ = parse.__doc__
        plugin("radar_reader", name, **facts)(read)
        return parse

    return register


def label_array(path: Path, parsed: Parsed, options: Mapping[str, Any]) -> Recording:
    """Make a recording of an array of any common shape; options come before the TOML file and this before the file."""
    given = {name: value for name, value in options.items() if value is not None}
    if isinstance(radar := given.get("radar"), Radar):
        given["radar"] = radar.model_dump()
    elif radar is not None:
        given["radar"] = {"preset": str(radar)}
    facts = read_facts(path, given, parsed.stated)
    values, attributes, notes = parsed.values, dict(facts.attributes), list(parsed.notes)
    if values.dtype.kind not in "fiuc":
        raise RecordingError(f"{path}: holds {values.dtype} values; a baseband is numbers")
    if values.dtype.kind != "c":
        if values.ndim == 1 or values.shape[-1] == 1:
            attributes["one_output"] = True
            notes.append("one real output: approaching and receding cannot be told apart")
            values = values if values.ndim == 1 else values[..., 0]
            values = join_parts(values, np.zeros_like(values))
        elif values.shape[-1] == 2:
            values = join_parts(values[..., 0], values[..., 1])
        else:
            raise RecordingError(
                f"{path}: holds real values of shape {values.shape}; a baseband is complex, or real with I and Q along "
                "a last axis of 2, or two arrays named i and q, or the one output of a module, shape (pulses,)"
            )
    if values.ndim not in (1, 2):
        allowed = "(pulses, range bins) or (pulses,), also of bursts, with slow_time_s or a radar in bursts"
        raise RecordingError(f"{path}: has the shape {values.shape}; it must be {allowed}")
    if values.ndim == 1:
        values = values[:, None]
    elif not facts.time_first:
        values = values.T
    check_shape(path, values)
    values = values.conj() if facts.conjugate else values
    if facts.scale_v is not None and facts.scale_v != 1.0:
        values = facts.scale_v * values
    is_forced = "prf_hz" in given and not parsed.is_timed
    slow_time_s, range_m, made, assumed = _describe(path, facts, values.shape, parsed, is_forced=is_forced)
    notes = [*notes, *assumed] if facts.notes is None else facts.notes
    recording = label_measured(
        path, values, radar=made, slow_time_s=slow_time_s, range_m=range_m, notes=notes, attrs=attributes
    )
    further = {name: getattr(facts, name) for name in ("noise_power_v2", "snr_frame_db", "seed")}
    return replace(recording, **{name: value for name, value in further.items() if value is not None})


KEYWORD = inspect.Parameter.KEYWORD_ONLY
OPTIONS = {
    "radar": str | Path | None,
    **dict.fromkeys(("prf_hz", "carrier_hz", "range_start_m", "bin_spacing_m"), float | None),
    "conjugate": bool | None,
    "scale_v": float | None,
}
"""Options of every reader of plain arrays."""


IN_MEMORY = Path("array")  # name of an array that is in no file


def make_recording(values: npt.NDArray[Any], axes: Arrays, options: Mapping[str, Any]) -> Recording:
    """Make a recording of an array in memory, with the rules of files."""
    return label_array(IN_MEMORY, Parsed(values, axes), options)


@array_reader("arrays", sniff=sniff_arrays, suffixes=(".npz", ".npy"), make=make_recording)
def parse_arrays(path: Path, *, time_first: bool | None = None, key: str | None = None) -> Parsed:
    """Read a complex matrix (pulses, range bins) of a NumPy file; one row is continuous wave."""
    facts = read_facts(path, {} if key is None else {"key": key})
    wanted = (facts.key or MATRIX, *PARTS, *AXES)
    is_npy = read_head(path).startswith(NPY_MAGIC)
    arrays = {wanted[0]: load_npy(path, RecordingError)} if is_npy else load_npz(path, wanted, RecordingError)
    unread = ", ".join(name for name, array in arrays.items() if array is None)
    notes = [f"not read: {unread}; times of pulses are named slow_time_s, ranges range_m"] if unread else []
    return Parsed(_pick(path, arrays, facts.key), arrays, notes=notes)


def _pick(path: Path, arrays: Arrays, key: str | None) -> npt.NDArray[Any]:
    found = arrays.get(key or MATRIX)
    if found is None and key is None and len(arrays) == 1:
        found = next(iter(arrays.values()))
    if found is not None:
        return found
    held = ", ".join(arrays) or "nothing"
    if key is not None:
        raise RecordingError(f"{path}: has no array {key!r}; it holds {held}")
    i, q = arrays.get("i"), arrays.get("q")
    if i is None or q is None:
        raise RecordingError(f"{path}: has no array {MATRIX!r} and not both 'i' and 'q'; it holds {held}: key='NAME'")
    if i.shape != q.shape or i.dtype.kind not in "fiu" or q.dtype.kind not in "fiu":
        raise RecordingError(
            f"{path}: i is {i.dtype} of shape {i.shape} and q {q.dtype} of shape {q.shape}; both must be real and of "
            "one shape"
        )
    return join_parts(i, q)


def join_parts(i: npt.NDArray[Any], q: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Join I and Q to complex values; 32-bit integers stay exact."""
    joined = np.empty(i.shape, np.result_type(i.dtype, np.complex64))
    joined.real, joined.imag = i, q
    return joined


def list_facts(recording: Recording) -> dict[str, Any]:
    """Return the facts that a file of a recording's values states, without unknown ones."""
    facts: dict[str, Any] = {"notes": [*recording.notes], "seed": recording.seed}
    facts |= {"noise_power_v2": recording.noise_power_v2, "snr_frame_db": recording.snr_frame_db}
    return {name: value for name, value in facts.items() if value is not None and value == value}  # not NaN


FIRST_LINE = "# Radar recording, written by doppelgait: what the arrays beside it are."


@plugin("radar_writer", "arrays", suffix=".npz")
def write_arrays(recording: Recording, path: str | os.PathLike[str]) -> None:
    """Write a recording as NumPy arrays and a TOML file.

    Both have the same stem; reading restores the same recording.

    The ``.npz`` file holds ``baseband`` complex64 (pulses, range bins) in V, ``slow_time_s`` and ``range_m``; the TOML
    file holds the radar, the notes and the further facts. The truth about the targets is not stored.

    Parameters
    ----------
    recording : Recording
    path : path-like
        Path that ends in ``.npz``.

    Raises
    ------
    OutputError
        If the name does not end in ``.npz``, another kind of TOML file with this stem exists, or
        the files cannot be written; existing files then do not change.
    """
    target = Path(path)
    if target.suffix.lower() != ".npz":
        raise OutputError(f"{target}: must end in .npz")
    sidecar = target.with_suffix(".toml")
    if sidecar.exists():
        try:
            with sidecar.open(encoding="utf-8", errors="replace") as text:
                first = text.readline().rstrip()
        except OSError as error:
            raise OutputError(f"{sidecar}: cannot be read: {error}") from None
        if first != FIRST_LINE:
            raise OutputError(
                f"{sidecar}: exists and is not a description of arrays; choose another name than {target.name}"
            )
    with open_atomically(sidecar) as partial_facts, open_atomically(target) as partial:
        table = {"scale_v": 1.0, "conjugate": False, **list_facts(recording)}
        table |= {"radar": recording.radar.model_dump(exclude_none=True), "attributes": list_further_facts(recording)}
        partial_facts.write_text(f"{FIRST_LINE}\n{write_toml(table)}", encoding="utf-8")
        with partial.open("wb") as file:
            baseband = recording.baseband.values.astype("<c8")
            np.savez(file, baseband=baseband, slow_time_s=recording.slow_time_s, range_m=recording.range_m)


MAX_CONFIG_BYTES = 1 << 20
ADC_CODES = 4096
"""Codes of the 12-bit converter; the SDK gives shares of full scale, older programs the codes."""


def find_infineon_config(path: Path, head: bytes) -> Path | None:
    """Return the settings next to an array of chirps, or None."""
    shape = re.search(rb"'descr': '[<>|][fiu]\d+'.*'shape': \((\d+, ){2,3}\d+\)", head)
    if not head.startswith(NPY_MAGIC) or shape is None:
        return None
    for config in (path.with_suffix(".json"), path.with_name("config.json")):
        if config.is_file() and config.stat().st_size <= MAX_CONFIG_BYTES:
            text = config.read_bytes().lower()
            if any(name.encode() in text for name in NAMES["infineon"]["start_hz"]):
                return config
    return None


def _list_values(table: Any) -> Iterator[tuple[str, float]]:
    if isinstance(table, Mapping):
        for key, value in table.items():
            if isinstance(value, int | float) and not isinstance(value, bool):
                yield str(key).lower(), float(value)
            yield from _list_values(value)
    elif isinstance(table, list):
        for value in table:
            yield from _list_values(value)


def _read_settings(config: Path) -> dict[str, float]:
    try:
        values = list(_list_values(parse_json(config.read_bytes())))
    except ValueError as error:
        raise RecordingError(f"{config}: is no JSON: {error}") from None
    settings = {}
    for key, names in NAMES["infineon"].items():
        stated = {value for name, value in values if name in names}
        if len(stated) != 1:
            said = "lacks" if not stated else "has several values of"
            raise RecordingError(f"{config}: {said} {' or '.join(names)}; one is needed")
        settings[key] = check_number(config, names[0], stated.pop(), above=0)
    return settings


@plugin(
    "radar_reader",
    "infineon",
    sniff=lambda path, head: find_infineon_config(path, head) is not None,
    suffixes=(".npy",),
)
def read_infineon(
    path: Path,
    *,
    antenna: int | Literal["sum"] = 0,
    conjugate: bool = True,
    range_stop_m: float | None = None,
) -> Recording:
    """Read the chirps of one antenna, or of their sum; every chirp becomes a row of range bins."""
    with path.open("rb") as file:
        config = find_infineon_config(path, file.read(4096))
    if config is None:
        raise RecordingError(f"{path}: has no settings next to it; put the SDK's config.json into its folder")
    settings = _read_settings(config)
    n_samples, n_chirps = int(settings["n_samples"]), int(settings["n_chirps"])
    data = load_npy(path, RecordingError)
    if data.ndim == 3:  # one antenna
        data = data[:, np.newaxis]
    if data.ndim != 4 or data.dtype.kind not in "fiu" or data.shape[2:] != (n_chirps, n_samples) or not data.size:
        raise RecordingError(
            f"{path}: holds {data.dtype} values of shape {data.shape}; by {config.name} it is (frames, antennas, "
            f"{n_chirps} chirps, {n_samples} samples), real"
        )
    if antenna == "sum":
        chosen = data.sum(axis=1, dtype=np.float64)
    else:
        chosen = data[:, choose_number(path, "antenna", antenna, data.shape[1], " or 'sum'")].astype(np.float64)
    samples = chosen.reshape(-1, n_samples) / (1 if data.dtype.kind == "f" else ADC_CODES)
    chirp_s, frame_s = settings["chirp_s"], settings["frame_s"]
    if n_chirps * chirp_s > frame_s * (1 + 1e-9):
        raise RecordingError(
            f"{config}: {n_chirps} chirps every {chirp_s:g} s do not fit into a frame of {frame_s:g} s"
        )
    bandwidth_hz = check_number(config, "bandwidth", settings["stop_hz"] - settings["start_hz"], above=0)
    return label_sweeps(
        path,
        samples - samples.mean(axis=1, keepdims=True),
        name="Infineon radar",
        carrier_hz=settings["start_hz"] + bandwidth_hz / 2.0,
        bandwidth_hz=bandwidth_hz,
        n_ranges=n_samples // 2,
        range_stop_m=range_stop_m,
        frames=(len(data), n_chirps, frame_s, 1.0 / chirp_s),
        sweep_s=n_samples / settings["sample_rate_hz"],
        conjugate=conjugate,
        notes=[
            f"antenna {antenna} of {data.shape[1]}; {len(data)} frames of {n_chirps} chirps; settings of {config.name}",
            "the mean of every chirp is removed; levels are shares of the converter's full scale",
        ],
    )

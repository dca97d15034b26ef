"""Raw data of Infineon's Radar SDK: chirps of BGT60 sensors as a NumPy file, and the JSON of its settings.

The array is real, (frames, antennas, chirps, samples), as ``get_next_frame`` gives it; the settings are ``config.json``
or a JSON file of the same stem, whose names have changed between releases.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from doppelgait.core.documents import parse_json
from doppelgait.core.errors import RecordingError
from doppelgait.core.npz import NPY_MAGIC, load_npy
from doppelgait.core.plugins import plugin
from doppelgait.radar.measured import check_number, choose_number, label_sweeps
from doppelgait.radar.recording import Recording

MAX_CONFIG_BYTES = 1 << 20
ADC_CODES = 4096
"""Codes of the 12-bit converter; the SDK gives shares of full scale, older programs the codes."""
KEYS = {
    "start_hz": ("start_frequency_hz", "lower_frequency_hz"),
    "stop_hz": ("end_frequency_hz", "upper_frequency_hz"),
    "n_samples": ("num_samples_per_chirp", "num_samples"),
    "n_chirps": ("num_chirps_per_frame", "num_chirps"),
    "sample_rate_hz": ("sample_rate_hz", "samplerate_hz"),
    "chirp_s": ("chirp_repetition_time_s",),
    "frame_s": ("frame_repetition_time_s",),
}
"""Names of the settings, in any table of the JSON and in any case."""


def find_infineon_config(path: Path, head: bytes) -> Path | None:
    """Return the settings next to an array of chirps, or None."""
    shape = re.search(rb"'descr': '[<>|][fiu]\d+'.*'shape': \((\d+, ){2,3}\d+\)", head)
    if not head.startswith(NPY_MAGIC) or shape is None:
        return None
    for config in (path.with_suffix(".json"), path.with_name("config.json")):
        if config.is_file() and config.stat().st_size <= MAX_CONFIG_BYTES:
            text = config.read_bytes().lower()
            if any(name.encode() in text for name in KEYS["start_hz"]):
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
    for key, names in KEYS.items():
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

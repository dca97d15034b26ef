"""Plan of a model on a small device, with its work."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.classify.learned import Ensemble, Network
from doppelgait.classify.model import Calibration, Model
from doppelgait.core.errors import ConfigError
from doppelgait.core.units import SPEED_OF_LIGHT_MPS, doppler_axis_hz, doppler_to_velocity_mps
from doppelgait.processing import Analysis
from doppelgait.processing.config import plan_transform
from doppelgait.processing.patches import Patch

SAME = 1.01
"""Maximum ratio of the limits of a condition that counts as one number."""


@dataclass(frozen=True)
class Device:
    """Numbers of a radar, a window and a transform.
    Shapes: taper (M,).
    """

    prf_hz: float
    wavelength_m: float
    bins: int
    patch: Patch
    taper: npt.NDArray[np.float64]
    hop: int
    n_doppler: int
    n_columns: int
    n_stft: int
    still_time_s: float | None

    @property
    def window_pulses(self) -> int:
        """Pulses of the first window."""
        return self.taper.size + self.hop * (self.n_stft - 1)

    @property
    def columns_per_cell(self) -> float:
        """Columns of the transform in one of the picture."""
        return self.patch.column_s * self.prf_hz / self.hop

    @property
    def velocity_mps(self) -> npt.NDArray[np.float64]:
        """Velocities of the rows of the transform."""
        return np.asarray(doppler_to_velocity_mps(doppler_axis_hz(self.n_doppler, self.prf_hz), self.wavelength_m))

    @property
    def row_edges(self) -> npt.NDArray[np.float64]:
        """Edges of the picture's rows in rows of the transform."""
        rows = self.velocity_mps
        width = (rows[-1] - rows[0]) / (rows.size - 1)
        return np.asarray(np.clip((self.patch.edges_mps - rows[0]) / width + 0.5, 0.0, rows.size))

    @property
    def picture_starts(self) -> list[int]:
        """First columns of the pictures that cover a window."""
        spare = self.n_columns - self.patch.n_time
        count = 1 + -(-2 * spare // self.patch.n_time)
        return [int(start) for start in np.linspace(0, spare, count).round()]

    @property
    def factors(self) -> list[int]:
        """Prime factors of the transform's length, the largest first."""
        found, rest, factor = [], self.n_doppler, 2
        while rest > 1:
            while rest % factor == 0:
                found.append(factor)
                rest //= factor
            factor += 1
        return found[::-1]


def plan_device(
    model: Model,
    patch: Patch,
    *,
    prf_hz: float | None,
    carrier_hz: float | None,
    window_s: float | None,
    bins: int,
    still_time_s: float | None,
) -> Device:
    """Plan the processing of a radar's samples for a model."""
    analysis = Analysis.model_validate(model.facts.analysis)
    if analysis.method != "standard" or analysis.gate_doppler_hz is not None:
        raise ConfigError("--form c exports the standard analysis without gate_doppler_hz; this model has another one")
    prf = _read_condition(model, "prf_hz", prf_hz, "--prf-hz")
    wavelength_m = SPEED_OF_LIGHT_MPS / _read_condition(model, "carrier_hz", carrier_hz, "--carrier-hz")
    if window_s is None:
        window_s = model.facts.conditions.get("observation_s", (0.0, 0.0))[0]
    n_columns = max(patch.n_time, round(window_s / patch.column_s))
    transform = plan_transform(analysis, n_pulses=10**9, prf_hz=prf)
    n_stft = math.ceil(n_columns * patch.column_s * prf / transform.hop - 1e-6)
    return Device(
        prf,
        wavelength_m,
        bins,
        patch,
        transform.window,
        transform.hop,
        transform.n_doppler_bins,
        n_columns,
        n_stft,
        still_time_s,
    )


def _read_condition(model: Model, name: str, stated: float | None, option: str) -> float:
    low, high = model.facts.conditions.get(name, (math.nan, math.nan))
    if stated is not None:
        if stated < 0.9 * low or stated > 1.1 * high:
            raise ConfigError(f"{option} {stated:g}: the model was trained on {low:g} to {high:g}")
        return stated
    if math.isnan(low):
        raise ConfigError(f"the model does not state its {name}; set {option}")
    if high > SAME * low:
        raise ConfigError(f"the model was trained on {name} {low:g} to {high:g}; set that of your radar: {option}")
    return low


def list_parts(model: Model) -> list[tuple[Any, float, float, npt.NDArray[np.float64]]]:
    """Return members, weights, slopes and shifts.
    A single model counts as one member without calibration.
    """
    found = model.learned
    if isinstance(found, Ensemble):
        return list(zip(found.members, found.weights.tolist(), found.slopes.tolist(), found.shifts, strict=True))
    return [(found, 1.0, 1.0, np.zeros(len(model.facts.classes)))]


def select_networks(model: Model) -> Model | None:
    """Return the networks of a model alone, or None.
    The networks keep their calibrations; the calibration of the whole model is left out.
    """
    parts = list_parts(model)
    seeing = [part for part in parts if isinstance(part[0], Network)]
    if not seeing or len(seeing) == len(parts):
        return model if seeing else None
    weights = np.array([weight for _, weight, _, _ in seeing])
    joined = Ensemble(
        tuple(part[0] for part in seeing),
        weights / weights.sum(),
        np.array([part[2] for part in seeing]),
        np.array([part[3] for part in seeing]),
    )
    unchanged = Calibration(1.0, np.zeros(len(model.facts.classes)), 0)
    facts = model.facts.model_copy(update={"names": (), "features": "signature"})
    nothing = np.zeros(0)
    return Model(facts, joined, unchanged, nothing, nothing, nothing)


def count_work(device: Device, networks: list[Network]) -> dict[str, float]:
    """Count multiply-adds of the transform and of the networks."""
    k = device.n_doppler
    stages = sum(2 * k if factor == 2 else 4 * k * factor for factor in device.factors)
    column = device.bins * (2 * device.taper.size + stages + 2 * k) + 2 * k
    height, width, picture = device.patch.n_velocity, device.patch.n_time, 0
    for network in networks:
        height, width = device.patch.n_velocity, device.patch.n_time
        for kernel in network.kernels:
            picture += height * width * kernel.size
            height, width = height // 2, width // 2
        picture += network.weight.size
    return {
        "transform_per_s": column * device.prf_hz / device.hop,
        "network_per_window": 2.0 * len(device.picture_starts) * picture,
        "network_per_s": 2.0 * len(device.picture_starts) * picture * device.prf_hz / (device.hop * device.n_stft),
    }

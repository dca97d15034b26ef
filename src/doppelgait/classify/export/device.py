"""Plan of a model on a small device, with networks in integers.

The networks have 8-bit weights and activations, and 32-bit sums.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from doppelgait.classify.learned import Ensemble, FloatArray, IntArray, Network
from doppelgait.classify.model import Calibration, Model
from doppelgait.core.errors import ConfigError
from doppelgait.core.units import SPEED_OF_LIGHT_MPS, doppler_axis_hz, doppler_to_velocity_mps
from doppelgait.processing import Analysis
from doppelgait.processing.config import plan_transform
from doppelgait.processing.patches import Levels, Patch, convolve_and_pool, cut_pictures

SAME = 1.01  # maximum ratio of the limits of a condition that counts as one number

LARGEST = 127
MULTIPLIER_BITS = 30
FURTHEST_SHIFT = 40


@dataclass(frozen=True)
class CSettings:
    """Settings of the form ``c``.

    Parameters
    ----------
    integers : bool
        Networks in 8-bit integers instead of float32.
    prf_hz, carrier_hz : float, optional
        Pulse rate and carrier of the radar; by default those of the training data, if each is one
        number.
    window_s : float, optional
        Observation of one decision; by default the shortest one of the training data, and at least
        one picture.
    bins : int
        Range bins of the gate.
    still_time_s : float or None
        Time constant of the running mean that is subtracted as static echoes; None: the samples
        have none.
    data : Path, optional
        Dataset with held-out signatures that set the scales of the integers and are golden vectors;
        by default both are simulated.
    n_examples : int
        Golden vectors of each kind.
    seed : int
        Of the simulated examples.
    """

    integers: bool = False
    prf_hz: float | None = None
    carrier_hz: float | None = None
    window_s: float | None = None
    bins: int = 1
    still_time_s: float | None = 2.0
    data: Path | None = None
    n_examples: int = 16
    seed: int = 0


@dataclass(frozen=True)
class Device:
    """Numbers of a radar, a window and a transform."""

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
    def mean_weight(self) -> float:
        """Share of a new pulse in the running mean."""
        return 0.0 if self.still_time_s is None else -math.expm1(-1.0 / (self.still_time_s * self.prf_hz))

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


def plan_device(model: Model, patch: Patch, settings: CSettings) -> Device:
    """Plan the processing of a radar's samples for a model."""
    analysis = Analysis.model_validate(model.facts.analysis)
    if analysis.method != "standard" or analysis.gate_doppler_hz is not None:
        raise ConfigError("--form c exports the standard analysis without gate_doppler_hz; this model has another one")
    prf = _read_condition(model, "prf_hz", settings.prf_hz, "--prf-hz")
    wavelength_m = SPEED_OF_LIGHT_MPS / _read_condition(model, "carrier_hz", settings.carrier_hz, "--carrier-hz")
    window_s = settings.window_s
    if window_s is None:
        window_s = model.facts.conditions.get("observation_s", (0.0, 0.0))[0]
    n_columns = max(patch.n_time, round(window_s / patch.column_s))
    transform = plan_transform(analysis, n_pulses=10**9, prf_hz=prf)
    n_stft = math.ceil(n_columns * patch.column_s * prf / transform.hop - 1e-6)
    stft = transform.window, transform.hop, transform.n_doppler_bins
    return Device(prf, wavelength_m, settings.bins, patch, *stft, n_columns, n_stft, settings.still_time_s)


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
    """Return members, weights, slopes and shifts."""
    found = model.learned
    if isinstance(found, Ensemble):
        return list(zip(found.members, found.weights.tolist(), found.slopes.tolist(), found.shifts, strict=True))
    return [(found, 1.0, 1.0, np.zeros(len(model.facts.classes)))]


def select_networks(model: Model) -> Model | None:
    """Return the networks of a model with their calibrations, or None."""
    parts = list_parts(model)
    seeing = [part for part in parts if isinstance(part[0], Network)]
    if not seeing or len(seeing) == len(parts):
        return model if seeing else None
    members, weights, slopes, shifts = zip(*seeing, strict=True)
    joined = Ensemble(members, np.array(weights) / np.sum(weights), np.array(slopes), np.array(shifts))
    return replace(model, learned=joined, calibration=Calibration(1.0, np.zeros(len(model.facts.classes)), 0))


def count_work(device: Device, networks: list[Network]) -> dict[str, float]:
    """Count multiply-adds of the transform and of the networks."""
    k = device.n_doppler
    stages = sum(2 * k if factor == 2 else 4 * k * factor for factor in device.factors)
    column = device.bins * (2 * device.taper.size + stages + 2 * k) + 2 * k
    cells, picture = device.patch.n_velocity * device.patch.n_time, 0
    for network in networks:
        picture += sum(cells // 4**n * kernel.size for n, kernel in enumerate(network.kernels)) + network.weight.size
    return {
        "transform_per_s": column * device.prf_hz / device.hop,
        "network_per_window": 2.0 * len(device.picture_starts) * picture,
        "network_per_s": 2.0 * len(device.picture_starts) * picture * device.prf_hz / (device.hop * device.n_stft),
    }


class IntegerLayer(NamedTuple):
    """Convolution of integers; (sum * multiplier + offset) >> shift, 0 to 127."""

    kernel: IntArray
    multiplier: IntArray
    offset: IntArray
    shift: int


@dataclass(frozen=True, eq=False)
class IntegerNetwork(Network):
    """Network with layers in integers."""

    layers: tuple[IntegerLayer, ...] = ()
    last_weight: IntArray = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int64))
    last_scale: FloatArray = field(default_factory=lambda: np.zeros(0))

    def score_pictures(self, layer: Levels) -> FloatArray:
        """Return scores (n, n_classes) of images (n, 1, n_velocity, n_time)."""
        whole = np.floor(layer.astype(np.float32) * np.float32(LARGEST) + np.float32(0.5)).astype(np.int64)
        for kernel, multiplier, offset, shift in self.layers:
            # the sums are exact in double precision
            total = convolve_and_pool(whole.astype(np.float64), kernel.astype(np.float64)).astype(np.int64)
            whole = total * multiplier[:, None, None] + offset[:, None, None]
            whole = np.clip(whole >> shift, 0, LARGEST)
        return np.asarray(whole.sum(axis=(2, 3)) @ self.last_weight.T * self.last_scale + self.bias)


def quantise(network: Network, examples: list[Levels]) -> IntegerNetwork:
    """Convert a network to integers."""
    # one scale per output channel, and one per layer: its largest activation is 127
    pictures = np.concatenate([cut_pictures(whole, network.patch) for whole in examples])
    values = np.concatenate([pictures, pictures[:, ::-1]])[:, None].astype(np.float64)
    layers, unit = [], 1.0 / LARGEST
    for kernel, scale, bias in zip(network.kernels, network.scales, network.biases, strict=True):
        values = convolve_and_pool(values, kernel.astype(np.float64))
        values = np.maximum(values * scale[:, None, None] + bias[:, None, None], 0.0)
        step = np.maximum(np.abs(kernel).max(axis=(1, 2, 3)).astype(np.float64), 1e-12) / LARGEST
        whole = np.round(kernel / step[:, None, None, None]).astype(np.int64)
        after = max(float(values.max()), 1e-6) / LARGEST
        factor, start = unit * step * scale / after, bias / after
        largest = float(np.abs(factor).max())
        shift = min(MULTIPLIER_BITS - int(np.ceil(np.log2(largest))) if largest > 0 else 0, FURTHEST_SHIFT)
        offset = np.round((start + 0.5) * 2.0**shift).astype(np.int64)
        layers.append(IntegerLayer(whole, np.round(factor * 2.0**shift).astype(np.int64), offset, shift))
        unit = after
    step = np.maximum(np.abs(network.weight).max(axis=1).astype(np.float64), 1e-12) / LARGEST
    last = np.round(network.weight / step[:, None]).astype(np.int64)
    own = {part.name: getattr(network, part.name) for part in fields(Network)}
    scale = (step * unit / np.prod(values.shape[2:])).astype(np.float32).astype(np.float64)
    return IntegerNetwork(**own, layers=tuple(layers), last_weight=last, last_scale=scale)

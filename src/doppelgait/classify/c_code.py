"""Networks of tracks on a small device: C99, one header and one source, without allocation."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait import __version__
from doppelgait.classify.learned import LAYERS, Learned
from doppelgait.classify.model import TOLERANCE, Model, describe_outside_conditions
from doppelgait.classify.scorer import LONGEST_S, MOST_LOG, SCALE
from doppelgait.core.errors import ConfigError
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.pipeline.verdicts import CELL_MPS, COLUMN_S, SIGNIFICANT, SLICE_M
from doppelgait.processing import Analysis
from doppelgait.processing.config import plan_transform
from doppelgait.processing.patches import N_CELLS, N_COLUMNS, N_SLICES, RANGE_DB
from doppelgait.radar import Radar

TEXTS = Path(__file__).parent / "c99"
LINE = 112
SIZES = {"float": 4, "int8_t": 1}
BODY_M, REACH_M = 0.3, 0.5  # half extents of a body and of the search for it
GAINS = {"ALPHA": 0.4, "BETA": 0.3, "NOISE_SHARE": 0.2, "SPIKE": 30.0}
"""Gains of range, velocity and noise, and power of a spike over the mean of a processing interval; assumed."""
MOST_SPIKES = 20  # pulses in succession, after which the level has changed
CONFIRM, MOST_LOST, LEAST_FOUND = 5, 10, 0.6  # columns to begin, columns without an echo, share of a window with one
SURE_SD = 8.0  # standard deviations above the mean of the noise at which a column has an echo
TOLERANCE_OF_GOLDEN = 1e-3
LARGEST = 127
HOPS_PER_COLUMN = 4  # transforms whose power is one column of a picture
HOP_S = 0.5  # from a decision to the next


@dataclass(frozen=True)
class CSettings:
    """Settings of the form ``c``.

    Parameters
    ----------
    radar : Radar
        Radar of the device: range bins, pulse rate and carrier.
    integers : bool
        Weights of the convolutions in 8-bit integers instead of float32.
    still_time_s : float or None
        Time constant of the running mean that is subtracted as static echoes; None: the samples
        have none.
    n_examples : int
        Number of golden vectors.
    """

    radar: Radar
    integers: bool = False
    still_time_s: float | None = 2.0
    n_examples: int = 16


@dataclass(frozen=True)
class Device:
    """Numbers of a radar, a window and a transform."""

    radar: Radar
    taper: npt.NDArray[np.float64]
    hop: int
    n_doppler: int
    n_columns: int
    still_time_s: float | None


def plan_device(model: Model, settings: CSettings) -> Device:
    """Plan the processing of a radar's samples for a model."""
    radar, analysis = settings.radar, Analysis.model_validate(model.facts.analysis)
    conditions = dict.fromkeys(model.facts.conditions, math.nan)
    conditions |= {"carrier_hz": SPEED_OF_LIGHT_MPS / radar.wavelength_m, "prf_hz": radar.prf_hz}
    known = {name: span for name, span in model.facts.conditions.items() if name in ("carrier_hz", "prf_hz")}
    if outside := describe_outside_conditions(conditions, known):
        raise ConfigError(f"--radar: {'; '.join(outside)}")
    if radar.n_range_bins < 2 or radar.burst_pulses is not None:
        raise ConfigError("--radar: the C code follows a target over range bins; this radar has one bin, or bursts")
    hop = max(1, round(COLUMN_S / HOPS_PER_COLUMN * radar.prf_hz))
    transform = plan_transform(analysis.model_copy(update={"hop": hop}), n_pulses=10**9, prf_hz=radar.prf_hz)
    seconds = (model.facts.window_s or 2.5) - transform.window.size / radar.prf_hz
    n_columns = min(max(int(seconds * radar.prf_hz / (HOPS_PER_COLUMN * hop)), 1), N_COLUMNS)
    n_doppler = 1 << (transform.window.size - 1).bit_length()
    return Device(radar, transform.window, hop, n_doppler, n_columns, settings.still_time_s)


def drop_features(network: Learned) -> Learned:
    """Return a network that answers as if no feature were known."""
    own = network.arrays
    return replace(network, arrays={**own, "feature_weight": np.zeros_like(own["feature_weight"])})


def round_kernels(network: Learned) -> Learned:
    """Round the kernels to 8-bit integers, with a scale of every channel."""
    own = dict(network.arrays)
    for name in [name for name in own if name.startswith("kernel.")]:
        scale = name.replace("kernel", "scale")
        step = np.maximum(np.abs(own[name]).max(axis=(1, 2, 3)), 1e-12) / LARGEST
        own[name] = np.round(own[name] / step[:, None, None, None]).astype(np.float32)
        own[scale] = (own[scale] * step).astype(np.float32)
    return replace(network, arrays=own)


def find_obstacle(model: Model) -> str:
    """Return why a model has no form in C, or an empty text."""
    facts, own = model.facts, model.learned
    if own.kind == "track" and "kernel.0" in own.arrays and None not in (facts.alarm, facts.alarm_threshold):
        return ""
    return f"{facts.name} is no network of tracks with pictures and an alarm; train one with torch"


class Sources:
    """Text of an export of a model, with the size of its tables."""

    def __init__(self, model: Model, device: Device, *, integers: bool) -> None:
        if obstacle := find_obstacle(model):
            raise ConfigError(f"--form c: {obstacle}")
        self.model, self.device, self.integers = model, device, integers
        network = drop_features(model.learned)
        self.network = (round_kernels(network) if integers else network).arrays
        self.n_layers = sum(name.startswith("kernel.") for name in self.network)
        self.flash_bytes = 0
        self._tables: list[str] = []
        self.tables = self._make_tables()

    def header(self) -> str:
        """Return the text of the header."""
        macros = "\n".join(f"#define DG_{name} {value}" for name, value in self._collect_macros().items())
        about = f"/* {self.model.facts.name}, trained on {self.model.facts.dataset_name}; doppelgait {__version__} */"
        weight = f"typedef {'int8_t' if self.integers else 'float'} dg_weight;"
        engine = (TEXTS / "engine.h").read_text(encoding="utf-8")
        return engine.replace("/* @MACROS@ */", f"{about}\n{macros}\n\n{weight}")

    def source(self) -> str:
        """Return the text of the source."""
        return (TEXTS / "engine.c").read_text(encoding="utf-8").replace("/* @TABLES@ */", self.tables)

    def _collect_macros(self) -> dict[str, Any]:
        from scipy.stats import gamma

        facts, device, network = self.model.facts, self.device, self.network
        biases = [network[f"bias.{n}"] for n in range(self.n_layers)]
        sizes = [N_COLUMNS * N_CELLS // 4**n * bias.size for n, bias in enumerate(biases, 1)]
        whole, bin_m = N_COLUMNS * N_CELLS * N_SLICES, device.radar.bin_spacing_m
        most_mps = facts.conditions.get("speed_mps", (0.0, math.inf))[1] * TOLERANCE["speed_mps"][1]
        body = max(1, round(BODY_M / bin_m))
        cells = (2 * body + 1) * device.n_doppler * HOPS_PER_COLUMN
        # above 4 times its mean, exponential noise has the mean excess 4 exp(-4) and the variance 17 exp(-4)
        window, lags = device.taper**2, device.hop * np.arange(1, HOPS_PER_COLUMN)
        rows = device.n_doppler * float((window**2).sum() / window.sum() ** 2)  # cells per independent one
        alike = [
            float(device.taper[lag:] @ device.taper[:-lag] / window.sum()) ** 2 for lag in lags if lag < window.size
        ]
        columns = 1.0 + 2.0 * sum(alike[n] * (1.0 - (n + 1) / HOPS_PER_COLUMN) for n in range(len(alike)))
        density = device.radar.waveform.independent_bins(device.radar)
        least = cells * SIGNIFICANT * math.exp(-SIGNIFICANT)
        variance = (SIGNIFICANT**2 + 1.0) * math.exp(-SIGNIFICANT) * cells * rows * columns / density
        least += SURE_SD * math.sqrt(variance)
        # mean of the lowest third of row means, which are gamma variables, over their mean
        bins = density * device.radar.n_range_bins
        bias = 3.0 * float(gamma.cdf(gamma.ppf(1.0 / 3.0, bins), bins + 1.0))
        prf_hz, still_s = device.radar.prf_hz, device.still_time_s or math.inf
        column_s = HOPS_PER_COLUMN * device.hop / prf_hz
        row_mps = prf_hz * device.radar.wavelength_m / (2.0 * device.n_doppler)  # of a row
        of_alarm = facts.classes.index(str(facts.alarm)), float(facts.alarm_threshold or 1.0)
        values: dict[str, float] = {"CLASSES": len(facts.classes), "ABSTAIN_BELOW": facts.abstain_below}
        values |= zip(("ALARM_CLASS", "ALARM_THRESHOLD"), of_alarm, strict=True)
        values |= {"SLOPE": self.model.calibration.slope, "TOLERANCE": TOLERANCE_OF_GOLDEN}
        values |= {"BINS": device.radar.n_range_bins, "BIN_M": bin_m, "PRF_HZ": prf_hz}
        values |= {"FIRST_M": float(device.radar.range_axis_m()[0]), "ROW_MPS": row_mps}
        values |= {"CPI": device.taper.size, "DOPPLER": device.n_doppler, "HOP": device.hop}
        values |= {"HOPS_PER_COLUMN": HOPS_PER_COLUMN, "COLUMNS": device.n_columns, "COLUMN_S": column_s}
        values |= {"HOP_COLUMNS": round(HOP_S / column_s), "POWER_SHARE": 1.0 / device.taper.size}
        values |= {"TIMES": N_COLUMNS, "VELOCITIES": N_CELLS, "SLICES": N_SLICES}
        values |= {"CELL_MPS": CELL_MPS, "SLICE_M": SLICE_M, "RANGE_DB": RANGE_DB}
        values |= {"LAYERS": self.n_layers, "CHANNELS": biases[-1].size}
        values |= {"EVEN_VALUES": max(whole, *sizes[1::2]), "ODD_VALUES": max(sizes[0::2])}
        parts = {"EMBEDDING": "embed", "MEMORY": "gate", "HIDDEN": "hidden"}
        values |= {key: network[f"{name}_bias"].size for key, name in parts.items()}
        values |= {"LONGEST_S": LONGEST_S, "MOST_LOG": MOST_LOG, "SCALE": SCALE}
        values |= {"CONFIRM": CONFIRM, "MOST_LOST": MOST_LOST, "MOST_SPIKES": MOST_SPIKES, **GAINS}
        values |= {"BODY_BINS": body, "REACH_M": max(REACH_M, bin_m), "MOST_MPS": min(most_mps, 1e9)}
        values |= {"LEAST_FOUND": math.ceil(LEAST_FOUND * device.n_columns)}
        values |= {"SIGNIFICANT": SIGNIFICANT, "LEAST_ENERGY": least, "NOISE_BIAS": bias}
        values |= {"STILL_SHARE": -math.expm1(-1.0 / (still_s * prf_hz))}  # of a pulse in the running mean
        return {key: _format_float(n) if isinstance(n, float) else n for key, n in values.items()}

    def _add_array(self, name: str, kind: str, values: Any) -> str:
        flat = np.ravel(values)
        sized = ("int8_t" if self.integers else "float") if kind == "dg_weight" else kind
        self.flash_bytes += flat.size * SIZES[sized]
        words = [_format_float(each) if sized == "float" else str(int(each)) for each in flat.tolist()]
        self._tables.append(f"static const {kind} {name}[{flat.size}] = {{\n{_wrap(words)}\n}};")
        return name

    def _make_tables(self) -> str:
        device, network, rows = self.device, self.network, []
        named = ", ".join(f'"{name}"' for name in self.model.facts.classes)
        self._tables.append(f"const char *const dg_class_names[DG_CLASSES] = {{{named}}};")
        for number in range(self.n_layers):
            kernel, *rest = (network[f"{name}.{number}"] for name in LAYERS)
            names = [self._add_array(f"kernel{number}", "dg_weight", kernel.transpose(0, 2, 3, 1))]
            scaled = zip(("scale", "bias"), rest, strict=True)
            names += [self._add_array(f"{name}{number}", "float", each) for name, each in scaled]
            rows.append(f"    {{{', '.join([*names, str(kernel.shape[1]), str(kernel.shape[0])])}}}")
        self._tables.append("static const dg_layer layers[DG_LAYERS] = {\n" + ",\n".join(rows) + "\n};")
        # the features' part of the embedding is the same for every window
        weight, bias = network["embed_weight"], network["feature_bias"]
        n_pooled = weight.shape[1] - bias.size
        unknown = weight[:, n_pooled:] @ np.maximum(bias, 0.0)
        tables = {"embed_weight": weight[:, :n_pooled], "embed_bias": network["embed_bias"] + unknown}
        own = [f"{name}_{kind}" for name in ("gate", "value", "hidden") for kind in ("weight", "bias")]
        tables |= {name: network[name] for name in [*own, "forgetting_hz"]}
        tables |= {"last_weight": network["weight"], "last_bias": network["bias"]}
        tables |= {"calibration_shift": self.model.calibration.shift, "taper": device.taper}
        for name, values in tables.items():
            self._add_array(name, "float", values)
        turns = np.exp(2j * np.pi * np.arange(device.n_doppler) / device.n_doppler)
        pairs = _wrap([f"{{{_format_float(each.real)},~{_format_float(each.imag)}}}" for each in turns])
        self.flash_bytes += 8 * turns.size
        self._tables.append(f"static const float turns[DG_DOPPLER][2] = {{\n{pairs.replace('~', ' ')}\n}};")
        return "\n\n".join(self._tables)


def _format_float(value: float) -> str:
    text = str(np.float32(value))
    return f"{text}f" if "." in text or "e" in text else f"{text}.0f"


def _wrap(words: list[str]) -> str:
    text = "".join(f"{word}, " for word in words)
    lines = fill(text, LINE, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)
    return lines.removesuffix(",")

"""Examples for an export, with the probabilities of the model."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.classify.export import scorer
from doppelgait.classify.export.device import Device, list_parts, select_networks
from doppelgait.classify.learned import Ensemble, FloatArray, Network, join_inputs
from doppelgait.classify.model import Model
from doppelgait.processing.patches import Levels, Patch, levels_of

Complex = npt.NDArray[np.complex64]

SPEED_MPS, STRIDE_HZ, SWING, LIMBS = (0.4, 3.0), (0.6, 2.5), (0.3, 1.5), 4
NOISE_DB, STILL = (-50.0, 10.0), 20.0


def walk_samples(rng: np.random.Generator, device: Device) -> Complex:
    """Simulate a window of a body that swings four limbs.
    The window has noise, and a static echo if the device removes one. Shapes: returns (n_pulses, n_bins).
    """
    time_s = np.arange(device.window_pulses) / device.prf_hz
    speed = rng.choice([-1.0, 1.0]) * rng.uniform(*SPEED_MPS)
    stride = 2.0 * np.pi * rng.uniform(*STRIDE_HZ)
    samples = np.zeros((time_s.size, device.bins), dtype=np.complex128)
    for limb in range(1 + LIMBS):
        swing, phase = (rng.uniform(*SWING), rng.uniform(0.0, 2.0 * np.pi)) if limb else (0.05, 0.0)
        moved_m = speed * (time_s + swing * (np.sin(stride * time_s + phase) - math.sin(phase)) / stride)
        echo = np.exp(4j * np.pi / device.wavelength_m * moved_m) * (0.3 if limb else 1.0)
        samples += echo[:, None] * rng.uniform(0.2, 1.0, device.bins)
    noise = 10.0 ** (rng.uniform(*NOISE_DB) / 20.0) / math.sqrt(2.0)
    samples += noise * (rng.normal(size=samples.shape) + 1j * rng.normal(size=samples.shape))
    if device.still_time_s is not None:
        samples += STILL * np.exp(2j * np.pi * rng.random(device.bins))
    return samples.astype(np.complex64)


def convert_samples(samples: Complex, device: Device) -> Levels:
    """Convert a window's samples to levels, (n_velocity, n_columns)."""
    moving = samples.astype(np.complex128)
    if device.still_time_s is not None:
        moving = remove_running_mean(moving, device)
    power, column_s, _ = scorer.signature(
        moving, prf_hz=device.prf_hz, taper=device.taper, hop=device.hop, n_doppler=device.n_doppler
    )
    patch = device.patch.model_dump()
    whole = scorer.levels(power, patch, column_s=column_s, velocity_mps=device.velocity_mps)
    return np.asarray(whole[:, : device.n_columns])


def compute_mean_weight(device: Device) -> float:
    """Return a new pulse's share in the running mean."""
    return 0.0 if device.still_time_s is None else -math.expm1(-1.0 / (device.still_time_s * device.prf_hz))


def remove_running_mean(samples: npt.NDArray[np.complex128], device: Device) -> npt.NDArray[np.complex128]:
    """Subtract the running mean."""
    mean, moving, share = (
        np.zeros(samples.shape[1], dtype=np.complex128),
        np.empty_like(samples),
        compute_mean_weight(device),
    )
    for number, pulse in enumerate(samples):
        mean = mean + max(share, 1.0 / (number + 1)) * (pulse - mean)
        moving[number] = pulse - mean
    return moving


def collect_levels(folder: Path, patch: Patch, n_columns: int, most: int) -> list[Levels]:
    """Collect levels of held-out rows, truncated to the window.
    If no rows were held out, all rows are used.
    """
    from doppelgait.dataset.learning import read_signature
    from doppelgait.dataset.open import open_dataset

    dataset = open_dataset(folder)
    dataset.check_fields(["signature"])
    held = np.flatnonzero((dataset.index["split"] == "validation").to_numpy(dtype=bool))
    chosen = held if held.size else np.arange(len(dataset))
    chosen = chosen[np.linspace(0, chosen.size - 1, min(most, chosen.size)).round().astype(int)]
    found = []
    for number in chosen.tolist():
        whole = levels_of(read_signature(dataset, number), patch)
        if whole is not None:
            first = max(0, (whole.shape[1] - n_columns) // 2)
            part = whole[:, first : first + n_columns]
            found.append(np.pad(part, ((0, 0), (0, n_columns - part.shape[1]))))
    return found


def feature_rows(rng: np.random.Generator, model: Model, n: int) -> FloatArray:
    """Sample features within the training range.
    Features are unknown as often as in the training data. The values are exact in float32.
    """
    low, high = np.nan_to_num(model.lowest), np.nan_to_num(model.highest)
    values = rng.uniform(low, high, (n, low.size))
    values[rng.random(values.shape) < model.unknown] = np.nan
    return values.astype(np.float32).astype(np.float64)


def predict_networks(model: Model, levels: list[Levels]) -> FloatArray:
    """Return log-probabilities of every network, (n, n_networks, n_classes)."""
    whole = _wrap_objects(levels)
    found = [part[0].log_probability(whole) for part in list_parts(model) if isinstance(part[0], Network)]
    return np.stack(found, axis=1) if found else np.zeros((len(levels), 0, len(model.facts.classes)))


def predict_network_probability(model: Model, levels: list[Levels]) -> FloatArray:
    """Return the probabilities of the networks alone, (n, n_classes)."""
    part = select_networks(model)
    if part is None:
        raise ValueError("this model has no network")
    whole = _wrap_objects(levels)
    joined = isinstance(part.learned, Ensemble)
    return part.probability(join_inputs(np.zeros((len(levels), 0)), whole) if joined else whole)


def predict_model_probability(model: Model, features: FloatArray, levels: list[Levels]) -> FloatArray:
    """Return the probabilities of the whole model, (n, n_classes)."""
    return model.probability(join_inputs(features, _wrap_objects(levels)) if levels else features)


def _wrap_objects(levels: list[Levels]) -> npt.NDArray[Any]:
    whole = np.empty(len(levels), dtype=object)
    for number, each in enumerate(levels):
        whole[number] = each
    return whole

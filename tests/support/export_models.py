"""Small models of every kind, trained on random numbers, and inputs for them."""

import os
import warnings
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from doppelgait.classify.learned import LabelledRows, Learned, Seen, join_inputs
from doppelgait.classify.model import ECHOES, WIDEST, Calibration, Facts, Model
from doppelgait.classify.network import train_track_network
from doppelgait.classify.scorer import covering, of_pictures
from doppelgait.classify.training import train_boosting, train_logistic
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.processing.patches import N_CELLS, N_COLUMNS, N_SLICES, Patch

NAMES = (
    "torso_speed_mps", "doppler_bandwidth_mps", "step_length_m", "harmonic_ratio_2", "harmonic_ratio_3",
    "limb_torso_ratio", "gait_frequency_hz",
)  # fmt: skip
KINDS = ("linear", "trees", "network", "ensemble")
SHARES = (0.2, 0.5, 0.3)

ALARM_MODEL = SimpleNamespace(
    facts=SimpleNamespace(
        classes=("human", "dog"), abstain_below=0.8, alarm="human", alarm_threshold=0.6,
        conditions={"observation_s": (2.0, 4.0)}, window_s=None,
    ),
    calibration=SimpleNamespace(n_rows=98), learned=SimpleNamespace(kind="linear"),
)  # fmt: skip
ALARM_MODEL.of_tracks = ALARM_MODEL


def random_features(rng: np.random.Generator, n: int) -> np.ndarray:
    """Rows of positive and of signed values, large and small, some unknown; exact in float32."""
    values = np.exp(rng.normal(0.0, 1.0, (n, len(NAMES)))) * np.geomspace(0.01, 1e4, len(NAMES))
    values[:, 1] -= np.median(values[:, 1])
    values[:, 4:][rng.random((n, len(NAMES) - 4)) < 0.2] = np.nan
    return values.astype(np.float32).astype(np.float64)


def random_network(rng: np.random.Generator, n_classes: int, patch: Patch, channels: tuple[int, ...]) -> Learned:
    own, n_in = {}, 1
    for n, n_out in enumerate(channels):
        own[f"kernel.{n}"] = rng.normal(0.0, (2.0 / (9 * n_in)) ** 0.5, (n_out, n_in, 3, 3)).astype(np.float32)
        own[f"scale.{n}"] = rng.choice([-1.0, 1.0], n_out, p=[0.2, 0.8]).astype(np.float32) * np.float32(1.3)
        own[f"bias.{n}"] = rng.normal(0.0, 0.1, n_out).astype(np.float32)
        n_in = n_out
    weight = rng.normal(0.0, 2.0, (n_classes, n_in)).astype(np.float32)
    own |= {"weight": weight, "bias": np.zeros(n_classes, np.float32)}
    # scores of pictures then differ by as much as those of a trained network
    scores = of_pictures(own, np.stack([random_levels(rng, patch, patch.n_time) for _ in range(40)]))
    scores -= scores.mean(axis=1, keepdims=True)
    factor = 1.5 / scores.std(axis=0).mean()
    bias = (-factor * scores.mean(axis=0)).astype(np.float32)
    return Learned("network", own | {"weight": (factor * weight).astype(np.float32), "bias": bias}, patch)


def a_signature(carrier_hz: float, prf_hz: float, *, stated: bool = True) -> xr.DataArray:
    """A signature of nothing but axes."""
    doppler_hz = (np.arange(64) - 32) * prf_hz / 64
    coords = {"doppler": doppler_hz, "velocity": ("doppler", doppler_hz * SPEED_OF_LIGHT_MPS / carrier_hz / 2)}
    attrs = {"wavelength_m": SPEED_OF_LIGHT_MPS / carrier_hz} if stated else {}
    return xr.DataArray(np.ones((3, 64)), dims=("time", "doppler"), coords=coords, attrs=attrs)


def track_rows(rng: np.random.Generator, n: int) -> LabelledRows:
    """Windows of tracks of two classes, three of each, the last one without pictures."""
    labels, windows = np.arange(n) // 3 % 2, np.empty(n, dtype=object)
    for number, label in enumerate(labels):
        pictures = rng.integers(0, 60 + 60 * label, (1, N_SLICES, N_COLUMNS, N_CELLS), dtype=np.uint8)
        windows[number] = Seen(pictures if number < n - 1 else None, number // 3, 0.7 * (number % 3))
    features = random_features(rng, n)
    features[:, 0] = np.exp(rng.normal(labels, 0.5))
    return LabelledRows(join_inputs(features, windows), labels)


def model_of_tracks(n: int = 30, network: Learned | None = None) -> tuple[Model, LabelledRows]:
    """A model that follows tracks, trained for an epoch where torch is installed, and its rows."""
    rows = track_rows(np.random.default_rng(5), n)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        network = network or train_track_network(rows, rows, n_classes=2, seed=0, epochs=1)
    facts = export_model_of("linear").facts.model_copy(
        update={"features": "track", "blocking": ECHOES, "window_s": 2.5}
    )
    facts = facts.model_copy(update={"conditions": facts.conditions | {"speed_mps": (0.0, 3.0)}})
    ones = np.ones(len(NAMES))
    return Model(facts, network, Calibration(1.3, np.array([0.0, 0.2]), 9), -WIDEST * ones, WIDEST * ones, ones), rows


def random_track_network(rng: np.random.Generator, n_classes: int, channels: tuple[int, ...] = (4, 6)) -> Learned:
    """A network of tracks of random numbers; its answers differ from picture to picture."""
    n, e, m, h, arrays = 2 * len(NAMES), 7, 5, 6, {}
    for k, (n_in, n_out) in enumerate(pairwise((N_SLICES, *channels))):
        arrays[f"kernel.{k}"] = rng.normal(0.0, (2.0 / (9 * n_in)) ** 0.5, (n_out, n_in, 3, 3))
        arrays |= {f"scale.{k}": rng.choice([-1.0, 1.3], n_out), f"bias.{k}": rng.normal(0.0, 0.1, n_out)}
    shapes = {"feature_": (4, n), "embed_": (e, 2 * channels[-1] + 4), "gate_": (m, e + 2), "value_": (m, e + 2)}
    shapes |= {"hidden_": (h, 3 * m), "": (n_classes, h)}
    arrays |= {f"{name}weight": rng.normal(0.0, 1.5 / size[1] ** 0.5, size) for name, size in shapes.items()}
    arrays |= {f"{name}bias": rng.normal(0.0, 0.1, size[0]) for name, size in shapes.items()}
    arrays |= {"forgetting_hz": rng.uniform(0.01, 0.2, m)}
    standard = {"median": np.zeros(len(NAMES)), "told": np.arange(len(NAMES)), "mean": np.zeros(n), "scale": np.ones(n)}
    own = {name: values.astype(np.float32) for name, values in arrays.items()}
    return Learned("track", {**standard, "floor": np.zeros(len(NAMES)), **own})


def random_levels(rng: np.random.Generator, patch: Patch, n_time: int) -> np.ndarray:
    """A noisy line and its surroundings."""
    rows = np.arange(patch.n_velocity)[:, None]
    line = patch.n_velocity * (0.5 + 0.3 * np.sin(np.arange(n_time) * rng.uniform(0.1, 0.6) + rng.uniform(0, 6)))
    height = rng.uniform(0.3, 1.2) * np.exp(-(((rows - line) / rng.uniform(1, 6)) ** 2))
    return np.clip(height + rng.normal(0, 0.1, (patch.n_velocity, n_time)), 0, 1).astype(np.float32)


def export_model_of(
    kind: str, n_classes: int = 2, *, patch: Patch | None = None, channels: tuple[int, ...] = (4, 8), seed: int = 0,
    **facts: Any,
) -> Model:  # fmt: skip
    """A model of a kind, with a calibration that changes something."""
    rng = np.random.default_rng(seed)
    values = random_features(rng, 300)
    labels = np.digitize(np.nan_to_num(values[:, 4]), np.nanquantile(values[:, 4], np.arange(1, n_classes) / n_classes))
    labels[np.isnan(values[:, 5])] = n_classes - 1
    part, nothing = LabelledRows(values, labels), LabelledRows(values[:0], labels[:0])
    train = {"linear": train_logistic, "trees": train_boosting}
    net = random_network(rng, n_classes, patch or Patch(n_velocity=16, n_time=16), channels)
    if kind == "ensemble":
        members = [train[name](part, nothing, n_classes=n_classes, seed=0) for name in train]
        shifts = np.hstack([np.zeros((3, 1)), rng.normal(0, 0.5, (3, n_classes - 1))])
        slopes = rng.uniform(0.3, 0.8, 3)
        arrays = {"weights": np.array([0.4, 0.2, 0.4]), "slopes": slopes, "shifts": shifts}
        learned = Learned("ensemble", arrays, members=(*members, net))
    elif kind in ("network", "constant"):
        learned = net if kind == "network" else Learned("constant", {"log_share": np.log(SHARES[:n_classes])})
    else:
        learned = train[kind](part, nothing, n_classes=n_classes, seed=0)
    names = () if kind == "network" else NAMES
    stated = {
        "name": kind, "features": "six", "names": names, "classes": tuple("abcd"[:n_classes]), "dataset_id": "0",
        "dataset_name": "random", "version": "0", "n_train": 300, "n_held": 0, "seed": 0, "analysis": {},
        "conditions": {"carrier_hz": (7.29e9, 7.29e9), "prf_hz": (500.0, 500.0), "observation_s": (2.0, 2.0)},
    }  # fmt: skip
    shift = np.concatenate([[0.0], rng.normal(0, 0.3, n_classes - 1)])
    span = (np.nanmin(values, axis=0), np.nanmax(values, axis=0), np.isnan(values).mean(axis=0))
    return Model(
        Facts(**{**stated, **facts}), learned, Calibration(1.3, shift, 9), *(each[: len(names)] for each in span)
    )


def network_of(model: Model) -> Learned | None:
    return next((part for part in (model.learned, *model.learned.members) if part.kind == "network"), None)


def inputs_of(model: Model, n: int, n_time: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Features, levels (every tenth unknown), and both as the model takes them."""
    rng, net = np.random.default_rng(seed), network_of(model)
    features, levels = random_features(rng, n), np.empty(n, dtype=object)
    for row in range(n if net else 0):
        levels[row] = None if row % 10 == 3 else random_levels(rng, net.patch, n_time)
    joined = levels if not model.facts.names else features if net is None else join_inputs(features, levels)
    return features, levels, joined


def pictures_of(model: Model, levels: np.ndarray) -> np.ndarray:
    """Pictures (n, m, n_velocity, n_time) of levels of one length, NaN for unknown ones."""
    patch = network_of(model).patch
    known = next(whole for whole in levels if whole is not None)
    unknown = np.full((len(covering(known, vars(patch))), patch.n_velocity, patch.n_time), np.nan, np.float32)
    return np.stack([unknown if whole is None else covering(whole, vars(patch)) for whole in levels])


def require(found: object, what: str) -> None:
    """Skip a test where something is not installed; fail it in CI."""
    if not found:
        if os.environ.get("CI", "").lower() == "true":
            pytest.fail(f"CI needs {what}")
        pytest.skip(f"needs {what}")

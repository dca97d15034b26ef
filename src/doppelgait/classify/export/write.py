"""Exports of a trained model as folders."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait import __version__
from doppelgait.classify import scorer
from doppelgait.classify.export.c_code import TEXTS, Sources
from doppelgait.classify.export.device import CSettings, Device, list_parts, plan_device, quantise, select_networks
from doppelgait.classify.learned import Ensemble, FloatArray, TrackNetwork, join_inputs
from doppelgait.classify.model import Model
from doppelgait.classify.model_file import save_model
from doppelgait.core.errors import ConfigError
from doppelgait.core.files import check_out, complete_folder
from doppelgait.processing.patches import Levels, Patch, levels_of

FORMS = ("c", "numpy", "onnx")
SCALE_EXAMPLES = 100  # number of signatures that set the scales of integers
Complex = npt.NDArray[np.complex64]

SPEED_MPS, STRIDE_HZ, SWING, LIMBS = (0.4, 3.0), (0.6, 2.5), (0.3, 1.5), 4
NOISE_DB, STILL = (-50.0, 10.0), 20.0
LISTING, FORMAT = "export.json", "doppelgait-model-export"


@dataclass(frozen=True)
class Export:
    """Written export."""

    folder: Path
    files: tuple[str, ...]
    facts: Mapping[str, Any]


def export_model(model: Model, form: str, folder: str | Path, settings: CSettings | None = None) -> Export:
    """Write a model in a form for other programs.

    Parameters
    ----------
    form : {"c", "numpy", "onnx"}
        ``c``: C99 of the networks of a model, from complex samples of a gate to probabilities.
        ``numpy``: the model file and a scorer that needs NumPy alone. ``onnx``: one graph from
        features and pictures to calibrated probabilities.
    folder : path
        Appears complete or not at all; replaces an earlier export.
    settings : CSettings, optional
        Of the form ``c`` only.

    Raises
    ------
    ConfigError
        If the form is unknown or cannot hold the model, a library for it is missing, the radar is
        not known, or the folder holds anything else.
    OutputError
        If it cannot be written.

    See Also
    --------
    save_model : write a model file that doppelgait reads.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.classify.export_model(dg.classify.open_model("x4"), "numpy", "scorer").files
    ('model.npz', 'scorer.py')
    """
    out, found = Path(folder), dict[str, Any]()
    if form not in FORMS:
        raise ConfigError(f"--form: form {form!r} is not known; allowed are {', '.join(FORMS)}")
    if form != "numpy" and isinstance(model.learned, TrackNetwork):
        raise ConfigError(
            f"--form {form}: {model.facts.name} follows tracks by pictures along range, which this form does not make; "
            "use --form numpy, or export a model of windows"
        )
    if settings is not None and form != "c":
        raise ConfigError(f"--form {form}: has no settings of a radar or device; these are for --form c")
    check_out(out, listing=LISTING, file_format=FORMAT, command="doppelgait model export")
    contents: dict[str, bytes] = {}
    if form == "onnx":
        from doppelgait.classify.export.onnx_graph import build_onnx_model

        contents["model.onnx"] = build_onnx_model(model).SerializeToString()
    elif form == "c":
        contents, found = _make_c_files(model, settings or CSettings())
    else:
        contents["scorer.py"] = Path(scorer.__file__).read_bytes()
    if form != "numpy" and model.track is not None:
        found = {**found, "left_out": "the model of tracks, which only --form numpy has"}
    with complete_folder(out) as partial:
        for name, content in contents.items():
            (partial / name).write_bytes(content)
        if form == "numpy":
            save_model(model, partial / "model.npz")
        files = sorted(path.name for path in partial.iterdir())
        facts = {"format": FORMAT, "form": form, "doppelgait": __version__, "files": files, **found}
        facts["model"] = model.facts.model_dump(mode="json")
        (partial / LISTING).write_text(json.dumps(facts, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    return Export(out, tuple(files), found)


def _make_c_files(model: Model, settings: CSettings) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Write header, source, golden vectors and their test."""
    exact = select_networks(model)
    if exact is None:
        raise ConfigError(
            f"--form c: the model {model.facts.name} has no network of signatures, and features are not computed on a "
            "device; train an ensemble or signature-network, or use --form onnx or numpy"
        )
    rng, model = np.random.default_rng(settings.seed), exact
    device = plan_device(exact, list_parts(exact)[0][0].patch, settings)
    samples = [walk_samples(rng, device) for _ in range(settings.n_examples)]
    simulated = scaling = [convert_samples(each, device) for each in samples]
    if settings.data is not None:
        scaling = collect_levels(settings.data, device.patch, device.n_columns, SCALE_EXAMPLES)
    elif settings.integers:
        more = range(SCALE_EXAMPLES - len(simulated))
        scaling = [*simulated, *(convert_samples(walk_samples(rng, device), device) for _ in more)]
    levels = scaling[: settings.n_examples]
    if settings.integers:
        parts = [quantise(part[0], scaling[:SCALE_EXAMPLES]) for part in list_parts(exact)]
        learned = exact.learned
        integers: Any = replace(learned, members=tuple(parts)) if isinstance(learned, Ensemble) else parts[0]
        model = replace(exact, learned=integers)
    sources = Sources(model, device)
    words: list[Any] = [np.array([2, len(samples), len(levels)], dtype=np.int32)]
    for inputs, rows in ((samples, simulated), ([each.T for each in levels], levels)):
        for each, answer in zip(inputs, predict_network_probability(model, rows) if rows else (), strict=True):
            words += [each, answer.astype(np.float32)]
    files = {
        "doppelgait_model.h": sources.header().encode(),
        "doppelgait_model.c": sources.source().encode(),
        "selftest.c": (TEXTS / "selftest.c").read_bytes(),
        "golden.bin": b"".join(np.ascontiguousarray(part).tobytes() for part in words),
    }
    facts = {"precision": "int8" if settings.integers else "float32", **sources.facts()}
    if settings.integers:
        apart = np.abs(predict_network_probability(model, scaling) - predict_network_probability(exact, scaling))
        facts |= {"int8_examples": len(scaling), "int8_mean_difference": float(apart.mean())}
        facts["int8_largest_difference"] = float(apart.max())
    return files, facts


def walk_samples(rng: np.random.Generator, device: Device) -> Complex:
    """Simulate a body that swings four limbs, (n_pulses, n_bins)."""
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


def remove_running_mean(samples: npt.NDArray[np.complex128], device: Device) -> npt.NDArray[np.complex128]:
    """Subtract the running mean."""
    mean, moving = np.zeros(samples.shape[1], dtype=np.complex128), np.empty_like(samples)
    for number, pulse in enumerate(samples):
        mean = mean + max(device.mean_weight, 1.0 / (number + 1)) * (pulse - mean)
        moving[number] = pulse - mean
    return moving


def collect_levels(folder: Path, patch: Patch, n_columns: int, most: int) -> list[Levels]:
    """Collect levels of held-out rows, truncated to the window."""
    from doppelgait.dataset.open import open_dataset, read_signature

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


def predict_network_probability(model: Model, levels: list[Levels]) -> FloatArray:
    """Return the probabilities of the networks alone, (n, n_classes)."""
    part = select_networks(model)
    if part is None:
        raise ValueError("this model has no network")
    whole = np.fromiter(levels, dtype=object)
    joined = isinstance(part.learned, Ensemble)
    return part.probability(join_inputs(np.zeros((len(levels), 0)), whole) if joined else whole)

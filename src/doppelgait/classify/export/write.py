"""Exports of a trained model as folders."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait import __version__
from doppelgait.classify.export import scorer
from doppelgait.classify.export.c_code import TEXTS, Sources
from doppelgait.classify.export.device import list_parts, plan_device
from doppelgait.classify.export.examples import (
    collect_levels,
    convert_samples,
    feature_rows,
    predict_model_probability,
    predict_network_probability,
    predict_networks,
    walk_samples,
)
from doppelgait.classify.export.integers import quantise
from doppelgait.classify.learned import Ensemble, Network
from doppelgait.classify.model import Model
from doppelgait.classify.model_file import save_model
from doppelgait.core.errors import ConfigError
from doppelgait.core.own_folder import check_out, complete_folder

FORMS = ("c", "numpy", "onnx")
SCALE_EXAMPLES = 100
"""Number of signatures that set the scales of integers."""
LISTING, FORMAT = "export.json", "doppelgait-model-export"


@dataclass(frozen=True)
class CSettings:
    """Settings of the form ``c``.

    Parameters
    ----------
    integers : bool
        Networks in 8-bit integers instead of float32.
    prf_hz, carrier_hz : float, optional
        Pulse rate and carrier of the radar; by default those of the training data, if each is one number.
    window_s : float, optional
        Observation of one decision; by default the shortest one of the training data, and at least one picture.
    bins : int
        Range bins of the gate.
    still_time_s : float or None
        Time constant of the running mean that is subtracted as static echoes; None: the samples have none.
    data : Path, optional
        Dataset with held-out signatures that set the scales of the integers and are golden vectors; by default both are
        simulated.
    n_examples : int
        Golden vectors of each kind.
    seed : int
        Of the simulated examples.

    Examples
    --------
    >>> import doppelgait as dg
    >>> model = dg.classify.open_model("x4")
    >>> settings = dg.classify.CSettings(prf_hz=640.0, n_examples=1)
    >>> dg.classify.export_model(model, "c", "device", settings).facts["precision"]
    'float32'
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
class Export:
    """Written export."""

    folder: Path
    files: tuple[str, ...]
    facts: Mapping[str, Any]


def export_model(model: Model, form: str, folder: str | Path, settings: CSettings | None = None) -> Export:
    """Write a model in a form for other programs.

    Parameters
    ----------
    model : Model
    form : {"c", "numpy", "onnx"}
        ``c``: C99 from complex samples of a gate, or from features, to probabilities. ``numpy``: the model file and a
        scorer that needs NumPy alone. ``onnx``: one graph from features and pictures to calibrated probabilities
        (:func:`doppelgait.classify.export.onnx_graph.build_onnx_model`).
    folder : path
        Appears complete or not at all; replaces an earlier export.
    settings : CSettings, optional
        Of the form ``c`` only.

    Returns
    -------
    Export

    Raises
    ------
    ConfigError
        If the form is unknown, a library for it is missing, the radar is not known, or the folder holds anything else.
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
    with complete_folder(out) as partial:
        for name, content in contents.items():
            (partial / name).write_bytes(content)
        if form == "numpy":
            save_model(model, partial / "model.npz")
        files = sorted(path.name for path in partial.iterdir())
        facts: dict[str, Any] = {
            "format": FORMAT,
            "form": form,
            "doppelgait": __version__,
            "files": files,
            "model": model.facts.model_dump(mode="json"),
            **found,
        }
        (partial / LISTING).write_text(json.dumps(facts, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    return Export(out, tuple(files), found)


def _make_c_files(model: Model, settings: CSettings) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Write the header, the source, golden vectors and their test."""
    rng, device = np.random.default_rng(settings.seed), None
    networks = [part[0] for part in list_parts(model) if isinstance(part[0], Network)]
    if settings.integers and not networks:
        raise ConfigError("--int8: this model has no network; features stay in float32")
    samples: list[Any] = []
    simulated: list[Any] = []
    scaling: list[Any] = []
    if networks:
        device = plan_device(
            model,
            networks[0].patch,
            prf_hz=settings.prf_hz,
            carrier_hz=settings.carrier_hz,
            window_s=settings.window_s,
            bins=settings.bins,
            still_time_s=settings.still_time_s,
        )
        samples = [walk_samples(rng, device) for _ in range(settings.n_examples)]
        simulated = scaling = [convert_samples(each, device) for each in samples]
        if settings.data is not None:
            scaling = collect_levels(settings.data, device.patch, device.n_columns, SCALE_EXAMPLES)
        elif settings.integers:
            more = range(SCALE_EXAMPLES - len(simulated))
            scaling = [*simulated, *(convert_samples(walk_samples(rng, device), device) for _ in more)]
    levels = scaling[: settings.n_examples]
    exact, found = model, dict[str, Any]()
    if settings.integers:
        model = convert_to_integers(exact, scaling[:SCALE_EXAMPLES])
    sources = Sources(model, device)
    features = feature_rows(rng, model, settings.n_examples if model.facts.names else 0)
    words: list[Any] = [np.array([1, len(samples), len(levels), len(features)], dtype=np.int32)]
    for inputs, rows in ((samples, simulated), ([each.T for each in levels], levels)):
        for each, answer in zip(inputs, predict_network_probability(model, rows) if rows else (), strict=True):
            words += [each, answer.astype(np.float32)]
    if len(features):
        rows = [levels[n % len(levels)] for n in range(len(features))] if networks else []
        seen = predict_networks(model, rows) if networks else np.zeros((len(features), 0))
        for each in zip(features, seen, predict_model_probability(model, features, rows), strict=True):
            words += [part.astype(np.float32) for part in each]
    if settings.integers:
        apart = np.abs(predict_network_probability(model, scaling) - predict_network_probability(exact, scaling))
        found = {
            "int8_examples": len(scaling),
            "int8_mean_difference": float(apart.mean()),
            "int8_largest_difference": float(apart.max()),
        }
    files = {
        "doppelgait_model.h": sources.header().encode(),
        "doppelgait_model.c": sources.source().encode(),
        "selftest.c": (TEXTS / "selftest.c").read_bytes(),
        "golden.bin": b"".join(np.ascontiguousarray(part).tobytes() for part in words),
    }
    return files, {"precision": "int8" if settings.integers else "float32", **sources.facts(), **found}


def convert_to_integers(model: Model, examples: list[Any]) -> Model:
    """Return a model with networks in integers."""
    learned = model.learned
    if isinstance(learned, Network):
        return replace(model, learned=quantise(learned, examples))
    if not isinstance(learned, Ensemble):
        return model
    members = tuple(quantise(each, examples) if isinstance(each, Network) else each for each in learned.members)
    return replace(model, learned=replace(learned, members=members))

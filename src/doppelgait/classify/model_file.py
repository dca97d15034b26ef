"""Model files: plain arrays and JSON, no code; shipped models.

``tools/train_models.py`` trains the shipped models, on synthetic recordings alone. The card of each
is next to it.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.classify.data import BANDWIDTH, ENVELOPE_WIDTH, SPEED, VELOCITY, WIDTH
from doppelgait.classify.learned import ARRAYS, INTEGERS, LAYERS, NOVELTY, Learned, Novelty, list_arrays
from doppelgait.classify.model import TOLERANCE, Calibration, Facts, Model, mark_outside
from doppelgait.classify.scorer import select_part
from doppelgait.core.config import validate
from doppelgait.core.documents import parse_json
from doppelgait.core.errors import ConfigError, DatasetError, list_choices
from doppelgait.core.files import FileKind, hash_file, open_atomically
from doppelgait.core.npz import load_npz
from doppelgait.features import FEATURE_UNITS
from doppelgait.processing.patches import N_SLICES, Patch
from doppelgait.radar import Radar

FOLDER = Path(str(resources.files("doppelgait.classify") / "models"))
MODEL = FileKind("doppelgait-model", 4, "a model of doppelgait", DatasetError, oldest=4, remedy="train it again")
SUFFIX = ".npz"
TRACK = "track."  # begins the names of the arrays of a model of tracks
SPANS = ("lowest", "highest", "unknown")
MOST_MEMBERS, MOST_LAYERS = 64, 5
SHOWN = 300  # maximum number of characters of a reason in an error
LARGEST = 1e30  # maximum absolute value of the numbers of a model, except thresholds of trees
LARGEST_SCORE = 1e37  # maximum absolute value of the numbers of a network, in single precision
FEATURES = {SPEED, WIDTH, ENVELOPE_WIDTH, "gait_frequency_hz", *FEATURE_UNITS} - {VELOCITY, BANDWIDTH}
"""Features of an analysis, in addition to the registered extended features."""
TRAIN_ONE = "Train one on a plan of your radar (evaluate DATASET -o REPORT --save model.npz) and name it (--model)"
Arrays = dict[str, npt.NDArray[Any]]


def save_model(model: Model, path: str | Path) -> Path:
    """Write a model to a file.

    The file appears complete or not at all; the same model gives the same bytes.

    Parameters
    ----------
    path : path
        Must end in ``.npz``: ``numpy.load(path, allow_pickle=False)`` reads it.

    Raises
    ------
    ConfigError
        If the name does not end in ``.npz``.
    OutputError
        If it cannot be written; an older file of that name then stays unchanged.

    See Also
    --------
    load_model : load the file again; its example saves a model.
    """
    target = Path(path)
    if target.suffix.lower() != SUFFIX:
        raise ConfigError(f"{target}: a model's file must end in {SUFFIX}")
    document, arrays = _pack_model(model)
    facts = {"format": MODEL.format, "format_version": MODEL.version, **document}
    text = np.frombuffer(json.dumps(facts, sort_keys=True, allow_nan=False).encode(), dtype=np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, model=text, **arrays)
    with open_atomically(target) as partial:
        partial.write_bytes(buffer.getvalue())
    return target


def _pack_model(model: Model) -> tuple[dict[str, Any], Arrays]:
    form, arrays = _pack(model.learned)
    facts = {**form, "facts": model.facts.model_dump(mode="json"), "calibration_rows": model.calibration.n_rows}
    arrays["calibration.slope"] = np.array([model.calibration.slope])
    arrays["calibration.shift"] = model.calibration.shift
    arrays |= {name: getattr(model, name) for name in SPANS}
    if model.novelty is not None:
        arrays |= {f"novelty.{name}": values for name, values in model.novelty.arrays.items()}
    if model.track is not None:
        facts["track"], own = _pack_model(model.track)
        arrays |= {TRACK + name: values for name, values in own.items()}
    return facts, arrays


def _unpack_model(document: Mapping[str, Any], arrays: Arrays, path: str | Path) -> Model:
    facts = validate(Facts, document["facts"], where=str(path))
    own = {name: values for name, values in arrays.items() if not name.startswith(TRACK)}
    slope, shift = float(own["calibration.slope"][0]), own["calibration.shift"]
    far = select_part(own, "novelty.")
    novelty = Novelty({name: far[name] for name in NOVELTY}) if far else None
    calibration = Calibration(slope, shift, int(document["calibration_rows"]))
    model = Model(facts, _unpack(document, own), calibration, own["lowest"], own["highest"], own["unknown"], novelty)
    _check_model(model)
    if "track" not in document:
        return model
    track = _unpack_model(document["track"], select_part(arrays, TRACK), path)
    if track.learned.kind != "track" or track.track or track.facts.alarm != facts.alarm:
        raise ValueError("its model of tracks is none, or has another alarm")
    return replace(model, track=track)


def _pack(learned: Learned) -> tuple[dict[str, Any], Arrays]:
    patch = None if learned.patch is None else learned.patch.model_dump(mode="json")
    form: dict[str, Any] = {"learned": learned.kind, "patch": patch}
    arrays = {name: learned.arrays[name] for name in list_arrays(learned.kind, learned.arrays)}
    if learned.kind == "ensemble":
        parts = [_pack(member) for member in learned.members]
        form["members"] = [own for own, _ in parts]
        arrays |= {f"member.{n}.{name}": values for n, (_, own) in enumerate(parts) for name, values in own.items()}
    return form, arrays


def _unpack(form: Mapping[str, Any], arrays: Arrays) -> Learned:
    kind, patch, members = form["learned"], None, list[Learned]()
    if kind == "network":
        patch = validate(Patch, form["patch"], where="patch")
    if kind == "ensemble":
        forms = form["members"][:MOST_MEMBERS]
        if any(own["learned"] == "ensemble" for own in forms):
            raise ValueError("its members are ensembles")
        members = [_unpack(own, select_part(arrays, f"member.{number}.")) for number, own in enumerate(forms)]
    return Learned(kind, {name: arrays[name] for name in list_arrays(kind, arrays)}, patch, tuple(members))


def load_model(path: str | Path) -> Model:
    """Read a model from a file.

    Only numbers and text are read: no code of the file runs.

    Raises
    ------
    DatasetError
        If the file is missing, is not a model of doppelgait, or is damaged, inconsistent or of a
        newer version.

    Examples
    --------
    >>> import doppelgait as dg
    >>> model = dg.classify.open_model("x4")
    >>> path = dg.classify.save_model(model, "copy.npz")
    >>> dg.classify.load_model(path).facts.classes
    ('human', 'animal')
    """
    try:
        arrays: dict[str, Any] = load_npz(Path(path), None, lambda text: ValueError(text.removeprefix(f"{path}: ")))
        document = parse_json(arrays.pop("model").tobytes().decode())
        for name, values in arrays.items():
            if values.dtype.kind not in "fiu":
                raise ValueError(f"{name} holds {values.dtype}, not numbers")
            arrays[name] = values.astype(np.int64) if name.split(".")[-1] in INTEGERS else values
        MODEL.check(path, document)
        return _unpack_model(document, arrays, path)
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror or error}; see open_model") from None
    except ConfigError as error:
        raise DatasetError(f"{path}: is damaged: {error}") from None
    except DatasetError:
        raise
    except Exception as error:  # NumPy and the archive raise whatever they like at damaged files
        reason = " ".join(str(error).split())[:SHOWN]
        raise DatasetError(f"{path}: is not a model of doppelgait, or is damaged: {reason}") from None


def _check_model(model: Model) -> None:
    from doppelgait.features.extended import list_features

    facts, calibration = model.facts, model.calibration
    sizes = {"c": len(facts.classes), "f": len(facts.names)}
    shapes = {"calibration.shift": "c", **dict.fromkeys(SPANS, "f")}
    _check_shapes({**vars(model), "calibration.shift": calibration.shift}, shapes, sizes)
    if not (0 < calibration.slope < LARGEST and (np.abs(calibration.shift) < LARGEST).all()):
        raise ValueError("its calibration is no number above 0, or too large")
    if len({*facts.classes}) < sizes["c"] or len({*facts.names}) < sizes["f"] or (model.lowest > model.highest).any():
        raise ValueError("it has a class or a feature twice, or a lowest value above the highest")
    if any(name not in TOLERANCE or not 0 <= span[0] <= span[1] for name, span in facts.conditions.items()):
        raise ValueError("one of its conditions is unknown, or not from a number to a higher one")
    if facts.alarm is not None and facts.alarm not in facts.classes:
        raise ValueError(f"its alarm is for {facts.alarm!r}, which is not one of its classes")
    # A model must not use values that no analysis measures, such as a plan's nuisance parameters.
    measured = FEATURES | {f"extended_{name}" for name, _, _ in list_features()}
    wrong = [name for name in facts.names if name not in measured]
    if wrong:
        raise ValueError(
            f"uses the feature {wrong[0]!r}, which no analysis measures; allowed are the six features, "
            "gait_frequency_hz and the registered extended features"
        )
    if model.novelty is not None:
        own = model.novelty.arrays
        _check_shapes(own, NOVELTY, _check_numbers(own, sizes))
        if not len(own["centre"]) or (np.diff(own["held"]) < 0).any():
            raise ValueError("novelty has no class, or ranks that fall")
    _check_learned(model.learned, sizes)


def _check_shapes(arrays: Mapping[str, Any], shapes: Mapping[str, str], sizes: dict[str, int]) -> None:
    """Check shapes, a letter for each size; a letter not in ``sizes`` stands for the size where it is first used."""
    for name, letters in shapes.items():
        found = arrays[name].shape
        expected = tuple(sizes.setdefault(*pair) for pair in zip(letters, (*found, 0, 0), strict=False))
        if found != expected:
            raise ValueError(f"{name} has the shape {found}, expected is {expected}")


def _check_numbers(own: Mapping[str, Any], sizes: Mapping[str, int]) -> dict[str, int]:
    """Check the numbers of a model and its columns; return the sizes with those of columns and scores."""
    for name, values in own.items():  # a threshold of a tree may be infinite
        good = ~np.isnan(values) if name == "threshold" else np.abs(values.astype(np.float64)) < LARGEST
        if not good.all():
            raise ValueError(f"{name} holds NaN, infinity or more than {LARGEST:g}")
    n_features, columns = sizes["f"], own.get("told", np.zeros(0))
    found = {**sizes, "u": 1 if sizes["c"] == 2 else sizes["c"], "k": n_features + columns.size}
    if "scale" in own and not (own["scale"] > 1.0 / LARGEST).all():
        raise ValueError("scale holds numbers that are not above 0")
    if columns.size and not (columns.min() >= 0 and columns.max() < n_features):
        raise ValueError("told names features that are not there")
    return found


def _check_learned(learned: Learned, sizes: Mapping[str, int]) -> None:
    kind, own, found = learned.kind, learned.arrays, _check_numbers(learned.arrays, sizes)
    if kind == "track":
        channels = _check_layers(own, N_SLICES, own["embed_weight"])
        v, m = len(own["feature_bias"]), len(own["gate_bias"])
        if not (own["forgetting_hz"] >= 0).all() or f"kernel.{MOST_LAYERS}" in own:
            raise ValueError(f"forgets at rates below 0, or has more than {MOST_LAYERS} layers")
        found |= {"v": v, "p": 2 * channels + v, "q": len(own["embed_bias"]) + 2, "m": m, "s": 3 * m}
    if kind == "ensemble":
        found["m"] = len(learned.members)
        if not 0 < found["m"] <= MOST_MEMBERS:
            raise ValueError(f"has {found['m']} members, allowed are 1 to {MOST_MEMBERS}")
        for name in ("weights", "slopes"):
            if not (own[name] > 0).all():
                raise ValueError(f"{name} holds numbers that are not above 0")
        for member in learned.members:
            _check_learned(member, sizes)
    if kind == "network" and learned.patch is not None:
        found["i"] = _check_layers(own, 1, own["weight"])
        if min(learned.patch.n_velocity, learned.patch.n_time) % 2 ** sum(name.startswith("kernel.") for name in own):
            raise ValueError("its pictures cannot be halved as often as it has layers")
    _check_shapes(own, ARRAYS[kind], found)
    if kind == "trees":
        count, inner, roots = own["feature"].size, own["feature"] >= 0, own["root"]
        for child in (own["left"][inner], own["right"][inner]):
            if (child <= np.flatnonzero(inner)).any() or (child >= count).any():
                raise ValueError("its trees have nodes that lead nowhere or back")
        if count == 0 or own["feature"].max() >= found["f"] or roots.min() < 0 or roots.max() >= count:
            raise ValueError("its trees use features or nodes that do not exist")


def _check_layers(own: Mapping[str, Any], n_in: int, weight: npt.NDArray[Any]) -> int:
    highest = 1.0  # of levels, 0 to 1, and of every layer
    for number in range(sum(name.startswith("kernel.") for name in own)):
        sizes, shapes = {"i": n_in, "3": 3}, {f"{name}.{number}": letters for name, letters in LAYERS.items()}
        _check_shapes(own, shapes, sizes)
        n_in = sizes["o"]
        kernel, scale, bias = (np.abs(own[name].astype(np.float64)) for name in shapes)
        highest = float(highest * np.max(kernel.sum(axis=(1, 2, 3)) * np.maximum(scale, 1.0), initial=1.0))
        highest += float(bias.max(initial=0.0))
    if not highest * np.abs(weight.astype(np.float64)).sum() < LARGEST_SCORE:
        raise ValueError("its numbers are too large")
    return n_in


def read_model_cards() -> dict[str, dict[str, Any]]:
    """Read the cards of the shipped models, by name.

    Returns
    -------
    dict
        By name of the model: what it was trained on, its classes, ``conditions`` (lowest and
        highest carrier, pulse rate and observation time), scores on synthetic test data, size and
        times.

    Examples
    --------
    >>> from doppelgait.classify import read_model_cards
    >>> read_model_cards()["x4"]["classes"]
    ['human', 'animal']
    """
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(FOLDER.glob("*.json"))}


@cache
def load_shipped_model(name: str) -> Model:
    """Load a model that comes with the package."""
    if name not in read_model_cards():
        known = list_choices(read_model_cards(), name)
        raise ConfigError(f"model {name!r} is not shipped with doppelgait; shipped models are {known}")
    path = FOLDER / f"{name}.npz"
    if hash_file(path) != read_model_cards()[name]["sha256"]:
        raise DatasetError(f"{path}: is not the model that came with this version; install doppelgait again")
    return load_model(path)


def load_model_for_radar(radar: Radar, burst_pulses: int | None = None) -> Model:
    """Load the shipped model that fits a radar."""
    if burst_pulses or radar.burst_pulses:
        raise ConfigError(f"{radar.name}: no shipped model is for frames in bursts. {TRAIN_ONE}")
    return load_shipped_model(find_shipped_model(radar.carrier_hz, radar.prf_hz))


def open_model(name: str | Path) -> Model:
    """Load a model by shipped name or from a file.

    Raises
    ------
    DatasetError
        As :func:`doppelgait.classify.load_model`.

    Examples
    --------
    >>> from doppelgait.classify import open_model
    >>> open_model("x4").facts.alarm
    'human'
    """
    is_name = str(name) in read_model_cards() or not (Path(name).suffix or Path(name).exists())
    return load_shipped_model(str(name)) if is_name else load_model(name)


def find_shipped_model(carrier_hz: float, prf_hz: float) -> str:
    """Return the name of the shipped model for a radar.

    Parameters
    ----------
    carrier_hz, prf_hz : float
        Of the radar; within 10 % of those that a model was trained on.

    Raises
    ------
    ConfigError
        If none fits.

    Examples
    --------
    >>> from doppelgait.classify import find_shipped_model
    >>> find_shipped_model(carrier_hz=7.29e9, prf_hz=1000)
    'x4'
    """
    asked, cards = {"carrier_hz": carrier_hz, "prf_hz": prf_hz}, read_model_cards()
    for name, card in cards.items():
        if not any(mark_outside(np.array([value]), key, card["conditions"])[0] for key, value in asked.items()):
            return name
    said = []
    for name, card in cards.items():
        low, high = (value / 1e9 for value in card["conditions"]["carrier_hz"])
        rates = card["conditions"]["prf_hz"]
        said.append(f"{name} ({(low + high) / 2:.4g} GHz, {rates[0]:g} to {rates[1]:g} Hz)")
    raise ConfigError(
        f"no shipped model is for a carrier of {carrier_hz / 1e9:.4g} GHz and {prf_hz:g} pulses a "
        f"second; there are {', '.join(said)}. {TRAIN_ONE}"
    )

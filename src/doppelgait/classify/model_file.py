"""A model as a file: plain NumPy arrays and one JSON text, in which nothing can run."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.classify.data import BANDWIDTH, SPEED, VELOCITY, WIDTH
from doppelgait.classify.learned import Constant, Learned, Linear, Network, Trees
from doppelgait.classify.model import Calibration, Facts, Model
from doppelgait.classify.patches import Patch
from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.files import atomic_path
from doppelgait.features import FEATURE_UNITS

FORMAT = "doppelgait-model"
FORMAT_VERSION = 1
SUFFIX = ".npz"
MOST_BYTES = 256_000_000
"""Of all arrays together: no model of ours is nearly as large."""
KINDS: dict[str, type[Any]] = {"constant": Constant, "linear": Linear, "trees": Trees}
FEATURES = {SPEED, WIDTH, "gait_frequency_hz", *FEATURE_UNITS} - {VELOCITY, BANDWIDTH}
"""What the analysis of a recording gives; besides these, the extended features that are registered."""
INTEGERS = {"told", "feature", "unknown_left", "left", "right", "root"}

Arrays = dict[str, npt.NDArray[Any]]


def save_model(model: Model, path: str | Path) -> Path:
    """Write a model; the file appears complete or not at all, the same model gives the same bytes.

    Parameters
    ----------
    model : Model
    path : path
        Must end in ``.npz``: ``numpy.load(path, allow_pickle=False)`` reads it.

    Returns
    -------
    Path

    Raises
    ------
    ConfigError
        If the name does not end in ``.npz``.
    OutputError
        If it cannot be written; an older file of that name is then untouched.
    """
    target = Path(path)
    if target.suffix.lower() != SUFFIX:
        raise ConfigError(f"{target}: a model's file must end in {SUFFIX}")
    kind, arrays = _arrays_of(model.learned)
    facts = {
        "format": FORMAT, "format_version": FORMAT_VERSION, "learned": kind,
        "facts": model.facts.model_dump(mode="json"), "calibration_rows": model.calibration.n_rows,
        "patch": model.learned.patch.model_dump(mode="json") if isinstance(model.learned, Network) else None,
    }  # fmt: skip
    arrays |= {
        "calibration.slope": np.array([model.calibration.slope]), "calibration.shift": model.calibration.shift,
        "lowest": model.lowest, "highest": model.highest, "unknown": model.unknown,
    }  # fmt: skip
    text = np.frombuffer(json.dumps(facts, sort_keys=True, allow_nan=False).encode(), dtype=np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, model=text, **arrays)
    with atomic_path(target) as partial:
        partial.write_bytes(buffer.getvalue())
    return target


def _arrays_of(learned: Learned) -> tuple[str, Arrays]:
    if isinstance(learned, Network):
        layers = {f"kernel.{n}": kernel for n, kernel in enumerate(learned.kernels)}
        layers |= {f"scale.{n}": scale for n, scale in enumerate(learned.scales)}
        layers |= {f"bias.{n}": bias for n, bias in enumerate(learned.biases)}
        return "network", {**layers, "weight": learned.weight, "bias": learned.bias}
    kind = next(name for name, known in KINDS.items() if isinstance(learned, known))
    return kind, dict(vars(learned))


def load_model(path: str | Path) -> Model:
    """Read a model. Only numbers and text are read: no code of the file runs, whoever made it.

    Raises
    ------
    DatasetError
        If it is not there, no model of ours, damaged, inconsistent, or of a newer version.
    """
    try:
        text, arrays = _read(Path(path))
        document = json.loads(text)
        if document["format_version"] > FORMAT_VERSION:
            raise DatasetError(f"{path}: is a model of a newer doppelgait; install that one")
        facts = validate(Facts, document["facts"], where=str(path))
        learned = _learned(document["learned"], arrays, document["patch"])
        slope, shift = float(arrays["calibration.slope"][0]), arrays["calibration.shift"]
        calibration = Calibration(slope, shift, int(document["calibration_rows"]))
        model = Model(facts, learned, calibration, arrays["lowest"], arrays["highest"], arrays["unknown"])
        # A ValueError unless all parts fit together, so that no answer can fail or never end.
        n_classes, n_features = len(model.facts.classes), len(model.facts.names)
        _same(model.calibration.shift.shape, (n_classes,), "calibration.shift")
        for name in ("lowest", "highest", "unknown"):
            _same(getattr(model, name).shape, (n_features,), name)
        if not (0 < model.calibration.slope < np.inf and np.isfinite(model.calibration.shift).all()):
            raise ValueError("its calibration is no number above 0")
        if model.facts.alarm is not None and model.facts.alarm not in model.facts.classes:
            raise ValueError(f"its alarm is for {model.facts.alarm!r}, which is none of its classes")
        _check_features(model)
        _check_numbers(vars(model.learned))
        checks: dict[type, Callable[..., None]] = {
            Constant: _check_constant, Linear: _check_linear, Trees: _check_trees, Network: _check_network
        }  # fmt: skip
        checks[type(model.learned)](model.learned, n_classes, n_features)
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ConfigError as error:
        raise DatasetError(f"{path}: is damaged: {error}") from None
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, EOFError, zipfile.BadZipFile) as error:
        raise DatasetError(f"{path}: is no model of doppelgait, or damaged: {' '.join(str(error).split())}") from None
    return model


def _read(path: Path) -> tuple[str, Arrays]:
    """The text and all arrays; objects are refused, and so is what would fill the memory."""
    with zipfile.ZipFile(path) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > MOST_BYTES:
        raise ValueError(f"holds {size / 1e6:.0f} MB, a model has at most {MOST_BYTES / 1e6:.0f}")
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: np.asarray(archive[name]) for name in archive.files}
    text = arrays.pop("model").tobytes().decode()
    for name, values in arrays.items():
        if values.dtype.kind not in "fiu":
            raise ValueError(f"{name} holds {values.dtype}, not numbers")
        arrays[name] = values.astype(np.int64) if name in INTEGERS else values
    if f'"{FORMAT}"' not in text:
        raise ValueError("its text does not say so")
    return text, arrays


def _learned(kind: str, arrays: Arrays, patch: Any) -> Learned:
    if kind == "network":
        count = sum(name.startswith("kernel.") for name in arrays)
        kernels, scales, biases = (
            tuple(arrays[f"{name}.{n}"] for n in range(count)) for name in ("kernel", "scale", "bias")
        )
        spec = validate(Patch, patch, where="patch")
        return Network(kernels, scales, biases, arrays["weight"], arrays["bias"], spec)
    known = KINDS[kind]
    learned: Learned = known(**{part.name: arrays[part.name] for part in fields(known)})
    return learned


def _check_features(model: Model) -> None:
    """Refuse a model that looks at what no analysis gives, such as the nuisance parameters of a plan."""
    from doppelgait.features.extended import feature_table

    given = FEATURES | {f"extended_{name}" for name, _, _ in feature_table()}
    wrong = [name for name in model.facts.names if name not in given]
    if wrong:
        raise ValueError(
            f"looks at the feature {wrong[0]!r}, which no analysis gives; it gives the six features, gait_frequency_hz "
            "and the registered extended features"
        )


def _check_numbers(parts: Mapping[str, Any]) -> None:
    """Refuse NaN and infinity in what is learnt; a threshold of a tree may be infinite."""
    for name, values in parts.items():
        for array in values if isinstance(values, tuple) else (values,):
            wrong = np.isnan if name == "threshold" else lambda numbers: ~np.isfinite(numbers)
            if isinstance(array, np.ndarray) and wrong(array).any():
                raise ValueError(f"{name} holds NaN or infinity")


def _same(found: tuple[int, ...], expected: tuple[int, ...], name: str) -> None:
    if found != expected:
        raise ValueError(f"{name} has the shape {found}, expected is {expected}")


def _check_constant(learned: Any, n_classes: int, n_features: int) -> None:
    _same(learned.log_share.shape, (n_classes,), "log_share")


def _check_linear(learned: Any, n_classes: int, n_features: int) -> None:
    columns = n_features + learned.told.size
    _same(learned.median.shape, (n_features,), "median")
    _same(learned.weight.shape, (n_classes, columns), "weight")
    _same(learned.bias.shape, (n_classes,), "bias")
    for name in ("mean", "scale"):
        _same(getattr(learned, name).shape, (columns,), name)
    if not (learned.scale > 0).all():
        raise ValueError("scale holds numbers that are not above 0")
    if learned.told.size and not (learned.told.min() >= 0 and learned.told.max() < n_features):
        raise ValueError("told names features that are not there")


def _check_trees(learned: Any, n_classes: int, n_features: int) -> None:
    count = learned.feature.size
    for name in ("feature", "threshold", "value", "unknown_left", "left", "right"):
        _same(getattr(learned, name).shape, (count,), name)
    _same(learned.root.shape[1:], (1 if n_classes == 2 else n_classes,), "root")
    _same(learned.start.shape, learned.root.shape[1:], "start")
    inner, own = learned.feature >= 0, np.arange(count)
    for child in (learned.left, learned.right):
        if (child[inner] <= own[inner]).any() or (child[inner] >= count).any():
            raise ValueError("its trees have nodes that lead nowhere or back")
    if count == 0 or learned.feature.max() >= n_features or learned.root.min() < 0 or learned.root.max() >= count:
        raise ValueError("its trees look at features or nodes that are not there")


def _check_network(learned: Any, n_classes: int, n_features: int) -> None:
    n_in = 1
    layers = zip(learned.kernels, learned.scales, learned.biases, strict=True)
    for number, (kernel, scale, bias) in enumerate(layers):
        _same(kernel.shape[1:], (n_in, 3, 3), f"kernel.{number}")
        n_in = kernel.shape[0]
        _same(scale.shape, (n_in,), f"scale.{number}")
        _same(bias.shape, (n_in,), f"bias.{number}")
    _same(learned.weight.shape, (n_classes, n_in), "weight")
    _same(learned.bias.shape, (n_classes,), "bias")
    if min(learned.patch.n_velocity, learned.patch.n_time) % 2 ** len(learned.kernels):
        raise ValueError("its pictures cannot be halved as often as it has layers")

"""A small convolutional network for signatures, trained with torch.

No other module of this package needs torch.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from pydantic import Field

from doppelgait.classify.learned import FloatArray, Inputs, LabelledRows, Network
from doppelgait.classify.model import row_weights
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import DatasetError
from doppelgait.core.interrupt import raise_if_stopped
from doppelgait.core.plugins import plugin
from doppelgait.processing.patches import Levels, Patch, cut

NO_TORCH = "torch is not installed, which signature-network needs to train: pip install 'doppelgait[torch]'"
CHANNELS = (8, 16, 32, 64)
NORM_EPSILON = 1e-5
AT_A_TIME = 256


class Training(FrozenModel):
    """Training and augmentation settings of a network.
    Training ends when the held-out loss has not improved for ``patience`` epochs, and returns the
    best state.
    """

    most_epochs: int = Field(default=60, ge=1)
    most_pictures: int = Field(default=60_000, ge=1)
    patience: int = Field(default=12, ge=1)
    batch_size: int = Field(default=32, ge=2)
    learning_rate: float = Field(default=1e-3, gt=0)
    weight_decay: float = Field(default=1e-3, ge=0)
    dropout: float = Field(default=0.3, ge=0, lt=1)
    # Levels are shifted, the floor is raised and the velocity axis is stretched by up to so much.
    gain_db: float = Field(default=3.0, ge=0)
    noise_db: float = Field(default=10.0, ge=0)
    stretch: float = Field(default=1.4, ge=1, le=4)
    # Share of the epochs over which gain, noise and stretch grow to their limits; 0: at once.
    widening: float = Field(default=0.5, ge=0, le=1)
    flip: bool = True


def is_torch_installed() -> bool:
    """Return True if torch is installed, without importing it."""
    from importlib.util import find_spec

    return find_spec("torch") is not None


@plugin("classifier", "signature-network", features="signature", learner="network")
def train_network(
    train: LabelledRows,
    held: LabelledRows,
    *,
    n_classes: int,
    seed: int,
    spec: Patch | None = None,
    settings: Training | None = None,
) -> Network:
    """Train a network on signatures.

    Parameters
    ----------
    train : Part
        Levels (:func:`doppelgait.classify.levels`) of every signature, an object array with None
        for none, and class numbers.
    held : Part
        Rows of other targets that decide when to stop; without any, all epochs are run.
    seed : int
        The same seed, rows and machine give the same network.
    spec : Patch, optional
        Format of the levels.
    settings : Training, optional

    Returns
    -------
    Network
        In plain arrays, which need no torch.

    Raises
    ------
    DatasetError
        If torch is not installed, or no row has a signature.
    """
    try:
        import torch
    except ImportError:
        raise DatasetError(NO_TORCH) from None

    spec, settings = spec or Patch(), settings or Training()
    train, held = _drop_missing(train), _drop_missing(held)
    if not train.labels.size:
        raise DatasetError("no training row has a signature")
    rng = np.random.default_rng(seed)
    weights = row_weights(train.labels, n_classes)
    with _make_deterministic(torch, seed):
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        model = build_model(torch, n_classes, settings.dropout).to(device, memory_format=torch.channels_last)
        optimiser = torch.optim.AdamW(model.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay)
        best, best_loss, since = model.state_dict(), np.inf, 0
        n_epochs = min(settings.most_epochs, -(-settings.most_pictures // train.labels.size))
        for epoch in range(n_epochs):
            slowly = settings.widening * n_epochs
            width = min(1.0, epoch / slowly) if slowly > 1.0 else 1.0  # the limits always widen before the last epoch
            _train_epoch(torch, model, optimiser, device, train, weights, rng, spec, settings, width)
            loss = (
                _compute_validation_loss(torch, model, device, held, n_classes, spec) if held.labels.size else -np.inf
            )
            if loss <= best_loss:
                best, best_loss, since = copy.deepcopy(model.state_dict()), loss, 0
            else:
                since += 1
            if since >= settings.patience:
                break
    return _to_arrays(best, spec)


def build_model(torch: Any, n_classes: int, dropout: float) -> Any:
    """Build the untrained network."""
    nn, layers, n_in = torch.nn, [], 1
    for n_out in CHANNELS:
        layers += [nn.Conv2d(n_in, n_out, 3, padding=1, bias=False), nn.MaxPool2d(2)]
        layers += [nn.BatchNorm2d(n_out, eps=NORM_EPSILON), nn.ReLU()]
        n_in = n_out
    layers += [nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Dropout(dropout), nn.Linear(n_in, n_classes)]
    return nn.Sequential(*layers)


def _drop_missing(part: LabelledRows) -> LabelledRows:
    present = np.array([whole is not None for whole in part.values], dtype=bool)
    return LabelledRows(part.values[present], part.labels[present])


@contextmanager
def _make_deterministic(torch: Any, seed: int) -> Iterator[None]:
    """Seed torch and make it deterministic, then restore its settings."""
    threads = torch.get_num_threads()
    with torch.random.fork_rng(), torch.backends.cudnn.flags(enabled=True, benchmark=False, deterministic=True):
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)


def _train_epoch(
    torch: Any,
    model: Any,
    optimiser: Any,
    device: Any,
    train: LabelledRows,
    weights: FloatArray,
    rng: np.random.Generator,
    spec: Patch,
    settings: Training,
    width: float,
) -> None:
    model.train()
    order = rng.permutation(train.labels.size)
    for first in range(0, order.size, settings.batch_size):
        raise_if_stopped()
        rows = order[first : first + settings.batch_size]
        if rows.size < 2:  # batch normalisation needs two
            continue
        pictures = torch.from_numpy(augment(train.values[rows], rng, spec, settings, width)).to(device)
        labels = torch.from_numpy(train.labels[rows]).to(device)
        each = torch.nn.functional.cross_entropy(model(pictures[:, None]), labels, reduction="none")
        loss = (each * torch.from_numpy(weights[rows]).to(each)).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()


def augment(values: Inputs, rng: np.random.Generator, spec: Patch, settings: Training, width: float = 1.0) -> Levels:
    """Augment every signature to a random image (n, n_velocity, n_time)."""
    pictures = []
    for whole in values:
        spare = whole.shape[1] - spec.n_time
        start = int(rng.integers(min(spare, 0), max(spare, 0) + 1))
        picture = cut(whole, start, spec)
        pictures.append(picture[::-1] if settings.flip and rng.random() < 0.5 else picture)
    shape = (len(pictures), 1, 1)
    factors = settings.stretch ** (width * rng.uniform(-1.0, 1.0, len(pictures)))
    stacked = stretch_pictures(np.stack(pictures), factors)
    gain = width * rng.uniform(-settings.gain_db, settings.gain_db, shape) / spec.range_db
    power = 10.0 ** ((np.where(stacked > 0, stacked + gain, 0.0)) * spec.range_db / 10.0)
    raised = 10.0 ** (width * rng.uniform(0.0, settings.noise_db, shape) / 10.0) - 1.0
    noisy = (power + raised * rng.gamma(4.0, 0.25, stacked.shape)) / (1.0 + raised)
    return np.clip(10.0 * np.log10(noisy) / spec.range_db, 0.0, 1.0).astype(np.float32)


def stretch_pictures(pictures: Levels, factors: FloatArray) -> Levels:
    """Stretch images in velocity about zero, one factor each."""
    n_rows = pictures.shape[1]
    middle = (n_rows - 1) / 2.0
    place = (np.arange(n_rows) - middle) / factors[:, None] + middle  # row that is moved here, (n, n_velocity)
    below = np.clip(np.floor(place).astype(np.int64), 0, n_rows - 2)
    share = np.where((place >= 0) & (place <= n_rows - 1), place - below, np.nan).astype(np.float32)[:, :, None]
    each = np.arange(len(pictures))[:, None]
    between = (1.0 - share) * pictures[each, below] + share * pictures[each, below + 1]
    return np.asarray(np.nan_to_num(between), dtype=np.float32)


def _compute_validation_loss(
    torch: Any, model: Any, device: Any, held: LabelledRows, n_classes: int, spec: Patch
) -> float:
    """Return the class-balanced log loss of the held-out signatures."""
    model.eval()
    weights, total = row_weights(held.labels, n_classes), 0.0
    for first in range(0, held.labels.size, AT_A_TIME):
        rows = slice(first, first + AT_A_TIME)
        pictures = np.stack([cut(whole, (whole.shape[1] - spec.n_time) // 2, spec) for whole in held.values[rows]])
        with torch.no_grad():
            scores = model(torch.from_numpy(pictures)[:, None].to(device))
        each = torch.nn.functional.cross_entropy(scores.cpu(), torch.from_numpy(held.labels[rows]), reduction="none")
        total += float((each.double() * torch.from_numpy(weights[rows])).sum())
    return total / held.labels.size


def _to_arrays(state: Mapping[str, Any], spec: Patch) -> Network:
    """Convert to plain arrays, with batch normalisation as scale and bias."""
    arrays = {name: values.cpu().contiguous().numpy() for name, values in state.items()}
    kernels, scales, biases = [], [], []
    for number in range(len(CHANNELS)):
        norm = f"{4 * number + 2}"
        scale = arrays[f"{norm}.weight"] / np.sqrt(arrays[f"{norm}.running_var"] + NORM_EPSILON)
        kernels.append(arrays[f"{4 * number}.weight"])
        scales.append(scale)
        biases.append(arrays[f"{norm}.bias"] - arrays[f"{norm}.running_mean"] * scale)
    last = f"{4 * len(CHANNELS) + 3}"
    return Network(tuple(kernels), tuple(scales), tuple(biases), arrays[f"{last}.weight"], arrays[f"{last}.bias"], spec)

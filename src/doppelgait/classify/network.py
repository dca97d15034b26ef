"""Convolutional networks for signatures and for the windows of tracks, trained with torch.

No other module of this package needs torch.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np
from pydantic import Field

from doppelgait.classify import scorer
from doppelgait.classify.learned import (
    FloatArray,
    Inputs,
    IntArray,
    LabelledRows,
    Learned,
    find_windows_before,
    select_features,
    to_levels,
)
from doppelgait.classify.model import row_weights
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import DatasetError, warn_caller
from doppelgait.core.interrupt import raise_if_stopped
from doppelgait.core.plugins import plugin
from doppelgait.processing.patches import N_SLICES, Levels, Patch, cut

NO_TORCH = "torch is not installed, which signature-network needs to train: pip install 'doppelgait[torch]'"
CHANNELS = (8, 16, 32, 64)
NORM_EPSILON = 1e-5
AT_A_TIME = 256
TRACK_CHANNELS, N_FEATURES, N_EMBEDDING, N_MEMORY = (24, 32, 48, 64), 64, 48, 16
LOG_HZ = (-5.0, -1.5)  # logarithms of the initial rates of forgetting: 1 / 148 s to 1 / 4.5 s
FORGETTING_HZ = 0.02  # rate of forgetting of a sum of log-odds
BATCH_TRACKS, MOST_WINDOWS, LEARNING_RATE, WEIGHT_DECAY, DROPOUT = 12, 16, 3e-3, 1e-2, 0.2
WINDOW_SHARE, MOST_WEIGHT, MOST_GRADIENT = 0.3, 5.0, 2.0
"""Weight of the answers to single windows, limits of the weight of a row and of a gradient."""
GAIN, HIGHEST_FLOOR, FLOOR_SHARE, HIDDEN_SHARE, BARE_SHARE = 0.08, 0.45, 0.7, 0.1, 0.2
"""Augmentation: largest shift of the levels of a track, its raised floor and how often; hidden features, and tracks
without features, as on a device."""


class Training(FrozenModel):
    """Settings of training, which returns the best state of held-out loss, and of augmentation."""

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
) -> Learned:
    """Train a network on signatures; held rows decide when to stop."""
    if not is_torch_installed():
        raise DatasetError(NO_TORCH)
    import torch

    spec, settings = spec or Patch(), settings or Training()
    known = [np.array([whole is not None for whole in part.values], dtype=bool) for part in (train, held)]
    train, held = (LabelledRows(p.values[own], p.labels[own]) for p, own in zip((train, held), known, strict=True))
    if not train.labels.size:
        raise DatasetError("no training row has a signature")
    rng, weights = np.random.default_rng(seed), row_weights(train.labels, n_classes)
    with _make_deterministic(torch, seed):
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        model = build_model(torch, n_classes, settings.dropout).to(device, memory_format=torch.channels_last)
        optimiser = torch.optim.AdamW(model.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay)
        best, best_loss, since = model.state_dict(), np.inf, 0
        n_epochs = min(settings.most_epochs, -(-settings.most_pictures // train.labels.size))
        for epoch in range(n_epochs):
            slowly = settings.widening * n_epochs
            width = min(1.0, epoch / slowly) if slowly > 1.0 else 1.0  # the limits always widen before the last epoch
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
            of_held = _compute_held_loss(torch, model, device, held, n_classes, spec) if held.labels.size else -np.inf
            since = 0 if of_held <= best_loss else since + 1
            if since == 0:
                best, best_loss = copy.deepcopy(model.state_dict()), of_held
            if since >= settings.patience:
                break
    return _read_model(best, spec)


def _read_model(state: Mapping[str, Any], spec: Patch) -> Learned:
    # the network as plain arrays
    last = f"{4 * len(CHANNELS) + 3}"
    weight, bias = (state[f"{last}.{name}"].cpu().contiguous().numpy() for name in ("weight", "bias"))
    return Learned("network", {"weight": weight, "bias": bias, **_read_layers(state, len(CHANNELS))}, spec)


def _build_layers(nn: Any, channels: Sequence[int]) -> list[Any]:
    layers = []
    for n_in, n_out in pairwise(channels):
        layers += [nn.Conv2d(n_in, n_out, 3, padding=1, bias=False), nn.MaxPool2d(2)]
        layers += [nn.BatchNorm2d(n_out, eps=NORM_EPSILON), nn.ReLU()]
    return layers


def build_model(torch: Any, n_classes: int, dropout: float) -> Any:
    """Build the untrained network."""
    nn, n_in = torch.nn, CHANNELS[-1]
    layers = _build_layers(nn, (1, *CHANNELS))
    layers += [nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Dropout(dropout), nn.Linear(n_in, n_classes)]
    return nn.Sequential(*layers)


@contextmanager
def _make_deterministic(torch: Any, seed: int) -> Iterator[None]:
    threads = torch.get_num_threads()
    with torch.random.fork_rng(), torch.backends.cudnn.flags(enabled=True, benchmark=False, deterministic=True):
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)


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


def _compute_held_loss(torch: Any, model: Any, device: Any, held: LabelledRows, n_classes: int, spec: Patch) -> float:
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


def _read_layers(state: Mapping[str, Any], n_layers: int) -> dict[str, Levels]:
    """Return kernels, scales and biases of layers, with batch normalisation as scale and bias."""
    arrays, layers = {name: values.cpu().contiguous().numpy() for name, values in state.items()}, dict[str, Levels]()
    for number in range(n_layers):
        norm = f"{4 * number + 2}"
        scale = arrays[f"{norm}.weight"] / np.sqrt(arrays[f"{norm}.running_var"] + NORM_EPSILON)
        layers[f"kernel.{number}"], layers[f"scale.{number}"] = arrays[f"{4 * number}.weight"], scale
        layers[f"bias.{number}"] = arrays[f"{norm}.bias"] - arrays[f"{norm}.running_mean"] * scale
    return layers


# Networks of tracks --------------------------------------------------------------------------------------------------


@plugin("classifier", "track-network", features="track", learner="track")
def train_track_network(
    train: LabelledRows, held: LabelledRows, *, n_classes: int, seed: int, epochs: int = 12
) -> Learned:
    """Train a network on windows of tracks; without torch the log-odds of features are summed."""
    from doppelgait.classify.training import standardise_columns

    kept = np.array([each.pictures is not None for each in train.values[:, -1]], dtype=bool)
    shown = np.array([each.shown for each in train.values[:, -1]])
    train = LabelledRows(train.values[kept], np.where(shown >= 0, shown, train.labels)[kept])
    if not train.labels.size:
        raise DatasetError("no training row has pictures of a track; build the dataset with the field pictures")
    own, whole = standardise_columns(select_features(train.values))
    columns: Levels = np.clip(whole, -scorer.FARTHEST_SD, scorer.FARTHEST_SD).astype(np.float32)
    if not is_torch_installed():
        warn_caller(f"{NO_TORCH.replace('signature', 'track')}. Without it the model is smaller: it uses no pictures")
        return Learned("track", own | _sum_log_odds(columns, train.labels, n_classes))
    import torch

    with _make_deterministic(torch, seed):
        model = _build_track_model(torch, columns.shape[1], n_classes)
        _train_tracks(torch, model, columns, train, np.random.default_rng(seed), epochs)
    return Learned("track", own | _read_track_model(model.eval()))


def _build_track_model(torch: Any, n_columns: int, n_classes: int) -> Any:
    nn, n_in = torch.nn, TRACK_CHANNELS[-1]
    layers = _build_layers(nn, (N_SLICES, *TRACK_CHANNELS))
    return nn.ModuleDict(
        {
            "convolution": nn.Sequential(*layers).to(memory_format=torch.channels_last),  # twice as fast
            "feature": nn.Linear(n_columns, N_FEATURES),
            "dropout": nn.Dropout(DROPOUT),
            "embed": nn.Linear(2 * n_in + N_FEATURES, N_EMBEDDING),
            "window": nn.Linear(N_EMBEDDING, n_classes),
            "gate": nn.Linear(N_EMBEDDING + 2, N_MEMORY),
            "value": nn.Linear(N_EMBEDDING + 2, N_MEMORY),
            "forgetting": nn.ParameterList([nn.Parameter(torch.linspace(*LOG_HZ, N_MEMORY))]),
            "hidden": nn.Linear(3 * N_MEMORY, N_EMBEDDING),
            "output": nn.Linear(N_EMBEDDING, n_classes),
        }
    )


def _train_tracks(
    torch: Any, model: Any, columns: Levels, train: LabelledRows, rng: np.random.Generator, epochs: int
) -> None:
    seen = train.values[:, -1]
    whole, _ = find_windows_before(seen.tolist())
    tracks = np.split(whole, np.flatnonzero(np.diff([seen[n].track for n in whole])) + 1)
    n_steps = -(-len(tracks) // BATCH_TRACKS) * epochs
    optimiser = torch.optim.AdamW(model.parameters(), weight_decay=WEIGHT_DECAY)
    rate = torch.optim.lr_scheduler.OneCycleLR(optimiser, LEARNING_RATE, total_steps=n_steps)
    weights = np.minimum(row_weights(train.labels, int(train.labels.max()) + 1), MOST_WEIGHT)
    cross_entropy = torch.nn.functional.cross_entropy
    model.train()
    for _ in range(epochs):
        order = rng.permutation(len(tracks))
        for first in range(0, order.size, BATCH_TRACKS):
            raise_if_stopped()
            batch = [_cut_track(tracks[n], rng) for n in order[first : first + BATCH_TRACKS]]
            rows, sizes = np.concatenate(batch), np.array([part.size for part in batch])
            if rows.size > 1:  # batch normalisation needs two
                pictures, shown = _augment_tracks(seen[rows], columns[rows], sizes, rng)
                windows, answers = _answer_tracks(torch, model, pictures, shown, seen[rows], sizes)
                labels = torch.from_numpy(train.labels[rows])
                weight = torch.from_numpy(weights[rows] / np.sqrt(np.repeat(sizes, sizes))).float()
                losses = cross_entropy(answers, labels, reduction="none")
                losses = losses + WINDOW_SHARE * cross_entropy(windows, labels, reduction="none")
                optimiser.zero_grad()
                ((losses * weight).sum() / weight.sum()).backward()
                torch.nn.utils.clip_grad_norm_(model.parameters(), MOST_GRADIENT)
                optimiser.step()
            rate.step()


def _cut_track(rows: IntArray, rng: np.random.Generator) -> IntArray:
    rows = rows[:: int(rng.integers(1, 3))]
    spare = max(rows.size - MOST_WINDOWS, 0)
    start = int(rng.integers(spare + 1)) if rng.random() < 0.5 else 0
    return rows[start : start + MOST_WINDOWS]


def _augment_tracks(seen: Inputs, columns: Levels, sizes: IntArray, rng: np.random.Generator) -> tuple[Levels, Levels]:
    n_tracks, shape = sizes.size, (-1, 1, 1, 1)
    levels = np.stack([to_levels(each.pictures[0]) for each in seen])
    floor = rng.uniform(0.0, HIGHEST_FLOOR, n_tracks) * (rng.random(n_tracks) < FLOOR_SHARE)
    raised = np.repeat(floor, sizes).reshape(shape).astype(np.float32)
    gain = np.repeat(rng.uniform(-GAIN, GAIN, n_tracks), sizes).reshape(shape).astype(np.float32)
    noise = (raised > 0) * rng.random(levels.shape, dtype=np.float32) * np.float32(GAIN)
    levels = np.clip(np.maximum(levels + gain * (levels > 0), raised + noise), 0.0, 1.0)
    hidden = rng.random(columns.shape) < HIDDEN_SHARE
    hidden |= np.repeat(rng.random(n_tracks) < BARE_SHARE, sizes)[:, None]
    return levels, np.where(hidden, np.float32(0.0), columns)


def _answer_tracks(
    torch: Any, model: Any, pictures: Levels, columns: Levels, seen: Inputs, sizes: IntArray
) -> tuple[Any, Any]:
    # scores (n, n_classes) of every window alone, and of its track up to it
    layer = model["convolution"](torch.from_numpy(pictures).to(memory_format=torch.channels_last))
    feature = torch.relu(model["feature"](torch.from_numpy(columns)))
    pooled = torch.cat([layer.mean((2, 3)), layer.amax((2, 3)), feature], 1)
    embedding = torch.relu(model["embed"](model["dropout"](pooled)))
    first = np.cumsum(sizes) - sizes
    own = np.repeat(np.arange(sizes.size), sizes)
    shared = np.array([each.shared for each in seen], dtype=bool)
    _, before = find_windows_before([each._replace(track=track) for each, track in zip(seen, own, strict=True)])
    stops_s, count = np.array([each.stop_s for each in seen]), np.zeros(len(seen), dtype=np.int64)
    since_s = np.where(before >= 0, stops_s - stops_s[before], 0.0)
    for number in np.flatnonzero(before >= 0):
        count[number] = count[before[number]] + 1
    extra = np.column_stack([np.minimum(since_s, scorer.LONGEST_S), np.log(count + 1.0)])
    inputs = torch.cat([embedding, torch.from_numpy(extra).float()], 1)
    weight = torch.exp(model["gate"](inputs).clamp(-scorer.MOST_LOG, scorer.MOST_LOG))
    content = weight * model["value"](inputs)
    kept = torch.exp(-torch.from_numpy(since_s).float()[:, None] * torch.exp(model["forgetting"][0]))
    # all tracks at once, step by step: a track that has ended repeats its last window, which is not read again
    steps = first[:, None] + np.minimum(np.arange(sizes.max()), sizes[:, None] - 1)
    total = weights = own_total = own_weights = torch.zeros(sizes.size, weight.shape[1])
    alone = torch.from_numpy(~shared)[:, None]
    sums = []
    for rows in steps.T:
        total, weights = torch.where(alone[rows], own_total, total), torch.where(alone[rows], own_weights, weights)
        total, weights = kept[rows] * total + content[rows], kept[rows] * weights + weight[rows]
        own_total = torch.where(alone[rows], total, own_total)
        own_weights = torch.where(alone[rows], weights, own_weights)
        sums.append(torch.cat([total / weights, torch.log(weights), total / scorer.SCALE], 1))
    place = np.arange(len(seen)) - first[own]
    memory = torch.stack(sums)[torch.from_numpy(place), torch.from_numpy(own)]
    return model["window"](embedding), model["output"](torch.relu(model["hidden"](memory)))


def _read_track_model(model: Any) -> dict[str, Any]:
    arrays: dict[str, Any] = {**_read_layers(model["convolution"].state_dict(), len(TRACK_CHANNELS))}
    for name in ("feature", "embed", "gate", "value", "hidden", "output"):
        start = "" if name == "output" else f"{name}_"
        arrays |= {f"{start}{kind}": values.detach().numpy() for kind, values in model[name].named_parameters()}
    return arrays | {"forgetting_hz": np.exp(model["forgetting"][0].detach().numpy())}


def _sum_log_odds(columns: Levels, labels: IntArray, n_classes: int) -> dict[str, Any]:
    # a network that sums the log-odds of a logistic regression, without layers for pictures
    from sklearn.linear_model import LogisticRegression

    model = LogisticRegression(max_iter=2000).fit(columns, labels, sample_weight=row_weights(labels, n_classes))
    weight, bias = model.coef_, model.intercept_
    if n_classes == 2:
        weight, bias = np.vstack([-weight, weight]) / 2.0, np.append(-bias, bias) / 2.0
    both, n = np.hstack([np.eye(n_classes), -np.eye(n_classes)]), n_classes  # positive and negative parts of scores
    nothing = np.zeros((n, 2 * n + 2))
    return {
        **{"feature_weight": both.T @ weight, "feature_bias": both.T @ bias},
        **{"embed_weight": np.hstack([np.zeros((2 * n, 2 * N_SLICES)), np.eye(2 * n)]), "embed_bias": np.zeros(2 * n)},
        **{"gate_weight": nothing, "gate_bias": np.zeros(n)},
        **{"value_weight": np.hstack([both, np.zeros((n, 2))]), "value_bias": np.zeros(n)},
        "forgetting_hz": np.full(n, FORGETTING_HZ),
        **{
            "hidden_weight": np.hstack([np.zeros((2 * n, 2 * n)), both.T * scorer.SCALE]),
            "hidden_bias": np.zeros(2 * n),
        },
        **{"weight": both, "bias": np.zeros(n)},
    }

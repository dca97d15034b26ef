"""Evidence that a target is a body, and that it is more than one: learned, and tested on kinds left out.

    python studies/verdicts.py --write --page

Question: how often is a thing called a body or a body a thing, and are the probabilities right?

Scenes of `studies/evidence_scenes.py` (seven recordings a name) and [everyday scenes](everyday.md) (seeds 10 and 11,
without rooms) are tracked. A target is a body if a person or an animal that moves is within 0.8 m of it (median), and
nearer than to other tracks for half of the time; it is left out near somebody who keeps still or has another track;
else it is a thing. The tables are of kinds that were left out of the fit (4 folds; a kind is a generator of things, one
to three bodies before one radar, or an everyday scene); the file has the fit of all. The limits of the package were
chosen on these tables. It takes about 50 minutes of one core, with PyTorch.

Not shown: recorded bodies and things, reflections, rooms, one-output radars, and the rule for both directions.
"""

from __future__ import annotations

import base64
import warnings
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from everyday import NEAR_M, ROOT_SEED, Body, observe
from everyday_scenes import SCENES as EVERYDAY
from evidence_scenes import SCENES as ANYTHING
from evidence_scenes import THINGS
from harness import FloatArray, finish, make_parser, markdown, run_jobs
from sklearn.model_selection import GroupKFold

import doppelgait as dg
from doppelgait.core.errors import AnalysisError
from doppelgait.pipeline import analyze, verdicts
from doppelgait.processing import patches

Levels = npt.NDArray[np.uint8]
WEIGHTS = Path(verdicts.__file__).with_name("evidence.npz")
SEEDS = {"anything": range(7), "everyday": range(10, 12)}
KINDS = {"anything": ANYTHING, "everyday": EVERYDAY}
FOLDS, EPOCHS, BATCH, RATE, DECAY = 4, 16, 32, 3e-3, 1e-2
LAYERS, HIDDEN, DROPOUT = ((patches.N_SLICES, 16), (16, 24), (24, 32)), 32, 0.3
MOST_PICTURES = 4  # of a target, kept for the fit
VALUES = (  # of a result, that the network sees
    "alternate_likeness", "backward_envelope_mean_mps", "duration", "entropy_width_mps", "envelope_asymmetry",
    "envelope_periodicity", "far_limb_share", "forward_envelope_mean_mps", "forward_envelope_range_mps",
    "gait_confidence", "limb_share", "limb_torso_amplitude_ratio", "median_speed", "net_way", "periodicity",
    "range_span", "salience", "snr_mu_db", "strength_variation", "swing_duty", "torso_bandwidth_mps",
    "torso_ripple_mps", "torso_share", "turns_per_s", "without_range",
)  # fmt: skip


@contextmanager
def record_evidence() -> Iterator[list[dict[str, Any]]]:
    """Record the evidence of all targets that are judged."""
    found: list[dict[str, Any]] = []
    compute = verdicts.compute_probabilities

    def record(values: Mapping[str, Any], pictures: npt.NDArray[np.float32]) -> tuple[float, float]:
        own = {name: float(values[name]) for name in VALUES if values.get(name) is not None}
        kept = np.unique(np.linspace(0, len(pictures) - 1, MOST_PICTURES).round().astype(int))
        levels = (255.0 * pictures[kept]).round().astype(np.uint8)
        text = base64.b64encode(zlib.compress(levels.tobytes())).decode()
        found.append({"values": own, "pictures": text})
        return compute(values, pictures)

    verdicts.compute_probabilities = record
    try:
        yield found
    finally:
        verdicts.compute_probabilities = compute


def run_one(job: tuple[str, str, int]) -> list[dict[str, Any]]:
    """Record one scene, and return evidence and truth of its targets."""
    group, name, seed = job
    number = zlib.crc32(name.encode())
    with warnings.catch_warnings(), record_evidence() as found:
        warnings.simplefilter("ignore")
        setup = KINDS[group][name](np.random.default_rng([ROOT_SEED, number, seed]))
        recording, bodies = observe(setup, dg.rng((number + seed) % 2**31))
        results: Sequence[Any] = ()
        with suppress(AnalysisError):  # bursts that are too few
            results = () if setup.environment else analyze(recording)
    rows: list[dict[str, Any]] = []
    judged = [result for result in results if "body_probability" in result.quality]
    for result, evidence in zip(judged, found, strict=True):
        times_s = np.linspace(result.quality["track_start_s"], result.quality["track_stop_s"], 50)
        others = [other for other in judged if other is not result]
        everywhere = evidence["values"]["without_range"] > 0.0
        near = [body for body in bodies if everywhere or np.median(distance_m(body, result, times_s)) < NEAR_M]
        own = [
            body.moves(recording.radar)
            for body in near
            if everywhere or all(is_nearer(body, result, other, times_s) for other in others)
        ]
        if any(own) or not near:
            rows.append({"kind": name_kind(group, name), "bodies": sum(own), **evidence})
    return rows


def name_kind(group: str, name: str) -> str:
    """Name what is left out together: a generator of things, bodies before one radar, or an everyday scene."""
    what, _, radar = name.partition(", ")
    kind = what.split()[0].partition("+")[0]
    return f"{group}, {name if group == 'everyday' else kind if kind in THINGS else f'{kind}, {radar}'}"


def distance_m(body: Body, result: Any, times_s: FloatArray) -> FloatArray:
    """Return the distance of a body from a track along range, infinite before and after the track."""
    inside = (times_s >= result.quality["track_start_s"]) & (times_s <= result.quality["track_stop_s"])
    return np.where(inside, np.abs(result.gate.centre_at(times_s) - body.range_m(times_s)), np.inf)


def is_nearer(body: Body, result: Any, other: Any, times_s: FloatArray) -> bool:
    """Return True if a body is for most of the time nearer to a track than to another."""
    return bool(np.mean(distance_m(body, result, times_s) <= distance_m(body, other, times_s)) >= 0.5)


def reliability(probability: FloatArray, true: npt.NDArray[np.bool_]) -> tuple[str, float]:
    """Format a reliability table, and measure the calibration error."""
    place, lines, error = np.minimum((10 * probability).astype(int), 9), [], 0.0
    for own, tenth in ((place == tenth, tenth) for tenth in np.unique(place)):
        stated, seen = probability[own].mean(), true[own].mean()
        lines.append((f"{tenth / 10:.1f} to {tenth / 10 + 0.1:.1f}", int(own.sum()), stated, seen))
        error += own.mean() * abs(stated - seen)
    return markdown(("probability", "targets", "mean", "true share"), lines), float(error)


def make_judge(n_values: int) -> Any:
    """Make the network of :func:`doppelgait.pipeline.verdicts.compute_probabilities`."""
    import torch
    from torch import nn

    class Judge(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.kernels = nn.ModuleList(nn.Conv2d(few, many, 3, padding=1, bias=False) for few, many in LAYERS)
            self.norms = nn.ModuleList(nn.BatchNorm2d(many) for _, many in LAYERS)
            self.hidden, self.output = nn.Linear(2 * LAYERS[-1][1] + n_values, HIDDEN), nn.Linear(HIDDEN, 2)
            self.drop = nn.Dropout(DROPOUT)

        def forward(self, layer: Any, values: Any) -> Any:
            for kernel, norm in zip(self.kernels, self.norms, strict=True):
                layer = norm(nn.functional.max_pool2d(kernel(layer), 2)).relu()
            seen = torch.cat([layer.mean((2, 3)), layer.amax((2, 3)), values], dim=1)
            return self.output(self.drop(self.hidden(self.drop(seen)).relu()))

    return Judge()


def as_arrays(judge: Any) -> dict[str, npt.NDArray[np.float32]]:
    """Return the weights of a network, with the normalisation as scale and bias."""
    found = {"hidden": judge.hidden.weight, "offsets": judge.hidden.bias}
    found |= {"output": judge.output.weight, "shifts": judge.output.bias}
    for n, (kernel, norm) in enumerate(zip(judge.kernels, judge.norms, strict=True)):
        scale = norm.weight / (norm.running_var + norm.eps).sqrt()
        found |= {f"kernel_{n}": kernel.weight, f"scale_{n}": scale}
        found[f"bias_{n}"] = norm.bias - norm.running_mean * scale
    return {name: value.detach().numpy().astype(np.float32) for name, value in found.items()}


def fit(pictures: Sequence[Levels], values: FloatArray, count: npt.NDArray[np.int64]) -> Any:
    """Fit a network; every step sees one picture of each target in its batch."""
    import torch

    torch.manual_seed(0)
    source, judge = np.random.default_rng(0), make_judge(values.shape[1])
    optimiser = torch.optim.AdamW(judge.parameters(), lr=RATE, weight_decay=DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, total_steps=EPOCHS * (len(count) // BATCH))
    loss = torch.nn.functional.binary_cross_entropy_with_logits
    for _ in range(EPOCHS):
        order = source.permutation(len(count))
        for first in range(0, len(order) - BATCH + 1, BATCH):
            own = order[first : first + BATCH]
            layer = np.stack([pictures[n][source.integers(len(pictures[n]))] for n in own])
            body, several = judge(torch.from_numpy(layer).float() / 255.0, torch.from_numpy(values[own]).float()).T
            is_body = torch.from_numpy(count[own] > 0).float()
            doubt = loss(several, torch.from_numpy(count[own] > 1).float(), reduction="none")
            total = loss(body, is_body) + (doubt * is_body).sum() / is_body.sum().clamp(min=1.0)
            optimiser.zero_grad()
            total.backward()
            optimiser.step()
            schedule.step()
    return judge.eval()


def predict(judge: Any, pictures: Sequence[Levels], values: FloatArray) -> FloatArray:
    """Return both probabilities of every target, shape (n, 2)."""
    import torch

    found = []
    with torch.no_grad():
        for own, value in zip(pictures, torch.from_numpy(values).float(), strict=True):
            logits = judge(torch.from_numpy(own).float() / 255.0, value.expand(len(own), -1))
            found.append(logits.mean(0).sigmoid().numpy())
    return np.array(found, dtype=np.float64)


def as_pictures(text: str) -> Levels:
    """Return the pictures of a row."""
    levels = np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype=np.uint8)
    return levels.reshape(-1, patches.N_SLICES, patches.N_COLUMNS, patches.N_CELLS).copy()


def main() -> None:
    """Record what is missing, fit, and write weights and page."""
    parser = make_parser(__doc__)
    parser.add_argument("--write", action="store_true", help="write the weights into the package")
    options = parser.parse_args()
    jobs = [(group, name, seed) for group, seeds in SEEDS.items() for seed in seeds for name in KINDS[group]]
    rows = run_jobs(run_one, jobs, rows=options.rows, processes=options.processes)
    raw = np.array([[row["values"].get(name, np.nan) for name in VALUES] for row in rows], dtype=np.float64)
    mean, sd = np.nanmean(raw, axis=0), np.maximum(np.nanstd(raw, axis=0), 1e-9)
    scaled = np.clip((raw - mean) / sd, -verdicts.MOST_SD, verdicts.MOST_SD)
    values = np.where(np.isnan(raw), 0.0, scaled)
    pictures = [as_pictures(row["pictures"]) for row in rows]
    count = np.array([row["bodies"] for row in rows])
    kinds = np.array([zlib.crc32(row["kind"].encode()) for row in rows])
    without, found = raw[:, VALUES.index("without_range")] > 0.0, np.zeros((len(rows), 2))
    for inner, outer in GroupKFold(FOLDS).split(kinds, groups=kinds):
        judge = fit([pictures[n] for n in inner], values[inner], count[inner])
        found[outer] = predict(judge, [pictures[n] for n in outer], values[outer])
    sections = {}
    for title, column, chosen in (("Body", 0, count >= 0), ("More than one", 1, count > 0)):
        for words, part in (("with range", chosen & ~without), ("without range", chosen & without)):
            probability, known = found[part, column], count[part] > column
            table, error = reliability(probability, known)
            limits = np.arange(0.2, 0.9, 0.1)
            shares = [(f"{x:g}", *(float(np.mean(probability[own] >= x)) for own in (known, ~known))) for x in limits]
            table += "\n\n" + markdown(("limit", "true, at or above", "false, at or above"), shares)
            sections[f"{title}, {words}"] = f"Calibration error {100 * error:.1f} %.\n\n{table}"
    if options.write:
        arrays = as_arrays(fit(pictures, values, count))
        np.savez_compressed(WEIGHTS, names=np.array(VALUES), mean=mean, sd=sd, **arrays)
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()

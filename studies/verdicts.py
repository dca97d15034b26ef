"""Evidence that a target is a body, and that it is more than one: learned, and tested on kinds left out.

    python studies/verdicts.py --write --page

Question: how often is a thing called a body or a body a thing, and are the probabilities right?

Bodies and things of `studies/evidence_scenes.py` (six recordings a kind) and of [everyday scenes](everyday.md) (four a
kind, seeds 10 to 13, without rooms) are recorded and tracked. A target is a body if a person or an animal that moves is
within 0.8 m of it (median); near somebody who keeps still it is left out; else it is a thing. The evidence of
`pipeline.verdicts` is the input of two networks of one hidden layer. The tables are of kinds that were left out of the
fit (8 folds); the file has the fit of all. It takes about 30 minutes of one core.

Not shown: recorded bodies and things, reflections, and rooms.
"""

from __future__ import annotations

import json
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from everyday import NEAR_M, ROOT_SEED, Body, observe
from everyday_scenes import SCENES as EVERYDAY
from evidence_scenes import SCENES as ANYTHING
from harness import finish, make_parser, markdown, run_jobs
from sklearn.model_selection import GroupKFold
from sklearn.neural_network import MLPClassifier

import doppelgait as dg
from doppelgait.pipeline import analyze, verdicts

FloatArray = npt.NDArray[np.float64]
WEIGHTS = Path(verdicts.__file__).with_name("evidence.toml")
SEEDS = {"anything": range(6), "everyday": range(10, 14)}
KINDS = {"anything": ANYTHING, "everyday": EVERYDAY}
NETWORK: dict[str, Any] = {"hidden_layer_sizes": (16,), "alpha": 3.0, "max_iter": 400, "random_state": 0}
RESULT = """alternate_likeness backward_envelope_mean_mps entropy_width_mps envelope_asymmetry
    envelope_periodicity far_limb_share forward_envelope_mean_mps forward_envelope_range_mps gait_confidence limb_share
    limb_torso_amplitude_ratio periodicity salience snr_mu_db strength_variation swing_duty torso_bandwidth_mps
    torso_ripple_mps torso_share track_echo_entropy track_echo_width_m track_second_echo_share without_range"""
"""Evidence among the values of a result."""


@contextmanager
def record_evidence() -> Iterator[list[dict[str, Any]]]:
    """Record the evidence of all targets that are judged."""
    found: list[dict[str, Any]] = []
    compute = verdicts.compute_probabilities

    def record(values: Mapping[str, Any]) -> tuple[float, float]:
        found.append({name: value for name, value in values.items() if isinstance(value, int | float)})
        return compute(values)

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
        results = [] if setup.environment else analyze(recording)
    rows: list[dict[str, Any]] = []
    judged = [result for result in results if "body_probability" in result.quality]
    for result, evidence in zip(judged, found, strict=True):
        near = [body.moves(recording.radar) for body in bodies if evidence["without_range"] or is_near(body, result)]
        if any(near) or not near:
            rows.append({"kind": f"{group}, {name}", "bodies": sum(near), "evidence": evidence})
    return rows


def is_near(body: Body, result: Any) -> bool:
    """Return True if a body is near the track of a target (median)."""
    times_s = np.linspace(result.quality["track_start_s"], result.quality["track_stop_s"], 50)
    return bool(np.median(np.abs(result.gate.centre_at(times_s) - body.range_m(times_s))) < NEAR_M)


def reliability(probability: FloatArray, true: npt.NDArray[np.bool_]) -> tuple[str, float]:
    """Format a reliability table, and measure the calibration error."""
    place, lines, error = np.minimum((10 * probability).astype(int), 9), [], 0.0
    for own, tenth in ((place == tenth, tenth) for tenth in np.unique(place)):
        stated, seen = probability[own].mean(), true[own].mean()
        lines.append((f"{tenth / 10:.1f} to {tenth / 10 + 0.1:.1f}", int(own.sum()), stated, seen))
        error += own.mean() * abs(stated - seen)
    return markdown(("probability", "targets", "mean", "true share"), lines), float(error)


def as_text(values: FloatArray) -> str:
    """Format numbers with four digits as a list of TOML."""
    return f"[{', '.join(f'{value:.4g}' for value in values)}]"


def predict_left_out(
    fit: Callable[[Any], MLPClassifier], values: FloatArray, chosen: npt.NDArray[np.bool_], kinds: FloatArray
) -> FloatArray:
    """Predict the probabilities of kinds that a fit has not seen."""
    found, numbers = np.full(len(values), np.nan), np.flatnonzero(chosen)
    for inner, outer in GroupKFold(8).split(numbers, groups=kinds[numbers]):
        training = np.isin(np.arange(len(values)), numbers[inner])
        found[numbers[outer]] = fit(training).predict_proba(values[numbers[outer]])[:, 1]
    return found


def main() -> None:
    """Record what is missing, fit, and write weights and page."""
    parser = make_parser(__doc__)
    parser.add_argument("--write", action="store_true", help="write the weights into the package")
    options = parser.parse_args()
    jobs = [(group, name, seed) for group, seeds in SEEDS.items() for seed in seeds for name in KINDS[group]]
    rows = run_jobs(run_one, jobs, rows=options.rows, processes=options.processes)
    still = verdicts.TrackStrip(np.arange(9.0), np.ones(9), np.zeros(9), np.ones((9, 9)), np.arange(9.0))
    names = sorted({*verdicts.measure_evidence(still), *RESULT.split()})
    raw = np.array([[row["evidence"].get(name, np.nan) for name in names] for row in rows], dtype=np.float64)
    mean, sd = np.nanmean(raw, axis=0), np.maximum(np.nanstd(raw, axis=0), 1e-9)
    scaled = np.clip((raw - mean) / sd, -verdicts.MOST_SD, verdicts.MOST_SD)
    values = np.where(np.isnan(raw), 0.0, scaled)
    count = np.array([row["bodies"] for row in rows])
    kinds = np.array([zlib.crc32(row["kind"].encode()) for row in rows])
    without = raw[:, names.index("without_range")] > 0.0
    sections, fits = {}, []
    for title, true, chosen in zip(
        ("Body", "More than one"), (count > 0, count > 1), (count >= 0, count > 0), strict=True
    ):

        def fit(own: Any, true: Any = true) -> MLPClassifier:
            return MLPClassifier(**NETWORK).fit(values[own], true[own])

        fits.append(fit(chosen))
        for words, part in (("with range", chosen & ~without), ("without range", chosen & without)):
            found = predict_left_out(fit, values, chosen, kinds)[part]
            table, error = reliability(found, true[part])
            limits, known = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8), true[part]
            shares = [(f"{x:g}", float(np.mean(found[known] >= x)), float(np.mean(found[~known] >= x))) for x in limits]
            table += "\n\n" + markdown(("limit", "true, at or above", "false, at or above"), shares)
            sections[f"{title}, {words}"] = f"Calibration error {100 * error:.1f} %.\n\n{table}"
    if options.write:
        tables = [f"names = {json.dumps(names)}", f"mean = {as_text(mean)}", f"sd = {as_text(sd)}"]
        for name, model in zip(("body", "several"), fits, strict=True):
            (hidden, output), (offsets, offset) = model.coefs_, model.intercepts_
            rows_text = ",\n".join(as_text(row) for row in hidden.T)
            tables += [f"\n[{name}]\noffset = {offset[0]:.4g}", f"offsets = {as_text(offsets)}"]
            tables += [f"output = {as_text(output[:, 0])}", f"hidden = [\n{rows_text},\n]"]
        WEIGHTS.write_text("# Written by studies/verdicts.py\n" + "\n".join(tables) + "\n", encoding="utf-8")
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()

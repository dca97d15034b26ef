"""Train on one radar, test on another that sees the same movers.

    python studies/cross_sensor.py OUT_FOLDER [--real RADAR_DATA] [--seeds 3] [--share 1]

Protocol, written down before any score:

1. Movers, places, cross sections and noise are those of the built-in plan ``home-alarm-wide`` without its varied
   motion, rooms and impairments, for 4 s at 9 m. Every mover is seen by four radars (:data:`SENSORS`); truth and labels
   are the same in all of them, which is checked. All radars see the same span of velocities; their bands are their own.
2. One picture for all: cells of m/s and seconds (:class:`doppelgait.classify.Patch`); features in physical units.
3. Trained on one radar, or on the three others together with the same number of movers, a third of them by each; tested
   on movers that no training has. A fifth of the training movers stops the training and calibrates.
4. With the recipe: the default ensemble, its network with stretched velocities, gain and noise on a widening
   curriculum. Without: the same with a network that has none of the three (:data:`PLAIN`). Single members are reported.
5. Every seed draws other movers and trains again. Tables show the mean over seeds and the range.
6. RADAR_DATA holds the real X-band images of :mod:`sim_to_real_xband`. They are asked once by models of each radar, in
   that study's picture and with its network settings. They choose nothing.

Answers in OUT_FOLDER are taken as they are: empty it after a change of the package.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import sim_to_real_models as real_models
import sim_to_real_xband as xband
import sim_to_real_xband_images as images
from recipe import mean_and_range
from sim_to_real_inputs import SIX
from sklearn.metrics import f1_score

from doppelgait.classify.data import feature_values
from doppelgait.classify.learned import Inputs, Learned, Part, features_in, join_inputs, levels_in
from doppelgait.classify.model import Calibration, calibrate
from doppelgait.classify.network import Training, train_network
from doppelgait.classify.patches import Patch, levels
from doppelgait.classify.scores import auc, balanced_accuracy
from doppelgait.classify.training import MEMBERS, fit, join, kind_of
from doppelgait.core.config import validate
from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.dataset import load_plan, stream_examples
from doppelgait.dataset.config import PlanConfig
from doppelgait.radar import Radar

SENSORS: dict[str, dict[str, Any]] = {
    "X4, 7.29 GHz": {"preset": "x4-long"},
    "24 GHz": {"preset": "ancortek-24", "sweep_s": 256e-6, "sample_rate_hz": 500e3},
    "60 GHz": {"preset": "ti-60", "sample_rate_hz": 6.6375e6},
    "77 GHz": {"preset": "ti-77", "sample_rate_hz": 5e6},
}
"""Presets with a frame of 18 m: the sweep at 24 GHz is shorter and has 128 samples, at 60 GHz there are more samples,
at 77 GHz no more than the frame needs."""
FRAME_M = 18.0
SPAN_MPS = 8.0
"""Unambiguous velocity of all radars."""
CPI_S = 0.1
TRAINED, TESTED = 120, 60
"""Movers of a class."""
HELD_OF = 5
PLAIN = Training(stretch=1.0, gain_db=0.0, noise_db=0.0)
SETTINGS = {"recipe": Training(), "plain": PLAIN}
OTHERS = "the three others"
SAME = ("label", "truth_ground_speed_mps", "truth_gait_frequency_hz", "truth_aspect_deg", "truth_range_m",
        "truth_height_m", "rcs_total_m2", "gate_error_m", "radar_height_m")  # fmt: skip
"""Columns that must be the same for all radars, up to rounding and the raster of time."""
VARIANTS = ("same resolution", "preset's rate")
"""Of the tested rows: a window with the velocity resolution of the X4; the preset's own pulse rate."""
VARIED = ("24 GHz", "77 GHz")
"""Their presets see +-3.1 m/s; those of the X4 and at 60 GHz 10.3 and 6.6."""


def radar_of(sensor: str) -> Radar:
    """Return a radar with its preset's pulse rate."""
    changes = {**SENSORS[sensor], "range_stop_m": FRAME_M}
    return Radar.preset(changes.pop("preset"), **changes)


def plan_of(sensor: str, seed: int, variant: str = "") -> tuple[PlanConfig, Path]:
    """Return the plan of a radar."""
    plan, base = load_plan("home-alarm-wide")
    table = plan.model_dump(mode="python", exclude={"background", "environment", "impairments"})
    radar, wavelength_m = {**SENSORS[sensor], "range_stop_m": FRAME_M}, radar_of(sensor).wavelength_m
    if variant != "preset's rate":
        radar["prf_hz"] = float(round(4.0 * SPAN_MPS / wavelength_m))
    scale = wavelength_m / radar_of("X4, 7.29 GHz").wavelength_m
    table["dataset"]["seed"] = seed
    table["radar"] = radar
    table["analysis"] = {"cpi_s": CPI_S * (scale if variant == "same resolution" else 1.0)}
    table["scene"] = {"duration_s": 4.0, "radar_position_m": [0.0, 0.0, {"uniform": [0.8, 1.6]}]}
    table["target"].pop("vary", None)
    table["target"] |= {"range_m": {"uniform": [8.5, 9.5]}, "rcs": {"total_m2": {"log_uniform": [0.1, 1.6]}}}
    return validate(PlanConfig, table, where=sensor), base


def examples(sensor: str, seed: int, n_movers: int, out: Path, variant: str = "") -> pd.DataFrame:
    """Simulate movers, or take them from OUT_FOLDER.

    Rows with ``number``, ``levels`` and ``xband`` (levels); classes alternate.
    """
    target = out / f"rows-{sensor}-{variant}-{n_movers}-{seed}.pkl"
    if target.is_file():
        return pd.read_pickle(target)
    plan, base = plan_of(sensor, seed, variant)
    rows = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)  # aliasing is counted from the rows
        stream = stream_examples(plan, folder=base).numbered()
        while len(rows) < 2 * n_movers:
            number, example = next(stream)
            signature = example.arrays["signature"]
            pictures = {"levels": levels(signature), "xband": levels(signature, images.PATCH)}
            rows.append({**example.row, "number": number, **pictures})
    frame = pd.DataFrame(rows).rename(columns=lambda name: name.removeprefix("feature_"))
    frame.to_pickle(target)
    return frame


def check_same(parts: Mapping[str, pd.DataFrame]) -> None:
    """Refuse radars that do not see the same movers (ValueError)."""
    first, *others = parts.values()
    for name, part in zip(list(parts)[1:], others, strict=True):
        for column in ("number", *SAME):
            one, other = first[column], part[column]
            if pd.api.types.is_numeric_dtype(one):
                equal = np.allclose(one.astype(float), other.astype(float), rtol=0.01, atol=0.02, equal_nan=True)
            else:
                equal = one.equals(other)
            if not equal:
                raise ValueError(f"{name}: {column} is not that of the other radars")


def features_of(rows: pd.DataFrame) -> dict[str, npt.NDArray[np.float64]]:
    """Return all features as model inputs, in units without the carrier."""
    names = [*SIX, *sorted(name for name in rows if name.startswith("extended_"))]
    wavelength_m = SPEED_OF_LIGHT_MPS / rows["carrier_hz"].to_numpy(dtype=np.float64)
    return feature_values({name: rows[name] for name in names}, wavelength_m)


def inputs_of(rows: pd.DataFrame, names: Sequence[str], pictures: str) -> Inputs:
    """Return features and pictures of rows as model inputs."""
    values = features_of(rows)
    return join_inputs(np.column_stack([values[name] for name in names]), rows[pictures].to_numpy(dtype=object))


@dataclass(frozen=True, eq=False)
class Trained:
    """A calibrated model with the names of its features."""

    learned: Learned
    calibration: Calibration
    names: tuple[str, ...]
    pictures: str
    view: Any

    def of_person(self, rows: pd.DataFrame) -> npt.NDArray[np.float64]:
        """Return the probability of a person, shape (n,)."""
        values = self.view(inputs_of(rows, self.names, self.pictures))
        return self.calibration(self.learned.log_probability(values))[:, 1]


def train(
    rows: pd.DataFrame, settings: Mapping[str, Training], seed: int, *, pictures: str = "levels",
    spec: Patch | None = None,
) -> dict[str, Trained]:  # fmt: skip
    """Train the members and one ensemble per network.

    Every fifth pair of movers is held back.
    """
    values = features_of(rows)
    names = tuple(name for name, column in values.items() if np.unique(column[np.isfinite(column)]).size > 1)
    inputs, labels = inputs_of(rows, names, pictures), (rows["label"] == "human").to_numpy(dtype=np.int64)
    held = (rows["number"] // 2 % HELD_OF == HELD_OF - 1).to_numpy()
    learn, kept = Part(inputs[~held], labels[~held]), Part(inputs[held], labels[held])
    views: dict[str, tuple[Any, Learned]] = {}
    for name in MEMBERS[:2]:
        parts = (Part(features_in(part.values), part.labels) for part in (learn, kept))
        views[name] = features_in, fit(kind_of(name), *parts, n_classes=2, seed=seed)
    for label, own in settings.items():
        parts = (Part(levels_in(part.values), part.labels) for part in (learn, kept))
        network = train_network(*parts, n_classes=2, seed=seed, spec=spec, settings=own)
        views[f"network, {label}"] = levels_in, network
        members = [[views[name][1]] for name in MEMBERS[:2]]
        views[f"ensemble, {label}"] = (lambda given: given), join([*members, [network]], kept, n_classes=2)
    found = {}
    for name, (view, learned) in views.items():
        calibration = calibrate(learned.log_probability(view(kept.values)), kept.labels)
        found[name] = Trained(learned, calibration, names, pictures, view)
    return found


def shared_out(parts: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Give every pair of movers to one radar in turn."""
    turns = [part[part["number"] // 2 % len(parts) == turn] for turn, part in enumerate(parts)]
    return pd.concat(turns, ignore_index=True)


def answers_of(seed: int, out: Path, real: pd.DataFrame | None, *, share: float) -> dict[str, pd.DataFrame]:
    """Simulate, train and test with one seed, or take what OUT_FOLDER holds.

    Returns
    -------
    dict of DataFrame
        ``sensors``: facts of every radar. ``tested``: answers to simulated rows (trained, tested, variant, model,
        label, p). ``real``: answers to real images.
    """
    target = out / f"cross-sensor-{share:g}-{seed}.pkl"
    if target.is_file():
        return pd.read_pickle(target)
    began = time.process_time()
    n_trained, n_tested = (max(int(share * size), 10) for size in (TRAINED, TESTED))
    learnt = {sensor: examples(sensor, 100 + seed, n_trained, out) for sensor in SENSORS}
    cases = [*((sensor, "") for sensor in SENSORS), *itertools.product(VARIED, VARIANTS)]
    tested = {case: examples(case[0], 900 + seed, n_tested, out, case[1]) for case in cases}
    check_same(learnt)
    check_same({" ".join(case): rows for case, rows in tested.items()})
    print(f"seed {seed}: simulated in {time.process_time() - began:.0f} s of processor time", flush=True)
    lines, shown = [], []
    for source, goal in [(sensor, "") for sensor in SENSORS] + [(OTHERS, sensor) for sensor in SENSORS]:
        rows = learnt[source] if not goal else shared_out([part for name, part in learnt.items() if name != goal])
        models = train(rows, SETTINGS, seed)
        for (sensor, variant), (name, model) in itertools.product(tested, models.items()):
            if goal in ("", sensor):
                rows = tested[sensor, variant]
                facts = {"trained": source, "tested": sensor, "variant": variant, "model": name}
                lines.append(pd.DataFrame({**facts, "label": rows["label"], "p": model.of_person(rows)}))
    for source in (*SENSORS, "all four") if real is not None else ():
        rows = shared_out(list(learnt.values())) if source == "all four" else learnt[source]
        models = train(rows, {"recipe": real_models.SETTINGS}, seed, pictures="xband", spec=images.PATCH)
        for name, model in models.items():
            facts = {"trained": source, "model": name, "image": real["image"], "label": real["label"]}
            shown.append(pd.DataFrame({**facts, "p": model.of_person(real)}))
    sensors = pd.DataFrame([facts_of(sensor, tested) for sensor in SENSORS])
    found = {"sensors": sensors, "tested": pd.concat(lines, ignore_index=True)}
    found["real"] = pd.concat(shown, ignore_index=True) if shown else pd.DataFrame()
    pd.to_pickle(found, target)
    print(f"seed {seed}: {time.process_time() - began:.0f} s of processor time", flush=True)
    return found


def facts_of(sensor: str, tested: Mapping[tuple[str, str], pd.DataFrame]) -> dict[str, Any]:
    """Return rate, resolutions, SNR and aliased rows of a radar."""
    radar = radar_of(sensor)
    rows = tested[sensor, ""]
    return {
        "radar": sensor, "pulses/s": rows["prf_hz"].iloc[0] if "prf_hz" in rows else np.nan,
        "preset's pulses/s": radar.prf_hz, "cell, cm": 100.0 * radar.range_resolution_m,
        "velocity cell, m/s": radar.wavelength_m / (2.0 * CPI_S), "SNR_mu, dB": rows["quality_snr_mu_db"].median(),
        "aliased": aliased(rows), "aliased at the preset's rate": aliased(tested.get((sensor, "preset's rate"), rows)),
    }  # fmt: skip


def aliased(rows: pd.DataFrame) -> float:
    """Return the share of rows in which a limb aliases."""
    return float(rows["warnings"].fillna("").str.contains("aliasing").mean())


def real_rows(data: Path) -> pd.DataFrame:
    """Read the real people and dogs as rows, all images whole."""
    found = xband.real_images(data)
    inputs = xband.real_inputs(found)
    columns = {name if name in SIX else f"extended_{name}": v for name, v in inputs.columns.items()}
    rows = pd.DataFrame({**columns, "label": inputs.labels, "image": list(found)})
    rows["carrier_hz"] = SPEED_OF_LIGHT_MPS / inputs.wavelength_m
    rows["xband"] = inputs.levels
    return rows[rows["label"].isin(("human", "dog"))].reset_index(drop=True)


def scores(rows: pd.DataFrame) -> dict[str, float]:
    """Return balanced accuracy, macro-F1 and AUC of answers."""
    person, called = (rows["label"] == "human").to_numpy(), (rows["p"] > 0.5).to_numpy()
    value = balanced_accuracy(person.astype(np.int64), person == called, 2)
    return {"accuracy": value, "f1": float(f1_score(person, called, average="macro")), "auc": auc(rows["p"], person)}


def cell(parts: Sequence[pd.DataFrame], score: str) -> str:
    """Format the mean over seeds and the range.

    A seed counts by the mean over its pairs of radars.
    """
    values = []
    for rows in parts:
        pairs = [scores(pair)[score] for _, pair in rows.groupby(["trained", "tested", "variant"])]
        values.append(float(np.mean(pairs)))
    return mean_and_range(values)


def markdown(head: Sequence[str], lines: Sequence[Sequence[str]]) -> list[str]:
    """Format a table."""
    text = ["| " + " | ".join(line) + " |" for line in (head, ["---"] + ["---:"] * (len(head) - 1), *lines)]
    return [*text, ""]


def report(found: Sequence[Mapping[str, pd.DataFrame]]) -> list[str]:
    """Tabulate all seeds."""
    sensors = pd.concat([each["sensors"] for each in found]).groupby("radar", sort=False).mean()
    facts = [[str(name), *(f"{value:.3g}" for value in row)] for name, row in sensors.iterrows()]
    lines = [f"# Between sensors, {len(found)} seeds", "", *markdown(["radar", *sensors.columns], facts)]
    answers = [each["tested"] for each in found]
    usual = [rows[rows["variant"] == ""] for rows in answers]
    for name, score in itertools.product([f"ensemble, {label}" for label in SETTINGS], ("accuracy", "f1")):
        table = []
        for source in (*SENSORS, OTHERS):
            own = [rows[(rows["trained"] == source) & (rows["model"] == name)] for rows in usual]
            table.append([source, *(cell([r[r["tested"] == goal] for r in own], score) for goal in SENSORS)])
        lines += [f"{name}, {score}, %:", "", *markdown(["trained on", *SENSORS], table)]
    names = list(dict.fromkeys(answers[0]["model"]))
    kinds = {
        "same radar": lambda rows: rows["trained"] == rows["tested"],
        "another radar": lambda rows: (rows["trained"] != rows["tested"]) & (rows["trained"] != OTHERS),
        OTHERS: lambda rows: rows["trained"] == OTHERS,
    }
    for score in ("accuracy", "f1", "auc"):
        table = []
        for name in names:
            own = [rows[rows["model"] == name] for rows in usual]
            table.append([name, *(cell([rows[take(rows)] for rows in own], score) for take in kinds.values())])
        lines += [f"Mean over pairs of radars, {score}, %:", "", *markdown(["model", *kinds], table)]
    table = []
    for name, variant in itertools.product(names, ("", *VARIANTS)):
        own = [rows[(rows["model"] == name) & (rows["variant"] == variant)] for rows in answers]
        own = [rows[rows["tested"].isin(VARIED)] for rows in own]
        cells = [cell([rows[take(rows)] for rows in own], "accuracy") for take in kinds.values()]
        table.append([name, variant or "as trained", *cells])
    lines += [f"Tested on {' and '.join(VARIED)}, accuracy, %:", "", *markdown(["model", "tested rows", *kinds], table)]
    if len(found[0]["real"]):
        table = []
        for (source, name), _ in found[0]["real"].groupby(["trained", "model"], sort=False):
            own = [rows[(rows["trained"] == source) & (rows["model"] == name)] for rows in (f["real"] for f in found)]
            right = [rows[(rows["p"] > 0.5) == (rows["label"] == "human")]["label"].value_counts() for rows in own]
            counts = [", ".join(str(each.get(label, 0)) for each in right) for label in ("human", "dog")]
            table.append([source, name, mean_and_range([scores(rows)["auc"] for rows in own]), *counts])
        head = ["trained on", "model", "AUC, %", "people right of 7, by seed", "dogs right of 4"]
        lines += ["Real X-band images:", "", *markdown(head, table)]
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--real", type=Path, help="folder with fmcw_xband_manga")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--share", type=float, default=1.0, help="share of the movers, 0.05 to 1")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    real = None if options.real is None else real_rows(options.real)
    lines = report([answers_of(seed, options.out, real, share=options.share) for seed in range(options.seeds)])
    (options.out / "cross-sensor.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    sys.exit(main())

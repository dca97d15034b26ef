"""Train on one radar, test on another that sees the same targets.

    python studies/cross_sensor.py OUT_FOLDER [--real RADAR_DATA] [--seeds 3] [--share 1]

Protocol, written down before any score:

1. Targets, places, cross sections and noise are those of the built-in plan ``home-alarm-wide`` without its varied
   motion, rooms and impairments, for 4 s at 9 m. Every target is seen by four radars (:data:`SENSORS`); truth and
   labels are the same in all of them, which is checked. All radars see the same span of
   velocities; their bands are their own.
2. One picture for all: cells of m/s and seconds (:class:`doppelgait.classify.Patch`); features in physical units.
3. Trained on one radar, or on the three others together with the same number of targets, a third of them by each;
   tested on targets that no training has. A fifth of the training targets stops the training and calibrates.
4. With the recipe: the default ensemble, its network with stretched velocities, gain and noise on a widening
   curriculum. Without: the same with a plain network that has none of the three; between them one that has the stretch
   alone. Single members are reported.
5. Every seed draws other targets and trains again. Tables show the mean over seeds and the range.
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
import pandas as pd
import sim_to_real_models as real_models
import sim_to_real_xband as xband
import sim_to_real_xband_images as images
from recipe import mean_and_range
from sim_to_real_inputs import SIX
from sklearn.metrics import f1_score

from doppelgait.classify.data import convert_features
from doppelgait.classify.learned import (
    FloatArray,
    Inputs,
    LabelledRows,
    Learned,
    join_inputs,
    log_softmax,
    select_features,
    select_levels,
)
from doppelgait.classify.model import Calibration, calibrate
from doppelgait.classify.network import Training, train_network
from doppelgait.classify.scores import auc, balanced_accuracy
from doppelgait.classify.training import MEMBERS, find_kind, fit
from doppelgait.core.config import validate
from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.dataset import load_plan, stream_examples
from doppelgait.dataset.config import PlanConfig
from doppelgait.processing.patches import Patch, levels
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
"""Targets of a class."""
HELD_OF = 5
PLAIN = Training(stretch=1.0, gain_db=0.0, noise_db=0.0)
SETTINGS = {"recipe": Training(), "stretch alone": Training(gain_db=0.0, noise_db=0.0), "plain": PLAIN}
FEATURES = MEMBERS[:2]
OTHERS = "the three others"
SAME = ("label", "truth_ground_speed_mps", "truth_gait_frequency_hz", "truth_aspect_deg", "truth_range_m",
        "truth_height_m", "rcs_total_m2", "gate_error_m", "radar_height_m")  # fmt: skip
"""Columns that must be the same for all radars, up to rounding and the raster of time."""


def radar_of(sensor: str) -> Radar:
    """Return a radar with its preset's pulse rate."""
    changes = {**SENSORS[sensor], "range_stop_m": FRAME_M}
    return Radar.preset(changes.pop("preset"), **changes)


def plan_of(sensor: str, seed: int) -> tuple[PlanConfig, Path]:
    """Return the plan of a radar."""
    plan, base = load_plan("home-alarm-wide")
    table = plan.model_dump(mode="python", exclude={"background", "environment", "impairments"})
    radar, wavelength_m = {**SENSORS[sensor], "range_stop_m": FRAME_M}, radar_of(sensor).wavelength_m
    radar["prf_hz"] = float(round(4.0 * SPAN_MPS / wavelength_m))
    table["dataset"]["seed"] = seed
    table["radar"] = radar
    table["analysis"] = {"cpi_s": CPI_S}
    table["scene"] = {"duration_s": 4.0, "radar_position_m": [0.0, 0.0, {"uniform": [0.8, 1.6]}]}
    table["target"].pop("vary", None)
    table["target"] |= {"range_m": {"uniform": [8.5, 9.5]}, "rcs": {"total_m2": {"log_uniform": [0.1, 1.6]}}}
    return validate(PlanConfig, table, where=sensor), base


def examples(sensor: str, seed: int, n_targets: int, out: Path) -> pd.DataFrame:
    """Simulate targets, or take them from OUT_FOLDER.

    Rows with ``number``, ``levels`` and ``xband`` (levels); classes alternate.
    """
    target = out / f"rows-{sensor}-{n_targets}-{seed}.pkl"
    if target.is_file():
        return pd.read_pickle(target)
    plan, base = plan_of(sensor, seed)
    rows = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)  # aliasing is counted from the rows
        stream = stream_examples(plan, folder=base).iterate_numbered()
        while len(rows) < 2 * n_targets:
            number, example = next(stream)
            signature = example.arrays["signature"]
            pictures = {"levels": levels(signature), "xband": levels(signature, images.PATCH)}
            rows.append({**example.row, "number": number, **pictures})
    frame = pd.DataFrame(rows).rename(columns=lambda name: name.removeprefix("feature_"))
    frame.to_pickle(target)
    return frame


def check_same(parts: Mapping[str, pd.DataFrame]) -> None:
    """Refuse radars that do not see the same targets (ValueError)."""
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


def features_of(rows: pd.DataFrame) -> dict[str, FloatArray]:
    """Return all features as model inputs, in units without the carrier."""
    names = [*SIX, *sorted(name for name in rows if name.startswith("extended_"))]
    wavelength_m = SPEED_OF_LIGHT_MPS / rows["carrier_hz"].to_numpy(dtype=np.float64)
    return convert_features({name: rows[name] for name in names}, wavelength_m)


def inputs_of(rows: pd.DataFrame, names: Sequence[str], pictures: str) -> Inputs:
    """Return features and pictures of rows as model inputs."""
    values = features_of(rows)
    return join_inputs(np.column_stack([values[name] for name in names]), rows[pictures].to_numpy(dtype=object))


@dataclass(frozen=True, eq=False)
class Trained:
    """Members and ensembles of one training, all calibrated.

    Parameters
    ----------
    names : tuple of str
        Features in their order.
    members : dict
        By name: model and calibration.
    ensembles : dict
        By name: its members and its calibration.
    """

    names: tuple[str, ...]
    pictures: str
    members: Mapping[str, tuple[Learned, Calibration]]
    ensembles: Mapping[str, tuple[tuple[str, ...], Calibration]]

    def of_person(self, rows: pd.DataFrame) -> dict[str, FloatArray]:
        """Return the probability of a person by every model, shape (n,)."""
        raw = log_probabilities(
            {name: model for name, (model, _) in self.members.items()}, inputs_of(rows, self.names, self.pictures)
        )
        found = {name: calibration(raw[name]) for name, (_, calibration) in self.members.items()}
        joined = {name: calibration(mean_of(found, own)) for name, (own, calibration) in self.ensembles.items()}
        return {name: values[:, 1] for name, values in {**found, **joined}.items()}


def log_probabilities(models: Mapping[str, Learned], inputs: Inputs) -> dict[str, FloatArray]:
    """Return log-probabilities of every member, (n, 2), not calibrated."""
    views = {True: select_features(inputs), False: select_levels(inputs)}
    return {name: model.log_probability(views[name in FEATURES]) for name, model in models.items()}


def mean_of(found: Mapping[str, FloatArray], names: Sequence[str]) -> FloatArray:
    """Return the mean of calibrated log-probabilities, as an ensemble does."""
    return log_softmax(np.mean([np.log(np.maximum(found[name], 1e-300)) for name in names], axis=0))


def train(
    rows: pd.DataFrame, settings: Mapping[str, Training], seed: int, *, pictures: str = "levels",
    spec: Patch | None = None,
) -> Trained:  # fmt: skip
    """Train the members and one ensemble per network.

    Every fifth pair of targets is held back.
    """
    values = features_of(rows)
    names = tuple(name for name, column in values.items() if np.unique(column[np.isfinite(column)]).size > 1)
    inputs, labels = inputs_of(rows, names, pictures), (rows["label"] == "human").to_numpy(dtype=np.int64)
    held = (rows["number"] // 2 % HELD_OF == HELD_OF - 1).to_numpy()
    models: dict[str, Learned] = {}
    for name in FEATURES:
        learn, kept = (LabelledRows(select_features(inputs[part]), labels[part]) for part in (~held, held))
        models[name] = fit(find_kind(name), learn, kept, n_classes=2, seed=seed)
    for label, own in settings.items():
        learn, kept = (LabelledRows(select_levels(inputs[part]), labels[part]) for part in (~held, held))
        models[f"network, {label}"] = train_network(learn, kept, n_classes=2, seed=seed, spec=spec, settings=own)
    raw = log_probabilities(models, inputs[held])
    members = {name: (model, calibrate(raw[name], labels[held])) for name, model in models.items()}
    found, ensembles = {name: calibration(raw[name]) for name, (_, calibration) in members.items()}, {}
    for label in settings:
        of = (*FEATURES, f"network, {label}")
        ensembles[f"ensemble, {label}"] = of, calibrate(mean_of(found, of), labels[held])
    return Trained(names, pictures, members, ensembles)


def shared_out(parts: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Give every pair of targets to one radar in turn."""
    turns = [part[part["number"] // 2 % len(parts) == turn] for turn, part in enumerate(parts)]
    return pd.concat(turns, ignore_index=True)


def results_of(seed: int, out: Path, real: pd.DataFrame | None, *, share: float) -> dict[str, pd.DataFrame]:
    """Simulate, train and test with one seed, or take what OUT_FOLDER holds.

    Returns
    -------
    dict of DataFrame
        ``sensors``: facts of every radar. ``tested``: answers to simulated rows (trained, tested, model, label,
        p). ``real``: answers to real images.
    """
    target = out / f"cross-sensor-{share:g}-{seed}.pkl"
    if target.is_file():
        return pd.read_pickle(target)
    began = time.process_time()
    n_trained, n_tested = (max(int(share * size), 10) for size in (TRAINED, TESTED))
    trained = {sensor: examples(sensor, 100 + seed, n_trained, out) for sensor in SENSORS}
    tested = {sensor: examples(sensor, 900 + seed, n_tested, out) for sensor in SENSORS}
    check_same(trained)
    check_same(tested)
    print(f"seed {seed}: simulated in {time.process_time() - began:.0f} s of processor time", flush=True)
    lines, shown = [], []
    for source, goal in [(sensor, "") for sensor in SENSORS] + [(OTHERS, sensor) for sensor in SENSORS]:
        rows = trained[source] if not goal else shared_out([part for name, part in trained.items() if name != goal])
        models = train(rows, {name: SETTINGS[name] for name in ("recipe", "plain")} if goal else SETTINGS, seed)
        for sensor, rows in tested.items():
            if goal in ("", sensor):
                facts = {"trained": source, "tested": sensor, "label": rows["label"]}
                lines += [pd.DataFrame({**facts, "model": name, "p": p}) for name, p in models.of_person(rows).items()]
    for source in (*SENSORS, "all four") if real is not None else ():
        rows = shared_out(list(trained.values())) if source == "all four" else trained[source]
        settings = {"recipe": real_models.SETTINGS.model_copy(update={"stretch": 1.4, "widening": 0.5})}
        models = train(rows, settings, seed, pictures="xband", spec=images.PATCH)
        facts = {"trained": source, "image": real["image"], "label": real["label"]}
        shown += [pd.DataFrame({**facts, "model": name, "p": p}) for name, p in models.of_person(real).items()]
    sensors = pd.DataFrame([facts_of(sensor, tested) for sensor in SENSORS])
    found = {"sensors": sensors, "tested": pd.concat(lines, ignore_index=True)}
    found["real"] = pd.concat(shown, ignore_index=True) if shown else pd.DataFrame()
    pd.to_pickle(found, target)
    print(f"seed {seed}: {time.process_time() - began:.0f} s of processor time", flush=True)
    return found


def facts_of(sensor: str, tested: Mapping[str, pd.DataFrame]) -> dict[str, Any]:
    """Return rate, resolutions, SNR and aliased rows of a radar."""
    radar, rows = radar_of(sensor), tested[sensor]
    return {
        "radar": sensor, "pulses/s": rows["prf_hz"].iloc[0], "preset's pulses/s": radar.prf_hz,
        "preset's span, m/s": radar.unambiguous_velocity_mps, "range cell, cm": 100.0 * radar.range_resolution_m,
        "velocity cell, m/s": radar.wavelength_m / (2.0 * CPI_S), "SNR_mu, dB": rows["quality_snr_mu_db"].median(),
        "aliased": aliased(rows),
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

    A seed counts by the mean over its pairs of radars; empty where no seed has any.
    """
    values = []
    for rows in parts:
        pairs = [scores(pair)[score] for _, pair in rows.groupby(["trained", "tested"])]
        values.append(float(np.mean(pairs)) if pairs else np.nan)
    return mean_and_range(values) if np.isfinite(values).all() else ""


def markdown(head: Sequence[str], lines: Sequence[Sequence[str]]) -> list[str]:
    """Format a table."""
    text = ["| " + " | ".join(line) + " |" for line in (head, ["---"] + ["---:"] * (len(head) - 1), *lines)]
    return [*text, ""]


def report(found: Sequence[Mapping[str, pd.DataFrame]]) -> list[str]:
    """Tabulate all seeds."""
    sensors = pd.concat([each["sensors"] for each in found]).groupby("radar", sort=False).mean()
    facts = [[str(name), *(f"{value:.3g}" for value in row)] for name, row in sensors.iterrows()]
    lines = [f"# Between sensors, {len(found)} seeds", "", *markdown(["radar", *sensors.columns], facts)]
    tested = [each["tested"] for each in found]
    for name, score in itertools.product([f"ensemble, {label}" for label in ("recipe", "plain")], ("accuracy", "f1")):
        table = []
        for source in (*SENSORS, OTHERS):
            own = [rows[(rows["trained"] == source) & (rows["model"] == name)] for rows in tested]
            table.append([source, *(cell([r[r["tested"] == goal] for r in own], score) for goal in SENSORS)])
        lines += [f"{name}, {score}, %:", "", *markdown(["trained on", *SENSORS], table)]
    names = list(dict.fromkeys(tested[0]["model"]))
    kinds = {
        "same radar": lambda rows: rows["trained"] == rows["tested"],
        "another radar": lambda rows: (rows["trained"] != rows["tested"]) & (rows["trained"] != OTHERS),
        OTHERS: lambda rows: rows["trained"] == OTHERS,
    }
    for score in ("accuracy", "f1", "auc"):
        table = []
        for name in names:
            own = [rows[rows["model"] == name] for rows in tested]
            table.append([name, *(cell([rows[take(rows)] for rows in own], score) for take in kinds.values())])
        lines += [f"Mean over pairs of radars, {score}, %:", "", *markdown(["model", *kinds], table)]
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
    parser.add_argument("--share", type=float, default=1.0, help="share of the targets, 0.05 to 1")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    real = None if options.real is None else real_rows(options.real)
    lines = report([results_of(seed, options.out, real, share=options.share) for seed in range(options.seeds)])
    (options.out / "cross-sensor.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    sys.exit(main())

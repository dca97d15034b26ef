"""Trained on one radar, tested on another that observes the same targets.

    python studies/cross_sensor.py OUT --page

Question: what does a model lose on another radar, and how much of it does the recipe (an augmentation for the training
of the network: stretch, gain and noise) give back?

Targets, places, cross sections and noise are those of the built-in plan `home-alarm-wide` without its varied motion,
rooms and impairments: 4 s at 9 m, approaching or receding within 45 degrees. Every target is observed by four radars;
truth and labels are the same in all of them, which is checked. All radars cover the same span of velocities (8 m/s)
and have a frame of 18 m; their bands are their own. All have the same picture format (64 rows of 0.2 m/s, columns of
1/32 s), window (0.1 s) and gate (1.6 m); features are in physical units. Training is on one radar, or on the three
others together with the same number of targets, a third of them by each; tests are on targets that no training has:
120 targets of a class for training, of which a fifth stops the training and calibrates, 60 for tests. With the recipe:
the default ensemble. Without: the same with a plain network; between them one that has the stretch alone. Every seed
samples other targets and trains again; tables have mean and range over three seeds. `doppelgait` itself makes no
decision at a carrier that is not in the training data; the study disables this rule. Answers in OUT are taken as they
are: empty it after a change of the package. It takes 30 minutes of one core.

Not shown: real radars. Models of these radars do not classify the real X-band images, whose display they do not have
([X-band](sim_to_real_xband.md)).
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from harness import finish, make_parser, markdown, spread
from sim_to_real_inputs import SIX
from sklearn.metrics import f1_score

from doppelgait.classify.data import convert_features
from doppelgait.classify.learned import (
    FloatArray,
    Inputs,
    LabelledRows,
    Learned,
    join_inputs,
    select_features,
    select_inputs,
)
from doppelgait.classify.model import Calibration, calibrate
from doppelgait.classify.network import Training, train_network
from doppelgait.classify.scores import auc, balanced_accuracy
from doppelgait.classify.training import MEMBERS, find_kind, fit, join
from doppelgait.core.config import validate
from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.dataset import load_plan, stream_examples
from doppelgait.dataset.config import PlanConfig
from doppelgait.processing.patches import levels
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
SCORES = {"accuracy": "balanced accuracy", "f1": "macro-F1", "auc": "AUC"}
SAME = ("label", "truth_ground_speed_mps", "truth_gait_frequency_hz", "truth_aspect_deg", "truth_range_m",
        "truth_height_m", "gate_error_m", "radar_height_m")  # fmt: skip
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
            rows.append({**example.row, "number": number, "levels": levels(signature)})
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


def inputs_of(rows: pd.DataFrame, names: Sequence[str]) -> Inputs:
    """Return features and pictures of rows as model inputs."""
    values = features_of(rows)
    return join_inputs(np.column_stack([values[name] for name in names]), rows["levels"].to_numpy(dtype=object))


@dataclass(frozen=True, eq=False)
class Trained:
    """Members and ensembles of one training, all calibrated."""

    names: tuple[str, ...]
    models: Mapping[str, tuple[Learned, Calibration]]

    def of_person(self, rows: pd.DataFrame) -> dict[str, FloatArray]:
        """Return the probability of a person by every model, shape (n,)."""
        inputs = inputs_of(rows, self.names)
        found = {name: calibration(ask(model, inputs)) for name, (model, calibration) in self.models.items()}
        return {name: probability[:, 1] for name, probability in found.items()}


def ask(model: Learned, inputs: Inputs) -> FloatArray:
    """Return log-probabilities of a member or an ensemble, (n, 2), not calibrated."""
    return model.log_probability(inputs if model.members else select_inputs(model, inputs))


def train(rows: pd.DataFrame, settings: Mapping[str, Training], seed: int) -> Trained:
    """Train the members and one ensemble per network. Every fifth pair of targets is held back."""
    values = features_of(rows)
    names = tuple(name for name, column in values.items() if np.unique(column[np.isfinite(column)]).size > 1)
    inputs, labels = inputs_of(rows, names), (rows["label"] == "human").to_numpy(dtype=np.int64)
    held = (rows["number"] // 2 % HELD_OF == HELD_OF - 1).to_numpy()
    models: dict[str, Learned] = {}
    for name in FEATURES:
        learn, kept = (LabelledRows(select_features(inputs[part]), labels[part]) for part in (~held, held))
        models[name] = fit(find_kind(name), learn, kept, n_classes=2, seed=seed)
    for label, own in settings.items():
        learn, kept = (LabelledRows(inputs[part][:, -1], labels[part]) for part in (~held, held))
        models[f"network, {label}"] = train_network(learn, kept, n_classes=2, seed=seed, settings=own)
    kept = LabelledRows(inputs[held], labels[held])
    for label in settings:
        members = [models[name] for name in (*FEATURES, f"network, {label}")]
        models[f"ensemble, {label}"] = join(members, kept, n_classes=2)
    calibrated = {name: (model, calibrate(ask(model, kept.values), kept.labels)) for name, model in models.items()}
    return Trained(names, calibrated)


def shared_out(parts: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Give every pair of targets to one radar in turn."""
    turns = [part[part["number"] // 2 % len(parts) == turn] for turn, part in enumerate(parts)]
    return pd.concat(turns, ignore_index=True)


def results_of(seed: int, out: Path, *, share: float) -> dict[str, pd.DataFrame]:
    """Simulate, train and test with one seed, or take what OUT holds: facts of the radars, answers to tested rows."""
    target = out / f"cross-sensor-{share:g}-{seed}.pkl"
    if target.is_file():
        return pd.read_pickle(target)
    n_trained, n_tested = (max(int(share * size), 10) for size in (TRAINED, TESTED))
    trained = {sensor: examples(sensor, 100 + seed, n_trained, out) for sensor in SENSORS}
    tested = {sensor: examples(sensor, 900 + seed, n_tested, out) for sensor in SENSORS}
    check_same(trained)
    check_same(tested)
    lines = []
    for source, goal in [(sensor, "") for sensor in SENSORS] + [(OTHERS, sensor) for sensor in SENSORS]:
        rows = trained[source] if not goal else shared_out([part for name, part in trained.items() if name != goal])
        models = train(rows, {name: SETTINGS[name] for name in ("recipe", "plain")} if goal else SETTINGS, seed)
        for sensor, rows in tested.items():
            if goal in ("", sensor):
                facts = {"trained": source, "tested": sensor, "label": rows["label"]}
                lines += [pd.DataFrame({**facts, "model": name, "p": p}) for name, p in models.of_person(rows).items()]
    sensors = pd.DataFrame([facts_of(sensor, tested) for sensor in SENSORS])
    found = {"sensors": sensors, "tested": pd.concat(lines, ignore_index=True)}
    pd.to_pickle(found, target)
    return found


def facts_of(sensor: str, tested: Mapping[str, pd.DataFrame]) -> dict[str, Any]:
    """Return rate, resolutions, SNR and aliased rows of a radar."""
    radar, rows = radar_of(sensor), tested[sensor]
    return {
        "radar": sensor, "pulses/s": rows["prf_hz"].iloc[0], "preset's pulses/s": radar.prf_hz,
        "preset's span, m/s": radar.unambiguous_velocity_mps, "range cell, cm": 100.0 * radar.range_resolution_m,
        "velocity cell, m/s": radar.wavelength_m / (2.0 * CPI_S), "SNR_mu, dB": rows["quality_snr_mu_db"].median(),
        "aliased": rows["warnings"].fillna("").str.contains("aliasing").mean(),
    }  # fmt: skip


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
    return spread(values, 1, scale=100.0) if np.isfinite(values).all() else ""


def report(found: Sequence[Mapping[str, pd.DataFrame]]) -> dict[str, str]:
    """Tabulate all seeds."""
    sensors = pd.concat([each["sensors"] for each in found]).groupby("radar", sort=False).mean()
    facts = [[str(name), *(f"{value:.3g}" for value in row)] for name, row in sensors.iterrows()]
    sections = {"Radars": markdown(["radar", *sensors.columns], facts)}
    tested = [each["tested"] for each in found]
    for name, score in itertools.product([f"ensemble, {label}" for label in ("recipe", "plain")], ("accuracy", "f1")):
        table = []
        for source in (*SENSORS, OTHERS):
            own = [rows[(rows["trained"] == source) & (rows["model"] == name)] for rows in tested]
            table.append([source, *(cell([r[r["tested"] == goal] for r in own], score) for goal in SENSORS)])
        sections[f"{name.capitalize()}: {SCORES[score]}, %"] = markdown(["trained on", *SENSORS], table)
    names = list(dict.fromkeys(tested[0]["model"]))
    kinds = {
        "same radar": lambda rows: rows["trained"] == rows["tested"],
        "another radar": lambda rows: (rows["trained"] != rows["tested"]) & (rows["trained"] != OTHERS),
        OTHERS: lambda rows: rows["trained"] == OTHERS,
    }
    for score, words in SCORES.items():
        table = []
        for name in names:
            own = [rows[rows["model"] == name] for rows in tested]
            table.append([name, *(cell([rows[take(rows)] for rows in own], score) for take in kinds.values())])
        sections[f"All models, mean over pairs of radars: {words}, %"] = markdown(["model", *kinds], table)
    return sections


def main() -> None:
    """Run the study and write its tables."""
    parser = make_parser(__doc__, out="folder for examples and answers")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--share", type=float, default=1.0, help="share of the targets, 0.05 to 1")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    found = [results_of(seed, options.out, share=options.share) for seed in range(options.seeds)]
    finish(__file__, __doc__, report(found), page=options.page)


if __name__ == "__main__":
    main()

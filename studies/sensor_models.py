"""Sensor models that are fitted to half of the recordings, compared with the others.

    python studies/sensor_models.py RADAR_DATA --page

Question: can a classifier separate real recordings from those of a fitted sensor model, and are the uncertainties of
the fit right?

Four parts, none of which chooses a constant of the fit. The 24 GHz module is fitted to the sessions of 2021 and judged
on those of 2022 (other people), and the other way round. The X4 is fitted to one of two radars before an empty room
and judged on the other, and the other way round. Four recordings of the A121 with four settings are each fitted to the
first half and judged on the second: that is no independent sensor and no independent scene, and flatters the fit.
Simulated units of a known population show whether means and spreads are within the stated uncertainty.

The judge is the domain classifier of `doppelgait radar compare`: `before` is the shipped preset, `after` the fitted
model; `shape` leaves out all levels. The scenes of the module are those that the recordings' read-me states
(`studies/plans/cw-people.toml`); the others are taken as empty rooms, also where somebody sat. It takes about 2
minutes of one core.

Not shown: a few recordings of one room cannot show an AUC of 0.5. They contain one sample of every quantity, while the
models sample many.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from harness import finish, make_parser, markdown, quiet
from sensor_units import POPULATION, fit_units, own_score, population_scores, summary

from doppelgait.classify.domain import Comparison, compare_recordings, simulate_like
from doppelgait.dataset.config import PlanConfig, load_plan
from doppelgait.radar import Radar, Recording
from doppelgait.radar.fit import fit_sensor, format_preset
from doppelgait.radar.readers import read_recording, read_several

SEEDS = 16
PEOPLE_AT_M = 3.0
"""Middle of the ranges that the recordings' read-me states (3.2 to 7 m down to the radar)."""
COPIES = 6
"""Simulated recordings for each real one, where those are few."""


def units_table(seeds: int) -> str:
    """Fit simulated units of a known population repeatedly; tabulate the scores."""
    means: dict[str, list[float]] = {name: [] for name in POPULATION}
    ratios: dict[str, list[float]] = {name: [] for name in POPULATION}
    covered: dict[str, list[bool]] = {name: [] for name in POPULATION}
    own: dict[str, list[float]] = {name: [] for name in ("iq_gain_db", "iq_phase_deg", "white_rad")}
    for seed in range(seeds):
        units, kind = fit_units(seed)
        for name, (score, ratio, inside) in population_scores(kind).items():
            means[name].append(score)
            ratios[name].append(ratio)
            covered[name].append(inside)
        for one, unit in zip(kind.recordings, units, strict=True):
            for name in own:
                own[name].append(own_score(one, name, unit.values[name]))
    rows = [
        {
            "quantity": name,
            "population": f"{mean:g} +- {sd:g}",
            "z of the mean: mean, rms, within 2": summary(np.array(means[name])),
            "spread over truth": f"{np.mean(ratios[name]):.2f} +- {np.std(ratios[name]):.2f}",
            "truth in the 95 % interval": f"{100 * np.mean(covered[name]):.0f} %",
            "z of single units": summary(np.array(own[name])) if name in own else "-",
        }
        for name, (mean, sd) in POPULATION.items()
    ]
    return markdown(pd.DataFrame(rows))


def judged(
    train: Sequence[Recording],
    test: Sequence[Recording],
    shipped: str,
    *,
    radar: Radar | None = None,
    people_at_m: float | None = None,
    plan: tuple[PlanConfig, Path] | None = None,
    copies: int = 1,
) -> dict[str, Comparison]:
    """Fit to some recordings and compare others with the shipped preset and the fitted model."""
    scene, folder = plan if plan is not None else (None, None)
    found = {}
    with tempfile.TemporaryDirectory() as models:
        model = Path(models) / "fitted.toml"
        model.write_text(format_preset(fit_sensor(train, radar=radar, people_at_m=people_at_m)), encoding="utf-8")
        for words, preset in (("before", shipped), ("after", str(model))):
            made = simulate_like(list(test) * copies, preset, plan=scene, folder=folder, seed=7)
            found[words] = compare_recordings(test, made)
    return found


def half(recording: Recording, second: bool) -> Recording:
    """Return the first or second half of a recording, in whole bursts."""
    burst = int(recording.facts.get("burst_pulses", 1))
    middle = recording.n_pulses // burst // 2 * burst
    part = recording.baseband[middle:] if second else recording.baseband[:middle]
    return recording.with_baseband(part, truth=())


def judge_all(data: Path) -> dict[str, dict[str, Comparison]]:
    """Fit and judge the models of the three sensors."""
    paths = sorted((data / "cw24_kmkim036").glob("*/*_RE.txt"))
    old = [read_recording(path) for path in paths if path.parent.name.startswith("21")]
    new = [read_recording(path) for path in paths if path.parent.name.startswith("22")]
    people = load_plan(Path(__file__).parent / "plans" / "cw-people.toml")
    cw = {"radar": Radar.preset("infineon-24"), "people_at_m": PEOPLE_AT_M, "plan": people}
    found = {
        "24 GHz, sessions of 2022": judged(old, new, "infineon-24", **cw),
        "24 GHz, sessions of 2021": judged(new, old, "infineon-24", **cw),
    }
    room = data / "x4_rf_giraffe_yin" / "rf_empty_room_two_radars_20220222_143239.mat"
    (one, other), _ = read_several([room])
    found["X4 radar 2"] = judged([one], [other], "x4-17fps", copies=COPIES)
    found["X4 radar 1"] = judged([other], [one], "x4-17fps", copies=COPIES)
    a121 = data / "a121_acconeer"
    settings = {
        "breathing": read_recording(a121 / "breathing-sitting.h5"),
        "presence": read_recording(a121 / "presence-default.h5", subsweep=1),
        "surface velocity": read_recording(a121 / "surface_velocity_default.h5"),
        "reflector": read_recording(a121 / "corner-reflector.h5", subsweep=0),
    }
    for name, recording in settings.items():
        first, second = (half(recording, later) for later in (False, True))
        found[f"A121, {name}, second half"] = judged([first], [second], "acconeer-a121", copies=COPIES)
    return found


def judge_table(found: Mapping[str, Mapping[str, Comparison]]) -> str:
    """Tabulate the domain classifiers before and after the fit."""
    rows = []
    for name, both in found.items():
        auc = {key: "{:.2f} ({:.2f} to {:.2f})".format(*one.auc) for key, one in both.items()}
        shape = {key: "{:.2f} ({:.2f} to {:.2f})".format(*one.auc_of_shape) for key, one in both.items()}
        worst, (distance, alone) = next(iter(both["after"].distances.items()))
        sizes = [np.median([d for d, _ in one.distances.values()]) for one in both.values()]
        rows.append(
            {
                "judged on": name,
                "AUC before": auc["before"],
                "after": auc["after"],
                "shape, before": shape["before"],
                "shape, after": shape["after"],
                "linear": " -> ".join(f"{one.auc_linear:.2f}" for one in both.values()),
                "median distance": f"{sizes[0]:.2f} -> {sizes[1]:.2f}",
                "differs most: distance (AUC alone)": f"{worst}: {distance:.2f} ({alone:.2f})",
            }
        )
    return markdown(pd.DataFrame(rows))


def main() -> None:
    """Run all four parts and write the tables."""
    parser = make_parser(__doc__, data="folder of the radar recordings")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="times a dozen simulated units")
    options = parser.parse_args()
    quiet()  # real ones clip, and so do those made like them
    sections = {
        "Real recordings against simulated ones": judge_table(judge_all(options.data)),
        f"{options.seeds} times a dozen simulated units": units_table(options.seeds),
    }
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()

"""Sensor models fitted to half of the recordings, judged on the others.

    python studies/sensor_models.py RADAR_DATA OUT [--quick]

Four questions, none of which chooses a constant of the fit:

1. Simulated units of a known population: are means and spreads within the stated uncertainty?
2. 24 GHz module: fitted to the sessions of 2021, judged on those of 2022 (other people), and the other way round.
3. X4: fitted to one of two radars before an empty room, judged on the other, and the other way round.
4. A121: four recordings of four settings; each is fitted to its first half and judged on its second. That is no
   independent sensor and no independent scene, and flatters the fit.

The judge is the domain classifier of ``doppelgait radar compare``: ``before`` is the shipped preset, ``after`` the
fitted model. The scenes of the module are those that the recordings' read-me states (``plans/cw-people.toml``); the
others are taken as empty rooms, also where somebody sat.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from sensor_units import POPULATION, fit_units, own_score, population_scores, summary

from doppelgait import viz
from doppelgait.classify.domain import Comparison, compare_recordings, comparison_rows, plot_recording, simulate_like
from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.dataset.config import PlanConfig, load_plan
from doppelgait.radar import Radar, Recording
from doppelgait.radar.fit import fit_kind, format_kind_preset
from doppelgait.radar.readers import read_recording, read_several
from doppelgait.viz.domains import plot_domains

SEEDS = 16
PEOPLE_AT_M = 3.0
"""Middle of the ranges that the recordings' read-me states (3.2 to 7 m down to the radar)."""
COPIES = 6
"""Simulated recordings for each real one, where those are few."""


def markdown(rows: Sequence[Mapping[str, str]]) -> str:
    """Return rows as a table."""
    head = list(rows[0])
    lines = [head, ["---"] * len(head), *([row[name] for name in head] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def units_table(seeds: int) -> str:
    """Fit simulated units of a known population repeatedly; tabulate the scores."""
    means: dict[str, list[float]] = {name: [] for name in POPULATION}
    ratios: dict[str, list[float]] = {name: [] for name in POPULATION}
    covered: dict[str, list[bool]] = {name: [] for name in POPULATION}
    own: dict[str, list[float]] = {name: [] for name in ("iq_gain_db", "iq_phase_deg", "white_rad")}
    for seed in range(seeds):
        units, kind = fit_units(seed)
        for name, (score, ratio, inside) in population_scores(kind, units).items():
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
    return markdown(rows)


def judged(
    name: str, train: Sequence[Recording], test: Sequence[Recording], shipped: str, out: Path, *,
    radar: Radar | None = None, people_at_m: float | None = None, plan: tuple[PlanConfig, Path] | None = None,
    copies: int = 1,
) -> dict[str, Comparison]:  # fmt: skip
    """Fit to some recordings, compare with others, draw the page."""
    model = out / f"{name}.toml"
    model.write_text(format_kind_preset(fit_kind(train, radar=radar, people_at_m=people_at_m)), encoding="utf-8")
    scene, folder = plan if plan is not None else (None, None)
    found, pictures = {}, {"real": [plot_recording(one) for one in test[:4]]}
    for words, preset in (("before", shipped), ("after", str(model))):
        made = simulate_like(list(test) * copies, preset, plan=scene, folder=folder, seed=7)
        found[words] = compare_recordings(test, made)
        pictures[f"{words}: {Path(preset).stem}"] = [plot_recording(one) for one in made[:4]]
    title = f"{name}: {len(test)} real recordings, none used for the fit"
    page = plot_domains(pictures, comparison_rows(found), title=title)
    viz.save_figure(page, out / f"{name}.png")
    return found


def half(recording: Recording, second: bool) -> Recording:
    """Return the first or second half of a recording, in whole bursts."""
    burst = int(recording.facts.get("burst_pulses", 1))
    middle = recording.n_pulses // burst // 2 * burst
    part = recording.baseband[middle:] if second else recording.baseband[:middle]
    return recording.with_baseband(part)


def main(data: Path, out: Path, *, seeds: int, most: int | None) -> None:
    """Run all four and write one report."""
    out.mkdir(parents=True, exist_ok=True)
    found: dict[str, dict[str, Comparison]] = {}
    paths = sorted((data / "cw24_kmkim036").glob("*/*_RE.txt"))
    old = [read_recording(path) for path in paths if path.parent.name.startswith("21")][:most]
    new = [read_recording(path) for path in paths if path.parent.name.startswith("22")][:most]
    sheet, people = Radar.preset("infineon-24"), load_plan(Path(__file__).parent / "plans" / "cw-people.toml")
    for name, train, test in (("cw24-2022", old, new), ("cw24-2021", new, old)):
        found[name] = judged(
            name, train, test, "infineon-24", out, radar=sheet, people_at_m=PEOPLE_AT_M, plan=people
        )  # fmt: skip
    room = data / "x4_rf_giraffe_yin" / "rf_empty_room_two_radars_20220222_143239.mat"
    (one, other), _ = read_several([room])
    found["x4-radar-2"] = judged("x4-radar-2", [one], [other], "x4-17fps", out, copies=COPIES)
    found["x4-radar-1"] = judged("x4-radar-1", [other], [one], "x4-17fps", out, copies=COPIES)
    a121 = data / "a121_acconeer"
    settings = {
        "breathing": read_recording(a121 / "breathing-sitting.h5"),
        "presence": read_recording(a121 / "presence-default.h5", subsweep=1),
        "surface": read_recording(a121 / "surface_velocity_default.h5"),
        "reflector": read_recording(a121 / "corner-reflector.h5", subsweep=0),
    }
    for name, recording in settings.items():
        parts = (half(recording, False), half(recording, True))
        found[f"a121-{name}"] = judged(
            f"a121-{name}", [parts[0]], [parts[1]], "acconeer-a121", out, copies=COPIES
        )  # fmt: skip
    rows = []
    for name, both in found.items():
        words = {key: "{:.2f} ({:.2f} to {:.2f})".format(*one.auc) for key, one in both.items()}
        shape = {key: "{:.2f} ({:.2f} to {:.2f})".format(*one.auc_of_shape) for key, one in both.items()}
        worst, (distance, alone) = next(iter(both["after"].distances.items()))
        sizes = [np.median([d for d, _ in one.distances.values()]) for one in both.values()]
        rows.append(
            {
                "judged on": name, "AUC before": words["before"], "after": words["after"],
                "without levels, before": shape["before"], "without levels, after": shape["after"],
                "linear": " -> ".join(f"{one.auc_linear:.2f}" for one in both.values()),
                "median distance": f"{sizes[0]:.2f} -> {sizes[1]:.2f}",
                "gives it away most": f"{worst}: {distance:.2f} ({alone:.2f})",
            }
        )  # fmt: skip
    parts = [
        "# Sensor models",
        markdown(rows),
        *(f"## {name}\n\n{markdown(comparison_rows(both, 30))}" for name, both in found.items()),
        f"## {seeds} times a dozen simulated units\n\n{units_table(seeds)}",
    ]
    (out / "sensor-models.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="folder of the radar recordings")
    parser.add_argument("out", type=Path, help="folder for pages, models and the report")
    parser.add_argument("--quick", action="store_true", help="a few recordings and seeds")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", DoppelgaitWarning)  # real ones clip, and so do those made like them
    main(arguments.data, arguments.out, seeds=2 if arguments.quick else SEEDS, most=6 if arguments.quick else None)
    print((arguments.out / "sensor-models.md").read_text(encoding="utf-8"))

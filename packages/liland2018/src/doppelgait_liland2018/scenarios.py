"""Scenarios of the study, their features and class separation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait import DoppelgaitError, Streams
from doppelgait.motion import Motion
from doppelgait.motion.models import boulic_walk, human_gait, quadruped_gait, sample_person
from doppelgait.pipeline import analyze, choose_lowest_prf, simulate
from doppelgait.processing import Analysis
from doppelgait.radar import Radar, Recording
from doppelgait.scene import RcsSpec, Scene, Target
from doppelgait_liland2018.measures import travel_speed_mps

FloatArray = npt.NDArray[np.float64]


def _drop_unknown(values: npt.ArrayLike) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    return np.asarray(array[np.isfinite(array)])


def cohens_d(first: npt.ArrayLike, second: npt.ArrayLike) -> float:
    """Return Cohen's d from pooled standard deviation."""
    a, b = _drop_unknown(first), _drop_unknown(second)
    if min(a.size, b.size) < 2:
        return math.nan
    pooled = ((a.size - 1) * a.var(ddof=1) + (b.size - 1) * b.var(ddof=1)) / (a.size + b.size - 2)
    return float((a.mean() - b.mean()) / math.sqrt(pooled)) if pooled > 0 else math.nan


def roc_area(first: npt.ArrayLike, second: npt.ArrayLike) -> float:
    """Return the area under the ROC curve."""
    a, b = _drop_unknown(first), np.sort(_drop_unknown(second))
    if not a.size or not b.size:
        return math.nan
    below = np.searchsorted(b, a, side="left") + np.searchsorted(b, a, side="right")
    return float(below.sum() / (2.0 * a.size * b.size))


def tabulate_separation(table: pd.DataFrame, features: Sequence[str], *, classes: tuple[str, str]) -> pd.DataFrame:
    """Tabulate medians, Cohen's d and ROC area by method."""
    import pandas as pd

    rows = []
    for method, part in table.groupby("method", sort=False):
        for name in features:
            one, other = (part.loc[part["label"] == label, name] for label in classes)
            rows.append(
                {
                    "method": method,
                    "feature": name,
                    **{f"median {c}": v.median() for c, v in zip(classes, (one, other), strict=True)},
                    "cohens_d": cohens_d(one, other),
                    "roc_area": roc_area(one, other),
                    "unknown": int(one.isna().sum() + other.isna().sum()),
                }
            )
    return pd.DataFrame(rows)


def is_wrong(table: pd.DataFrame, share: float, *, bins: float = 0.0) -> pd.Series:
    """Mark gait frequencies that are missing or wrong."""
    error_hz = (table["gait_frequency_hz"] - table["true_gait_frequency_hz"]).abs()
    allowed_hz = np.maximum(share * table["true_gait_frequency_hz"], bins / table["observation_s"])
    return ~(error_hz <= allowed_hz) & table["true_gait_frequency_hz"].notna()


def fit_line(x: npt.ArrayLike, y: npt.ArrayLike) -> tuple[float, float]:
    """Return a robust line's slope and offset (Theil, Sen)."""
    from scipy.stats import theilslopes

    a, b = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    known = np.isfinite(a) & np.isfinite(b)
    if known.sum() < 3 or np.ptp(a[known]) == 0:
        return math.nan, math.nan
    slope = float(theilslopes(b[known], a[known])[0])
    return slope, float(np.median(b[known] - slope * a[known]))


N_PEOPLE, N_WALKERS, N_DOGS = 148, 21, 200
"""Numbers of scenarios. The report has 148 people, 21 walkers and one dog; here there are a hundred dogs."""
RCS_M2 = {"human": 1.0, "dog": 0.2}
"""Cross sections of the report's Table 3.2; the columns are normalised, so that they have no effect."""
PERSON_M = 1.8
"""Stature of people in the report."""
LONGEST_S = 5.0
SHORTEST_S = 1.0
RECORDED_M = (3.0, 6.0)
"""Length, m, of a recording room: a model is observed for the time of this distance, 1 to 5 s."""
AWAY_EVERY = 3
"""Interval of receding scenarios: every third target recedes, the others approach."""
WALKER_CYCLES = 5
RUNNER_SHARE = 0.35
GaitName = Literal["walk", "pace", "trot", "canter", "gallop", "bound"]
FROUDE: dict[GaitName, tuple[float, float, float]] = {
    "walk": (0.05, 0.5, 0.2),
    "pace": (0.1, 1.0, 0.4),
    "trot": (0.3, 2.5, 1.0),
    "canter": (1.0, 5.0, 2.0),
    "gallop": (1.2, 10.0, 4.0),
    "bound": (1.0, 6.0, 2.5),
}
"""Lowest, highest and usual Froude number of a dog's gait, as in doppelgait's models."""
DOG_GAITS = tuple(FROUDE)
REPORT_HOP_S = 0.005
"""Columns of the report's method; it takes every frame, which changes nothing that its bin of 1 / T_o shows."""
WRONG = 0.10
"""Relative error above which a step frequency counts as wrong."""

METHODS = ("liland2018", "standard")
METHOD_NAMES = {"liland2018": "the report's method", "standard": "ours"}


@dataclass(frozen=True)
class Scenario:
    """Target that moves straight towards or away from radar."""

    group: str
    label: str
    name: str
    motion: Motion
    seconds: float
    away: bool = False


def make_scenarios(
    people: Mapping[str, Motion],
    dogs: Mapping[str, Motion],
    *,
    seed: int,
    counts: tuple[int, int, int] = (N_PEOPLE, N_WALKERS, N_DOGS),
) -> list[Scenario]:
    """Make the scenarios of the study."""
    n_people, n_walkers, n_dogs = counts
    found = [_make_recorded_scenario("human", name, motion) for name, motion in list(people.items())[:n_people]]
    found += [_sample_person(seed, number) for number in range(n_people - len(found))]
    for speed_mps in np.linspace(0.5, 2.5, n_walkers):
        motion = boulic_walk(speed_mps=float(speed_mps), height_m=PERSON_M, duration_s=20.0)
        seconds = WALKER_CYCLES / motion.facts.stride_frequency_hz
        found.append(Scenario("Boulic walker", "human", f"Boulic walker {speed_mps:.1f} m/s", motion, seconds))
    recorded = [_make_recorded_scenario("dog", name, motion) for name, motion in list(dogs.items())[:n_dogs]]
    found += recorded + [_sample_dog(seed, number) for number in range(n_dogs - len(recorded))]
    return [replace(one, away=number % AWAY_EVERY == AWAY_EVERY - 1) for number, one in enumerate(found)]


def _make_recorded_scenario(label: str, name: str, motion: Motion) -> Scenario:
    seconds = min(float(np.ptp(motion.time_s)), LONGEST_S)
    return Scenario(f"recorded {'person' if label == 'human' else 'dog'}", label, name, motion, seconds)


def _sample_person(seed: int, number: int) -> Scenario:
    """Sample a person who walks or runs."""
    rng = Streams(seed, number).generator("motion", "person")
    person = sample_person(rng)
    runs = rng.random() < RUNNER_SHARE
    low, high = (2.3, 4.5) if runs else (0.7 * person.speed_mps, min(1.4 * person.speed_mps, 1.9))
    speed_mps = float(rng.uniform(low, high))
    seconds = _sample_seconds(speed_mps, rng)
    motion = human_gait(
        gait="run" if runs else "walk",
        speed_mps=speed_mps,
        height_m=person.height_m,
        walk_ratio=float(np.clip(person.walk_ratio, 0.7, 1.4)),
        step_time_sd=0.02,
        step_length_sd=0.02,
        start_phase=float(rng.random()),
        duration_s=seconds + 0.1,
        rng=rng,
    )
    return Scenario("model person", "human", f"person {number}", motion, seconds)


def _sample_dog(seed: int, number: int) -> Scenario:
    """Sample a dog of 0.25 to 0.65 m per gait."""
    rng = Streams(seed, number).generator("motion", "dog")
    gait = DOG_GAITS[number % len(DOG_GAITS)]
    slowest, fastest, usual = FROUDE[gait]
    low, high = math.sqrt(slowest * usual), math.sqrt(usual * fastest)
    withers_m, froude = float(rng.uniform(0.25, 0.65)), float(rng.uniform(low, high))
    speed_mps = math.sqrt(froude * 9.81 * (0.8 * withers_m))  # the hip stands at 0.8 of the withers
    seconds = _sample_seconds(speed_mps, rng)
    motion = quadruped_gait(
        gait=gait,
        speed_mps=speed_mps,
        withers_m=withers_m,
        stride_variation=0.02,
        start_phase=float(rng.random()),
        duration_s=seconds + 0.1,
        rng=rng,
    )
    return Scenario("model dog", "dog", f"{gait} {number}", motion, seconds)


def _sample_seconds(speed_mps: float, rng: np.random.Generator) -> float:
    return float(np.clip(rng.uniform(*RECORDED_M) / speed_mps, SHORTEST_S, LONGEST_S))


def observe(scenario: Scenario, radar: Radar) -> Recording:
    """Simulate a scenario without noise."""
    height_m = PERSON_M if scenario.group == "recorded person" else None
    target = Target(
        scenario.motion,
        label=scenario.label,
        rcs=RcsSpec(kind="equal", total_m2=RCS_M2[scenario.label]),
        height_m=height_m,
        aspect_deg=180.0 if scenario.away else 0.0,
    )
    scene = Scene([target], duration_s=scenario.seconds)
    way_m = travel_speed_mps(scenario.motion) * scenario.seconds * (1.0 if height_m is None else 1.5)
    framed = radar.model_copy(update={"range_stop_m": math.ceil(max(5.0 + way_m / 2, way_m + 2.0) + 3.0)})
    return simulate(scene, choose_lowest_prf(scene, framed, cpi_s=0.1), angles=False)


def run_study(
    scenarios: Sequence[Scenario], radar: Radar, *, on_progress: Callable[[int, int], None] | None = None
) -> pd.DataFrame:
    """Measure the features of every scenario by both methods."""
    import pandas as pd

    rows: list[dict[str, Any]] = []
    left_out: dict[str, str] = {}
    for number, scenario in enumerate(scenarios):
        try:
            recording = observe(scenario, radar)
            truth, prf_hz = recording.truth[0], recording.radar.prf_hz
            facts = {
                "number": number,
                "group": scenario.group,
                "label": scenario.label,
                "motion": scenario.name,
                "gait": truth.gait,
                "away": scenario.away,
                "observation_s": scenario.seconds,
                "prf_hz": prf_hz,
                "true_velocity_mps": float(truth.centre_velocity_mps.mean()),
                "true_gait_frequency_hz": truth.gait_frequency_hz,
            }
            report = Analysis(method="liland2018", hop=max(1, round(REPORT_HOP_S * prf_hz)))
            both = []
            for method, analysis in zip(METHODS, (report, Analysis(extended=False)), strict=True):
                result = analyze(recording, gate="truth", analysis=analysis)[0]
                numbers = {"gait_frequency_hz": result.gait_frequency_hz, **result.features.as_dict()}
                known = {name: math.nan if value is None else value for name, value in numbers.items()}
                both.append({**facts, "method": method, **known, "flagged": "low_confidence" in result.flags})
            rows += both  # keep a scenario only if both methods succeed
        except DoppelgaitError as error:
            left_out[scenario.name] = str(error)
        if on_progress is not None:
            on_progress(number + 1, len(scenarios))
    table = pd.DataFrame(rows)
    table.attrs["left_out"] = left_out
    return table

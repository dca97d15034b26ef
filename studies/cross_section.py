"""Radar cross sections by part and aspect, and their effect on features.

    python studies/cross_section.py --page

Question: how do the cross sections of people, dogs and cats depend on aspect and part, and do v_m and rho depend on
the kind of cross section?

Cross section: the sum over the scatterers of surfaces with and without occlusion and the share of the trunk, every 5
degrees all round, in the mean over one gait cycle, dBsm, of an unscaled total of 0.01 m^2/kg. v_m and rho: dogs and
cats in three gaits and walking people, 0 to 45 degrees off the line of sight, approaching and receding, 3 s, SNR 20 dB
in the true gate, through each kind of cross section. The error of v_m is relative to the mean radial velocity of the
body's centre. It takes about 2 minutes of one core.

Not shown: measured cross sections of body parts, of which none are published.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from harness import finish, make_parser, quiet, run_jobs

from doppelgait.core.rng import Streams
from doppelgait.motion.models import human_gait, quadruped_gait
from doppelgait.motion.models.quadruped_gaits import GAITS
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.pipeline import analyze, simulate
from doppelgait.pipeline.radar_table import Conditions
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target, assemble
from doppelgait.scene.rcs import RcsSpec

FAR_M = 1000.0
SECONDS = 3.0
STEP_DEG = 5.0
KINDS = ("equal", "body_parts", "surfaces")
ASPECTS_DEG = (0.0, 25.0, 45.0, 180.0, 155.0, 135.0)
GAITS_SHOWN = ("walk", "trot", "gallop")
SNR_DB = 20.0
TOO_LOW = 0.9
ANIMALS = {"dog": ("standard", 0.5), "cat": ("cat", 0.25)}
TRUNKS = ("torso", "trunk")

Make = Callable[[np.random.Generator], Motion]


def animal(name: str, gait: str) -> Make:
    """Return the maker of an animal at a speed within its gait."""
    build, withers_m = ANIMALS[name]

    def make(rng: np.random.Generator) -> Motion:
        low, high = (math.sqrt(froude * 9.81 * 0.8 * withers_m) for froude in GAITS[gait].froude[:2])
        speed_mps = float(rng.uniform(max(low, 0.4) + 0.1 * (high - low), high - 0.3 * (high - low)))
        return quadruped_gait(
            gait=gait, build=build, withers_m=withers_m, speed_mps=speed_mps, stride_variation=0.02,
            start_phase=float(rng.random()), duration_s=SECONDS + 0.2, rng=rng,
        )  # fmt: skip

    return make


def walker(rng: np.random.Generator) -> Motion:
    """Make a walking person at a speed that is drawn."""
    return human_gait(
        gait="walk", speed_mps=float(rng.uniform(0.8, 1.6)), start_phase=float(rng.random()), step_time_sd=0.02,
        step_length_sd=0.03, duration_s=SECONDS + 0.2, rng=rng,
    )  # fmt: skip


def seen_m2(motion: Motion, aspect_deg: float, *, occlusion: bool) -> dict[str, float]:
    """Return the mean cross section over a gait cycle, by body part."""
    centre_m = float(np.median(motion.position_m[:, [p in TRUNKS for p in motion.parts], 2]))
    stride_s = 1.0 / motion.facts.stride_frequency_hz
    target = Target(motion, rcs=RcsSpec(kind="surfaces", occlusion=occlusion), range_m=FAR_M, aspect_deg=aspect_deg)
    scene, times_s = Scene([target], radar_position_m=(0.0, 0.0, centre_m)), np.arange(32) / 32 * stride_s
    table = assemble(scene, times_s, angles=False, wavelength_m=Radar.preset("x4").wavelength_m)
    mean = (table["rcs"] * table["path_gain"]).mean("slow_time")
    return mean.groupby("part").sum().to_series().to_dict()


def aspect_table(bodies: dict[str, Motion]) -> pd.DataFrame:
    """Tabulate mean and spread over aspect, dBsm, and the trunk's part."""
    aspects = np.arange(0.0, 360.0, STEP_DEG)
    rows = []
    for name, motion in bodies.items():
        for occlusion in (False, True):
            parts = pd.DataFrame([seen_m2(motion, aspect, occlusion=occlusion) for aspect in aspects]).fillna(0.0)
            total, trunk = parts.sum(axis=1).to_numpy(), parts[[p for p in parts if p in TRUNKS]].sum(axis=1).to_numpy()
            limbs = {"legs": ("thigh", "shank", "foot", "upper", "lower", "paw"), "head, neck": ("head", "neck")}
            shares = {
                what: parts[[p for p in parts if any(word in p for word in words) and "arm" not in p]].to_numpy().sum()
                for what, words in limbs.items()
            }
            at = {angle: int(angle / STEP_DEG) for angle in (0, 90, 180)}
            level_db = 10.0 * np.log10(total)
            rows.append({
                "target": name, "kg": round(motion.facts.mass_kg, 1), "occlusion": "yes" if occlusion else "no",
                "mean": round(10.0 * math.log10(total.mean()), 1), "least": round(level_db.min(), 1),
                "most": round(level_db.max(), 1), "sd dB": round(level_db.std(), 1),
                **{f"{angle} deg": round(level_db[n], 1) for angle, n in at.items()},
                **{f"trunk % {angle} deg": round(100 * trunk[n] / total[n]) for angle, n in at.items()},
                "trunk %": round(100 * trunk.sum() / total.sum()),
                **{f"{what} %": round(100 * share / total.sum()) for what, share in shares.items()},
            })  # fmt: skip
    return pd.DataFrame(rows)


def measured(make: Make, label: str, rcs: RcsSpec, aspect_deg: float, seed: int) -> dict[str, Any]:
    """Simulate one target and measure it in its true gate."""
    motion = make(np.random.default_rng(seed))
    middle_m = 4.0 + travel_speed_mps(motion) * SECONDS / 2.0
    target = Target(motion, label=label, rcs=rcs, range_m=middle_m, aspect_deg=aspect_deg)
    radar = Radar.preset("x4-long", range_stop_m=2.0 * middle_m)
    noisy = Conditions(noise={"kind": "snr", "snr_db": SNR_DB})
    scene = Scene([target], radar_position_m=(0.0, 0.0, 1.0 if label == "human" else 0.5), duration_s=SECONDS)
    recording = simulate(scene, radar, conditions=noisy, rng=Streams(seed), angles=False)
    features = analyze(recording, gate="truth")[0].features
    truth_mps = float(recording.truth[0].centre_velocity_mps.mean())
    found_mps = features.torso_velocity_mps
    ratio = math.nan if found_mps is None else found_mps / truth_mps
    return {"ratio": ratio, "rho": features.limb_torso_ratio}


def run_target(job: tuple[str, str, str, float, int]) -> list[dict[str, Any]]:
    """Measure one target through one kind of cross section."""
    quiet()
    name, gait, kind, aspect_deg, seed = job
    make, label = (walker, "human") if name == "human" else (animal(name, gait), "dog")
    rcs = RcsSpec(kind=kind, occlusion=kind == "surfaces")
    found = measured(make, label, rcs, aspect_deg, seed)
    return [{"target": name, "gait": gait, "kind": kind, "aspect": aspect_deg, **found}]


def velocity_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate v_m over truth: bias, scatter, shares off by a tenth."""
    found = []
    for (kind, name, gait), cell in rows.groupby(["kind", "target", "gait"], sort=False):
        ratio = cell["ratio"].astype(float).dropna()
        found.append({
            "kind": kind, "target": name, "gait": gait, "n": len(cell), "missing": int(cell["ratio"].isna().sum()),
            "median %": round(100 * (ratio.median() - 1), 1), "mean %": round(100 * (ratio.mean() - 1), 1),
            "> 10 % low": f"{100 * (ratio < TOO_LOW).mean():.0f} %",
            "within 10 %": f"{100 * ((ratio - 1).abs() <= 1 - TOO_LOW).mean():.0f} %",
        })  # fmt: skip
    return pd.DataFrame(found)


def rho_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate median and quartiles of rho by kind of cross section."""
    quartiles = rows.assign(rho=rows["rho"].astype(float)).groupby(["target", "gait", "kind"], sort=False)["rho"]
    text = quartiles.apply(lambda v: "{1:.2f} ({0:.2f}-{2:.2f})".format(*v.quantile([0.25, 0.5, 0.75])))
    return text.unstack("kind")[list(KINDS)].reset_index()


def main() -> None:
    """Run the study and write its tables."""
    parser = make_parser(__doc__)
    parser.add_argument("--trials", type=int, default=4, help="targets of every gait at every aspect")
    options = parser.parse_args()
    rng = np.random.default_rng(1)
    bodies = {"person": walker(rng), "dog": animal("dog", "walk")(rng), "cat": animal("cat", "walk")(rng)}
    targets = [("human", "walk"), *product(ANIMALS, GAITS_SHOWN)]
    jobs = [(*target, *rest) for target, *rest in product(targets, KINDS, ASPECTS_DEG, range(options.trials))]
    rows = pd.DataFrame(run_jobs(run_target, jobs, rows=options.rows, processes=options.processes))
    sections = {
        "Cross section by aspect": aspect_table(bodies),
        "v_m over the truth": velocity_table(rows),
        "rho: median (quartiles)": rho_table(rows),
    }
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()

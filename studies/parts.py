"""Energy of torso, legs and arms that is assigned to the right part.

    python studies/parts.py --mocap MOTION_FOLDER --page

Question: which share of a body's energy does `parts` assign to the right part of the body?

Every example is one walking or running person or one dog in one of five gaits, of points or of surfaces, seen for
2.4 s at 5 m by the preset `x4-long` in its true gate. The scatterers of torso (with head, neck, trunk and tail), legs
and arms (of dogs: legs only) are simulated alone with the same motion; the mask that is located in their sum, with
noise where there is any, is then applied to each alone. Baselines: everything is torso, and a fixed band of Doppler
around the torso line. Constants were chosen on seeds 100 to 111 (`--tune` prints the grid); the tables are of seeds
from 300 on. SNR is SNR_mu: the median over time of the strongest clean cell over the mean noise floor. It takes about
3 minutes of one core.

Not shown: several bodies in one gate, and tracked gates.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from harness import finish, make_parser, quiet, run_jobs

import doppelgait.processing.parts as parts_module
from doppelgait.core.errors import DoppelgaitError
from doppelgait.core.frames import Frames
from doppelgait.core.labels import SIGNATURE, Signal, read_axis
from doppelgait.core.units import slow_time_axis_s
from doppelgait.motion.models import human_gait, quadruped_gait, sample_person
from doppelgait.motion.models.quadruped_gaits import BUILDS, GAITS, froude_speed_mps, hip_height_m
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers import read
from doppelgait.motion.segments import crop, find_segments
from doppelgait.processing import Analysis, Gate, choose_line_order, main_line_hz, signature
from doppelgait.processing.parts import locate_parts, measure_parts
from doppelgait.radar import Radar, synthesise
from doppelgait.scene import Scene, Target, assemble, compute_body_track, place
from doppelgait.scene.rcs import RcsSpec

RADAR = Radar.preset("x4-long", range_start_m=1.0, range_stop_m=9.5)
ANALYSIS = Analysis(hop=24)
"""Three times coarser than lossless: a third of the time, and the shares are the same."""
SECONDS = 2.4
TUNING, REPORTED = range(100, 112), 300
FIXED_MPS = 0.35
"""Half of the fixed band of the baseline; the best of the tuning grid."""
ASPECTS_DEG = (0.0, 30.0, 60.0, 75.0, 90.0, 180.0)
SNRS_DB = (math.inf, 20.0, 10.0, 5.0, 0.0)
DOG_GAITS = ("walk", "pace", "trot", "canter", "gallop")
BODIES = tuple(itertools.product(("person", "dog"), ("body_parts", "surfaces")))
TRUNK = {"torso", "head", "trunk", "neck", "tail"}
GRID = {"SWAY_SHARE": (0.13, 0.19, 0.25), "SWAY_CELLS": (0.4, 0.7, 1.0), "LENGTH_EXTENTS": (2.5, 3.25, 4.0)}


@dataclass(frozen=True)
class Body:
    """Echoes of a body's torso, legs and arms, each alone."""

    echoes: tuple[xr.DataArray, xr.DataArray, xr.DataArray]
    gate: Gate
    speed_mps: float

    @property
    def whole(self) -> xr.DataArray:
        """Echo of the whole body."""
        return self.echoes[0].copy(data=sum(echo.values for echo in self.echoes))

    def view(self, echo: xr.DataArray) -> xr.DataArray:
        """Return the signature of an echo in the body's gate."""
        return signature(echo, self.gate, ANALYSIS, wavelength_m=RADAR.wavelength_m)


def draw_motion(kind: str, seed: int) -> Motion:
    """Draw a walking or running person, or a dog."""
    rng = np.random.default_rng(seed)
    common: dict[str, Any] = {"duration_s": SECONDS + 0.1, "rng": rng}
    if kind == "dog":
        gait: Any = DOG_GAITS[seed % len(DOG_GAITS)]
        slowest, fastest, usual = GAITS[gait].froude
        froude = rng.uniform(math.sqrt(slowest * usual), math.sqrt(usual * fastest))
        withers_m = rng.uniform(0.3, 0.7)
        speed_mps = min(froude_speed_mps(froude, hip_height_m(BUILDS["standard"], withers_m)), 3.0)
        return quadruped_gait(
            gait=gait, speed_mps=speed_mps, withers_m=withers_m, stride_variation=0.02,
            start_phase=float(rng.random()), **common,
        )  # fmt: skip
    person, runs = sample_person(rng), rng.random() < 0.25
    return human_gait(
        gait="run" if runs else "walk", speed_mps=rng.uniform(2.2, 3.2) if runs else rng.uniform(0.6, 1.8),
        height_m=person.height_m, start_phase=float(rng.random()), step_time_sd=0.02, step_length_sd=0.02, **common,
    )  # fmt: skip


def part_number(part: str) -> int:
    """Return 0 for the torso, 1 for legs and 2 for arms."""
    name = part.removeprefix("left_").removeprefix("right_")
    if name in TRUNK:
        return 0
    return 1 if name in ("thigh", "shank", "foot") or name.startswith(("hind", "fore_")) else 2


def observe(motion: Motion, aspect_deg: float, rcs: str, seed: int, seconds: float = SECONDS) -> Body:
    """Simulate the echoes of a body's parts, each alone."""
    target = Target(motion, rcs=RcsSpec(kind=rcs), range_m=5.0, aspect_deg=aspect_deg)  # type: ignore[arg-type]
    placed = place(Scene([target], duration_s=seconds))
    time_s = slow_time_axis_s(int(seconds * RADAR.prf_hz), RADAR.prf_hz)
    table = assemble(placed, time_s, angles=False, wavelength_m=RADAR.wavelength_m, rng=np.random.default_rng(seed))
    numbers = np.array([part_number(str(part)) for part in table["part"].values])
    track = compute_body_track(placed.observed[0], placed.scene, time_s)
    none = synthesise(table.isel(scatterer=[0]), RADAR) * 0.0
    echoes = [
        synthesise(table.isel(scatterer=np.flatnonzero(numbers == n)), RADAR) if (numbers == n).any() else none
        for n in range(3)
    ]
    gate = Gate(time_s, track.range_m, ANALYSIS.gate_span_m, None, "truth")
    return Body((echoes[0], echoes[1], echoes[2]), gate, float(track.radial_velocity_mps.mean()))


def score(body: Body, snr_db: float, seed: int) -> dict[str, Any]:
    """Score the parts of a body: shares of its energy."""
    heard, clean = body.whole, body.view(body.whole)
    if math.isfinite(snr_db):
        rng = np.random.default_rng([seed, 5])
        floor_v2 = float(np.median(clean.values.max(axis=1))) / 10 ** (snr_db / 10)
        sd_v = math.sqrt(floor_v2 / clean.attrs["window_energy"] / clean.attrs["n_gate_bins"] / 2)
        noise = rng.standard_normal(heard.shape) + 1j * rng.standard_normal(heard.shape)
        heard = heard.copy(data=(heard.values + sd_v * noise).astype(np.complex64))
    mu = body.view(heard)
    true_v2 = np.stack([body.view(echo).values for echo in body.echoes]).astype(np.float64)
    energy = true_v2.sum(axis=(1, 2))
    line_hz = main_line_hz(mu, order=choose_line_order(SECONDS))
    half_hz = FIXED_MPS * 2.0 / RADAR.wavelength_m
    near = np.abs(read_axis(mu, "doppler")[None, :] - line_hz[:, None]) < half_hz
    banded = true_v2[0][near].sum() + true_v2[1:, ~near].sum()
    line_mps = float(np.median(line_hz)) * RADAR.wavelength_m / 2.0
    row = {
        "all torso": energy[0] / energy.sum(), "fixed band": banded / energy.sum(),
        "speed_cells": abs(line_mps) / (RADAR.wavelength_m / 2.0 / ANALYSIS.cpi_s),
        "true_share": energy[0] / energy.sum(), "line_error_mps": abs(line_mps - body.speed_mps),
    }  # fmt: skip
    mask, reason = locate_parts(Frames.of(heard), Signal.of(mu, SIGNATURE), body.gate, ANALYSIS)
    if mask is None:
        return {**row, "reason": reason}
    quiet = replace(mask, floor_v2=0.0)
    wavelength_m = RADAR.wavelength_m
    found = np.stack(
        [
            quiet.power_v2(Frames.of(echo), ANALYSIS, wavelength_m=wavelength_m).values.sum(
                axis=(1, 2), dtype=np.float64
            )
            for echo in body.echoes
        ],
        axis=1,
    )  # assigned part, true part
    measured = measure_parts(mask.power_v2(Frames.of(heard), ANALYSIS, wavelength_m=wavelength_m).label())
    torso_mps = float(np.nanmedian(measured["velocity_mps"].values[0]))
    return {
        **row, "reason": "",
        "right": (found[0, 0] + found[1:, 1:].sum()) / energy.sum(),
        "three parts": (found[0, 0] + found[1:, 1].sum()) / energy.sum(),
        "legs are legs": found[1, 1] / found[1].sum(), "of all legs": found[1, 1] / energy[1],
        "share_error": float(measured["share"].values[0]) - energy[0] / energy.sum(),
        "torso_error_mps": abs(torso_mps - body.speed_mps), "length_m": mask.length_m,
    }  # fmt: skip


def summarise(rows: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Average what was determined, and count the rest."""
    shown = [
        "all torso", "fixed band", "right", "three parts", "legs are legs", "of all legs", "share_error",
    ]  # fmt: skip
    known = rows[rows["reason"] == ""]
    every = rows.assign(none=rows["reason"] != "").groupby(list(by), sort=False)["none"]
    counts = pd.DataFrame({"n": every.size(), "none": every.sum()})
    return counts.join(known.groupby(list(by))[shown].mean().round(2)).reset_index()


def score_recorded(mocap: str) -> list[dict[str, Any]]:
    """Score recorded people and dogs whose parts are known."""
    quiet()
    rows = []
    for kind, folder in (("person", "human"), ("dog", "dog")):
        for file in sorted(path for path in (Path(mocap) / folder).rglob("*") if path.is_file()):
            try:
                motion = read(file)
                for segment in find_segments(motion)[:2]:
                    clip = crop(motion, segment)
                    seconds = min(SECONDS, clip.duration_s)
                    if seconds < 1.5 or not {part_number(part) for part in clip.parts if part} >= {0, 1}:
                        continue
                    if any(not part for part in clip.parts):
                        continue
                    body = observe(clip, 0.0, "body_parts", 0, seconds=math.floor(seconds * 50) / 50 - 0.02)
                    rows.append({"body": kind, "scatterers": "recorded", **score(body, math.inf, 0)})
            except DoppelgaitError:
                continue
    return rows


def tune() -> None:
    """Print the mean share that is right over the grid."""
    global FIXED_MPS
    bodies = [
        [observe(draw_motion(kind, seed), (0.0, 30.0, 180.0)[seed % 3], rcs, seed) for seed in TUNING]
        for kind, rcs in BODIES
    ]
    for fixed_mps in (0.25, 0.3, 0.35, 0.4, 0.5):
        FIXED_MPS = fixed_mps
        means = [np.mean([score(body, math.inf, 0)["fixed band"] for body in group]) for group in bodies]
        print(f"fixed band {fixed_mps}: {np.mean(means):.3f}", np.round(means, 3))
    for values in itertools.product(*GRID.values()):
        for name, value in zip(GRID, values, strict=True):
            setattr(parts_module, name, value)
        means = [
            np.mean([row["right"] for body in group if not (row := score(body, math.inf, 0))["reason"]])
            for group in bodies
        ]
        print(dict(zip(GRID, values, strict=True)), f"{np.mean(means):.3f}", np.round(means, 3))


def draw_picture(path: Path) -> None:
    """Plot signature, estimated and true parts of two bodies."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    from doppelgait.viz import save_figure
    from doppelgait.viz.style import BLUE, TIME_LABEL, VERMILLION, YELLOW, make_figure, name_axes

    colours = ListedColormap([BLUE, VERMILLION, YELLOW])
    figure = make_figure(width_in=11.0, height_in=6.4)
    rows = figure.subplots(2, 3, sharex=True, sharey="row")
    for (kind, seed), axes in zip((("person", 301), ("dog", 302)), rows, strict=True):
        body = observe(draw_motion(kind, seed), 0.0, "surfaces", seed)
        mu = body.view(body.whole)
        mask, reason = locate_parts(Frames.of(body.whole), Signal.of(mu, SIGNATURE), body.gate, ANALYSIS)
        if mask is None:
            raise DoppelgaitError(f"no parts: {reason}")
        found = measure_parts(mask.power_v2(Frames.of(body.whole), ANALYSIS, wavelength_m=RADAR.wavelength_m).label())
        time_s, speed_mps = read_axis(mu, "time"), read_axis(mu, "velocity")
        level_db = 10 * np.log10(mu.values / mu.values.max(axis=1, keepdims=True) + 1e-9)
        true_v2 = np.stack([body.view(echo).values for echo in body.echoes])
        shown = level_db > -30
        middle, reach = float(np.median(mask.torso_mps)), 2.6 * abs(mask.middle_mps)
        labels = (np.where(shown, found["label"].values, np.nan), np.where(shown, true_v2.argmax(axis=0), np.nan))
        image = axes[0].pcolormesh(time_s, speed_mps, level_db.T, vmin=-40, vmax=0, cmap="Greys", rasterized=True)
        for panel, label in zip(axes[1:], labels, strict=True):
            panel.pcolormesh(time_s, speed_mps, label.T, vmin=-0.5, vmax=2.5, cmap=colours, rasterized=True)
        axes[0].set_ylim(middle - reach, middle + reach)
        for panel, title in zip(axes, ("signature", "estimated parts", "true parts"), strict=True):
            name_axes(panel, title=f"{kind}: {title}", x=TIME_LABEL, y="radial velocity (m/s)")
            panel.label_outer()
    figure.colorbar(image, ax=rows[:, 0], location="left", aspect=40).set_label("power (dB re maximum of the column)")
    names = ("torso", "legs", "arms (estimated: arms and slow parts of legs)")
    handles = [Patch(color=colours(n), label=name) for n, name in enumerate(names)]
    figure.legend(handles=handles, ncols=3, loc="outside lower center", frameon=False)
    save_figure(figure, path)


def score_body(job: tuple[str, str, int, float]) -> list[dict[str, Any]]:
    """Score one body at one aspect, head-on at every level of noise."""
    quiet()
    kind, rcs, seed, aspect_deg = job
    body = observe(draw_motion(kind, seed), aspect_deg, rcs, seed)
    facts = {"body": kind, "scatterers": rcs, "aspect_deg": aspect_deg}
    return [{**facts, "snr_db": n, **score(body, n, seed)} for n in (SNRS_DB if aspect_deg == 0 else SNRS_DB[:1])]


def main() -> object:
    """Write the tables."""
    parser = make_parser(__doc__)
    parser.add_argument("--seeds", type=int, default=10, help="examples of every row")
    parser.add_argument("--tune", action="store_true", help="print the grid of the constants instead")
    parser.add_argument("--mocap", type=Path, help="folder with human/ and dog/ recordings")
    parser.add_argument("--picture", type=Path, help="plot a person and a dog into this file instead")
    options = parser.parse_args()
    if options.tune or options.picture:
        quiet()
        return draw_picture(options.picture) if options.picture else tune()
    jobs = [(*b, REPORTED + n, a) for b, n, a in itertools.product(BODIES, range(options.seeds), ASPECTS_DEG)]
    table = pd.DataFrame(run_jobs(score_body, jobs, rows=options.rows, processes=options.processes))
    clean = table[np.isinf(table["snr_db"])]
    known = clean[clean["reason"] == ""]
    errors = known.groupby(["body", "scatterers"], sort=False)[["line_error_mps", "torso_error_mps"]].median()
    sections = {
        "Aspects, no noise": summarise(clean, ("body", "scatterers", "aspect_deg")),
        "Noise, 0 degrees": summarise(table[table["aspect_deg"] == 0], ("body", "scatterers", "snr_db")),
        "Torso velocity: median error of the main line and of the torso part, no noise": errors.reset_index(),
    }
    if options.mocap:
        recorded = run_jobs(score_recorded, [str(options.mocap)], rows=options.rows)
        sections["Recorded, 0 degrees, no noise"] = summarise(pd.DataFrame(recorded), ("body", "scatterers"))
    return finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()

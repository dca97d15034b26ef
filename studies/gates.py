"""Track gates compared with true gates: features and energy.

    python studies/gates.py --page

Question: what do features lose if the gate follows a track instead of the truth?

Every run samples its target with its own seed: five gaits, presets `x4` and `x4-long`, 0 to 45 degrees. Static clutter
lies 20 dB above the mean echo. SNR_frame is the mean power of the strongest bin over that of the noise. The truth is
used only to judge. "Only the gate differs" compares with a true gate of the same time and data; "whole chains" compares
clutter and track with a truth gate without clutter. It takes about 9 minutes of one core.

Not shown: several bodies in one gate, and recordings of real radars.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from harness import finish, make_parser, quiet, run_jobs
from tracking import SCENES, Truth, truth_of

from doppelgait.core.frames import Frames
from doppelgait.core.labels import read_axis
from doppelgait.motion.models import quadruped_gait
from doppelgait.motion.models.human import human_gait
from doppelgait.motion.motion import Motion
from doppelgait.motion.retime import travel_speed_mps
from doppelgait.pipeline import Result, analyze, simulate
from doppelgait.pipeline.target import analyze_gated
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.clutter import clean_frames
from doppelgait.processing.common_phase import remove_common_phase
from doppelgait.processing.detect import Detector, find_scans
from doppelgait.processing.track import Track, track
from doppelgait.radar import Radar
from doppelgait.radar.recording import Recording
from doppelgait.radar.simulate import synthesise
from doppelgait.scene import Scene, Target

SEED = 7300
SPAN_M = 1.6
CLUTTER_OVER_ECHO_DB = 20.0
X4, X4_LONG = Radar.preset("x4"), Radar.preset("x4-long")
FloatArray = npt.NDArray[np.float64]
Rng = np.random.Generator
MODELS: dict[str, tuple[Callable[..., Motion], dict[str, object]]] = {
    "person walks": (human_gait, {"gait": "walk", "speed_mps": (0.8, 1.6), "height_m": (1.55, 1.95)}),
    "person runs": (human_gait, {"gait": "run", "speed_mps": (2.4, 3.4), "height_m": (1.55, 1.95)}),
    "dog walks": (quadruped_gait, {"gait": "walk", "froude": (0.15, 0.3), "withers_m": (0.35, 0.65)}),
    "dog trots": (quadruped_gait, {"gait": "trot", "froude": (0.5, 1.0), "withers_m": (0.35, 0.65)}),
    "dog gallops": (quadruped_gait, {"gait": "canter", "froude": (1.5, 2.2), "withers_m": (0.35, 0.65)}),
}  # fmt: skip


def complex_noise(rng: Rng, shape: tuple[int, ...], power_v2: float) -> npt.NDArray[np.complex64]:
    """Sample circular white noise."""
    parts = rng.standard_normal((2, *shape), dtype=np.float32) * np.float32(np.sqrt(power_v2 / 2.0))
    return np.asarray(parts[0] + 1j * parts[1], dtype=np.complex64)


def make_motion(kind: str, rng: Rng, seconds: float) -> Motion:
    """Sample a motion of one kind."""
    model, options = MODELS[kind]
    sampled = {name: rng.uniform(*v) if isinstance(v, tuple) else v for name, v in options.items()}
    return model(**sampled, duration_s=seconds)


def walk_past(kind: str, radar: Radar, aspect_deg: float, rng: Rng) -> Recording:
    """Simulate one approaching target without noise. For as long as the frame holds it, 8 s at most."""
    motion = make_motion(kind, rng, 9.0)
    speed_mps = travel_speed_mps(motion)
    first_m = radar.range_stop_m - 1.2
    depth_m = (first_m - 1.8) / max(np.cos(np.deg2rad(aspect_deg)), 0.3)
    seconds = float(min(8.0 if radar is X4_LONG else 5.0, depth_m / speed_mps))
    target = Target(motion, label="target", start_position_m=(min(first_m, 1.8 + speed_mps * seconds + 0.5), 0.0),
                    heading_deg=180.0 - aspect_deg)  # fmt: skip
    return simulate(Scene([target], duration_s=seconds), radar, angles=False)


def spoilt(
    baseband: xr.DataArray, level_db: float, rng: Rng, clutter_db: float | None = CLUTTER_OVER_ECHO_DB
) -> xr.DataArray:
    """Add white noise at SNR_frame and static clutter in every bin."""
    echo_v2 = float((np.abs(baseband.values) ** 2).max(axis=1).mean())
    values = baseband.values + complex_noise(rng, baseband.shape, echo_v2 / 10 ** (level_db / 10))
    if clutter_db is not None:
        values = values + complex_noise(rng, baseband.shape[1:], echo_v2 * 10 ** (clutter_db / 10))
    return baseband.copy(data=values.astype(np.complex64))


def tracks_in(baseband: xr.DataArray, radar: Radar, detector: Detector | None = None) -> list[Track]:
    """Track with the defaults."""
    scans = find_scans(baseband, detector, wavelength_m=radar.wavelength_m)
    return track(scans, velocity_span_mps=radar.wavelength_m * radar.prf_hz / 2)


# Features ---------------------------------------------------------------------------------------------------------

NAMES = (
    "torso_velocity_mps", "doppler_bandwidth_hz", "step_length_m", "harmonic_ratio_2", "harmonic_ratio_3",
    "limb_torso_ratio", "gait_frequency_hz",
)  # fmt: skip
SIGNS = ("v_m", "B_mu", "L_m", "beta_1", "beta_2", "rho", "f_mu")
ASPECTS_DEG = (0.0, 15.0, 30.0, 45.0)
LEVELS_DB = (30.0, 20.0, 10.0)
ENERGY_DB = (20.0, 10.0)
ENERGY_SCENES = ("one walker", "crossing", "person + dog", "stop and turn", "stop and go")


def seven(result: Result | None) -> FloatArray:
    """Return the six features and the gait frequency, NaN for null."""
    if result is None:
        return np.full(len(NAMES), np.nan)
    features = [getattr(result.features, name) for name in NAMES[:-1]]
    return np.array([np.nan if v is None else v for v in [*features, result.gait_frequency_hz]], dtype=float)


def compare_gates(job: tuple[int, str, float, int]) -> list[dict[str, Any]]:
    """Compare the track gate with true gates: of the same time and data, and without clutter."""
    quiet()
    radar_number, kind, aspect_deg, draw = job
    radar = (X4, X4_LONG)[radar_number]
    rng = np.random.default_rng([SEED, 1, radar_number, list(MODELS).index(kind), int(aspect_deg), draw])
    recording, rows = walk_past(kind, radar, aspect_deg, rng), []
    for level_db in LEVELS_DB:
        state = rng.bit_generator.state
        cluttered = recording.with_baseband(spoilt(recording.baseband, level_db, rng))
        rng.bit_generator.state = state  # the same noise without the clutter
        bare = recording.with_baseband(spoilt(recording.baseband, level_db, rng, clutter_db=None))
        followed = [r for r in analyze(cluttered, analysis=Analysis(extended=False)) if _follows(r, recording)]
        best = max(followed, key=lambda r: float(np.ptp(r.gate.time_s)), default=None)
        whole = analyze(bare, gate="truth", analysis=Analysis(extended=False))[0]
        pairs = {"whole": whole}
        if best is not None:
            settings = Analysis(clutter="median", extended=False)
            clean = clean_frames(remove_common_phase(cluttered.frames), settings)
            gate = Gate.from_truth(recording.truth[0], recording.slow_time_s, settings)
            gate = gate.during(best.quality["start_s"], best.quality["stop_s"])
            pairs["gate"] = analyze_gated(gate.crop(clean), recording.radar.wavelength_m, gate, settings)
        facts = {"radar": ("x4", "x4-long")[radar_number], "kind": kind, "level": f"{level_db:g} dB"}
        rows += [
            {**facts, "way": way, "track": seven(best).tolist(), "truth": seven(true).tolist()}
            for way, true in pairs.items()
        ]
    return rows


def _follows(result: Result, recording: Recording) -> bool:
    """Check that the gate of a result follows the body. Nearer than 0.8 m for most of its time."""
    gate = result.gate
    centre_m = (gate.low_m + gate.high_m) / 2
    times_s = recording.slow_time_s
    true_m = np.interp(gate.time_s, times_s, recording.truth[0].centre_range_m)
    return bool(np.median(np.abs(centre_m - true_m)) < 0.8)


def tabulate_features(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the differences of every feature, by level, radar and target."""
    found = []
    sets = [(value, own) for key in ("level", "radar", "kind") for value, own in rows.groupby(key, sort=False)]
    for name, own in sets:
        by_track, by_truth = np.array(own["track"].tolist()), np.array(own["truth"].tolist())
        for n, sign in enumerate(SIGNS):
            a, b = by_track[:, n], by_truth[:, n]
            both = np.isfinite(a) & np.isfinite(b)
            off = (a[both] - b[both]) / np.abs(b[both])
            inner = np.sort(np.abs(off))[: max(1, round(0.95 * off.size))]
            found.append(
                {
                    "set": name,
                    "feature": sign,
                    "n": off.size,
                    "median difference %": 100 * np.median(off),
                    "rms %": 100 * np.sqrt(np.mean(off**2)),
                    "rms of the middle 95 %": 100 * np.sqrt(np.mean(inner**2)),
                    "within 2 / 5 / 10 %": " / ".join(
                        f"{100 * np.mean(np.abs(off) <= limit):.0f}" for limit in (0.02, 0.05, 0.1)
                    ),
                    "null by track / truth alone": f"{(both < np.isfinite(b)).sum()} / {(both < np.isfinite(a)).sum()}",
                }
            )
    return pd.DataFrame(found)


# Energy in the gate -----------------------------------------------------------------------------------------------


def share_inside(baseband: xr.DataArray, gate: xr.Dataset | None) -> tuple[float, float]:
    """Return the share of energy of a single target in a gate.

    Over the time of the gate, and over the whole recording.
    """
    power = np.abs(baseband.values).astype(np.float64) ** 2
    total = power.sum()
    if gate is None:
        return np.nan, 0.0
    part = gate.crop(Frames.of(baseband)).label()
    bins = np.arange(part.sizes["range"])
    low, high = gate.edges(read_axis(part, "range"), read_axis(part, "slow_time"), sharp=False)
    # a cell at the edge counts by the share of it that is inside (E-27)
    inside = np.clip(np.minimum(bins + 0.5, high[:, None]) - np.maximum(bins - 0.5, low[:, None]), 0.0, 1.0)
    energy = np.abs(part.values).astype(np.float64) ** 2
    kept = (energy * inside).sum()
    return float(kept / energy.sum()), float(kept / total)


def measure_energy(job: tuple[str, int]) -> list[dict[str, Any]]:
    """Measure the share of energy in track gates and true gates of a scene."""
    quiet()
    name, run = job
    rng = np.random.default_rng([SEED, 2, list(SCENES).index(name), run])
    recording = simulate(SCENES[name](rng), X4, angles=False)
    truth, rows = truth_of(recording), []
    lone = [synthesise(one.scatterers, X4) for one in recording.truth]
    for level_db in ENERGY_DB:
        tracks = tracks_in(spoilt(recording.baseband, level_db, rng), X4)
        for number, baseband in enumerate(lone):
            true = Gate.around(truth.slow_time_s, truth.range_m[:, number], span_m=SPAN_M, source="truth")
            best = own_track(tracks, truth, number)
            gate = None if best is None else Gate.from_track(best, span_m=SPAN_M, time_s=truth.slow_time_s)
            shares = (share_inside(baseband, true)[0], *share_inside(baseband, gate))
            rows.append({"scene": name, "level_db": level_db, "shares": shares})
    return rows


def tabulate_energy(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate median and lowest share of energy by scene and level."""
    found = []
    for (name, level_db), own in rows.groupby(["scene", "level_db"], sort=False):
        table = 100 * np.array(own["shares"].tolist(), dtype=float)
        cells = [f"{np.nanmedian(column):.1f} / {np.nanmin(column):.1f}" for column in table.T]
        found.append((name, f"{level_db:g}", len(own), int(np.isfinite(table[:, 1]).sum()), *cells))
    head = ("scene", "SNR_frame dB", "targets", "tracked", "truth gate %", "while tracked %", "whole recording %")
    return pd.DataFrame(found, columns=[name + (": median / lowest" if "%" in name else "") for name in head])


def own_track(tracks: list[Track], truth: Truth, number: int) -> Track | None:
    """Return the longest track of a body. The body is the nearest one, within 0.8 m, for most of its time."""
    own = []
    for one in tracks:
        apart_m = np.abs(truth.at(one.times_s)[0] - one.range_m[:, None])
        if np.mean((apart_m.argmin(axis=1) == number) & (apart_m.min(axis=1) < 0.8)) > 0.5:
            own.append(one)
    return max(own, key=lambda one: one.last_s - one.first_s, default=None)


def main() -> None:
    """Run both parts and write their tables."""
    parser = make_parser(__doc__)
    parser.add_argument("--draws", type=int, default=2)
    options = parser.parse_args()
    how = {"rows": options.rows, "processes": options.processes}
    jobs = list(product(range(2), MODELS, ASPECTS_DEG, range(options.draws)))
    pairs = pd.DataFrame(run_jobs(compare_gates, jobs, **how))
    energy = run_jobs(measure_energy, list(product(ENERGY_SCENES, range(4 * options.draws))), **how)
    sections = {
        "Features, only the gate differs": tabulate_features(pairs[pairs["way"] == "gate"]),
        "Features, whole chains": tabulate_features(pairs[pairs["way"] == "whole"]),
        "Energy of the target's echo inside the gate (1.6 m)": tabulate_energy(pd.DataFrame(energy)),
    }
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()

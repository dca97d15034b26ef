"""Limits of tracks: false tracks, loss of the torso.

    python studies/gate_limits.py --page

Question: do empty rooms make tracks, and does clutter removal take the torso of a person who crosses the line of sight?

Every run samples its target with its own seed, preset `x4`. Static clutter lies 20 dB above the echo. The loss of the
torso is measured on the echo of the trunk alone, within 0.1 s of the crossing and over the whole recording, next to the
closed form. It takes about 3 minutes of one core.

Not shown: reflections, which make tracks of their own, and rooms with people who sit.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from everyday_scenes import PHASE_NOISE, X4, X4_OFFICE, Rng
from harness import finish, make_parser, quiet, run_jobs

from doppelgait.core.labels import read_axis
from doppelgait.core.rng import Streams
from doppelgait.motion.models import fan
from doppelgait.motion.models.human import human_gait
from doppelgait.pipeline import analyze, simulate
from doppelgait.pipeline.radar_table import Conditions
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.clutter import ClutterKind, predict_torso_share_removed, remove_static_clutter
from doppelgait.processing.detect import Detector, find_scans
from doppelgait.processing.track import track
from doppelgait.radar.impairments import ThermalNoise, noise_power_per_sample_v2
from doppelgait.radar.recording import Recording
from doppelgait.radar.simulate import synthesise
from doppelgait.scene import Scene, Target

SEED = 7300
SPAN_M = 1.6
CLUTTER_OVER_ECHO_DB = 20.0


def complex_noise(rng: Rng, shape: tuple[int, ...], power_v2: float) -> npt.NDArray[np.complex64]:
    """Sample circular white noise."""
    parts = rng.standard_normal((2, *shape), dtype=np.float32) * np.float32(np.sqrt(power_v2 / 2.0))
    return np.asarray(parts[0] + 1j * parts[1], dtype=np.complex64)


def spoilt(baseband: xr.DataArray, level_db: float, rng: Rng) -> xr.DataArray:
    """Add white noise at SNR_frame and static clutter in every bin."""
    echo_v2 = float((np.abs(baseband.values) ** 2).max(axis=1).mean())
    values = baseband.values + complex_noise(rng, baseband.shape, echo_v2 / 10 ** (level_db / 10))
    values = values + complex_noise(rng, baseband.shape[1:], echo_v2 * 10 ** (CLUTTER_OVER_ECHO_DB / 10))
    return baseband.copy(data=values.astype(np.complex64))


# False tracks -----------------------------------------------------------------------------------------------------

DRIFT = PHASE_NOISE | {"drift_rad_per_min": 1.0, "walk_rad_per_sqrt_min": 0.5}
JITTER: list[dict[str, object]] = [
    {"kind": "frame_jitter", "sd_s": 1e-5}, {"kind": "dropped_frames", "probability": 0.001},
]  # fmt: skip
FAN_M = 4.0
"""Range of the fan, which is seen from the side: its blades come and go."""


def clutter_at(level_db: float) -> dict[str, object]:
    """Add static clutter above the thermal noise of the X4. The same at all ranges."""
    noise_db = 10 * np.log10(noise_power_per_sample_v2(ThermalNoise(), X4))
    return {"kind": "static_clutter", "levels": [[0.0, float(noise_db) + level_db]]}


def rooms() -> dict[str, tuple[list[Target], list[dict[str, object]]]]:
    """Make empty rooms with confusers and impairments."""
    rotor = Target(fan(duration_s=62.0), start_position_m=(3.5, 2.0), heading_deg=60.0, background=True)
    leak: dict[str, object] = {"kind": "leakage"}
    return {
        "noise": ([], []),
        "clutter 20 dB above noise, phase noise 4 mrad": ([], [clutter_at(20), PHASE_NOISE]),
        "clutter 30 dB, phase noise 4 mrad": ([], [clutter_at(30), PHASE_NOISE]),
        "clutter 40 dB, phase noise 4 mrad": ([], [clutter_at(40), PHASE_NOISE]),
        "the same, frame jitter 10 us, 0.1 % dropped": ([], [clutter_at(40), PHASE_NOISE, *JITTER]),
        "clutter 40 dB, clock drifts 1 rad/min and walks 0.5 rad": ([], [clutter_at(40), DRIFT]),
        "measured office and direct path, the same clock": ([], [leak, X4_OFFICE, DRIFT]),
        "clutter 30 dB, phase noise 4 mrad, fan at 4 m": ([rotor], [clutter_at(30), PHASE_NOISE]),
    }


def count_false(job: tuple[str, int]) -> list[dict[str, Any]]:
    """Count the tracks of a minute in an empty room; also without aligned phases and by the mean."""
    quiet()
    name, minute = job
    bodies, impairments = rooms()[name]
    rng = Streams(int(np.random.default_rng([SEED, 4, list(rooms()).index(name), minute]).integers(2**31)))
    conditions = Conditions(impairments=impairments)
    made = simulate(Scene(bodies, duration_s=60.0), X4, rng=rng, angles=False, conditions=conditions)
    scans = find_scans(made.baseband, wavelength_m=X4.wavelength_m)
    span_mps = X4.wavelength_m * X4.prf_hz / 2
    tracks = track(scans, velocity_span_mps=span_mps)
    still = remove_static_clutter(made.baseband, kind="mean")
    row = {
        "room without a body": name,
        "minutes": 1,
        "detections/min": sum(len(scan.detections) for scan in scans),
        "tracks/min": len(tracks),
        "of them at the fan": sum(bool(bodies) and abs(float(np.median(t.range_m)) - FAN_M) < 0.8 for t in tracks),
        "tracks/min by the mean, phases not aligned": len(
            track(find_scans(still, Detector(clutter="none"), wavelength_m=X4.wavelength_m), velocity_span_mps=span_mps)
        ),
    }
    return [row]


def tabulate_false(rows: pd.DataFrame) -> pd.DataFrame:
    """Average the counts of all minutes of a room."""
    grouped = rows.groupby("room without a body", sort=False)
    return grouped.mean().assign(minutes=grouped["minutes"].sum()).reset_index()


# Torsos that cross ------------------------------------------------------------------------------------------------

KINDS: tuple[ClutterKind, ...] = ("mean", "median", "exponential", "mti")
NEAR_S = 0.1
CROSSINGS = ((0.8, 1.5, 5.0), (0.8, 1.5, 15.0), (0.3, 0.5, 5.0))
"""Lowest and highest speed, m/s, and seconds."""
LOSSES = ("near the crossing", "closed form there", "whole recording", "closed form")


def crossing_at_90(rng: Rng, seconds: float, slowest_mps: float, fastest_mps: float) -> Recording:
    """Simulate a person who crosses the line of sight at mid-time."""
    speed_mps, range_m = rng.uniform(slowest_mps, fastest_mps), rng.uniform(3.0, 6.0)
    motion = human_gait(gait="walk", speed_mps=speed_mps, height_m=rng.uniform(1.6, 1.9), duration_s=seconds + 1.0)
    start_m = (range_m, -speed_mps * seconds / 2)
    target = Target(motion, label="human", start_position_m=start_m, heading_deg=90.0)
    return simulate(Scene([target], duration_s=seconds), X4, angles=False)


def torso_of(recording: Recording) -> xr.DataArray:
    """Simulate the noise-free echo of the trunk alone."""
    table = recording.truth[0].scatterers
    own = np.flatnonzero(table["part"].values == "torso")
    return synthesise(table.isel(scatterer=own), recording.radar)


def measure_losses(job: tuple[tuple[float, float, float], int]) -> list[dict[str, Any]]:
    """Measure the energy of the trunk that each clutter filter takes, and the flags of the analysis."""
    quiet()
    (slowest_mps, fastest_mps, seconds), run = job
    rng = np.random.default_rng([SEED, 5, CROSSINGS.index(job[0]), run])
    recording, rows = crossing_at_90(rng, seconds, slowest_mps, fastest_mps), []
    cluttered = recording.with_baseband(spoilt(recording.baseband, 20.0, rng))
    for kind in KINDS:
        results = analyze(cluttered, analysis=Analysis(clutter=kind, extended=False))
        flags = [f for r in results for one in (r, *r.segments) for f in one.flags]
        flagged = any(flag.startswith("clutter_removal_took_") for flag in flags)
        case = f"{slowest_mps:g}-{fastest_mps:g} m/s, {seconds:g} s"
        losses = dict(zip(LOSSES, losses_db(recording, kind), strict=True))
        rows.append({"walk": case, "clutter": kind, "flagged": flagged, "found": bool(results), **losses})
    return rows


def tabulate_losses(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate median, 10th and 90th percentile of the losses, dB."""
    found = []
    for (walk, clutter), own in rows.groupby(["walk", "clutter"], sort=False):
        quantiles = own[list(LOSSES)].quantile([0.5, 0.1, 0.9])
        cells = ["{:.1f} ({:.1f} to {:.1f})".format(*quantiles[name]) for name in LOSSES]
        found.append((walk, clutter, len(own), *cells, f"{own['flagged'].sum()} of {own['found'].sum()}"))
    return pd.DataFrame(found, columns=["walk", "clutter", "n", *LOSSES, "flagged, of those found"])


def losses_db(recording: Recording, kind: ClutterKind) -> list[float]:
    """Return the loss of the trunk near the crossing and overall. Measured and closed form."""
    before = torso_of(recording)
    after = remove_static_clutter(before, kind=kind)
    truth, times_s = recording.truth[0], read_axis(before, "slow_time")
    gate = Gate.around(times_s, truth.centre_range_m, span_m=SPAN_M, source="truth")
    energy = (np.abs(before.values) ** 2).sum(axis=1)
    left = (np.abs(after.values) ** 2).sum(axis=1)
    share = predict_torso_share_removed(
        gate, times_s, kind=kind, wavelength_m=X4.wavelength_m, prf_hz=X4.prf_hz, n_pulses=times_s.size
    )
    near = np.abs(times_s - times_s.mean()) <= NEAR_S
    found = []
    for part in (near, np.ones(near.size, dtype=bool)):
        closed = (energy[part] * (1.0 - share[part])).sum() / energy[part].sum()
        found += [-10 * np.log10(left[part].sum() / energy[part].sum()), -10 * np.log10(closed)]
    return [float(v) for v in found]


def main() -> None:
    """Run both parts and write their tables."""
    parser = make_parser(__doc__)
    parser.add_argument("--draws", type=int, default=3, help="a quarter of the crossings")
    parser.add_argument("--minutes", type=int, default=4, help="of every room without a body")
    options = parser.parse_args()
    how = {"rows": options.rows, "processes": options.processes}
    false = run_jobs(count_false, list(product(rooms(), range(options.minutes))), **how)
    losses = run_jobs(measure_losses, list(product(CROSSINGS, range(4 * options.draws))), **how)
    sections = {
        "False tracks": tabulate_false(pd.DataFrame(false)),
        "Trunk of a person who crosses at 90 degrees: energy lost, dB": tabulate_losses(pd.DataFrame(losses)),
    }
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()

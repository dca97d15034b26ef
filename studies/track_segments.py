"""Segments of range tracks, and the weakest breath that is detected.

    python studies/track_segments.py --page

Question: are turns and changes of speed found where they are, and down to which SNR is a breathing person detected?

Tracks are made at 10 Hz: legs back and forth at 0.8 to 1.6 m/s with sudden turns, speeds that swing or jump, straight
walks past the radar. Their errors are Gaussian with the stated standard deviation and correlation time: a tracker's
output has correlated ones. A turn is found if a change point is within 0.3 s of it. Breaths are those of a simulated
chest that moves by 5 mm at 2 m before the preset `x4-17fps`, with white noise; the level is that of one frame in the
strongest bin. It takes about 4 minutes of one core.

Not shown: tracks of real recordings, and breaths of people who move.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from harness import FloatArray, finish, make_parser, markdown, match

from doppelgait.core.frames import Frames
from doppelgait.core.rng import rng
from doppelgait.motion import breathing_person
from doppelgait.pipeline import simulate
from doppelgait.processing.breathing import find_breathing
from doppelgait.processing.track_segments import TrackSegment, find_track_segments
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target

TOLERANCE_S = 0.3
STEP_S = 0.1
LEG_S = 2.8


def errors(source: np.random.Generator, n: int, *, sd_m: float, memory_s: float) -> FloatArray:
    """Sample first-order Markov errors."""
    keep = float(np.exp(-STEP_S / memory_s)) if memory_s > 0 else 0.0
    noise, found = source.normal(0.0, sd_m, n), np.empty(n)
    found[0] = noise[0]
    for k in range(1, n):
        found[k] = keep * found[k - 1] + np.sqrt(1 - keep**2) * noise[k]
    return found


def legs(source: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Make times, ranges and turns of four legs."""
    times = np.arange(0, 4 * LEG_S, STEP_S)
    speeds = source.uniform(0.8, 1.6, 4) * np.array([1, -1, 1, -1])
    corners = np.concatenate([[7.0], 7.0 - np.cumsum(speeds * LEG_S)])
    return times, np.interp(times, LEG_S * np.arange(5), corners), LEG_S * np.arange(1, 4)


def change_points_s(segments: tuple[TrackSegment, ...]) -> list[float]:
    """Return the middles between segments."""
    return [(left.stop_s + right.start_s) / 2 for left, right in pairwise(segments)]


def offsets_s(found: list[float], true: FloatArray) -> list[float]:
    """Match detected change points to true ones within the tolerance. Returns their distances."""
    distance_s = np.abs(np.subtract.outer(np.array(found), true))
    return [float(distance_s[pair]) for pair in match(distance_s, TOLERANCE_S)]


def turns_table(trials: int, seed: int) -> str:
    """Tabulate F1 on four legs."""
    rows = []
    for sd_m in (0.03, 0.065, 0.1, 0.15):
        for memory_s in (0.0, 0.3):
            offsets: list[float] = []
            found_all = true_all = 0
            for trial in range(trials):
                source = np.random.default_rng(seed + trial)
                times, clean, true = legs(source)
                track = clean + errors(source, times.size, sd_m=sd_m, memory_s=memory_s)
                found = change_points_s(find_track_segments(times, track, range_sd_m=max(sd_m, 0.05)))
                offsets += offsets_s(found, true)
                found_all, true_all = found_all + len(found), true_all + true.size
            f1 = 2 * len(offsets) / (found_all + true_all)
            rows.append((sd_m, memory_s, true_all, f1, float(np.median(offsets))))
    return markdown(("error (m)", "correlation time (s)", "turns", "F1", "median offset (s)"), rows, digits=3)


def cut_share(track: Callable[[FloatArray, float], FloatArray], *, trials: int, seed: int, seconds: float) -> float:
    """Return the share of tracks that are split, errors 0.065 m."""
    times = np.arange(0, seconds, STEP_S)
    cut = 0
    for trial in range(trials):
        source = np.random.default_rng(seed + trial)
        clean = track(times, float(source.uniform(0, 2 * np.pi)))
        cut += len(find_track_segments(times, clean + source.normal(0, 0.065, times.size))) > 1
    return cut / trials


def shapes_table(trials: int, seed: int) -> str:
    """Tabulate which tracks are split."""
    shapes: dict[str, tuple[Callable[[FloatArray, float], FloatArray], float]] = {}
    for period_s in (3.0, 5.0, 8.0, 12.0):
        w = 2 * np.pi / period_s
        shapes[f"speed 1.2 m/s swinging by 0.3 m/s^2, period {period_s:g} s"] = (
            lambda t, phase, w=w: 18 - 1.2 * t + 0.3 / w**2 * np.cos(w * t + phase), 12.0,
        )  # fmt: skip
        shapes[f"speed 1.2 m/s swinging by 5 %, period {period_s:g} s"] = (
            lambda t, phase, w=w: 18 - 1.2 * t + 0.06 / w * np.cos(w * t + phase), 12.0,
        )  # fmt: skip
    for near_m in (1.5, 4.0):
        shapes[f"straight past the radar at {near_m:g} m, 1.4 m/s"] = (
            lambda t, phase, near_m=near_m: np.hypot(near_m, 1.4 * (t - 2.5)), 5.0,
        )  # fmt: skip
    for jump_mps in (0.3, 0.5, 0.6, 0.8, 1.0, 1.2):
        shapes[f"speed jumps by {jump_mps:g} m/s"] = (
            lambda t, phase, jump_mps=jump_mps: 14 - 0.5 * t - jump_mps * np.maximum(t - 4, 0), 8.0,
        )  # fmt: skip
    shares = {name: cut_share(t, trials=trials, seed=seed, seconds=seconds) for name, (t, seconds) in shapes.items()}
    return markdown(("track", "share that is divided"), list(shares.items()))


def breath_table(trials: int, seed: int) -> str:
    """Tabulate detected share and rate error by level."""
    radar, rows = Radar.preset("x4-17fps"), []
    for seconds in (20.0, 60.0, 120.0):
        motion = breathing_person(breathing_hz=0.25, amplitude_m=0.005, duration_s=seconds + 2, rate_hz=50)
        scene = Scene([Target(motion, label="human", range_m=2.0)], duration_s=seconds)
        clean = simulate(scene, radar, rng=rng(0), snr_db=float("inf")).baseband
        power = float((np.abs(clean.values) ** 2).mean(axis=0).max())
        for snr_db in (10, 3, 0, -3, -6, -9, -12):
            off, others = [], 0
            for trial in range(trials):
                source = np.random.default_rng(seed + trial)
                pair = source.standard_normal((2, *clean.shape)) * np.sqrt(power / 2 / 10 ** (snr_db / 10))
                noisy = clean.copy(data=(clean.values + pair[0] + 1j * pair[1]).astype(np.complex64))
                people = find_breathing(Frames.of(noisy), wavelength_m=radar.wavelength_m)
                near = [person for person in people if abs(person.range_m - 2.0) < 0.2]
                off += [near[0].rate_hz / 0.25 - 1] if near else []
                others += len(people) - len(near[:1])
            rms = f"{100 * np.sqrt(np.mean(np.square(off))):.2f} %" if off else "-"
            good = f"{np.mean(np.abs(off) < 0.02):.2f}" if off else "-"
            rows.append((f"{seconds:g}", snr_db, len(off) / trials, others, rms, good))
    head = ("seconds", "SNR of a frame (dB)", "found", "others", "rms rate error", "within 2 %")
    return markdown(head, rows)


def main() -> None:
    """Write the tables."""
    parser = make_parser(__doc__)
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    sections = {
        "Turns of four legs": turns_table(options.trials, options.seed),
        "Which tracks are divided": shapes_table(options.trials, options.seed),
        "Breath": breath_table(options.trials, options.seed),
    }
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()

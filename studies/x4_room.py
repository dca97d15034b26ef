"""Real X4 modules compared with their sensor models.

An empty room, and a person who breathes.

    python studies/x4_room.py RECORDINGS OUT_FOLDER

RECORDINGS is a folder with the two MATLAB files named below (XeThru X4, RF frames, 25 frames/s). A twin is fitted to
each of the two radars of the empty room; rooms drawn from the twin are fitted in the same way, and a breathing person
simulated through it stands beside the recorded one. Prints a table in markdown, draws four figures, and writes the
twins.

What is assumed: the carrier (7.29 GHz), the volts of a unit (so chosen that noise figure 6 dB gives this noise, which
makes the noise figure no finding), the transmit power and antenna gains of the preset, which set the person's level.
Of the person nothing but range and rate is known: 1.75 m of stature, radar cross section 0.8 m^2 times mass over 80 kg,
radar at the height of the chest. The recorded person moves the whole body at first and then sits still; the simulated
one does nothing but breathe. So the part from 40 s on is compared too, there with the chest's amplitude taken from the
phase of the recording.
"""

from __future__ import annotations

import argparse
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from doppelgait import viz
from doppelgait.core.rng import Streams
from doppelgait.motion.models.primitives import breathing_person
from doppelgait.pipeline import simulate
from doppelgait.pipeline.conditions import Conditions
from doppelgait.radar import Radar, Recording
from doppelgait.radar.fit import Estimate, SensorFit, calibrated_preset, fit_sensor
from doppelgait.radar.impairments import apply_impairments, make_impairment
from doppelgait.radar.readers import read_recording
from doppelgait.radar.simulate import label_baseband
from doppelgait.scene import Scene, Target
from doppelgait.viz.style import ACCENT, legend_below, name_axes, new_figure

EMPTY = "rf_empty_room_two_radars_20220222_143239.mat"
BREATHING = "rf_breathing_20220303_131324.mat"
MATRICES = ("Data_Matrix_1", "Data_Matrix_2")
SEED = 20220222
N_ROOMS = 12
PERSON_M = 1.73
BREATHING_HZ = 0.24
SEARCH_M = 0.15
"""The person's bin is the one that varies most within this distance of the stated range."""
BAND_HZ = (0.1, 0.6)
STILL_S = 40.0
"""From here on the recorded person only breathes."""
CHEST_FORWARD_M, CHEST_HEIGHT_M = 0.0525, 1.28
"""Chest of the breathing model before the mean of its points, and above the floor, for 1.75 m stature."""
USUAL_AMPLITUDE_M = 0.005
MEASURED, SIMULATED, NOISE = "#1f3b57", ACCENT, "#56b4e9"

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Person:
    """Slow-time statistics about a breathing person.

    Parameters
    ----------
    range_m, level_db : ndarray, shape (N,)
        Slow-time standard deviation of every bin, dB re one unit.
    bin_m, bin_db : float
        The person's bin and its level.
    rate_hz : float
        Strongest frequency of that bin between 0.1 and 0.6 Hz.
    time_s, phase_rad : ndarray, shape (I,)
        Phase of that bin about the centre of the circle that its values lie on.
    swing_rad : float
        Amplitude of that phase between 0.1 and 0.6 Hz: sqrt(2) times its standard deviation.
    """

    range_m: FloatArray
    level_db: FloatArray
    bin_m: float
    bin_db: float
    rate_hz: float
    time_s: FloatArray
    phase_rad: FloatArray
    swing_rad: float


def unit_db(radar: Radar) -> float:
    """Return the level of one unit, dB re 1 V."""
    return float(20.0 * np.log10(radar.volts_per_unit or 1.0))


def drawn_room(twin: Path, *, frames: int, seed: int) -> Recording:
    """Simulate an empty room by a sensor model.

    Only thermal noise and the impairments of the model.
    """
    radar = Radar.preset(str(twin))
    tables = tomllib.loads(twin.read_text(encoding="utf-8"))["impairments"]
    specs = [make_impairment(table) for table in [{"kind": "thermal_noise"}, *tables]]
    nothing = np.zeros((frames, radar.n_range_bins), dtype=np.complex64)
    samples = apply_impairments(nothing, specs, radar=radar, rng=np.random.default_rng(seed)).matrix
    baseband = label_baseband(samples, np.arange(frames) / radar.prf_hz, radar)
    return Recording.from_baseband(baseband, radar, source=twin.name)


def drawn_person(twin: Path, like: Recording, *, amplitude_m: float, seed: int) -> Recording:
    """Simulate a breathing person by a sensor model.

    In the frame and for the time of a recording.
    """
    range_m, time_s = like.range_m, like.slow_time_s
    frame = {"range_start_m": float(range_m[0]), "range_stop_m": float(range_m[-1]) + 0.03}
    radar = Radar.preset(str(twin), **frame)
    motion = breathing_person(
        breathing_hz=BREATHING_HZ, amplitude_m=amplitude_m, duration_s=float(time_s[-1]) + 1.0, rate_hz=radar.prf_hz
    )
    target = Target(motion, label="human", range_m=PERSON_M + CHEST_FORWARD_M)
    scene = Scene([target], radar_position_m=(0.0, 0.0, CHEST_HEIGHT_M), duration_s=float(time_s[-1]))
    tables = tomllib.loads(twin.read_text(encoding="utf-8"))["impairments"]
    return simulate(scene, radar, rng=Streams(seed), conditions=Conditions(impairments=tables), angles=False)


def person(recording: Recording, *, start_s: float = 0.0) -> Person:
    """Measure bin, size and rate of the strongest variation near the person."""
    range_m, times_s = recording.range_m, recording.slow_time_s
    chosen = times_s >= start_s
    values, time_s = recording.baseband.values[chosen].astype(complex), times_s[chosen]
    level_db = 20.0 * np.log10(values.std(axis=0)) - unit_db(recording.radar)
    near = np.where(np.abs(range_m - PERSON_M) <= SEARCH_M, level_db, -np.inf)
    strongest = int(np.argmax(near))
    signal = values[:, strongest]
    frequency_hz = np.fft.fftfreq(signal.size, float(np.mean(np.diff(time_s))))
    inside = (np.abs(frequency_hz) >= BAND_HZ[0]) & (np.abs(frequency_hz) <= BAND_HZ[1])
    phase_rad = np.unwrap(np.angle(signal - circle_centre(signal)))
    spectrum = np.fft.fft(phase_rad - phase_rad.mean())
    swing_rad = float(np.sqrt(2.0) * np.std(np.fft.ifft(np.where(inside, spectrum, 0.0)).real))
    power = np.where(inside, np.abs(np.fft.fft((signal - signal.mean()) * np.hanning(signal.size))) ** 2, 0.0)
    rate_hz = float(np.abs(frequency_hz[np.argmax(power)]))
    bin_m, bin_db = float(range_m[strongest]), float(level_db[strongest])
    return Person(range_m, level_db, bin_m, bin_db, rate_hz, time_s, phase_rad, swing_rad)


def circle_centre(values: npt.NDArray[np.complex128]) -> complex:
    """Fit a circle to complex points (Kasa) and return its centre."""
    matrix = np.stack([values.real, values.imag, np.ones(values.size)], axis=1)
    solution = np.linalg.lstsq(matrix, np.abs(values) ** 2, rcond=None)[0]
    return complex(solution[0], solution[1]) / 2.0


def room_rows(name: str, real: SensorFit, drawn: list[SensorFit]) -> list[tuple[str, str, str, str]]:
    """Tabulate measured and simulated numbers of an empty room."""
    own, minute = unit_db(real.radar), 60.0

    def row(what: str, estimate: Estimate, others: list[float], unit: str) -> tuple[str, str, str, str]:
        mean, sd = float(np.mean(others)), float(np.std(others))
        measured = f"{estimate.value:.4g} +- {estimate.sd:.2g} {unit}"
        return f"{name}: {what}", measured, f"{mean:.4g} +- {sd:.2g} {unit}", f"{mean - estimate.value:+.2g} {unit}"

    level = Estimate(real.noise_level_db.value - own, real.noise_level_db.sd)
    rows = [row("noise per bin and frame", level, [f.noise_level_db.value - own for f in drawn], "dB")]
    single = level_of_bins(real)
    for start_m, stop_m in ((0.75, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 6.0), (6.0, 8.0)):
        inside = (real.range_m >= start_m) & (real.range_m < stop_m)
        measured = Estimate(float(np.median(single[inside])), 0.0)
        others = [float(np.median(level_of_bins(f)[inside])) for f in drawn]
        rows.append(row(f"static echo, median of {start_m:g} to {stop_m:g} m", measured, others, "dB"))
    if real.phase is not None:
        phases = [f.phase for f in drawn if f.phase is not None]
        walk = minute**0.5
        rows += [
            row("white phase jitter", real.phase.white, [p.white.value for p in phases], "rad"),
            row("phase walk", real.phase.walk_per_root_s.scaled(walk),
                [p.walk_per_root_s.value * walk for p in phases], "rad/sqrt(min)"),
            row("phase drift", real.phase.drift_per_s.scaled(minute),
                [p.drift_per_s.value * minute for p in phases], "rad/min"),
        ]  # fmt: skip
    return rows


def level_of_bins(fit: SensorFit) -> FloatArray:
    """Return the static echo of every bin, dB re one unit."""
    return np.asarray(20.0 * np.log10(np.abs(fit.echo_v)) - unit_db(fit.radar))


def person_rows(what: str, real: Person, drawn: list[Person], *, noise_db: float) -> list[tuple[str, str, str, str]]:
    """Tabulate measured and simulated numbers of the person."""
    level, sd = (float(f([p.bin_db for p in drawn])) for f in (np.mean, np.std))
    rate = float(np.mean([p.rate_hz for p in drawn]))
    swing = float(np.mean([p.swing_rad for p in drawn]))
    return [
        (f"{what}: bin", f"{real.bin_m:.2f} m", f"{np.mean([p.bin_m for p in drawn]):.2f} m", ""),
        (f"{what}: slow-time standard deviation", f"{real.bin_db:.1f} dB", f"{level:.1f} +- {sd:.1g} dB",
         f"{level - real.bin_db:+.1f} dB"),
        (f"{what}: over the noise of the empty room", f"{real.bin_db - noise_db:.1f} dB", f"{level - noise_db:.1f} dB",
         f"{level - real.bin_db:+.1f} dB"),
        (f"{what}: rate", f"{real.rate_hz:.3f} Hz", f"{rate:.3f} Hz", f"{rate - real.rate_hz:+.3f} Hz"),
        (f"{what}: swing of the phase", f"{real.swing_rad:.2f} rad", f"{swing:.2f} rad", ""),
    ]  # fmt: skip


def draw_room(real: SensorFit, drawn: list[SensorFit], *, title: str) -> Figure:
    """Plot static echo and noise over range.

    The measured room, simulated rooms, and the fitted profile.
    """
    figure = new_figure(width_in=10.5, height_in=5.5)
    axes = figure.add_subplot()
    own = unit_db(real.radar)
    for number, fit in enumerate(drawn[:6]):
        label = "static echo, drawn rooms" if number == 0 else None
        axes.plot(fit.range_m, level_of_bins(fit), color=SIMULATED, lw=0.6, alpha=0.5, label=label)
    axes.plot(real.range_m, level_of_bins(real), color=MEASURED, lw=1.4, label="static echo, measured")
    axes.plot(real.clutter.range_m, real.clutter.level_db - own, "k--", lw=1.2, label="fitted profile")
    for fit, colour, words in ((drawn[0], "#e69f00", "noise, drawn room"), (real, NOISE, "noise, measured")):
        axes.plot(fit.range_m, 10 * np.log10(fit.noise.by_bin_v2) - own, color=colour, lw=1.2, label=words)
    name_axes(axes, title=title, x="range (m)", y="level (dB re 1 unit)")
    legend_below(figure, axes)
    return figure


def draw_person(real: Person, drawn: Person, *, title: str) -> Figure:
    """Plot slow-time deviation over range and phase at the person."""
    figure = new_figure(width_in=10.5, height_in=7.0)
    above, below = figure.subplots(2, 1)
    for found, colour, words in ((real, MEASURED, "measured"), (drawn, SIMULATED, "simulated")):
        above.plot(found.range_m, found.level_db, color=colour, lw=1.4, label=words)
        shown = found.time_s < found.time_s[0] + 40.0
        below.plot(found.time_s[shown], found.phase_rad[shown] - found.phase_rad[shown].mean(), color=colour, lw=0.9)
    above.axvline(PERSON_M, color="0.6", lw=0.8)
    name_axes(above, title=title, x="range (m)", y="slow-time standard deviation (dB re 1 unit)")
    name_axes(below, title="", x="time (s)", y="phase of the person's bin (rad)")
    legend_below(figure, above)
    return figure


def main(recordings: Path, out: Path) -> None:
    """Fit, plot, compare and print."""
    out.mkdir(parents=True, exist_ok=True)
    rows: list[tuple[str, str, str, str]] = []
    noise_db = []
    for number, matrix in enumerate(MATRICES, start=1):
        real = fit_sensor(read_recording(recordings / EMPTY, matrix=matrix))
        twin = out / f"x4-twin-{number}.toml"
        twin.write_text(calibrated_preset(real), encoding="utf-8")
        seeds = np.random.SeedSequence([SEED, number]).generate_state(N_ROOMS)
        drawn = [fit_sensor(drawn_room(twin, frames=real.n_frames, seed=int(seed))) for seed in seeds]
        rows += room_rows(f"radar {number}", real, drawn)
        noise_db.append(real.noise_level_db.value - unit_db(real.radar))
        viz.save_figure(draw_room(real, drawn, title=f"Empty room, radar {number}"), out / f"empty-room-{number}.png")
    breathing = read_recording(recordings / BREATHING)
    twin = out / "x4-twin-1.toml"
    still = person(breathing, start_s=STILL_S)
    chest_m = still.swing_rad * breathing.radar.wavelength_m / (4.0 * np.pi)
    for what, start_s, amplitude_m in (
        ("whole, chest +-5 mm", 0.0, USUAL_AMPLITUDE_M),
        (f"still, chest +-{1e3 * chest_m:.1f} mm", STILL_S, chest_m),
    ):
        made = [drawn_person(twin, breathing, amplitude_m=amplitude_m, seed=SEED + n) for n in range(4)]
        people = [person(recording, start_s=start_s) for recording in made]
        measured = person(breathing, start_s=start_s)
        rows += person_rows(what, measured, people, noise_db=noise_db[0])
        name = "breathing" if start_s == 0.0 else "breathing-still"
        viz.save_figure(draw_person(measured, people[0], title=f"Breathing person, {what}"), out / f"{name}.png")
    print("| quantity | measured | simulated | difference |\n| --- | --- | --- | --- |")
    for row in rows:
        print("| " + " | ".join(row) + " |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, help="folder of the X4 recordings")
    parser.add_argument("out", type=Path, help="folder for figures and twins; made if missing")
    arguments = parser.parse_args()
    main(arguments.recordings, arguments.out)

"""Real X4 modules compared with what is simulated of them.

    python studies/x4_room.py RADAR_DATA/x4_rf_giraffe_yin --page

Question: do the counter, the preset `x4` and fitted sensor models predict noise, echoes, phase and a breathing person?

The folder holds two MATLAB files (XeThru X4, RF frames, 25 frames/s). Levels are in the units of the files, by the
host's way of down-conversion (27 Hamming taps) and by the chip's own taps. `counters`: the RF path, sample by sample:
the echoes (for the empty room its own mean frame), read by a receiver that counts comparisons with a swept threshold,
then down-converted as the recording is. `preset`: noise and person of the preset `x4` at the recordings' frame rate and
averages, in closed form. `sensor model`: rooms sampled from the model that was fitted to each radar; what was fitted is
no finding.

One number is taken from the recordings for counters and preset: the noise of an RF sample in the empty room. With it
the law of the counter (E-18b) gives the input noise in units, and the preset's noise figure the volts of a unit. The
step of the threshold over the pulses counted, the other number in the law, is the smallest step of the files' values.

Assumed: the carrier (7.29 GHz); noise figure (6 dB), transmit power and antenna gains of the preset, which set the
person's level. Of the person only range and rate are known: 1.75 m of stature, radar cross section 0.8 m^2 times mass
over 80 kg, radar at the height of the chest. The recorded person moves the whole body at first and then sits still; the
simulated one only breathes. The part from 40 s on is therefore compared too, with the chest's amplitude taken from the
phase of the recording. It takes about 1 minute of one core.

Not shown: other rooms and other modules. Two radars of one room and one person are a small sample.
"""

from __future__ import annotations

import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
from harness import FloatArray, finish, make_parser, markdown
from scipy.io import loadmat
from scipy.special import ndtr

from doppelgait.core.rng import Streams
from doppelgait.motion.models.primitives import breathing_person
from doppelgait.pipeline import simulate
from doppelgait.pipeline.radar_table import Conditions, Noise
from doppelgait.radar import Radar, Recording
from doppelgait.radar.fit import fit_sensor, format_preset
from doppelgait.radar.fit.room import Room, fit_room, fit_series
from doppelgait.radar.impairments import apply_impairments, make_impairment
from doppelgait.radar.link import comparator_noise_v, noise_power_v2
from doppelgait.radar.readers import read_recording
from doppelgait.radar.simulate import label_baseband, sample_rf_frames
from doppelgait.radar.xethru.downconvert import compute_chip_gain, down_convert_frames
from doppelgait.scene import Scene, Target, assemble, place

EMPTY = "rf_empty_room_two_radars_20220222_143239.mat"
BREATHING = "rf_breathing_20220303_131324.mat"
MATRICES = ("Data_Matrix_1", "Data_Matrix_2")
CARRIER_HZ, SAMPLE_RATE_HZ, DECIMATION = 7.29e9, 23.328e9, 8
Filter = Literal["hamming", "chip"]
FILTERS: dict[Filter, str] = {"hamming": "host's filter", "chip": "chip's filter"}
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
NEAR_M = 1.1
"""Phase steps of the echoes up to here are compared with those of the echoes beyond."""
BEHIND_M = 2.4
"""From here on echoes are weak enough that their phase jitter does not show in the noise of RF samples."""
MARGIN = 64
"""RF samples simulated before and after the recorded frame: more than a filter is long."""

ComplexArray = npt.NDArray[np.complex128]
Row = tuple[str, str, str, str, str]
Rooms = dict[str, tuple[Recording, Room]]


@dataclass(frozen=True)
class RfNoise:
    """Noise of RF samples in the file's unit. A unit is 1024 steps of the threshold converter."""

    rms: float
    counts: int

    @property
    def input_rms(self) -> float:
        """Return the noise of one pulse at the comparator, units. It is sqrt(pi) var n / d (E-18b)."""
        return float(np.sqrt(np.pi) * self.rms**2 * self.counts * 1024.0)


@dataclass(frozen=True)
class Person:
    """Slow-time statistics about a breathing person."""

    range_m: FloatArray
    level_db: FloatArray
    bin_m: float
    bin_db: float
    rate_hz: float
    time_s: FloatArray
    phase_rad: FloatArray
    swing_rad: float


def rf_noise(frames: FloatArray, *, frame_rate_hz: float) -> RfNoise:
    """Measure noise and counting step of RF frames.

    The noise is that above 9 Hz (of 12.5), where nobody in these rooms moves.
    """
    turns = frames[:, ::7].ravel()[::31] * 1024.0
    tried = np.arange(16, 20000)
    fits = np.array([abs(np.exp(2j * np.pi * turns * count).mean()) for count in tried])
    count = int(tried[np.argmax(fits > 0.999)])
    window = np.hanning(len(frames))
    spectrum = np.fft.rfft((frames - frames.mean(axis=0)) * window[:, None], axis=0)
    fast = np.fft.rfftfreq(len(frames), 1.0 / frame_rate_hz) > 9.0
    power = np.mean(np.abs(spectrum[fast]) ** 2, axis=0) / np.sum(window**2)
    return RfNoise(float(np.sqrt(np.median(power))), count)


def count_thresholds(signal: FloatArray, noise: RfNoise, rng: np.random.Generator) -> FloatArray:
    """Read samples with a counter. It compares with a threshold that is swept in steps of 1/1024 unit."""
    step, reach = 1.0 / 1024.0, int(np.ceil(6.0 * noise.input_rms * 1024.0))
    lowest = np.floor(signal / step) - reach
    counts = np.zeros(signal.shape)
    for k in range(2 * reach + 1):
        over = ndtr((signal - (lowest + k) * step) / noise.input_rms)
        counts += rng.binomial(noise.counts, over)
    return np.asarray((lowest - 0.5) * step + step * counts / noise.counts)


def convert(frames: FloatArray, filter: Filter, *, start_m: float, bin_m: float) -> tuple[ComplexArray, FloatArray]:
    """Convert RF frames to baseband as a recording is on reading."""
    values, range_m = down_convert_frames(
        frames, carrier_hz=CARRIER_HZ, sample_rate_hz=SAMPLE_RATE_HZ, decimation=DECIMATION, range_start_m=start_m,
        bin_length_m=bin_m, filter=filter,
    )  # fmt: skip
    return values.astype(complex), range_m


def carrier_gain(filter: Filter) -> float:
    """Return what a down-conversion makes of an RF sinusoid of amplitude 1."""
    wave = np.cos(2.0 * np.pi * CARRIER_HZ / SAMPLE_RATE_HZ * np.arange(512))[None]
    return float(np.abs(convert(wave, filter, start_m=0.0, bin_m=0.00643)[0]).mean())


def unit_db(radar: Radar, filter: Filter = "hamming") -> float:
    """Return the level of a read file's unit, dB re 1 V."""
    return db((radar.volts_per_unit or 1.0) * compute_chip_gain(radar.carrier_hz, radar.sample_rate_hz, filter))


def counted_room(frames: FloatArray, noise: RfNoise, like: Recording, filter: Filter, *, bin_m: float) -> Recording:
    """Simulate an empty room by counters. Its mean frame is read as often as the recording has frames."""
    still = np.broadcast_to(frames.mean(axis=0), frames.shape)
    counted = count_thresholds(still, noise, np.random.default_rng(SEED))
    values, _ = convert(counted, filter, start_m=0.0, bin_m=bin_m)
    scale_v = 10.0 ** (unit_db(like.radar, filter) / 20.0)
    return Recording.from_baseband(label_baseband(scale_v * values, like.slow_time_s, like.radar), like.radar)


def drawn_room(model: Path, *, frames: int, seed: int) -> Recording:
    """Simulate an empty room by a sensor model. Only thermal noise and the impairments of the model."""
    radar = Radar.preset(str(model))
    tables = tomllib.loads(model.read_text(encoding="utf-8"))["impairments"]
    specs = [make_impairment(table) for table in [{"kind": "thermal_noise"}, *tables]]
    nothing = np.zeros((frames, radar.n_range_bins), dtype=np.complex64)
    samples = apply_impairments(nothing, specs, radar=radar, rng=np.random.default_rng(seed)).matrix
    baseband = label_baseband(samples, np.arange(frames) / radar.prf_hz, radar)
    return Recording.from_baseband(baseband, radar, source=model.name)


def whole_jitter_rad(fit: Room) -> float:
    """Return the white jitter of the common phase, thermal noise included."""
    return fit_series(np.unwrap(np.angle(fit.factor)), time_s=fit.time_s).white.value


def common_share(recording: Recording, fit: Room) -> float:
    """Correlate the phase steps of near and far echoes. 1 for a clock that all share, 0 for thermal noise."""
    still = np.ones(recording.range_m.size, dtype=bool)
    for body in fit.moving:
        still &= (recording.range_m < body.start_m) | (recording.range_m > body.stop_m)
    steps = []
    for chosen in (still & (recording.range_m <= NEAR_M), still & (recording.range_m > NEAR_M)):
        sums = recording.baseband.values[:, chosen].astype(complex) @ fit.echo_v[chosen].conj()
        steps.append(np.diff(np.unwrap(np.angle(sums))))
    return float(np.corrcoef(steps[0], steps[1])[0, 1])


def breathing_scene(amplitude_m: float, duration_s: float) -> Scene:
    """Place a person who only breathes where the recorded one stands."""
    motion = breathing_person(
        breathing_hz=BREATHING_HZ, amplitude_m=amplitude_m, duration_s=duration_s + 1.0, rate_hz=25.0
    )
    target = Target(motion, label="human", range_m=PERSON_M + CHEST_FORWARD_M)
    return Scene([target], radar_position_m=(0.0, 0.0, CHEST_HEIGHT_M), duration_s=duration_s)


def person(values: ComplexArray, range_m: FloatArray, time_s: FloatArray, *, start_s: float) -> Person:
    """Measure the strongest variation near the person. Values are in units."""
    values, time_s = values[time_s >= start_s], time_s[time_s >= start_s]
    level_db = 20.0 * np.log10(np.maximum(values.std(axis=0), 1e-9))
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


def circle_centre(values: ComplexArray) -> complex:
    """Fit a circle to complex points (Kasa) and return its centre."""
    matrix = np.stack([values.real, values.imag, np.ones(values.size)], axis=1)
    solution = np.linalg.lstsq(matrix, np.abs(values) ** 2, rcond=None)[0]
    return complex(solution[0], solution[1]) / 2.0


def db(rms: float) -> float:
    """Return the level of an amplitude."""
    return float(20.0 * np.log10(rms))


def pair(values: list[float], digits: int) -> str:
    """Write the values of both radars, or the one of both."""
    return " / ".join(f"{value:.{digits}f}" for value in values)


def room_rows(recordings: Path, out: Path) -> tuple[list[Row], float]:
    """Compare noise, echoes and phase of the empty room. The volts of an RF unit are returned, too."""
    frames = {matrix: np.asarray(loadmat(recordings / EMPTY)[matrix], dtype=float) for matrix in MATRICES}
    facts = loadmat(recordings / EMPTY, variable_names=["actual_fps", "bin_length"])
    rate_hz, bin_m = (float(facts[name].item()) for name in ("actual_fps", "bin_length"))
    noises = {matrix: rf_noise(frames[matrix], frame_rate_hz=rate_hz) for matrix in MATRICES}
    counts = next(iter(noises.values())).counts
    preset = Radar.preset("x4")
    pulses = (preset.pulse_rate_hz or 0.0) * preset.integration_share / rate_hz
    levels = round(pulses / counts)  # so that a frame averages as many pulses
    preset = Radar.preset("x4", prf_hz=rate_hz, sweep_levels=levels)
    volts = comparator_noise_v(preset) / float(np.sqrt(np.mean([noise.input_rms**2 for noise in noises.values()])))
    rows: list[Row] = []

    def row(what: str, measured: list[float], simulated: list[float], by: str, *, digits: int, unit: str) -> None:
        off = [b - a for a, b in zip(measured, simulated, strict=True)]
        signed = " / ".join(f"{value:+.{digits}f}" for value in off)
        rows.append((what, f"{pair(measured, digits)} {unit}", f"{pair(simulated, digits)} {unit}", by, signed))

    rms = [db(noise.rms) for noise in noises.values()]
    rows.append(("noise of an RF sample", f"{pair(rms, 1)} dB", "as measured: gives the unit", "", ""))
    for filter, name in FILTERS.items():
        real, counted = {}, {}
        for matrix in MATRICES:
            recording = read_recording(recordings / EMPTY, matrix=matrix, filter=filter)
            real[matrix] = recording, fit_room(recording)
            room = counted_room(frames[matrix], noises[matrix], recording, filter, bin_m=bin_m)
            counted[matrix] = room, fit_room(room)
        own = unit_db(recording.radar, filter)
        fits, others = ([found[matrix][1] for matrix in MATRICES] for found in (real, counted))
        levels_db, others_db = ([f.noise.power_v2.to_db(10.0).value - own for f in group] for group in (fits, others))
        row(f"noise of a bin, {name}", levels_db, others_db, "counters", digits=1, unit="dB")
        for lag in (1, 2, 3):
            rho, other = ([float(f.noise.correlation[lag].real) for f in group] for group in (fits, others))
            row(f"its correlation {lag} bin{'s' * (lag > 1)} apart, {name}", rho, other, "counters", digits=2, unit="")
            if filter == "chip":
                stated = (*preset.noise_correlation, 0.0, 0.0, 0.0)[lag - 1]
                row("the same", rho, [stated] * 2, "preset", digits=2, unit="")
        if filter == "chip":
            closed_db = 10.0 * np.log10(noise_power_v2(preset)) + db(carrier_gain(filter) / volts)
            row(f"noise of a bin, {name}", levels_db, [closed_db] * 2, "preset", digits=1, unit="dB")
        if filter == "hamming":
            rows += model_rows(real, counted, out)
    return rows, volts


def model_rows(real: Rooms, counted: Rooms, out: Path) -> list[Row]:
    """Compare echoes and phase with rooms drawn from the sensor models."""
    rooms_of: list[list[tuple[Recording, Room]]] = []
    for number, (recording, _) in enumerate(real.values(), start=1):
        model = out / f"x4-sensor-{number}.toml"
        model.write_text(format_preset(fit_sensor(recording)), encoding="utf-8")
        seeds = np.random.SeedSequence([SEED, number]).generate_state(N_ROOMS)
        rooms = [drawn_room(model, frames=recording.n_pulses, seed=int(seed)) for seed in seeds]
        rooms_of.append([(room, fit_room(room)) for room in rooms])
    fits = [fit for _, fit in real.values()]
    rows: list[Row] = []

    def row(what: str, measured: list[float], others: list[list[float]], digits: int, unit: str) -> None:
        means, sds = ([float(f(values)) for values in others] for f in (np.mean, np.std))
        simulated = " / ".join(f"{m:.{digits}f} ± {s:.{digits}f}" for m, s in zip(means, sds, strict=True))
        off = " / ".join(f"{m - a:+.{digits}f}" for a, m in zip(measured, means, strict=True))
        rows.append((what, f"{pair(measured, digits)} {unit}", f"{simulated} {unit}", "sensor model", off))

    for start_m, stop_m in ((0.75, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 6.0), (6.0, 8.0)):

        def median_db(found: tuple[Recording, Room], start_m: float = start_m, stop_m: float = stop_m) -> float:
            inside = (found[0].range_m >= start_m) & (found[0].range_m < stop_m)
            return float(np.median(20.0 * np.log10(np.abs(found[1].echo_v[inside])) - unit_db(found[0].radar)))

        own, *others = ([median_db(found) for found in rooms] for rooms in (real.values(), *rooms_of))
        row(f"static echo, median of {start_m:g} to {stop_m:g} m", own, others, 1, "dB")
    jitter = [1e3 * whole_jitter_rad(fit) for fit in fits]
    thermal = [1e3 * whole_jitter_rad(fit) for _, fit in counted.values()]
    rows.append(
        ("white jitter of the common phase, all of it", f"{pair(jitter, 1)} mrad", f"{pair(thermal, 1)} mrad",
         "counters: thermal noise alone", "")
    )  # fmt: skip
    row("the same", jitter, [[1e3 * whole_jitter_rad(fit) for _, fit in rooms] for rooms in rooms_of], 1, "mrad")
    shares = [common_share(*found) for found in real.values()]
    rows.append(
        (f"phase steps of echoes below and above {NEAR_M:g} m, correlation", pair(shares, 2),
         pair([common_share(*found) for found in counted.values()], 2), "counters: thermal noise alone", "")
    )  # fmt: skip
    row("the same", shares, [[common_share(*found) for found in rooms] for rooms in rooms_of], 2, "")
    root_minute = 60.0**0.5
    walk = [fit.phase.walk_per_root_s.value * root_minute for fit in fits if fit.phase]
    others = [[fit.phase.walk_per_root_s.value * root_minute for _, fit in rooms if fit.phase] for rooms in rooms_of]
    row("phase walk", walk, others, 3, "rad/√min")
    return rows


def person_rows(recordings: Path, volts: float) -> list[Row]:
    """Compare the breathing person."""
    content = loadmat(recordings / BREATHING)
    frames = np.asarray(content["Data_Matrix"], dtype=float)
    rate_hz, bin_m = (float(content[name].item()) for name in ("actual_fps", "bin_length"))
    start_m, time_s = float(content["range_vector"].flat[0]), np.arange(len(frames)) / rate_hz
    behind = content["range_vector"].ravel() >= BEHIND_M
    noise = rf_noise(frames[time_s >= STILL_S][:, behind], frame_rate_hz=rate_hz)
    empty = np.asarray(loadmat(recordings / EMPTY)[MATRICES[0]], dtype=float)
    room = rf_noise(empty, frame_rate_hz=rate_hz)
    law = room.rms * np.sqrt(room.counts / noise.counts)
    rows: list[Row] = [
        (f"breathing: noise of an RF sample ({noise.counts} pulses a threshold, not {room.counts})",
         f"{db(noise.rms):.1f} dB", f"{db(law):.1f} dB", "law, input noise of the empty room",
         f"{db(law) - db(noise.rms):+.1f}")
    ]  # fmt: skip
    stop_m = start_m + frames.shape[1] * bin_m
    radar = Radar.preset("x4", prf_hz=rate_hz, range_start_m=start_m, range_stop_m=stop_m)
    measured = {filter: convert(frames, filter, start_m=start_m, bin_m=bin_m) for filter in FILTERS}
    hosts = person(*measured["hamming"], time_s, start_s=STILL_S)
    chest_m = hosts.swing_rad * radar.wavelength_m / (4.0 * np.pi)
    rng = np.random.default_rng(SEED)
    for what, from_s, amplitude_m in (
        ("whole, chest ±5 mm", 0.0, USUAL_AMPLITUDE_M),
        (f"still, chest ±{1e3 * chest_m:.1f} mm", STILL_S, chest_m),
    ):
        scene = breathing_scene(amplitude_m, float(time_s[-1]))
        echoes_v = sample_rf_frames(assemble(place(scene), time_s), radar, margin=MARGIN)
        samples = echoes_v / volts + law * rng.standard_normal(echoes_v.shape)
        recording = simulate(
            scene, radar, rng=Streams(SEED), conditions=Conditions(noise=Noise(kind="none")), angles=False
        )
        for filter, name in FILTERS.items():
            gain = carrier_gain(filter)
            real = person(*measured[filter], time_s, start_s=from_s)
            converted = convert(samples, filter, start_m=start_m - MARGIN * bin_m, bin_m=bin_m)
            counted = person(*converted, time_s, start_s=from_s)
            closed_form = gain / volts * recording.baseband.values.astype(np.complex128)
            closed = person(closed_form, recording.range_m, recording.slow_time_s, start_s=from_s)
            simulated = [(counted, "counters"), (closed, "preset")] if filter == "chip" else [(counted, "counters")]
            for found, by in simulated:
                rows.append(
                    (f"person, {what}: slow-time deviation, {name}", f"{real.bin_db:.1f} dB", f"{found.bin_db:.1f} dB",
                     by, f"{found.bin_db - real.bin_db:+.1f}")
                )  # fmt: skip
            if filter == "hamming":
                rows.append(
                    (f"person, {what}: breathing rate", f"{real.rate_hz:.3f} Hz", f"{counted.rate_hz:.3f} Hz",
                     "counters", f"{counted.rate_hz - real.rate_hz:+.3f}")
                )  # fmt: skip
    return rows


def main() -> None:
    """Fit, compare and write."""
    options = make_parser(__doc__, recordings="folder of the X4 recordings").parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows, volts = room_rows(options.recordings, Path(folder))
    rows += person_rows(options.recordings, volts)
    own = Radar.preset("x4").volts_per_unit
    words = f"One unit of RF samples is {volts:.4f} V; `volts_per_unit` of the preset is {own}."
    table = markdown(("quantity", "measured, radar 1 / 2", "simulated", "by", "difference"), rows)
    finish(__file__, __doc__, {"Measured and simulated": f"{words}\n\n{table}"}, page=options.page)


if __name__ == "__main__":
    main()

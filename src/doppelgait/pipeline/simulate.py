"""Simulation of recordings from scene and radar."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core import lazy
from doppelgait.core.config import FrozenModel, check_type, validate
from doppelgait.core.errors import ConfigError, explain_memory
from doppelgait.core.files import check_target
from doppelgait.core.labels import ScattererTable, take_columns
from doppelgait.core.rng import Streams, draw_key
from doppelgait.core.samples import Factor, Matrix, Samples, borrow_memory
from doppelgait.core.units import FloatArray, cosine, duration_to_pulses, sine, slow_time_axis_s
from doppelgait.motion.motion import FREQUENCIES
from doppelgait.motion.retime import Spline
from doppelgait.pipeline.radar_table import Conditions, read_radar
from doppelgait.radar.antenna import apply_antenna
from doppelgait.radar.impairments import ThermalNoise, apply_impairments, noise_power_per_sample_v2, shift_pulse_times
from doppelgait.radar.link import fold_scatterers, make_noise_taps
from doppelgait.radar.parameters import Radar
from doppelgait.radar.recording import Recording, TargetTruth
from doppelgait.radar.recordings import read_hdf5, write_recording
from doppelgait.radar.simulate import (
    compress,
    lowest_prf_hz,
    noise_level_v2,
    snr_frame_db,
    strongest_powers_v2,
    synthesise_echoes,
    warn_of_limits,
)
from doppelgait.scene import LineOfSight, PlacedScene, PlacedTarget, RcsSpec, Scene, assemble, compute_body_track
from doppelgait.scene.environment import ENVIRONMENT, Setting, apply_environment, needs_angles
from doppelgait.scene.environment.effects import Mirror
from doppelgait.scene.observe import (
    fit_splines,
    look,
    make_scatterers,
    make_table,
    place_points_at,
    tabulate,
    tabulate_later,
)
from doppelgait.scene.placement import BACKGROUND, as_placed
from doppelgait.scene.rcs import Scatterers

SCENE_REMEDY = (
    "make one with doppelgait.Scene(targets=[...]), or simulate a scene file with "
    "doppelgait.pipeline.run_simulation(doppelgait.Run.from_toml(PATH))"
)
MAX_SAMPLES = 2e9  # largest data matrix: 16 GB of complex64
BODY_RATE_HZ = 60.0
"""Highest rate of the body positions that the truth stores for plots; a screen shows no more."""
DIRECTIONS = ("azimuth", "elevation")
PROBE_RATE_HZ = 500.0
"""Rate at which the speeds of a scene are sampled to find the lowest frame rate."""


@explain_memory
def simulate(
    scene: Scene | PlacedScene,
    radar: Radar | str | Path,
    *,
    rng: Streams | None = None,
    conditions: Conditions | None = None,
    snr_db: float | None = None,
    angles: bool = True,
    path: str | Path | None = None,
) -> Recording:
    """Simulate the recording of a scene by a radar.

    Parameters
    ----------
    scene : Scene or PlacedScene
        Scene to simulate. The motions of a scene that is not placed are placed first, with ``rng``.
    radar : Radar, str or Path
        A string or path is the name of a preset or the ``.toml`` file of a radar, as for the option ``--radar``.
    rng : Streams, optional
        Random streams, for example ``dg.rng(2018)``; the recording is then that of ``seed = 2018`` in a scene file.
        Without random streams the recording is noise-free, and random effects are not allowed.
    conditions : Conditions, optional
        Receiver noise, environment and impairments; by default thermal noise (equation E-18 of
        docs/theory.md) and, for a preset or file, its environment and impairments. Receiver noise
        is added before the impairments; an impairment ``thermal_noise`` replaces it.
    snr_db : float, optional
        SNR_frame to set instead of ``conditions.noise``: time mean of the strongest bin's power over the noise power,
        in dB; ``inf`` for no noise. The power is that of the targets by all paths, without background and clutter.
    angles : bool
        Add the aspect angles of scatterers and the bodies for plots to the truth; False is faster.
    path : str or Path, optional
        File for the recording (HDF5). More than 32,768 pulses are then synthesised tile by tile into the file, so that
        memory hardly grows with the duration. Impairments and environment effects need the whole recording in memory.

    Returns
    -------
    Recording
        With ``path`` that of the file: its source is the file's name, its truth has no angles, and
        more than 32,768 pulses are read from the file on every access.

    Raises
    ------
    ConfigError
        If ``snr_db`` or impairments need random numbers and ``rng`` is missing, or an argument is not allowed.
    OutputError
        If ``path`` cannot be written.

    Warns
    -----
    DoppelgaitWarning
        If a scatterer aliases in Doppler or leaves the frame.

    See Also
    --------
    analyze : analyze a recording.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0), rng=dg.rng(1), snr_db=10.0)
    >>> recording.n_pulses
    1920
    >>> dg.simulate(scene, "x4").radar.prf_hz
    1000.0
    """
    check_type(scene, (Scene, PlacedScene), "scene", SCENE_REMEDY)
    check_type(rng, (Streams, type(None)), "rng", "pass rng=doppelgait.rng(SEED)")
    if isinstance(radar, str | Path):
        streams = rng or Streams(0)
        radar, stated = read_radar(radar, seed=streams.seed, example=streams.example)
        conditions = stated if conditions is None else conditions
    check_type(radar, Radar, "radar", 'name a preset ("x4"), or make one with doppelgait.Radar.preset("x4")')
    conditions = conditions if conditions is not None else Conditions()
    check_type(conditions, Conditions, "conditions", "make them with doppelgait.Conditions(impairments=[...])")
    check_type(snr_db, (float, int, type(None)), "snr_db", "give a number of dB")
    if snr_db is None and conditions.noise.kind == "snr":
        snr_db = conditions.noise.snr_db
    if snr_db is not None and rng is None and not math.isinf(snr_db):
        raise ConfigError(f"snr_db = {snr_db} adds noise, which needs rng: pass rng=doppelgait.rng(SEED)")
    if conditions.impairments and rng is None:
        raise ConfigError("impairments draw random numbers: pass rng=doppelgait.rng(SEED)")
    if snr_db is not None and conditions.has_impairment("thermal_noise"):
        raise ConfigError(
            f"snr_db = {snr_db:g} and an impairment thermal_noise both set the noise level: leave one out"
        )
    check_type(path, (str, Path, type(None)), "path", 'name a file, for example "walk.h5"')
    target = None if path is None else check_target(path)
    placed = as_placed(scene, rng)
    slow_time_s = pulse_times_s(placed.observation_s, radar)
    scatterers, tracks = observe_scene(placed, radar, slow_time_s, conditions, angles=angles, streams=rng)
    warn_of_limits(scatterers, radar, has_jumps=any(t.motion.report.get("has_jumps") for t in placed.targets))
    # only impairments need the samples before the range transform
    echoes = Echoes(scatterers, radar, compressed=not conditions.impairments)
    strongest_v2: list[npt.NDArray[np.float32]] = []
    tiles, samples = echoes.make_tiles(strongest_v2), None
    if target is None or conditions.impairments or slow_time_s.size <= lazy.LONG_PULSES:
        n_samples = radar.waveform.n_samples(radar) if conditions.impairments else radar.n_range_bins
        samples = Samples.join(tiles, (slow_time_s.size, n_samples))
    for _ in tiles:  # tiles for a file are made for their level, and again when they are written
        pass
    signal_v2 = float(np.concatenate(strongest_v2).mean(dtype=np.float64))
    thermal = [spec for spec in conditions.impairments if isinstance(spec, ThermalNoise)]
    noise_v2, gain = 0.0, radar.waveform.noise_gain(radar)  # mean square in a range bin, and over that in a sample
    noise: NoiseLevel | None = None
    if thermal:
        noise_v2 = sum(noise_power_per_sample_v2(spec, radar) for spec in thermal) * gain
    elif rng is not None and (snr_db is not None or conditions.noise.kind != "none"):
        noise_v2 = noise_level_v2(radar, signal_v2, snr_db)
        if noise_v2 > 0:
            noise = draw_key(rng.generator("noise")), noise_v2 / gain, make_noise_taps(radar)
    if samples is None:
        samples = Samples.stored((slow_time_s.size, radar.n_range_bins), partial(echoes.read_noisy, noise))
    else:
        samples = echoes.add_noise(samples, noise)
    if rng is not None:  # noise first, then the impairments in order
        _, samples_rng = rng.generator("impairments").spawn(2)
        samples = apply_impairments(samples, conditions.impairments, radar=radar, rng=samples_rng)
    # the truth stores the bodies for plots, at the rate of a screen
    shown_s = slow_time_s[:: math.ceil(radar.prf_hz / BODY_RATE_HZ)] if angles else None
    recording = Recording(
        echoes.compress(samples),
        radar,
        slow_time_s,
        radar.range_axis_m(),
        truth=[
            build_target_truth(target, placed.observation_s, scatterers, track, shown_s=shown_s)
            for target, track in zip(placed.observed, tracks, strict=True)
        ],
        noise_power_v2=noise_v2,
        snr_frame_db=snr_frame_db(signal_v2, noise_v2),
        seed=None if rng is None else rng.seed,
        source="simulation",
        radar_position_m=placed.scene.radar_position_m,
        radar_azimuth_deg=placed.scene.radar_azimuth_deg,
        radar_tilt_deg=placed.scene.radar_tilt_deg,
    )
    if target is None:
        return recording
    write_recording(recording, target)
    return read_hdf5(target)


NoiseLevel = tuple[int, float, Factor]
"""Key, mean square (V^2), and filter taps over range of the receiver noise."""
ECHO_VARIABLES = ("range", "radial_velocity", "rcs", "path_gain", "path_phase")


@dataclass(frozen=True)
class Echoes:
    """Echoes of a scatterer table as range bins, or as samples unless compressed."""

    scatterers: ScattererTable
    radar: Radar
    compressed: bool

    def compress(self, samples: Samples) -> Samples:
        """Compress samples to range bins, unless they are."""
        if self.compressed or self.radar.waveform.samples_are_bins:
            return samples
        return Samples.own(compress(samples.matrix, self.radar))

    def make_tile(self, first: int, stop: int) -> tuple[Samples, npt.NDArray[np.float32]]:
        """Synthesise some pulses; also return the targets' strongest power per pulse, V^2."""
        # background bodies are added to the targets' echoes of all paths, which set the level
        values = {name: self.scatterers[name] for name in ECHO_VARIABLES if name in self.scatterers}
        table = replace(self.scatterers, values=values).take_pulses(slice(first, stop))
        table = fold_scatterers(table, self.radar)
        background = table["target"] == BACKGROUND
        targets = table.take(~background) if background.any() else table
        samples = synthesise_echoes(targets, self.radar, compressed=self.compressed)
        strongest_v2 = strongest_powers_v2(self.compress(samples))
        if background.any():
            samples += synthesise_echoes(table.take(background), self.radar, compressed=self.compressed)
        return samples, strongest_v2

    def make_tiles(self, strongest_v2: list[npt.NDArray[np.float32]]) -> Iterator[Samples]:
        """Synthesise all pulses without noise, tile by tile, and append their strongest powers."""
        n_pulses = self.scatterers.slow_time_s.size
        for first in range(0, n_pulses, lazy.LONG_PULSES):
            samples, powers_v2 = self.make_tile(first, min(first + lazy.LONG_PULSES, n_pulses))
            strongest_v2.append(powers_v2)
            yield samples

    def add_noise(self, samples: Samples, noise: NoiseLevel | None, first_pulse: int = 0) -> Samples:
        """Add the noise of the receiver's samples to the pulses from ``first_pulse``."""
        if noise is None:
            return samples
        if self.radar.waveform.samples_are_bins or not self.compressed:
            return samples.with_noise(*noise, first_pulse=first_pulse)
        silent = np.zeros((samples.shape[0], self.radar.waveform.n_samples(self.radar)), dtype=np.complex64)
        heard = Samples.own(silent).with_noise(*noise, first_pulse=first_pulse)
        samples += compress(heard.matrix, self.radar)
        return samples

    def read_noisy(self, noise: NoiseLevel | None, first: int, stop: int) -> Matrix:
        """Return some pulses of the recording, (stop - first, bins)."""
        return self.add_noise(self.make_tile(first, stop)[0], noise, first).matrix


def observe_scene(
    scene: Scene | PlacedScene,
    radar: Radar,
    slow_time_s: FloatArray,
    conditions: Conditions,
    *,
    angles: bool,
    streams: Streams | None,
) -> tuple[ScattererTable, list[LineOfSight]]:
    """Observe a scene through its environment and the antenna. Shapes: slow_time_s (I,)."""
    placed, times_s = as_placed(scene, streams), slow_time_s
    if conditions.impairments and streams is not None:
        timing_rng, _ = streams.generator("impairments").spawn(2)
        times_s = shift_pulse_times(slow_time_s, conditions.impairments, radar=radar, rng=timing_rng)
    directions = radar.antenna.kind != "isotropic" or needs_angles(conditions.environment)
    scene_rng = None if streams is None else streams.generator("scene")
    room = placed.scene
    tracks = [compute_body_track(target, room, times_s) for target in placed.observed]
    setting = Setting(radar.wavelength_m, room.radar_position_m, math.radians(room.radar_azimuth_deg))
    tilt_rad = math.radians(room.radar_tilt_deg)

    def through(table: ScattererTable) -> ScattererTable:
        table = apply_environment(table, conditions.environment, setting)
        boresight = {"boresight_azimuth_rad": setting.radar_azimuth_rad, "boresight_tilt_rad": tilt_rad}
        return apply_antenna(table, radar.antenna, **boresight)

    bodies = make_scatterers(placed, times_s, radar.wavelength_m, scene_rng)
    wanted = ("azimuth", "elevation", "aspect") if angles else ()
    scatterers: ScattererTable | None = None
    if directions:
        scatterers = apply_room(placed, bodies, times_s, wanted, conditions.environment, through)
    elif times_s.size > lazy.LONG_PULSES and not conditions.environment and room.receiver_position_m is None:
        scatterers = tabulate_later(placed, bodies, times_s, wanted)
    if scatterers is None:
        scatterers = through(tabulate(placed, bodies, times_s, wanted or (DIRECTIONS if directions else ())))
    if times_s is not slow_time_s:
        scatterers = replace(scatterers, slow_time_s=slow_time_s)
    return scatterers, tracks


def pulse_times_s(observation_s: float, radar: Radar) -> FloatArray:
    """Compute the pulse times of a scene, which must not be too short or too large."""
    slow_time_s = radar.pulse_times_s(observation_s)
    if slow_time_s.size < 2:
        few = f"a burst of {radar.burst_pulses}" if radar.burst_pulses else "two"
        raise ConfigError(f"{observation_s} s at prf_hz = {radar.prf_hz:g} is less than {few} frames; observe longer")
    if slow_time_s.size * radar.n_range_bins > MAX_SAMPLES:
        raise ConfigError(
            f"{slow_time_s.size} frames of {radar.n_range_bins} range bins are more than {MAX_SAMPLES:g} samples; "
            "observe less long, or narrow the frame (radar.range_start_m, range_stop_m)"
        )
    return slow_time_s


def build_target_truth(
    placed: PlacedTarget,
    observation_s: float,
    scatterers: ScattererTable,
    centre: LineOfSight,
    *,
    shown_s: FloatArray | None = None,
) -> TargetTruth:
    """Build a target's truth from the simulation's geometry."""
    # gait frequencies are those of the touchdowns in the observation, NaN if unknown
    own = scatterers["target"] == placed.number
    rows = scatterers if own.all() else scatterers.take(own)
    facts = placed.motion.facts
    frequencies_hz = {key: getattr(facts, key) for key in FREQUENCIES}
    if facts.path is None or facts.path.pause_s <= 0:  # with pauses already a mean over the time not paused
        start_s = float(placed.motion.time_s[0])
        found = []
        for touchdowns_s in (np.asarray(times_s) for times_s in facts.footfalls.values() if len(times_s) > 1):
            # strides of one foot between touchdowns in the observation, or those just outside
            first, stop = np.searchsorted(touchdowns_s, [start_s - 1e-9, start_s + observation_s + 1e-9])
            while stop - first < 2:
                first, stop = max(first - 1, 0), min(stop + 1, touchdowns_s.size)
            found.append(float((stop - first - 1) / (touchdowns_s[stop - 1] - touchdowns_s[first])))
        factor = float(np.mean(found)) / frequencies_hz["stride_frequency_hz"] if found else 1.0
        if not math.isclose(factor, 1.0, rel_tol=1e-9):  # touchdowns are roots of a spline: keep a regular gait exact
            frequencies_hz = {key: factor * hz for key, hz in frequencies_hz.items()}
    return TargetTruth(
        label=placed.target.label,
        scatterers=rows,  # type: ignore[arg-type]
        centre_range_m=centre.range_m,
        centre_velocity_mps=centre.radial_velocity_mps,
        centre_aspect_rad=centre.aspect_rad,
        ground_speed_mps=placed.ground_speed_mps,
        gait=facts.gait,
        subject=facts.subject,
        motion=facts.source,
        height_m=facts.height_m,
        **frequencies_hz,
        body=None if shown_s is None else place_points_at(placed, shown_s[placed.is_there(shown_s)]),  # type: ignore[arg-type]
    )


def choose_lowest_prf(scene: Scene | PlacedScene, radar: Radar, *, cpi_s: float) -> Radar:
    """Return the radar at the lowest unaliased frame rate (E-06)."""
    placed = as_placed(scene)
    probe_s = slow_time_axis_s(duration_to_pulses(placed.observation_s, PROBE_RATE_HZ), PROBE_RATE_HZ)
    # points, whatever the cross section: a limb shows the speeds of its ends, which are points,
    # and not of its slower middle
    points = {"rcs": RcsSpec()}
    seen = [replace(one, target=one.target.model_copy(update=points)) for one in placed.targets]
    table = assemble(replace(placed, targets=tuple(seen)), probe_s, angles=False)
    prf_hz = lowest_prf_hz(table, radar, cpi_s)
    return validate(Radar, {**radar.model_dump(), "prf_hz": prf_hz}, where="radar")


GAIN_STEP_S = 0.0125  # longest time between two computations of the gains
MIN_LOOKS = 5
MAX_TURN_RAD = 0.018  # largest change of a scatterer's direction between two computations
MAX_CHANGE = 0.25
"""Largest change of an amplitude between two computations, relative to its maximum; a larger change is a jump."""


def apply_room(
    placed: PlacedScene,
    bodies: Sequence[Scatterers],
    times_s: FloatArray,
    wanted: Sequence[str],
    effects: Sequence[FrozenModel],
    through: Callable[[ScattererTable], ScattererTable],
) -> ScattererTable | None:
    """Observe a scene through the effects of a room; None where they are needed at every pulse."""
    # Ranges are exact at every pulse, also of mirror images. Gains, phases and delays of walls depend on directions,
    # which change little in a hundredth of a second: they are computed 80 times per second and interpolated by cubic
    # splines. The error is below 1e-4 of the strongest echo for a sprinter or a galloping dog half a metre from a wall.
    smooth = all(ENVIRONMENT.of(spec).facts.get("is_smooth", False) for spec in effects)
    if not smooth or placed.scene.receiver_position_m is not None or not bodies:
        return None
    splines = fit_splines(bodies)
    # scatterers of unit cross section at the computation times
    alike = [replace(b, rcs_m2=np.ones(len(b.motion.markers)), path_gain=np.ones(1), phase_rad=None) for b in bodies]
    n_looks = max(math.ceil(float(np.ptp(times_s)) / GAIN_STEP_S) + 1, MIN_LOOKS)
    while 2 * n_looks <= times_s.size:
        looks_s = np.linspace(times_s.min(), times_s.max(), n_looks)
        seen = look(placed.scene, alike, splines, looks_s, ("azimuth", "elevation"))
        elevation, azimuth = seen["elevation"], seen["azimuth"]
        level = cosine(elevation)
        aside = level[1:] * sine(np.diff(azimuth, axis=0) / 2.0) * 2.0
        turned2 = np.square(np.diff(elevation, axis=0)) + np.square(aside)
        closer = math.sqrt(float(turned2.max(initial=0.0))) / MAX_TURN_RAD
        if closer <= 1.0:
            break
        n_looks = math.ceil(1.2 * closer * n_looks)
    else:
        return None
    before = make_table(placed, alike, looks_s, seen)
    after = through(before)
    amplitude = np.sqrt(after["path_gain"])
    if (np.abs(np.diff(amplitude, axis=0)).max(axis=0) > MAX_CHANGE * amplitude.max(axis=0)).any():
        return None
    mirrors: tuple[Mirror, ...] = after.attrs.get("mirrors", ())
    n_rows, n_own = after.shape[1], before.shape[1]
    values = look(placed.scene, bodies, splines, times_s, wanted, n_rows - n_own)
    range_m, velocity_mps = values["range"], values["radial_velocity"]
    _fill_images(range_m, velocity_mps, splines, placed, times_s, mirrors)
    geometric_m, rates_mps = np.empty((2, *after.shape))
    geometric_m[:, :n_own], rates_mps[:, :n_own] = before["range"], before["radial_velocity"]
    _fill_images(geometric_m, rates_mps, splines, placed, looks_s, mirrors)
    delay_m = after["range"] - geometric_m
    if np.abs(delay_m).max(initial=0.0) > 1e-9:  # delay of a wall, above rounding errors
        range_m += _interpolate_table(delay_m, looks_s, times_s)
        velocity_mps -= _interpolate_table(np.gradient(delay_m, looks_s, axis=0, edge_order=2), looks_s, times_s)
    gain = _interpolate_table(amplitude, looks_s, times_s)
    np.square(gain, out=gain)
    sources = np.arange(n_rows)
    for mirror in mirrors:
        sources[mirror.first : mirror.first + 2 * len(mirror.sources)] = 2 * mirror.sources
    values |= {name: take_columns(values[name], sources) for name in {"rcs", "path_phase"} & values.keys()}
    values["path_gain"] = gain * take_columns(values["path_gain"], sources)
    if "path_phase" in after:
        phase_rad = after["path_phase"]
        if np.abs(np.diff(phase_rad, axis=0)).max(initial=0.0) > np.pi:
            phase_rad = np.unwrap(phase_rad, axis=0)
        values["path_phase"] = values.get("path_phase", 0.0) + _interpolate_table(phase_rad, looks_s, times_s)
    for name in wanted:
        values[name][:, n_own:] = np.nan
    return ScattererTable(times_s, values, after.columns)


def _fill_images(
    range_m: FloatArray,
    velocity_mps: FloatArray,
    splines: Sequence[Spline],
    placed: PlacedScene,
    times_s: FloatArray,
    mirrors: Sequence[Mirror],
) -> None:
    """Compute ranges and velocities of images from those of the scatterers, the first columns."""
    for mirror in mirrors:
        sources, distance_m = np.array(mirror.sources, dtype=np.int64), mirror.radar_distance_m
        size, axes = sources.size, [(axis, n) for axis, n in enumerate(mirror.normal) if n]
        from_plane = distance_m - sum(n * placed.scene.radar_position_m[axis] for axis, n in axes)
        column, out = 0, (range_m, velocity_mps)
        for spline in splines:  # a distance from a plane is a spline as well
            heights, moments = (
                np.add.reduce([n * part[:, axis::3] for axis, n in axes]) for part in (spline.values, spline.moments)
            )
            own = np.flatnonzero((sources >= column) & (sources < column + heights.shape[1]))
            for run in np.split(own, np.flatnonzero(np.diff(sources[own]) != 1) + 1) if own.size else ():
                source, first = int(sources[run[0]]), mirror.first + int(run[0])
                chosen = slice(source - column, sources[run[-1]] - column + 1)
                above = heights[:, chosen] + from_plane, moments[:, chosen], spline.step_s
                native.image_ranges(*above, times_s, source, distance_m, first, first + size, *out)
            column += heights.shape[1]


def _interpolate_table(values: FloatArray, looks_s: FloatArray, times_s: FloatArray) -> FloatArray:
    heights = np.ascontiguousarray(values)
    moments, step_s = np.empty_like(heights), float(looks_s[1] - looks_s[0])
    native.spline_moments(heights, step_s, moments)
    out = borrow_memory((times_s.size, heights.shape[1]), np.float64)
    native.values_between(heights, moments, step_s, times_s - looks_s[0], out)
    return out

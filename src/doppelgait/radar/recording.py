"""A radar recording: samples, radar, and truth of simulated targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.config import format_canonical_json
from doppelgait.core.errors import ConfigError, RecordingError
from doppelgait.core.frames import Frames, SlowTime
from doppelgait.core.labels import AnyTable, ScattererTable, labels_on_demand, read_axis
from doppelgait.core.lazy import read_tiles, xr
from doppelgait.core.notebook import plot, show_html, show_text
from doppelgait.core.plugins import Group
from doppelgait.core.samples import Samples
from doppelgait.core.units import velocity_to_doppler_hz
from doppelgait.radar.parameters import Radar

if TYPE_CHECKING:  # pyright takes a cached property for no property: functions of viz would reject a recording
    from builtins import property as cached_property
else:
    from functools import cached_property

NAN = float("nan")
_ARRAYS: Group[Any] = Group("radar_reader", ("doppelgait.radar.readers.arrays",), listed=False)
"""Reader of arrays, which imports this module."""


@labels_on_demand("scatterers", "body")
@dataclass(frozen=True)
class TargetTruth:
    """Simulation truth of one target.

    Parameters
    ----------
    label, gait, subject, motion : str
        Class, gait, person or animal, and the motion's source; ``""`` when unknown.
    scatterers : Dataset (slow_time, scatterer)
        The target's rows of the scatterer table: range, radial velocity, aspect, radar cross section.
    centre_range_m, centre_velocity_mps, centre_aspect_rad : ndarray, shape (I,)
        Body centre: range, radial velocity (positive approaching), aspect psi; NaN while it is away.
    ground_speed_mps : float
        Mean speed over ground during the observation.
    height_m : float
        Stature or withers height, NaN when unknown.
    stride_frequency_hz, step_frequency_hz, gait_frequency_hz : float
        Means over the observation, NaN when unknown (E-07).
    body : DataArray (time, marker, space), optional
        Positions of the body's points, for plots: at most 60 positions per second, in the frame of
        the scene (floor at z = 0).
    """

    label: str
    scatterers: xr.Dataset
    centre_range_m: npt.NDArray[np.float64]
    centre_velocity_mps: npt.NDArray[np.float64]
    centre_aspect_rad: npt.NDArray[np.float64]
    ground_speed_mps: float = NAN
    gait: str = ""
    subject: str = ""
    motion: str = ""
    height_m: float = NAN
    stride_frequency_hz: float = NAN
    step_frequency_hz: float = NAN
    gait_frequency_hz: float = NAN
    body: xr.DataArray | None = None

    @property
    def table(self) -> AnyTable:
        """Scatterers, as plain arrays if a simulation made them."""
        return vars(self)["scatterers"]  # type: ignore[no-any-return]

    def doppler_hz(self, wavelength_m: float) -> npt.NDArray[np.float64]:
        """Return the true Doppler shift of every scatterer, 2 v_r / lambda, shape (I, L) (E-05)."""
        values = velocity_to_doppler_hz(np.asarray(self.table["radial_velocity"]), wavelength_m)
        return np.where(np.isnan(self.centre_range_m)[:, np.newaxis], np.nan, values)

    def during(self, pulses: slice, start_s: float, stop_s: float) -> TargetTruth:
        """Return the truth at a range of pulses, with unchanged means."""
        arrays = {name: getattr(self, name)[pulses] for name in CENTRE_ARRAYS}
        body = self.body
        if body is not None:
            times_s = read_axis(body, "time")
            body = body.isel(time=np.flatnonzero((times_s >= start_s) & (times_s < stop_s)))
            body = body if body.sizes["time"] else None
        table = self.table
        table = table.take_pulses(pulses) if isinstance(table, ScattererTable) else table.isel(slow_time=pulses)
        return replace(self, scatterers=table, body=body, **arrays)  # type: ignore[arg-type]


CENTRE_ARRAYS = ("centre_range_m", "centre_velocity_mps", "centre_aspect_rad")
"""Fields of a target's truth with one value per pulse."""
SLACK_S = 1e-9
"""Tolerance for the rounding of pulse times, s."""


@dataclass(frozen=True, eq=False)
class Recording:
    """One recording.

    Parameters
    ----------
    samples : Samples, shape (pulses, range bins)
        Complex baseband, V; read-only.
    radar : Radar
    slow_time_s, range_m : ndarray, shape (pulses,), (range bins,)
        Times of the pulses, ranges of the bins.
    facts : mapping
        Further facts about the samples in a file, for example ``burst_pulses``.
    truth : sequence of TargetTruth
        Empty for measured recordings.
    noise_power_v2 : float
        Mean square of the added receiver noise; NaN if unknown.
    snr_frame_db : float
        SNR of a frame, computed from separate signal and noise; inf without noise, NaN if unknown.
    seed : int, optional
        Seed of the simulation.
    source : str
        File name, or origin of the recording.
    notes : sequence of str
        Values that the file does not state and that were assumed or set by options; empty for simulated recordings.
    radar_position_m : (float, float, float), optional
        Position of the radar in the frame of the scene; None for measured recordings.
    radar_azimuth_deg, radar_tilt_deg : float
        Direction of the antenna: from +x towards +y, and up from the horizontal.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> recording.n_pulses, recording.radar.prf_hz, recording.radar.n_range_bins
    (4000, 1000.0, 188)
    """

    samples: Samples
    radar: Radar
    slow_time_s: npt.NDArray[np.float64]
    range_m: npt.NDArray[np.float64]
    facts: Mapping[str, Any] = field(default_factory=dict)
    truth: Sequence[TargetTruth] = ()
    noise_power_v2: float = NAN
    snr_frame_db: float = NAN
    seed: int | None = None
    source: str = ""
    notes: Sequence[str] = ()
    radar_position_m: tuple[float, float, float] | None = None
    radar_azimuth_deg: float = 0.0
    radar_tilt_deg: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "samples", self.samples.freeze())
        object.__setattr__(self, "truth", tuple(self.truth))
        object.__setattr__(self, "notes", tuple(self.notes))
        if self.radar.burst_pulses is not None and "burst_pulses" not in self.facts:
            object.__setattr__(self, "facts", {**self.facts, "burst_pulses": self.radar.burst_pulses})

    @classmethod
    def from_baseband(cls, baseband: xr.DataArray, radar: Radar, **facts: Any) -> Recording:
        """Make a recording from an array (slow_time, range), V; its attributes become facts."""
        frames = Frames.of(baseband)
        further = {name: value for name, value in frames.facts.items() if name != "radar"}
        return cls(frames.samples, radar, frames.slow_time.time_s, frames.range_m, facts=further, **facts)

    @classmethod
    def from_array(
        cls,
        iq: npt.ArrayLike,
        *,
        slow_time_s: npt.ArrayLike | None = None,
        range_m: npt.ArrayLike | None = None,
        **options: Any,
    ) -> Recording:
        """Make a recording of plain samples, as the reader of NumPy files makes it.

        Parameters
        ----------
        iq : array_like
            Complex, of shape (pulses, range bins), or (pulses,) for a continuous wave. Real with I and Q along a last
            axis of 2, or real of shape (pulses,): the one output of a module, which has no direction.
        slow_time_s, range_m : array_like, optional
            Times of the pulses, as they were stamped, and ranges of the bins.
        **options
            ``prf_hz``, ``carrier_hz``, ``range_start_m``, ``bin_spacing_m``, ``conjugate``,
            ``scale_v``, ``time_first`` and ``radar``, a :class:`Radar` or the name of a preset.

        Raises
        ------
        RecordingError
            If a fact is missing or not allowed, or the array has no such shape.

        Examples
        --------
        >>> import doppelgait as dg
        >>> import numpy as np
        >>> iq = np.exp(2j * np.pi * 80 * np.arange(1000) / 500)
        >>> dg.Recording.from_array(iq, prf_hz=500, carrier_hz=24e9).n_pulses
        1000
        """
        axes = {"slow_time_s": slow_time_s, "range_m": range_m}
        arrays = {name: None if axis is None else np.asarray(axis) for name, axis in axes.items()}
        recording: Recording = _ARRAYS["arrays"].facts["make"](np.asarray(iq), arrays, options)
        check_plausible(recording, "array")
        return recording

    def with_baseband(self, baseband: xr.DataArray, **changes: Any) -> Recording:
        """Return the recording with other samples and further changes, such as ``truth=()`` for other pulses."""
        frames = Frames.of(baseband)
        if self.truth and "truth" not in changes and frames.n_pulses != self.n_pulses:
            raise RecordingError(
                f"{self.source or 'recording'}: the new samples have {frames.n_pulses} pulses, but the truth has "
                f"{self.n_pulses}; take a part with between(), or drop the truth: with_baseband(..., truth=())"
            )
        further = {name: value for name, value in frames.facts.items() if name != "radar"}
        return self.with_frames(frames, **{"facts": further, **changes})

    def with_frames(self, frames: Frames, **changes: Any) -> Recording:
        """Return the recording with other frames and further changes."""
        times_s, range_m = frames.slow_time.time_s, frames.range_m
        return replace(self, samples=frames.samples, slow_time_s=times_s, range_m=range_m, **changes)

    def between(self, start_s: float, stop_s: float) -> Recording:
        """Return the part of the recording between two times.

        Parameters
        ----------
        start_s, stop_s : float
            The part has the pulses with start_s <= time < stop_s; these limits may be outside the
            recording. If the ``facts`` have ``burst_pulses``, only complete bursts are included.

        Returns
        -------
        Recording
            Part with unchanged pulse times. Means in the truth (speed, frequencies) stay those of
            the whole recording, and the SNR of the part is unknown.

        Raises
        ------
        ConfigError
            If the times do not rise, or fewer than two pulses lie between them.

        Examples
        --------
        >>> import doppelgait as dg
        >>> scene = dg.Scene(targets=[dg.Target(motion=dg.motion.generate("human", duration_s=2.0))])
        >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=500.0))
        >>> part = recording.between(0.5, 1.5)
        >>> part.n_pulses, float(part.slow_time_s[0])
        (500, 0.5)
        """
        where = f"{self.source or 'recording'}: between {start_s:g} and {stop_s:g} s"
        if not start_s < stop_s:
            raise ConfigError(f"{where}: the times must rise, for example 2 and 6 s")
        first, stop = (int(np.searchsorted(self.slow_time_s, time_s - SLACK_S)) for time_s in (start_s, stop_s))
        burst = int(self.facts.get("burst_pulses", 1))
        first, stop = -(-first // burst) * burst, stop // burst * burst if stop < self.n_pulses else stop
        if stop - first < 2:
            raise ConfigError(
                f"{where} are {max(stop - first, 0)} pulses, at least 2 are needed; the recording has "
                f"{self.n_pulses} from {self.slow_time_s[0]:g} to {self.slow_time_s[-1]:g} s"
            )
        pulses = slice(first, stop)
        return self.with_frames(
            self.frames.take_pulses(pulses),
            truth=[truth.during(pulses, start_s, stop_s) for truth in self.truth],
            **({"snr_frame_db": NAN} if stop - first < self.n_pulses else {}),
        )

    def split_at_pauses(self) -> list[Recording]:
        """Return the parts between pauses, each with its own rate; those of one pulse are left out."""
        pieces = self.frames.slow_time.find_pieces()
        if len(pieces) == 1:
            return [self]
        parts = []
        for piece in (piece for piece in pieces if piece.stop - piece.start > 1):
            times_s = self.slow_time_s[piece]
            part = self.between(times_s[0], times_s[-1] + 2 * SLACK_S)
            rate_hz = part.frames.slow_time.rate_hz
            parts.append(replace(part, radar=self.radar.model_copy(update={"prf_hz": rate_hz})))
        return parts

    @cached_property
    def baseband(self) -> xr.DataArray:
        """Labelled samples (slow_time, range), V; of a long file they are read at every access."""
        return self.frames.label({**make_baseband_facts(self.radar), **self.facts})

    @cached_property
    def frames(self) -> Frames:
        """Samples with slow time and range axis, without labels."""
        share = self.radar.waveform.independent_bins(self.radar)
        facts = {**({"independent_bin_share": share} if share < 1.0 else {}), **self.facts}
        burst = self.facts.get("burst_pulses")
        slow_time = SlowTime(self.slow_time_s, None if burst is None else int(burst))
        return Frames(self.samples, slow_time, self.range_m, facts)

    def __repr__(self) -> str:
        return show_text("Recording", self._facts())

    def _repr_html_(self) -> str:
        return show_html("Recording", self._facts(), "recording", self)

    def _facts(self) -> dict[str, str]:
        return {
            "source": self.source,
            "radar": self.radar.name or self.radar.waveform.kind,
            "pulses": f"{self.n_pulses} in {self.observation_s:.4g} s",
            "range bins": f"{self.n_range_bins}, {self.range_m[0]:.4g} to {self.range_m[-1]:.4g} m",
            "targets": ", ".join(truth.label or "target" for truth in self.truth),
            "seed": "" if self.seed is None else str(self.seed),
        }

    def plot(self, *, ax: Any = None, **settings: Any) -> Any:
        """Plot the range-time map on axes or a new figure by :func:`doppelgait.viz.range_time`."""
        return plot("recording", self, ax=ax, **settings)

    @property
    def n_pulses(self) -> int:
        """Number of pulses, I."""
        return self.samples.shape[0]

    @property
    def n_range_bins(self) -> int:
        """Number of range bins, N."""
        return self.samples.shape[1]

    @property
    def observation_s(self) -> float:
        """Observation time T_o, until the end of the last pulse, with pauses between bursts."""
        return float(self.slow_time_s[-1] - self.slow_time_s[0]) + 1.0 / self.radar.prf_hz

    @property
    def independent_bin_share(self) -> float:
        """Independent noise values per range bin; below 1 if a window correlates bins."""
        share = self.facts.get("independent_bin_share")
        return self.radar.waveform.independent_bins(self.radar) if share is None else float(share)


def concat(recordings: Sequence[Recording], *, gap_s: float | None = None) -> Recording:
    """Join recordings of one radar, one after the other in time.

    Parameters
    ----------
    recordings : sequence of Recording
        They have the same radar and the same ranges.
    gap_s : float, optional
        Pause from one to the next, in addition to a pulse interval; by their times by default.

    Returns
    -------
    Recording
        The samples of all, without truth, seed and SNR, which describe one simulation.

    Raises
    ------
    RecordingError
        If there are none, radars or ranges differ, or the times do not follow one another and ``gap_s`` is missing.

    Examples
    --------
    >>> import doppelgait as dg
    >>> import numpy as np
    >>> part = dg.Recording.from_array(np.ones(100, complex), prf_hz=100, carrier_hz=24e9)
    >>> dg.radar.concat([part, part], gap_s=2.0).observation_s
    4.0
    """
    if not recordings:
        raise RecordingError("concat: there are no recordings; give one or more")
    if gap_s is not None and not (np.isfinite(gap_s) and gap_s >= 0):
        raise RecordingError(f"concat: gap_s = {gap_s!r} is not allowed; it must be 0 s or more")
    first, times = recordings[0], [recordings[0].slow_time_s]
    for number, one in enumerate(recordings[1:], start=1):
        where = f"concat: recording {number} ({one.source or 'without a name'})"
        if one.radar != first.radar or one.facts.get("burst_pulses") != first.facts.get("burst_pulses"):
            raise RecordingError(f"{where} is of another radar than the first; join recordings of one radar")
        if not np.array_equal(one.range_m, first.range_m):
            raise RecordingError(f"{where} has other ranges than the first; join recordings of the same ranges")
        epochs = [float(each.facts.get("epoch_s", 0.0)) for each in (first, one)]
        start_s, end_s = float(one.slow_time_s[0]), float(times[-1][-1])
        shift_s = epochs[1] - epochs[0] if gap_s is None else end_s + gap_s + 1.0 / one.radar.prf_hz - start_s
        if start_s + shift_s <= end_s:
            raise RecordingError(
                f"{where} begins at {start_s + shift_s:.4g} s, but the one before ends at {end_s:.4g} s; give gap_s"
            )
        times.append(one.slow_time_s + shift_s)
    powers = {one.noise_power_v2 for one in recordings}
    shares = [float(one.facts.get("lost_frame_share", 0.0)) for one in recordings]
    return replace(
        first,
        facts={**first.facts, **({"lost_frame_share": max(shares)} if any(shares) else {})},
        samples=Samples(np.concatenate([one.samples.matrix for one in recordings])),
        slow_time_s=np.concatenate(times),
        truth=(),
        noise_power_v2=powers.pop() if len(powers) == 1 else NAN,
        snr_frame_db=NAN,
        seed=None,
        source=" + ".join(dict.fromkeys(one.source for one in recordings if one.source)),
        notes=list(dict.fromkeys(note for one in recordings for note in one.notes)),
    )


PULSES_OFF = 0.05
"""Maximum relative difference of the pulse rate and the times of the pulses."""
RANGES_M = (-1e3, 1e6)
TIMES_S = (-1e12, 1e12)
LONGEST_S = 366 * 86_400.0
FASTEST_MPS = 1e4


def check_plausible(recording: Recording, where: str) -> None:
    """Check that axes and facts are plausible for a radar; readers check the samples."""
    times_s, range_m = recording.slow_time_s, recording.range_m
    for key, values, (low, high) in (("slow_time_s", times_s, TIMES_S), ("range_m", range_m, RANGES_M)):
        fault = np.flatnonzero(~((low <= values) & (values <= high)))
        if fault.size:
            _refuse(where, f"{key}[{fault[0]}]", f"{values[fault[0]]:g}", f"allowed are {low:g} to {high:g}")
        falls = np.flatnonzero(~(np.diff(values) > 0))
        if falls.size:
            before, value = values[falls[0]], values[falls[0] + 1]
            _refuse(where, f"{key}[{falls[0] + 1}]", f"{value:g}", f"it must rise, and the one before is {before:g}")
    if times_s.size < 2 or times_s[-1] - times_s[0] > LONGEST_S:
        said = f"{times_s.size} pulses" if times_s.size < 2 else f"{times_s[-1] - times_s[0]:g} s"
        _refuse(where, "the duration", said, f"allowed are 2 pulses to {LONGEST_S:g} s")
    burst = recording.facts.get("burst_pulses", 1)
    if isinstance(burst, bool) or not isinstance(burst, int | np.integer) or burst < 1:
        _refuse(where, "burst_pulses", repr(burst)[:40], "it must be a whole number from 1")
    steps_s, prf_hz = np.diff(times_s), recording.radar.prf_hz
    if burst > 1:
        step_s = float(steps_s.min())
    else:  # prf_hz is the rate of a piece
        pieces_s = [
            float(np.median(np.diff(times_s[one])))
            for one in SlowTime(times_s).find_pieces()
            if one.stop - one.start > 1
        ]
        step_s = min(pieces_s, key=lambda usual_s: abs(usual_s * prf_hz - 1.0))
    if abs(step_s * prf_hz - 1.0) > PULSES_OFF:
        _refuse(where, "prf_hz", f"{prf_hz:g}", f"the pulses are {step_s:.6g} s apart, which is {1 / step_s:.6g} Hz")
    if not (np.isnan(recording.noise_power_v2) or 0.0 <= recording.noise_power_v2 < np.inf):
        _refuse(where, "noise_power_v2", f"{recording.noise_power_v2:g}", "it must be 0 or more")
    place = recording.radar_position_m or (0.0, 0.0, 0.0)
    pose = (*place, recording.radar_azimuth_deg, recording.radar_tilt_deg)
    if len(pose) != 5 or not np.isfinite(pose).all():
        _refuse(where, "the pose of the radar", repr(pose)[:80], "it must be three coordinates and two angles")
    for number, truth in enumerate(recording.truth):
        for name, values, most in (
            *((name, getattr(truth, name), most) for name, most in zip(CENTRE_ARRAYS, MOST_OF_TRUTH, strict=True)),
            ("range_m", truth.table["range"], RANGES_M[1]),
            ("radial_velocity_mps", truth.table["radial_velocity"], FASTEST_MPS),
        ):
            parts = [values] if isinstance(values, np.ndarray) else (part for _, part in read_tiles(values))
            shape = values.shape if name in CENTRE_ARRAYS else values.shape[:1]
            if name == "centre_aspect_rad":  # NaN while a body stands still
                parts = [np.nan_to_num(values)]
            elif name in CENTRE_ARRAYS and shape == times_s.shape == truth.centre_velocity_mps.shape:
                away = np.isnan(np.fmax(truth.centre_range_m, truth.centre_velocity_mps))  # both are NaN
                parts = [values[~away]]
            if shape != times_s.shape or not all((np.abs(part) <= most).all() for part in parts):
                said = f"of shape {values.shape}" if shape != times_s.shape else "not finite or too large"
                _refuse(where, f"{name} of truth {number}", said, f"one value a pulse, up to {most:g}, is allowed")


MOST_OF_TRUTH = (RANGES_M[1], FASTEST_MPS, 1e3)


def _refuse(where: str, key: str, value: str, allowed: str) -> None:
    raise RecordingError(
        f"{where}: {key} is {value}, which is not plausible: {allowed}. The file is damaged, or an option is wrong"
    )


def make_baseband_facts(radar: Radar) -> dict[str, str | float]:
    """Return the attributes of a baseband: the radar as JSON, independent noise values per bin."""
    share = radar.waveform.independent_bins(radar)
    return {"radar": format_canonical_json(radar), **({"independent_bin_share": share} if share < 1.0 else {})}


def list_further_facts(recording: Recording) -> dict[str, str | int | float]:
    """Return the facts without a field of their own, such as the pulses in a burst."""
    labelled = vars(recording).get("baseband")  # somebody may have added attributes to it
    attrs = {**make_baseband_facts(recording.radar), **recording.facts} if labelled is None else labelled.attrs
    facts = {name: value.item() if isinstance(value, np.generic) else value for name, value in attrs.items()}
    return {k: v for k, v in facts.items() if k not in ("units", "radar") and isinstance(v, str | int | float)}

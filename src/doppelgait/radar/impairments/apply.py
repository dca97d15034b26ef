"""Declare and apply impairments; levels, unit echoes and ranges of samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import numpy as np
import numpy.typing as npt
from pydantic import Field

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.labels import ScattererTable, takes_arrays
from doppelgait.core.plugins import Group
from doppelgait.core.samples import Samples
from doppelgait.core.units import db_to_amplitude
from doppelgait.radar.link import echo_amplitude_v
from doppelgait.radar.parameters import Radar

Times = npt.NDArray[np.float64]
Level = tuple[Annotated[float, Field(ge=0, le=1e6)], Annotated[float, Field(ge=-400, le=100)]]


class Apply(Protocol):
    """An impairment: a function that returns the changed receiver samples.

    It may change the samples in place (``samples += ...``) and return them, or return new samples
    or a complex array of shape (pulses, samples). All random numbers must be drawn from ``rng``.
    """

    def __call__(self, samples: Samples, parameters: Any, radar: Radar, rng: np.random.Generator, /) -> Any:
        """Return the receiver samples (pulse, sample), V, after the impairment."""


ShiftTimes = Callable[[Times, Any, Radar, np.random.Generator], Times]
"""Fact ``shift_times`` of an impairment that moves pulses, before the scene is observed."""


IMPAIRMENTS: Group[Apply] = Group(
    "impairment",
    built_in=("doppelgait.radar.impairments.additive", "doppelgait.radar.impairments.receiver"),
)
"""Impairments by the ``kind`` of a scene file's ``[[impairments]]``."""

if TYPE_CHECKING:
    Impairments = tuple[FrozenModel, ...]
else:
    Impairments = tuple[IMPAIRMENTS.field(), ...]
"""Type of a model's field that takes a list of tables or of impairment models, in the order they act."""


def make_impairment(table: Mapping[str, Any] | FrozenModel) -> FrozenModel:
    """Make an impairment from a ``[[impairments]]`` table; a model is returned unchanged.

    Raises
    ------
    ConfigError
        If the kind or a parameter is not allowed.
    """
    return IMPAIRMENTS.parse(table)


def apply_impairments(
    samples: Samples | npt.NDArray[Any], specs: Sequence[FrozenModel], *, radar: Radar, rng: np.random.Generator
) -> Samples:
    """Apply all impairments to receiver samples in the order listed.

    The n-th impairment uses the n-th child of ``rng``, so that its random numbers do not depend on the others.

    Parameters
    ----------
    samples : Samples or ndarray, shape (I, S), complex
        Samples of the receiver, V; a row is a pulse, frame or sweep. ``Samples`` may be changed in
        place, an array is not changed.
    specs : sequence of models
        Impairments made by :func:`make_impairment`.

    Raises
    ------
    AnalysisError
        If an array is not complex with two dimensions, or an impairment changes the number of samples.
    ConfigError
        If an impairment is not possible for this radar or recording.
    """
    current = samples if isinstance(samples, Samples) else Samples(samples)
    for spec, own_rng in zip(specs, rng.spawn(len(specs)), strict=True):
        item = IMPAIRMENTS.of(spec)
        found = item.run(current, spec, radar, own_rng)
        owner = f"impairment {item.name!r} of {item.package}"
        if found is None:
            raise AnalysisError(f"{owner} returns nothing; it must return the samples, also those it changed in place")
        try:
            changed = found if isinstance(found, Samples) else Samples(found)
        except (AnalysisError, ValueError) as error:  # ValueError: of rows of several lengths
            raise AnalysisError(f"{owner}: {error}") from None
        if changed.shape != current.shape:
            raise AnalysisError(f"{owner} returns samples of shape {changed.shape} instead of {current.shape}")
        current = changed
    return current


def shift_pulse_times(
    slow_time_s: npt.ArrayLike, specs: Sequence[FrozenModel], *, radar: Radar, rng: np.random.Generator
) -> Times:
    """Return the true transmission times of the pulses, at which the scene is observed.

    The recording has the rising nominal times ``slow_time_s`` (I,). Impairments that do not shift
    pulses are ignored; the n-th draws from the n-th child of ``rng``.

    Returns
    -------
    ndarray, shape (I,)
        Times, s, clipped to the first and last nominal time, between which the scene is defined.

    Raises
    ------
    ConfigError
        If the shifts are so large that the order of pulses could change.
    """
    nominal_s = np.asarray(slow_time_s, dtype=np.float64)
    times_s = nominal_s
    for spec, own_rng in zip(specs, rng.spawn(len(specs)), strict=True):
        shift: ShiftTimes | None = IMPAIRMENTS.of(spec).facts.get("shift_times")
        if shift is not None:
            times_s = shift(times_s, spec, radar, own_rng)
    return times_s if times_s is nominal_s else np.clip(times_s, nominal_s[0], nominal_s[-1])


def check_rising(knots: Sequence[tuple[float, float]] | None) -> Any:
    """Check that the first numbers of knots rise (``ValueError``)."""
    for (one, _), (other, _) in pairwise(knots or ()):
        if other <= one:
            raise ValueError(f"the first numbers must rise from entry to entry, but {other:g} follows {one:g}")
    return knots


def exclude(first: str, second: str, *, needed: bool = False) -> Callable[[Any], Any]:
    """Return a check that not both of two parameters are set, or exactly one."""

    def check(spec: Any) -> Any:
        count = sum(getattr(spec, name) is not None for name in (first, second))
        if needed and count != 1:
            raise ValueError(f"give exactly one of {first} and {second}")
        if count == 2:
            raise ValueError(f"give {first} or {second}, not both")
        if getattr(spec, "in_units", False) and getattr(spec, first) is None:
            raise ValueError(f"in_units belongs to {first}, which is not set")
        return spec

    return check


def find_volts_per_unit(radar: Radar, *, wanted_by: str) -> float:
    """Return the volts per unit of the sensor's own files."""
    if radar.volts_per_unit is None:
        raise ConfigError(
            f"{wanted_by} is in the sensor's own unit, but the radar {radar.name!r} has no volts_per_unit: set "
            "radar.volts_per_unit, or state the level in dB re 1 V"
        )
    return radar.volts_per_unit


def convert_level_to_volt(spec: Any, radar: Radar) -> float:
    """Convert ``level_db``, re 1 V or re one unit of the sensor's own files, to volts."""
    unit_v = find_volts_per_unit(radar, wanted_by=f"{spec.kind}: level_db") if spec.in_units else 1.0
    return float(db_to_amplitude(spec.level_db)) * unit_v


def make_static_samples(
    range_m: npt.NDArray[np.float64], amplitude_v: npt.NDArray[np.float64], radar: Radar
) -> npt.NDArray[np.complex64]:
    """Return receiver samples (I, S) of scatterers at rest, (I, L)."""
    one_v = echo_amplitude_v(radar, range_m=range_m, rcs_m2=1.0)
    values = {
        "range": range_m,
        "radial_velocity": np.zeros_like(range_m),
        "rcs": np.ones_like(range_m),
        "path_gain": (amplitude_v / one_v) ** 2,
    }
    table = ScattererTable(np.arange(range_m.shape[0]) / radar.prf_hz, values)
    plain = takes_arrays(type(radar.waveform).synthesise)
    return radar.waveform.synthesise(table if plain else table.label(), radar)


def check_width(samples: Samples, radar: Radar) -> None:
    """Check the number of samples per pulse (:class:`AnalysisError`)."""
    wanted = radar.waveform.n_samples(radar)
    if samples.shape[1] != wanted:
        raise AnalysisError(
            f"a pulse of the radar {radar.name!r} has {wanted} samples, but these have {samples.shape[1]}; use the "
            "radar that made them"
        )


def sample_range_m(radar: Radar) -> npt.NDArray[np.float64]:
    """Return the range of every sample, m; the frame's middle if samples hold all ranges."""
    if radar.waveform.samples_are_bins:
        return radar.range_axis_m()
    return np.array([(radar.range_start_m + radar.range_stop_m) / 2.0])

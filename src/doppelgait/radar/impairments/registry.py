"""How an impairment is declared, read from a table and applied."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Protocol

import numpy as np
import numpy.typing as npt
from pydantic import BeforeValidator, SerializeAsAny

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.registry import Registry
from doppelgait.radar.parameters import Radar

Samples = npt.NDArray[np.complex64]
Times = npt.NDArray[np.float64]


class Apply(Protocol):
    """Acts on receiver samples: a new array, or the given one where nothing changes; never changed in place."""

    def __call__(self, samples: Samples, spec: Any, /, *, radar: Radar, rng: np.random.Generator) -> Samples:
        """Samples (pulse, sample) complex64, V, after the impairment."""


class ShiftTimes(Protocol):
    """Acts on the times of the pulses before the scene is observed."""

    def __call__(self, times_s: Times, spec: Any, /, *, radar: Radar, rng: np.random.Generator) -> Times:
        """Times of the pulses, s, after the impairment."""


@dataclass(frozen=True)
class Impairment:
    """A fault of the receiver or its surroundings.

    Parameters
    ----------
    model : type
        Its parameters; the field ``kind`` holds the name it is registered under.
    apply : callable
        ``apply(samples, spec, radar=..., rng=...) -> samples``.
    shift_times : callable, optional
        ``shift_times(times_s, spec, radar=..., rng=...) -> times_s``, of those that move the pulses in time.
    """

    model: type[FrozenModel]
    apply: Apply
    shift_times: ShiftTimes | None = None


IMPAIRMENTS: Registry[Impairment] = Registry("doppelgait.impairments", "impairment")
"""Impairments by the ``kind`` of a scene file's ``[[impairments]]``."""


def make_impairment(table: Mapping[str, Any] | FrozenModel) -> FrozenModel:
    """Impairment of a ``[[impairments]]`` table; one that is a model already is returned as it is.

    Raises
    ------
    ConfigError
        If the kind or a parameter is not allowed.
    """
    kind = table.get("kind") if isinstance(table, Mapping) else getattr(table, "kind", None)
    if not isinstance(kind, str) or kind not in IMPAIRMENTS:
        raise ConfigError(f"impairment kind {kind!r} is not allowed: known are {', '.join(IMPAIRMENTS)}")
    model = IMPAIRMENTS[kind].model
    if isinstance(table, Mapping):
        return validate(model, table, where=f"impairment kind {kind!r}")
    if not isinstance(table, model):
        raise ConfigError(f"impairment kind {kind!r} must be a table or {model.__name__}, not {type(table).__name__}")
    return table


def _of_its_kind(entry: Any) -> Any:
    try:
        return make_impairment(entry)
    except ConfigError as error:
        raise ValueError(str(error)) from None


Impairments = tuple[Annotated[SerializeAsAny[FrozenModel], BeforeValidator(_of_its_kind)], ...]
"""Type of a model's field that takes a list of tables or of impairment models, in the order they act."""


def apply_impairments(
    samples: Samples, specs: Sequence[FrozenModel], *, radar: Radar, rng: np.random.Generator
) -> Samples:
    """Receiver samples after all impairments, in the order of the list.

    The n-th acts with the n-th child of ``rng``, so that its random numbers do not depend on those before it.

    Parameters
    ----------
    samples : ndarray, shape (I, S), complex64
        Samples of the receiver, V; a row is a pulse, frame or sweep. Left as they are.
    specs : sequence of models
        Impairments as :func:`make_impairment` gives them.
    radar : Radar
    rng : Generator

    Returns
    -------
    ndarray, shape (I, S), complex64
        ``samples`` themselves if the list is empty.

    Raises
    ------
    AnalysisError
        If the samples are not complex64 of two dimensions.
    ConfigError
        If an impairment does not suit this radar or recording.
    """
    if samples.ndim != 2 or samples.dtype != np.complex64:
        raise AnalysisError(
            f"receiver samples must be complex64 of shape (pulse, sample), not {samples.dtype} of shape {samples.shape}"
        )
    for spec, own_rng in zip(specs, rng.spawn(len(specs)), strict=True):
        samples = _entry(spec).apply(samples, spec, radar=radar, rng=own_rng)
    return samples


def pulse_times(
    slow_time_s: npt.ArrayLike, specs: Sequence[FrozenModel], *, radar: Radar, rng: np.random.Generator
) -> Times:
    """Times at which the pulses really leave, to observe the scene at; the recording keeps the nominal ones.

    Parameters
    ----------
    slow_time_s : array_like, shape (I,)
        Nominal times, rising.
    specs : sequence of models
        Impairments; those that do not move pulses are passed over.
    radar : Radar
    rng : Generator
        The n-th impairment draws from its n-th child.

    Returns
    -------
    ndarray, shape (I,)
        s, clipped to the first and last nominal time, between which the scene is known.

    Raises
    ------
    ConfigError
        If the pulses would move so far that they change places.
    """
    nominal_s = np.asarray(slow_time_s, dtype=np.float64)
    times_s = nominal_s
    for spec, own_rng in zip(specs, rng.spawn(len(specs)), strict=True):
        shift = _entry(spec).shift_times
        if shift is not None:
            times_s = shift(times_s, spec, radar=radar, rng=own_rng)
    return times_s if times_s is nominal_s else np.clip(times_s, nominal_s[0], nominal_s[-1])


def _entry(spec: FrozenModel) -> Impairment:
    return IMPAIRMENTS[make_impairment(spec).kind]  # type: ignore[attr-defined]

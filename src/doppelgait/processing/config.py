"""Parameters of the analysis and the short-time transform."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import AnalysisError
from doppelgait.core.units import cpi_to_pulses, exponential

Method = Literal["standard", "liland2018"]
Normalisation = Literal["sum", "max", "r4"]

LILAND2018_OWN = {"gate_span_m": None, "gate_edges": "sharp", "gate_doppler_hz": None, "normalisation": "max"}
"""Parameters that method ``liland2018`` fixes, each with the only value that may be set."""
MIN_CPI_PULSES = 5  # fewest pulses of a processing interval from which Doppler can be measured


class Analysis(FrozenModel):
    """Analysis parameters; the defaults are those of datasets.

    method: ``liland2018`` uses the choices of the report: zero padding at the ends, columns divided
        by their maximum, the cadence spectrum's highest peak, gate span by class, sharp gate edges
        and the Doppler gate from the truth. Parameters that contradict these choices are rejected.
        By default ``hop`` is then 1 and ``doppler_bins`` M.
    clutter: Removal of static clutter before the analysis
        (:func:`doppelgait.processing.remove_clutter`). ``auto`` is ``median`` for tracking, which
        needs clutter removal, and ``none`` for any other gate.
    clutter_time_s: Time constant of ``exponential``.
    cpi_s: Coherent processing interval T_d.
    window_steepness: sigma_w of the Gaussian window (E-23; labels of this form are the equations of
        docs/theory.md).
    doppler_bins: Transform length K; by default the smallest 2^a, 3 2^a or 5 2^a that is at least
        M.
    hop: Pulses from column to column of the signature; by default floor(T_d f_p / 12), which is
        lossless. A hop that divides the default changes no feature
        (:func:`doppelgait.processing.decimate`).
    gate_span_m: Range extent of the gate, the same for every class (E-26).
    gate_edges: Weight of a range bin at the edge of the gate: the share of its cell inside the gate
        (``fractional``), or 1 or 0 as in the report (``sharp``). Sharp edges jump from bin to bin
        and cause steps in the signature.
    gate_doppler_hz: Doppler band of the gate; none by default.
    normalisation: Columns are divided by their sum or maximum over Doppler, or multiplied by
        range^4 (E-28).
    bandwidth_threshold: t_mu of the threshold form of the micro-Doppler bandwidth (E-35).
    extended: Compute the extended features and the standard deviations; not available with
        ``liland2018``.
    parts: Separate the body into torso, legs and other limbs (:mod:`doppelgait.processing.parts`,
        E-40). In a fixed gate this takes several times as long as the rest of the analysis.
    """

    method: Method = "standard"
    clutter: Literal["auto", "none", "mean", "median", "exponential", "mti"] = "auto"
    clutter_time_s: float = Field(default=2.0, gt=0, le=3600)
    cpi_s: float = Field(default=0.1, gt=0, le=10)
    window_steepness: float = Field(default=0.4, gt=0, le=10)
    doppler_bins: int | None = Field(default=None, ge=3, le=65536)
    hop: int | None = Field(default=None, ge=1, le=100_000)
    gate_span_m: float = Field(default=1.6, gt=0, le=100)
    gate_edges: Literal["fractional", "sharp"] = "fractional"
    gate_doppler_hz: tuple[float, float] | None = None
    normalisation: Normalisation = "sum"
    bandwidth_threshold: float = Field(default=0.04, gt=0, lt=1)
    extended: bool = True
    parts: bool = False

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.gate_doppler_hz is not None and self.gate_doppler_hz[0] >= self.gate_doppler_hz[1]:
            raise ValueError(f"gate_doppler_hz {self.gate_doppler_hz} must rise")
        stated = {name: getattr(self, name) for name in LILAND2018_OWN if name in self.model_fields_set}
        ignored = [name for name, value in stated.items() if value != LILAND2018_OWN[name]]
        if self.method == "liland2018" and ignored:
            raise ValueError(f"method 'liland2018' fixes {', '.join(ignored)}; leave this out or use method 'standard'")
        return self

    @model_serializer(mode="wrap")
    def _serialise(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        ignored = set(LILAND2018_OWN) - self.model_fields_set if self.method == "liland2018" else set()
        return {name: value for name, value in plain(self).items() if name not in ignored}

    def resolved(self, gate: object) -> Analysis:
        """Return the settings for this gate, without ``"auto"``."""
        if self.clutter != "auto":
            return self
        return self.model_copy(update={"clutter": "median" if gate == "track" else "none"})

    @property
    def sharp_edges(self) -> bool:
        """True if each range bin is entirely inside or outside the gate."""
        return self.gate_edges == "sharp" or self.method == "liland2018"

    @property
    def zero_padded(self) -> bool:
        """True if zero padding extends the signature, for reproduction only."""
        return self.method == "liland2018"


@dataclass(frozen=True)
class Transform:
    """Short-time transform of one recording. Shapes: window (M,) (E-23)."""

    window: npt.NDArray[np.float64]
    n_doppler_bins: int
    hop: int
    first_pulse: int
    n_columns: int

    @property
    def half_window(self) -> int:
        """Pulses on either side of the centre, (M - 1)/2."""
        return (self.window.size - 1) // 2

    def compute_centre_pulses(self) -> npt.NDArray[np.int64]:
        """Compute the pulse number at every column's centre (E-22)."""
        return self.first_pulse + self.half_window + self.hop * np.arange(self.n_columns)


def gaussian_window(n_pulses: int, steepness: float) -> npt.NDArray[np.float64]:
    """Compute a Gaussian window of shape (M,) (E-23).

    The window is exp(-0.5 ((m - h) / (sigma_w h))^2) with h = (M - 1) / 2.
    """
    half = (n_pulses - 1) / 2.0
    return np.asarray(exponential(-0.5 * ((np.arange(n_pulses) - half) / (steepness * max(half, 0.5))) ** 2))


def find_fast_length(n_pulses: int) -> int:
    """Find the smallest fast transform length: 2^a, 3 2^a or 5 2^a."""
    return min(base << max(0, math.ceil(math.log2(n_pulses / base))) for base in (1, 3, 5) if base <= n_pulses)


def find_lossless_hop(cpi_pulses: int) -> int:
    """Compute the largest lossless hop, T_d f_p / 12 rounded down (E-23)."""
    return max(1, cpi_pulses // 12)


def choose_doppler_bins(analysis: Analysis, pulses: int, noun: str) -> int:
    """Return the transform length K of M pulses, K >= M."""
    default = pulses if analysis.method == "liland2018" else find_fast_length(pulses)
    wanted = analysis.doppler_bins or default
    if wanted < pulses:
        raise AnalysisError(f"doppler_bins is {wanted}, but {noun} has {pulses} pulses: K >= M")
    return wanted


def plan_transform(analysis: Analysis, *, n_pulses: int, prf_hz: float) -> Transform:
    """Plan window, transform length, hop and columns of ``n_pulses`` at ``prf_hz``.

    Raises
    ------
    AnalysisError
        If a processing interval has fewer than 5 pulses, the recording is shorter than one, or
        ``doppler_bins`` is below M.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.processing.plan_transform(dg.Analysis(cpi_s=0.2), n_pulses=1500, prf_hz=500.0).half_window
    50
    """
    cpi_pulses = cpi_to_pulses(analysis.cpi_s, prf_hz)
    if cpi_pulses < MIN_CPI_PULSES:
        raise AnalysisError(
            f"cpi_s = {analysis.cpi_s:g} at prf_hz = {prf_hz:g} makes a processing interval of {cpi_pulses} "
            f"pulse{'s' * (cpi_pulses > 1)}, at least {MIN_CPI_PULSES} are needed; raise cpi_s to "
            f"{math.ceil(1e3 * (MIN_CPI_PULSES - 1) / prf_hz) / 1e3:g} or more, or record at a higher prf_hz"
        )
    if n_pulses < cpi_pulses:
        raise AnalysisError(
            f"the recording has {n_pulses} pulses, less than one processing interval of {cpi_pulses} (cpi_s = "
            f"{analysis.cpi_s} at {prf_hz:g} Hz); record longer or lower cpi_s"
        )
    n_doppler = choose_doppler_bins(analysis, cpi_pulses, "a processing interval")
    hop = analysis.hop or (1 if analysis.method == "liland2018" else find_lossless_hop(cpi_pulses))
    half = (cpi_pulses - 1) // 2
    valid = n_pulses if analysis.zero_padded else n_pulses - 2 * half
    return Transform(
        window=gaussian_window(cpi_pulses, analysis.window_steepness),
        n_doppler_bins=n_doppler,
        hop=hop,
        first_pulse=-half if analysis.zero_padded else 0,
        n_columns=(valid - 1) // hop + 1,
    )

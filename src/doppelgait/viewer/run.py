"""One run to look at: a recording, the targets in it, or what was stored about them."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import AnalysisError, DoppelgaitError, DoppelgaitWarning
from doppelgait.pipeline import TargetResult, analyze
from doppelgait.pipeline.results import StoredTarget
from doppelgait.pipeline.tracked import with_clutter_off
from doppelgait.processing import Analysis, remove_clutter
from doppelgait.radar.recording import Recording, TargetTruth
from doppelgait.viewer.query import Gate
from doppelgait.viewer.settings import Settings

T = TypeVar("T")
Kind = Literal["recording", "result", "example", "try"]
STORED_FACTS = (
    "label", "gate", "features", "gait_frequency_hz", "torso_doppler_hz", "quality", "standard_deviation", "extended",
)  # fmt: skip
MOST_ANALYSES = 4
"""Analyses of one run, by gate, that are kept."""


@dataclass(frozen=True)
class TargetView:
    """What is shown of one target, from an analysis, a result file or a dataset.

    Parameters
    ----------
    label : str or None
    gate : str
        Where the gate came from: ``truth``, ``track`` or ``given``.
    features : mapping
        The six by name, None where undetermined.
    gait_frequency_hz, torso_doppler_hz : float or None
    harmonics_hz : tuple of float or None
        Found second and third harmonic of the gait frequency.
    quality, standard_deviation, extended : mapping
    flags : tuple of str
    signature, cadence_map, cadence_spectrum : DataArray, optional
        None where it was not kept.
    main_line_hz : ndarray, optional
        At the columns of the signature.
    gate_limits : Dataset (time), optional
    truth : mapping, optional
        What is true of the features and frequencies, by their names.
    pieces : tuple of (float, float)
        Start and stop of the pieces of steady motion, s.
    """

    label: str | None
    gate: str
    features: Mapping[str, float | None]
    gait_frequency_hz: float | None = None
    torso_doppler_hz: float | None = None
    harmonics_hz: tuple[float | None, ...] = ()
    quality: Mapping[str, Any] = field(default_factory=dict)
    standard_deviation: Mapping[str, float | None] = field(default_factory=dict)
    extended: Mapping[str, float | None] = field(default_factory=dict)
    flags: tuple[str, ...] = ()
    signature: xr.DataArray | None = None
    cadence_map: xr.DataArray | None = None
    cadence_spectrum: xr.DataArray | None = None
    main_line_hz: npt.NDArray[np.float64] | None = None
    gate_limits: xr.Dataset | None = None
    truth: Mapping[str, Any] | None = None
    pieces: tuple[tuple[float, float], ...] = ()


@dataclass(eq=False)
class Run:
    """A recording with its analyses, made when they are first asked for; not safe for several threads at once.

    Parameters
    ----------
    name : str
    kind : {"recording", "result", "example", "try"}
    settings : Settings
        Its gate is the one that is shown first.
    load : callable, optional
        Gives the recording; without, or where it raises a DoppelgaitError, there is none.
    reason : str
        Why there is no recording, for people.
    stored : callable, optional
        Gives the targets as they were stored; shown unless a gate is asked for.
    notes : tuple of str
        For people, beside those of the recording.
    """

    name: str
    kind: Kind
    settings: Settings = field(default_factory=Settings)
    load: Callable[[], Recording] | None = None
    reason: str = ""
    stored: Callable[[], Sequence[TargetView]] | None = None
    notes: tuple[str, ...] = ()
    _analyses: dict[Gate, tuple[list[TargetView], list[str]]] = field(default_factory=dict, repr=False)
    _kept: dict[str, Any] = field(default_factory=dict, repr=False)

    @cached_property
    def recording(self) -> Recording | None:
        """The recording; None where there is none, and ``reason`` says why."""
        if self.load is None:
            return None
        try:
            return self.load()
        except DoppelgaitError as error:
            self.reason = str(error)
            return None

    @cached_property
    def stored_targets(self) -> list[TargetView]:
        """The targets that were stored."""
        return list(self.stored()) if self.stored is not None else []

    def needed_recording(self) -> Recording:
        """The recording, or an AnalysisError that says why there is none."""
        if self.recording is None:
            raise AnalysisError(f"{self.name}: there is no recording to take it from: {self.reason}")
        return self.recording

    def analysis(self, gate: Gate | None) -> Analysis:
        """Parameters that targets in a gate are analysed with."""
        known = self.settings.analysis
        return with_clutter_off(known) if (gate or self.settings.gate) == "track" else known

    def clean_baseband(self, gate: Gate | None) -> xr.DataArray:
        """Baseband without clutter, as it is analysed."""
        analysis = self.analysis(gate)
        return self.keep(
            f"baseband, {analysis.clutter}", lambda: remove_clutter(self.needed_recording().baseband, analysis)
        )

    def keep(self, name: str, make: Callable[[], T]) -> T:
        """What was made under this name, made now if it was not."""
        if name not in self._kept:
            self._kept[name] = make()
        kept: T = self._kept[name]
        return kept

    def targets(self, gate: Gate | None) -> list[TargetView]:
        """Targets in a gate; in None those that were stored, or those in the gate that is shown first.

        Raises
        ------
        DoppelgaitError
            If there is no recording to analyse, or it cannot be analysed so.
        """
        if gate is None and self.stored is not None:
            return self.stored_targets
        return self._analysis_in(gate or self.settings.gate)[0]

    def warnings(self, gate: Gate | None) -> list[str]:
        """What the analysis of :meth:`targets` warned of."""
        if gate is None and self.stored is not None:
            return []
        return self._analysis_in(gate or self.settings.gate)[1]

    def _analysis_in(self, gate: Gate) -> tuple[list[TargetView], list[str]]:
        if gate not in self._analyses:
            while len(self._analyses) >= MOST_ANALYSES:
                self._analyses.pop(next(iter(self._analyses)))
            self._analyses[gate] = with_warnings(lambda: self._analysed(gate))
        return self._analyses[gate]

    def _analysed(self, gate: Gate) -> list[TargetView]:
        recording, known = self.needed_recording(), self.settings
        given: Any = gate
        results = analyze(recording, gate=given, analysis=self.analysis(gate), tracking=known.tracking)
        return [view_of(result, truth_for(recording, number, result)) for number, result in enumerate(results)]


def with_warnings(make: Callable[[], T]) -> tuple[T, list[str]]:
    """What a function gives, and what doppelgait warned of meanwhile, each text once."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DoppelgaitWarning)
        made = make()
    texts = [str(one.message) for one in caught if issubclass(one.category, DoppelgaitWarning)]
    return made, list(dict.fromkeys(texts))


def truth_for(recording: Recording, number: int, result: TargetResult) -> TargetTruth | None:
    """Truth that a result is to be compared with: of the same number for a truth gate, of the only body otherwise."""
    if result.gate == "truth" and number < len(recording.truth):
        return recording.truth[number]
    return recording.truth[0] if len(recording.truth) == 1 else None


def view_of(result: TargetResult, truth: TargetTruth | None) -> TargetView:
    """What is shown of an analysed target."""
    features = result.features.as_dict()
    return TargetView(
        label=result.label,
        gate=result.gate,
        features=features,
        gait_frequency_hz=result.gait_frequency_hz,
        torso_doppler_hz=result.torso_doppler_hz,
        harmonics_hz=harmonics_of(features, result.gait_frequency_hz),
        quality=result.quality,
        standard_deviation=result.standard_deviation,
        extended=result.extended,
        flags=result.flags,
        signature=result.signature,
        cadence_map=result.cadence_map,
        cadence_spectrum=result.cadence_spectrum,
        main_line_hz=result.main_line_hz,
        gate_limits=result.gate_limits,
        truth=None if truth is None else true_values(truth),
        pieces=tuple(_piece_span(piece) for piece in result.pieces),
    )


def view_of_stored(target: StoredTarget) -> TargetView:
    """What is shown of a target of a result file."""
    facts = target.facts
    spans = [piece["quality"] for piece in facts.get("pieces", ())]
    return TargetView(
        **{key: facts[key] for key in STORED_FACTS},
        flags=tuple(facts["flags"]),
        harmonics_hz=harmonics_of(facts["features"], facts["gait_frequency_hz"]),
        signature=target.signature,
        cadence_map=target.cadence_map,
        cadence_spectrum=target.cadence_spectrum,
        main_line_hz=target.main_line_hz,
        gate_limits=target.gate_limits,
        pieces=tuple((float(span["start_s"]), float(span["stop_s"])) for span in spans),
    )


def _piece_span(piece: TargetResult) -> tuple[float, float]:
    return float(piece.quality["start_s"]), float(piece.quality["stop_s"])


def harmonics_of(
    features: Mapping[str, float | None], gait_frequency_hz: float | None
) -> tuple[float | None, float | None]:
    """Cadence of the second and third harmonic, Hz, from the ratios to the gait frequency."""
    ratios = (features.get("harmonic_ratio_2"), features.get("harmonic_ratio_3"))
    second, third = (None if r is None or gait_frequency_hz is None else r * gait_frequency_hz for r in ratios)
    return second, third


def true_values(truth: TargetTruth) -> dict[str, Any]:
    """What a simulation knows of the features and frequencies, by their names; the rest under names of its own."""
    radial_mps = float(np.mean(truth.centre_velocity_mps))
    steps = truth.gait_frequency_hz > 0
    return {
        "torso_velocity_mps": radial_mps,
        "step_length_m": abs(radial_mps) / truth.gait_frequency_hz if steps else None,
        "harmonic_ratio_2": 2.0 if steps else None,
        "harmonic_ratio_3": 3.0 if steps else None,
        "gait_frequency_hz": truth.gait_frequency_hz,
        "step_frequency_hz": truth.step_frequency_hz,
        "stride_frequency_hz": truth.stride_frequency_hz,
        "ground_speed_mps": truth.ground_speed_mps,
        "height_m": truth.height_m,
        "label": truth.label,
        "gait": truth.gait,
    }

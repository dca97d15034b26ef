"""Class decisions about targets of recordings and stored results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from doppelgait.classify.data import convert_features
from doppelgait.classify.learned import Inputs, Seen, join_inputs
from doppelgait.classify.model import (
    Model,
    collect_conditions,
    describe_outside_conditions,
    find_blocking_flag,
    read_carrier_and_prf_hz,
)
from doppelgait.classify.model_file import find_shipped_model, load_model_for_radar, load_shipped_model
from doppelgait.classify.options import WindowOptions, takes_options
from doppelgait.core.config import format_canonical_json, validate
from doppelgait.core.errors import AnalysisError, explain_memory, warn_caller
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.dataset.example import find_feature_columns
from doppelgait.pipeline import Result, analyze, read_results
from doppelgait.pipeline.result_files import is_result_file
from doppelgait.processing import Analysis
from doppelgait.processing.patches import Levels, Patch, levels_of
from doppelgait.radar import Recording, read_recording


@dataclass(frozen=True)
class Decision:
    """Decision of a model about one target.

    Parameters
    ----------
    target : int
        Number of the target among the results.
    label : str
        The most likely class, also of an abstention.
    probability : float
        Calibrated probability of that class for equally frequent classes.
    probabilities : mapping
        Of every class.
    abstained : bool
        True where no decision is made.
    reason : str
        Reason of an abstention; empty for a decision.
    blocked : bool
        True if a flag, the conditions or features outside the training range prevent a decision, so
        that the probabilities are meaningless; False if the probabilities are only too low.
    alarm : bool or None
        True if the target triggers the alarm that detects 95 % of its class; None if the model has
        no alarm or was not trained on such a radar. An abstention by a flag or by features outside
        the training range does not prevent the alarm.
    flags : tuple of str
        Of the analysis.
    quality : mapping
        Range, times and SNR of the target, carrier and pulse rate, as far as known.
    """

    target: int
    label: str
    probability: float
    probabilities: Mapping[str, float]
    abstained: bool
    reason: str
    blocked: bool
    alarm: bool | None
    flags: tuple[str, ...]
    quality: Mapping[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """Return the decision as plain values for JSON."""
        return {**vars(self), "flags": list(self.flags)}


@dataclass(frozen=True, eq=False)
class TargetInputs:
    """Features and signature of one target, as the classifier uses them."""

    columns: Mapping[str, Any]
    signature: xr.DataArray | None
    pictures: Levels | None = None  # of a tracked target
    flags: tuple[str, ...] = ()

    @classmethod
    def of(cls, result: Result) -> TargetInputs:
        """Return those of a result."""
        return cls(result.to_row(), result.signature, result.pictures, result.flags)

    @cached_property
    def conditions(self) -> dict[str, float]:
        """Conditions of the observation; NaN for unknown."""
        known = {name: value for name, value in self.columns.items() if value is not None}
        carrier_hz = float(known.get("carrier_hz", np.nan))
        if self.signature is not None:
            carrier_hz, known["prf_hz"] = read_carrier_and_prf_hz(self.signature)
        found = collect_conditions(known, np.array([carrier_hz]))
        return {name: float(values[0]) for name, values in found.items()}

    def collect_inputs(self, model: Model, number: int) -> Inputs:
        """Return the inputs of a model, one row."""
        names, pictures = model.facts.names, np.empty(1, dtype=object)
        parts = {part.kind: part for part in (model.learned, *model.learned.members)}
        if network := parts.get("network"):
            pictures[0] = levels_of(self.signature, network.patch or Patch())
        elif "track" in parts:
            pictures[0] = Seen(self.pictures, 0, 0.0)
        if not names:
            return pictures
        table = pd.DataFrame([self.columns])
        columns = find_feature_columns(table, "extended").items()
        wavelength_m = np.array([SPEED_OF_LIGHT_MPS / self.conditions["carrier_hz"]])
        known = {name: table[column] for name, column in columns if column in table}
        features = convert_features(known, wavelength_m)
        if missing := [name for name in names if name not in features]:
            raise AnalysisError(
                f"target {number}: has no {missing[0]}, which {model.facts.name} uses; analyse with extended = "
                "true and the standard method"
            )
        values = np.column_stack([features[name] for name in names])
        return join_inputs(values, pictures) if parts.keys() & {"network", "track"} else values


@explain_memory
@takes_options(WindowOptions, but=("window_s", "hop_s"))
def classify(
    source: str | Path | Recording | Sequence[Result], model: Model | None = None, **options: Any
) -> list[Decision]:
    """Classify every target of a recording.

    Parameters
    ----------
    source : path, Recording or sequence of Result
        A recording, or its results of :func:`doppelgait.analyze`, also as a file (``analyze -o``).
    model : Model, optional
        Model; by default the shipped model that fits the radar
        (:func:`doppelgait.classify.model_file.find_shipped_model`).
    **options

    Returns
    -------
    list of Decision
        One decision per target; empty if no target was found.

    Raises
    ------
    AnalysisError
        As :func:`doppelgait.analyze`; or if results lack inputs of the model.
    RecordingError
        If a file cannot be read.
    ConfigError
        If no model is named and no shipped model fits.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> model = dg.classify.open_model("x4")
    >>> decisions = dg.classify.classify(recording, model)
    >>> decisions[0].label, round(decisions[0].probability, 1)
    ('human', 1.0)
    """
    chosen, stored = WindowOptions(**options), isinstance(source, str | Path) and is_result_file(source)
    if isinstance(source, str | Path) and not stored:
        source = read_recording(Path(source).resolve() if Path(source).is_dir() else source)
    if isinstance(source, Recording):
        model = model or choose_model(source)
        settings = chosen.analysis or read_training_analysis(model)
        _warn_about_settings(settings.model_dump(mode="json"), model)
        results: Sequence[Result] = analyze(source, gate=chosen.gate, analysis=settings, tracking=chosen.tracking)
    else:
        results = read_results(source).targets if isinstance(source, str | Path) else source
    if not results:
        return []
    model = model or choose_model(results)
    if stored:
        for analysis_used in {format_canonical_json(result.analysis): result.analysis for result in results}.values():
            _warn_about_settings(analysis_used.model_dump(mode="json"), model)
    return [decide(TargetInputs.of(r), model, number) for number, r in enumerate(results)]


def choose_model(source: Recording | Sequence[Result]) -> Model:
    """Return the shipped model for a recording's radar."""
    if isinstance(source, Recording):
        return load_model_for_radar(source.radar, source.frames.find_bursts().slow_time.burst_pulses)
    return load_shipped_model(find_shipped_model(*read_carrier_and_prf_hz(source[0].signature)))


def read_training_analysis(model: Model) -> Analysis:
    """Return the analysis parameters of a model's training data."""
    return validate(Analysis, model.facts.analysis, where=f"model {model.facts.name}")


def decide(seen: TargetInputs, model: Model, number: int) -> Decision:
    """Decide the class of one target."""
    values, facts = seen.collect_inputs(model, number), model.facts
    outside, rank = model.describe_outside(values), float(model.rank(values)[0])
    if rank < facts.novel_below:
        outside.append(
            f"unlike the training data: {100 * rank:.1f} % of the held-out rows have the same or a larger distance"
        )
    probability = model.probability(values)[0]
    best = int(probability.argmax())
    elsewhere = describe_outside_conditions(seen.conditions, facts.conditions)
    if model.learned.kind == "track" and seen.pictures is None:
        elsewhere = ["no pictures of a track: this model needs a recording and gates that are tracks"]
    flag = find_blocking_flag(seen.flags, model.blocking)
    reasons = [*([] if flag is None else [f"flag {flag}"]), *elsewhere, *outside]
    blocked = bool(reasons)
    if not blocked and not probability[best] >= facts.abstain_below:
        reasons = [f"probability {probability[best]:.2f} is below {facts.abstain_below:g}"]
    probabilities, alarm = dict(zip(facts.classes, probability.tolist(), strict=True)), None
    if facts.alarm is not None and facts.alarm_threshold is not None and not elsewhere:
        alarm = probabilities[facts.alarm] >= facts.alarm_threshold
    found = {name: seen.columns.get(f"quality_{name}") for name in SHOWN_QUALITY}
    found |= {name: value for name, value in seen.conditions.items() if name != "observation_s"}
    return Decision(
        target=number,
        label=facts.classes[best],
        probability=probabilities[facts.classes[best]],
        probabilities=probabilities,
        abstained=bool(reasons),
        reason="; ".join(reasons),
        blocked=blocked,
        alarm=alarm,
        flags=seen.flags,
        quality={name: float(value) for name, value in found.items() if value is not None and np.isfinite(value)},
    )


SHOWN_QUALITY = ("track_range_m", "start_s", "stop_s", "observation_s", "snr_mu_db", "breathing_rate_hz")


def _warn_about_settings(found: Mapping[str, Any], model: Model) -> None:
    expected = read_training_analysis(model).model_dump(mode="json")
    ignored = ("clutter", "clutter_time_s", "hop")
    other = [name for name, value in expected.items() if name not in ignored and found.get(name, value) != value]
    if other:
        words = ", ".join(f"{name} {found[name]} instead of {expected[name]}" for name in other)
        warn_caller(f"the analysis differs from that of the model: {words}")

"""Result of a target with its analysis settings: memory, JSON, table row."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.config import validate
from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import (
    CADENCE_MAP,
    CADENCE_SPECTRUM,
    NORMALISED_SIGNATURE,
    SIGNATURE,
    STEP_LENGTHS,
    Schema,
    Signal,
)
from doppelgait.core.lazy import xr
from doppelgait.core.notebook import plot, show_html, show_text
from doppelgait.features import FEATURE_UNITS, GaitFeatures, measure_columns
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.parts import measure_parts

LABELLED_ARRAYS: dict[str, Schema] = {
    "signature": SIGNATURE,
    "normalised_signature": NORMALISED_SIGNATURE,
    "cadence_map": CADENCE_MAP,
    "cadence_spectrum": CADENCE_SPECTRUM,
}
PLAIN_AXES = {
    "time_s": "axes/signature/time",
    "doppler_hz": "axes/signature/doppler",
    "cadence_hz": "axes/cadence_map/cadence",
}
"""Names of links in a file to the axes of the signature and of the cadence map."""
NUMBERS, SECONDS = ("gait_frequency_hz", "torso_doppler_hz", "n_periods"), ("start_s", "stop_s")
GROUPS = {"quality": "quality_", "standard_deviation": "sd_", "extended": "extended_"}
"""Mappings of a result and the prefixes of their columns in a table."""

DEFINITE = 0.7  # probability from which a target is a body, a thing, or two bodies; in between there is doubt
FROM_GAIT_FREQUENCY = (
    "gait_frequency_hz",
    "ground_step_length_m",
    "step_length_m",
    "harmonic_ratio_2",
    "harmonic_ratio_3",
    "n_periods",
)
"""Values that are derived from the gait frequency and share its confidence."""


class LateArrays(Mapping[str, Any]):
    """Arrays by name, computed and labelled on first use."""

    def __init__(self, others: Mapping[str, Any] | None = None, **arrays: Any) -> None:
        made = others._found if isinstance(others, LateArrays) else others or {}
        self._found: dict[str, Any] = {**made, **arrays}

    def __getitem__(self, name: str) -> Any:
        array = self.read(name)
        if isinstance(array, Signal):
            array = self._found[name] = array.label()
        return array

    def read(self, name: str) -> Any:
        """Return an array, without labels if nobody asked for them before."""
        array = self._found[name]
        if callable(array):
            array = self._found[name] = array()
        return array

    def __contains__(self, name: object) -> bool:
        return name in self._found

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


@dataclass(frozen=True, eq=False)
class Result:
    """Signature, cadence map, features and settings of a target.

    Two results are equal if all their contents are equal to the last bit; NaN equals NaN.

    Parameters
    ----------
    analysis : Analysis
        Settings of the analysis, including clutter removal.
    label : str or None
        Class from the recording's truth or labels; None if it is unknown.
    gate_source : str
        Source of the gate: ``"truth"``, ``"track"`` or ``"given"`` (set by the user).
    features : GaitFeatures
        The report's set F.
    gait_frequency_hz, torso_doppler_hz, n_periods : float or None
    quality : mapping
        Diagnostics by name.
    flags : tuple of str
        Reasons for None values and for caution, without semicolons.
    extended : mapping
        Further features by name, None where undetermined.
    standard_deviation : mapping
        Standard deviations of the set F and of the gait frequency, None where unknown.
    arrays : mapping
        Arrays by name, which :attr:`signature`, :attr:`cadence_map` and the other properties
        return. A result from a table row may have none.
    gate_limits : Gate, optional
        Gate of the target, for a tracked target over the whole track; None in a result from a table row.
    segments : tuple of Result
        For a tracked target, one result per segment of steady motion in the order of time. The
        values of the target are those of the longest segment.
    pictures : ndarray, shape (pictures, slices, columns, cells), optional
        Of a tracked target: levels from 0 to 1 about its range and velocity; not stored in files.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.simulate(dg.Scene([dg.Target("boulic", "human")], duration_s=3.0), "x4")
    >>> dg.analyze(recording, gate="truth")[0].label
    'human'
    """

    analysis: Analysis
    label: str | None = None
    gate_source: str = "given"
    features: GaitFeatures = field(default_factory=GaitFeatures)
    gait_frequency_hz: float | None = None
    torso_doppler_hz: float | None = None
    n_periods: float | None = None
    quality: Mapping[str, Any] = field(default_factory=dict)
    flags: tuple[str, ...] = ()
    extended: Mapping[str, float | None] = field(default_factory=dict)
    standard_deviation: Mapping[str, float | None] = field(default_factory=dict)
    arrays: Mapping[str, Any] = field(default_factory=dict)
    gate_limits: Gate | None = None
    segments: tuple[Result, ...] = ()
    pictures: npt.NDArray[np.float32] | None = None

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Result):
            return NotImplemented
        return json.dumps(self.to_json(), sort_keys=True) == json.dumps(other.to_json(), sort_keys=True)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return show_text(
            f"Result of {self.label or 'a target of unknown class'}, gate {self.gate_source}", self._facts()
        )

    def _repr_html_(self) -> str:
        facts = {"label": self.label or "unknown", "gate": self.gate_source, **self._facts()}
        return show_html("Result", facts, "result" if "signature" in self.arrays else "", self)

    def _facts(self) -> dict[str, str]:
        figures = {**self.shown_features, "gait_frequency_hz": self.gait_frequency_hz}
        return {
            **{
                STEP_LENGTHS.get(name, name): f"{value:.4g}" + " ?" * (name in self.doubtful)
                for name, value in figures.items()
                if value is not None
            },
            "segments": str(len(self.segments) or ""),
            "seconds": " to ".join(f"{self.quality[key]:.4g}" for key in SECONDS if key in self.quality),
            "flags": "; ".join(self.flags),
        }

    def plot(self, *, ax: Any = None, **settings: Any) -> Any:
        """Plot the signature with its main line; settings of :func:`doppelgait.viz.signature`."""
        return plot("result", self, ax=ax, **settings)

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Names of values of low confidence: the gait frequency and what is derived from it."""
        return FROM_GAIT_FREQUENCY if "low_confidence" in self.flags else ()

    @property
    def shown_features(self) -> dict[str, float | None]:
        """Features for display; a known step length on the ground is before the radial one."""
        shown: dict[str, float | None] = {}
        for name, value in self.features.as_dict().items():
            if name == "step_length_m" and self.quality.get("ground_step_length_m") is not None:
                shown["ground_step_length_m"] = self.quality["ground_step_length_m"]
            shown[name] = value
        return shown

    @property
    def verdict(self) -> str | None:
        """Kind of target: body, or with a flag thing, unknown, reflection or folded."""
        verdict = self.quality.get("verdict")
        return None if verdict is None else str(verdict)

    @property
    def is_body(self) -> bool:
        """True unless the verdict is thing, unknown, reflection or folded."""
        return self.verdict in (None, "body")

    @property
    def n_bodies(self) -> int:
        """Number of bodies that the target counts as: 2 where more than one is likely."""
        several = float(self.quality.get("more_than_one_probability") or 0.0) >= DEFINITE
        return int(self.is_body) * (1 + several)

    def _get_array(self, name: str) -> Any:
        if name not in self.arrays:
            raise AnalysisError(f"this result has no {name}; it was read from a table row that does not store it")
        return self.arrays[name]

    @property
    def gate(self) -> Gate:
        """Gate of the target; :class:`AnalysisError` if it is not stored."""
        if self.gate_limits is None:
            raise AnalysisError("this result has no gate; it was read from a table row, which does not store it")
        return self.gate_limits

    @property
    def signature(self) -> xr.DataArray:
        """Signature (time, doppler), V^2, with the analysis hop."""
        return self._get_array("signature")  # type: ignore[no-any-return]

    @property
    def ti_frames(self) -> xr.DataArray:
        """Four features per column as in the classifier of TI's xWRL6432, above the noise floor."""
        return measure_columns(self.signature, noise_floor_v2=float(self.quality.get("noise_floor_v2") or 0.0))

    @property
    def normalised_signature(self) -> xr.DataArray:
        """Normalised signature (time, doppler) for the features, decimated to the lossless hop."""
        return self._get_array("normalised_signature")  # type: ignore[no-any-return]

    @property
    def cadence_map(self) -> xr.DataArray:
        """Cadence-velocity diagram (cadence, doppler), relative to the main line if ``aligned``."""
        return self._get_array("cadence_map")  # type: ignore[no-any-return]

    @property
    def cadence_spectrum(self) -> xr.DataArray:
        """Cadence spectrum (cadence)."""
        return self._get_array("cadence_spectrum")  # type: ignore[no-any-return]

    @property
    def mean_doppler_spectrum(self) -> npt.NDArray[np.float64]:
        """D_1 of the normalised signature, shape (K,)."""
        return self._get_array("mean_doppler_spectrum")  # type: ignore[no-any-return]

    @property
    def main_line_hz(self) -> npt.NDArray[np.float64]:
        """Straight main line at the signature's columns, (J,)."""
        return self._get_array("main_line_hz")  # type: ignore[no-any-return]

    @property
    def parts(self) -> xr.Dataset | None:
        """Power, label, energy share, velocity of torso, legs, limbs (E-40), or None with a flag."""
        power = self.arrays.get("part_power")
        return None if power is None else measure_parts(power)

    @property
    def torso_velocity_mps(self) -> npt.NDArray[np.float64]:
        """Torso radial velocity at the signature's columns, (J,), of an ``extended`` analysis."""
        return self._get_array("torso_velocity_mps")  # type: ignore[no-any-return]

    def to_json(self, *, arrays: bool = True) -> dict[str, Any]:
        """Convert to plain values for ``json.dumps``; :meth:`from_json` returns an equal result.

        ``arrays`` adds arrays, gate limits and analysis settings to the document of a target of
        ``doppelgait analyze --json``. Numbers that are not finite stay NaN and Infinity.
        """
        plain = {
            "label": self.label,
            "gate": self.gate_source,
            "features": convert_to_plain(self.features.as_dict()),
            **{name: convert_to_plain(getattr(self, name)) for name in NUMBERS},
            "quality": convert_to_plain(self.quality),
            "flags": list(self.flags),
            "standard_deviation": convert_to_plain(self.standard_deviation),
            "extended": convert_to_plain(self.extended),
        }
        if self.segments:
            plain["segments"] = [segment.to_json(arrays=arrays) for segment in self.segments]
        if arrays:
            gate = self.gate_limits
            plain["analysis"] = self.analysis.model_dump(mode="json")
            plain["arrays"] = {name: _encode_values(describe_array(array)) for name, array in self.arrays.items()}
            plain["gate_limits"] = gate and {
                "time_s": _encode_values({"values": gate.time_s}),
                "centre_m": _encode_values({"values": gate.centre_m}),
                "span_m": gate.span_m,
                "doppler_hz": gate.doppler_hz and list(gate.doppler_hz),
                "source": gate.source,
            }
        return plain

    @classmethod
    def from_json(cls, plain: Mapping[str, Any]) -> Result:
        """Make a result from :meth:`to_json` with arrays; an AnalysisError if a part is missing."""
        needed = ("analysis", "label", "gate", "features", *NUMBERS, *GROUPS, "flags", "arrays", "gate_limits")
        _check_keys(plain, needed, "document", "make it with Result.to_json(), with arrays")
        gate = plain["gate_limits"]
        arrays = {name: join_array(_decode_values(stored)) for name, stored in plain["arrays"].items()}
        limits = None
        if gate is not None:
            band_hz = None if gate["doppler_hz"] is None else tuple(gate["doppler_hz"])
            times_s, centre_m = (_decode_values(gate[name])["values"] for name in ("time_s", "centre_m"))
            limits = Gate(times_s, centre_m, gate["span_m"], band_hz, gate["source"])
        segments = [cls.from_json(segment) for segment in plain.get("segments", ())]
        return make_result(plain, arrays, limits, segments)

    def to_row(self) -> dict[str, Any]:
        """Convert numbers and flags to table columns, without label and analysis."""
        row = {
            "gate": self.gate_source,
            **{f"feature_{name}": value for name, value in self.features.as_dict().items()},
            **{name: getattr(self, name) for name in NUMBERS},
        }
        for name, prefix in GROUPS.items():
            row |= {f"{prefix}{key}": value for key, value in getattr(self, name).items()}
        return {**row, "flags": ";".join(self.flags)}

    @classmethod
    def from_row(
        cls,
        row: Mapping[str, Any],
        analysis: Analysis,
        *,
        label: str | None = None,
        arrays: Mapping[str, Any] | None = None,
        gate_limits: Gate | None = None,
    ) -> Result:
        """Make a result from the columns of :meth:`to_row`, and from what is stored with the row.

        Other columns are ignored; a missing one is an AnalysisError. ``analysis`` has the settings
        of the row. In the index of a dataset the column ``flags`` is named ``quality_flags``.
        """
        if "quality_flags" in row:
            row = {"flags" if key == "quality_flags" else key: value for key, value in row.items()}
        needed = ("gate", "flags", *NUMBERS, *(f"feature_{name}" for name in FEATURE_UNITS))
        _check_keys(row, needed, "row", "make it with Result.to_row()")
        plain: dict[str, Any] = {
            **row,
            "analysis": analysis,
            "label": label,
            "features": {name: row[f"feature_{name}"] for name in FEATURE_UNITS},
            "flags": filter(None, (row["flags"] or "").split(";")),
        }
        for name, prefix in GROUPS.items():
            plain[name] = {key.removeprefix(prefix): row[key] for key in row if key.startswith(prefix)}
        return make_result(plain, arrays or {}, gate_limits)


def make_result(
    plain: Mapping[str, Any], arrays: Mapping[str, Any], gate: Gate | None, segments: Iterable[Result] = ()
) -> Result:
    """Make a result from its plain values, named as in :meth:`Result.to_json`, and its arrays."""
    analysis = plain["analysis"]
    return Result(
        analysis=analysis if isinstance(analysis, Analysis) else validate(Analysis, analysis, where="analysis"),
        label=plain["label"],
        gate_source=plain["gate"],
        features=GaitFeatures(**plain["features"]),
        **{name: plain[name] for name in (*NUMBERS, *GROUPS)},
        flags=tuple(plain["flags"]),
        arrays=arrays,
        gate_limits=gate,
        segments=tuple(segments),
    )


def read_signal(result: Result | None, name: str) -> Any:
    """Return an array of a result, without labels if it has none yet."""
    arrays = {} if result is None else result.arrays
    return arrays.read(name) if isinstance(arrays, LateArrays) and name in arrays else getattr(result, name, None)


def _check_keys(stored: Any, needed: Sequence[str], noun: str, remedy: str) -> None:
    missing = [name for name in needed if not isinstance(stored, Mapping) or name not in stored]
    if missing:
        raise AnalysisError(f"this {noun} of a result has no {', '.join(missing[:3])}; {remedy}")


def convert_to_plain(value: Any) -> Any:
    """Convert NumPy scalars to Python scalars."""
    if isinstance(value, Mapping):
        return {str(key): convert_to_plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [convert_to_plain(inner) for inner in value]
    return value.item() if isinstance(value, np.generic) else value


def describe_array(array: Any) -> dict[str, Any]:
    """Take an array apart: ``values``; of labels ``dims``, ``name``, ``attrs`` and ``coords``."""
    if not isinstance(array, xr.DataArray):
        return {"values": np.asarray(array)}
    axes = {
        str(key): {"values": axis.values, "dims": list(axis.dims), "attrs": convert_to_plain(axis.attrs)}
        for key, axis in array.coords.items()
    }
    facts = {"dims": list(array.dims), "name": array.name, "attrs": convert_to_plain(array.attrs)}
    return {"values": array.values, **facts, "coords": axes}


def join_array(members: Mapping[str, Any]) -> Any:
    """Make an array from what :func:`describe_array` returns."""
    if "dims" not in members:
        return members["values"]
    axes = {key: (axis["dims"], axis["values"], axis["attrs"]) for key, axis in members["coords"].items()}
    facts = {key: members[key] for key in ("dims", "name", "attrs")}
    return xr.DataArray(members["values"], coords=axes, **facts)


def _encode_values(members: Mapping[str, Any]) -> dict[str, Any]:
    """Replace values by text, also those of the axes."""
    plain = {key: value for key, value in members.items() if key != "values"}
    if "coords" in plain:
        plain["coords"] = {key: _encode_values(axis) for key, axis in plain["coords"].items()}
    values = np.ascontiguousarray(members["values"])
    text = base64.b64encode(values.tobytes()).decode()
    return {"dtype": values.dtype.str, "shape": list(values.shape), "base64": text, **plain}


def _decode_values(plain: Mapping[str, Any]) -> dict[str, Any]:
    members = dict(plain)
    if "coords" in members:
        members["coords"] = {key: _decode_values(axis) for key, axis in members["coords"].items()}
    data = np.frombuffer(base64.b64decode(plain["base64"]), dtype=np.dtype(plain["dtype"]))
    return {**members, "values": data.reshape(plain["shape"]).copy()}


class TargetList(list[Result]):
    """List of results per target; if empty, ``reason`` is one sentence with numbers."""

    def __init__(self, results: Iterable[Result] = (), *, reason: str = "") -> None:
        super().__init__(results)
        self.reason = reason

    @property
    def n_bodies(self) -> int:
        """Number of bodies."""
        return sum(result.n_bodies for result in self)

    @property
    def n_unknown(self) -> int:
        """Number of targets of which it is unknown whether they are bodies."""
        return sum(result.verdict == "unknown" for result in self)

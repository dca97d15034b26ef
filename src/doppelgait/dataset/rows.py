"""Index rows: identity, resolved parameters, truth, features and diagnostics of every target."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from doppelgait.core.config import FrozenModel, canonical_json
from doppelgait.dataset.resolve import ExampleSpec, RowSpec
from doppelgait.features import FEATURE_UNITS
from doppelgait.pipeline import TargetResult
from doppelgait.pipeline.fused import FusedExample
from doppelgait.radar.recording import TargetTruth

NOTHING = {
    **{f"feature_{name}": None for name in FEATURE_UNITS},
    **dict.fromkeys(("gait_frequency_hz", "torso_doppler_hz", "n_periods")),
}
"""Columns of a row without a target; they are there even if no row has one."""


def index_rows(
    example: ExampleSpec, made: FusedExample, results: Sequence[TargetResult | None], messages: Sequence[str]
) -> list[dict[str, Any]]:
    """Rows of an example, one per target; None for unknown.

    Parameters
    ----------
    example : ExampleSpec
    made : FusedExample
        Truth and levels.
    results : sequence of TargetResult or None
        One per row; None where no track follows the target.
    messages : sequence of str
        Warnings of simulation and analysis.
    """
    scene = _scene_columns(example, made)
    rows = []
    for number, (row, result) in enumerate(zip(example.rows, results, strict=True)):
        truth = made.truth[number]
        columns = {
            **_identity_columns(example, row, number),
            **scene,
            "rcs_total_m2": float(truth.scatterers["rcs"].values.sum(axis=1).mean()),
            **(truth_columns(truth) if row.source != "none" else dict.fromkeys(truth_columns(truth))),
            **(result_columns(result) if result is not None else {"gate": "track", **NOTHING, "flags": "not_tracked"}),
            "warnings": ";".join(messages),
        }
        rows.append({key: _plain(value) for key, value in columns.items()})
    return rows


def _identity_columns(example: ExampleSpec, row: RowSpec, number: int) -> dict[str, Any]:
    motion = example.run.scene.targets[number].motion
    return {
        "id": row.id,
        "scene_id": example.id,
        "label": row.label,
        "split": example.split,
        "subject": row.subject,
        "group": example.group,
        "source": row.source,
        "recording": row.recording,
        "licence": row.licence,
        "motion_kind": "none" if row.source == "none" else motion["kind"],
        "motion": "" if row.source == "none" else canonical_json(motion),
    }


def _scene_columns(example: ExampleSpec, made: FusedExample) -> dict[str, Any]:
    prf_hz = example.run.radar.prf_hz
    nobody = all(row.source == "none" for row in example.rows)
    return {
        "carrier_hz": example.run.radar.carrier_hz,
        "prf_hz": prf_hz,
        "observation_s": made.n_pulses / prf_hz,
        "environment": _listed(example.run.environment),
        "impairments": _listed(example.run.impairments),
        "radar_height_m": example.run.scene.radar_position_m[2],
        "snr_frame_db": None if nobody else made.snr_frame_db,
        "gate_error_m": example.gate_error_m,
    }


def result_columns(result: TargetResult) -> dict[str, Any]:
    """Columns of an analysed target, simulated or measured: features, their spread, diagnostics and flags."""
    return {
        "gate": result.gate,
        **{f"feature_{k}": v for k, v in result.features.as_dict().items()},
        "gait_frequency_hz": result.gait_frequency_hz,
        "torso_doppler_hz": result.torso_doppler_hz,
        "n_periods": result.n_periods,
        **{f"quality_{k}": v for k, v in result.quality.items()},
        **{f"sd_{k}": v for k, v in result.standard_deviation.items()},
        **{f"extended_{k}": v for k, v in result.extended.items()},
        "flags": ";".join(result.flags),
    }


def _listed(specs: Sequence[FrozenModel]) -> str:
    """Environment or impairments of an example as one line of JSON."""
    return json.dumps([spec.model_dump(mode="json") for spec in specs], sort_keys=True, separators=(",", ":"))


def truth_columns(truth: TargetTruth) -> dict[str, Any]:
    """Columns of the index that only a simulation knows; their names begin with ``truth_``."""
    aspect_rad = truth.centre_aspect_rad[np.isfinite(truth.centre_aspect_rad)]  # unknown while the body stands still
    return {
        "truth_gait": truth.gait,
        "truth_height_m": truth.height_m,
        "truth_ground_speed_mps": truth.ground_speed_mps,
        "truth_radial_velocity_mps": float(truth.centre_velocity_mps.mean()),
        "truth_range_m": float(truth.centre_range_m.mean()),
        "truth_aspect_deg": float(np.degrees(aspect_rad.mean())) if aspect_rad.size else math.nan,
        "truth_gait_frequency_hz": truth.gait_frequency_hz,
        "truth_step_frequency_hz": truth.step_frequency_hz,
        "truth_stride_frequency_hz": truth.stride_frequency_hz,
    }


def _plain(value: Any) -> Any:
    """JSON has no NaN and no infinity; both are unknown."""
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value

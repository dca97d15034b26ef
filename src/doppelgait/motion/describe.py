"""Facts about a motion recording: file, travel and stride."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait.core.errors import MotionError, warn_caller
from doppelgait.motion.checks import list_few
from doppelgait.motion.clean import clean_motion, fill_linear, find_stationary_points
from doppelgait.motion.gait import measure_stride, measure_travel
from doppelgait.motion.motion import Motion
from doppelgait.motion.readers import check_types, cut_part, read, take_part
from doppelgait.motion.segments import Segment, find_segments


def describe_recording(path: str | os.PathLike[str], **options: Any) -> dict[str, Any]:
    """Return facts about a motion file, raw and cleaned."""
    # facts about the cleaned motion are under "cleaned". If cleaning fails, the reason is there.
    if "clean" in options:
        raise MotionError("clean is not an option here: both the recorded and the cleaned motion are described")
    check_types(Path(path), options)
    part: dict[str, Any] = {"segment": None, "loop_to_s": None, "loop_variation": 1.0, "treadmill": False}
    part = {name: options.pop(name, default) for name, default in part.items()}
    start_s, stop_s = options.pop("start_s", None), options.pop("stop_s", None)
    whole = read(path, clean=False, **options)
    raw = cut_part(Path(path), whole, start_s, stop_s)
    try:
        motion = clean_motion(raw, whole=None if raw is whole else whole)
    except MotionError as error:
        cleaned = {"refused": str(error)}
    else:
        if unknown := motion.report["unknown_parts"]:  # a scene warns of them, too, if its cross sections need parts
            warn_caller(f"{path}: points without a known body part: {list_few(unknown)}; name them after body parts")
        cleaned = describe_motion(take_part(Path(path), motion, **part))
    facts = describe_motion(raw)
    segments = cleaned.pop("segments", facts["segments"])
    return {**facts, "segments": segments, "cleaned": cleaned}


def describe_motion(motion: Motion) -> dict[str, Any]:
    """Return facts about a motion as JSON values. A value that cannot be measured is None."""
    position = motion.position_m
    rate = motion.rate_hz
    report: Mapping[str, Any] = motion.report
    missing = np.isnan(position).any(axis=2)
    still = find_stationary_points(position)
    z = fill_linear(position[:, ~still])[:, :, 2]
    z = z[:, np.isfinite(z).all(axis=0)]
    facts = {
        "file": motion.facts.source,
        "subject": motion.facts.subject,
        **{key: report[key] for key in report if key not in ("dropped", "n_frames", "frame_rate_hz")},
        "frame_rate_hz": rate,
        "n_frames": int(position.shape[0]),
        "duration_s": position.shape[0] / rate,
        "gap_fraction": float(missing.mean()) if missing.size else 0.0,
        "points_with_gaps": int(missing.any(axis=0).sum()),
        "points_all_missing": int(missing.all(axis=0).sum()),
        "stationary_points": int(still.sum()),
        "height_m": float(np.median(np.ptp(z, axis=1))) if z.size else None,
        "lowest_point_m": float(z.min()) if z.size else None,
        "stature_m": motion.facts.height_m,
        **measure_travel(position, rate_hz=rate),
        **measure_stride(position, rate_hz=rate),
        "points": motion.markers,
        "points_dropped": {str(k): list(v) for k, v in report.get("dropped", {}).items()},
        "segments": [_describe_segment(segment, motion.facts.file_time_s) for segment in find_segments(motion)],
    }
    return _drop_unknown(facts)


def _describe_segment(segment: Segment, starts_s: float) -> dict[str, Any]:
    # times are relative to the first frame of the file, like start_s and stop_s of read
    facts, gait = vars(segment) | vars(segment.gait), segment.gait
    facts |= {"start_s": starts_s + segment.start_s, "stop_s": starts_s + segment.stop_s}
    facts["footfalls"] = {foot: [starts_s + t for t in times] for foot, times in gait.footfalls.items()}
    facts["stride_from"] = facts.pop("measured_from")
    return _drop_unknown(facts)


def _drop_unknown(facts: Mapping[str, Any]) -> dict[str, Any]:
    unknown = (key for key, value in facts.items() if isinstance(value, float) and not math.isfinite(value))
    return {**facts, **dict.fromkeys(unknown)}

"""Segments, stride frequencies and gaits of the shared recordings, against the table measured with other code."""

import csv
import json
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from doppelgait.cli.app import app
from doppelgait.motion import Motion
from doppelgait.motion.readers import bvh, read  # noqa: F401  (BVH registers itself)
from doppelgait.motion.segments import QUADRUPED, Segment, find_segments
from recorded import read_quietly

pytestmark = pytest.mark.shared


@dataclass(frozen=True)
class Pair:
    """A row of the table and the segment that overlaps it most, None when none does by more than half."""

    row: dict[str, str]
    segment: Segment | None


def _motion(shared: Path, file: str, *, clean: bool = False) -> Motion:
    return read_quietly(shared / "data" / "mocap" / file, clean=clean)


def _overlap(row: dict[str, str], segment: Segment) -> float:
    start, stop = (float(row[key]) / float(row["frame_rate_hz"]) for key in ("start_frame", "end_frame"))
    both = min(stop, segment.stop_s) - max(start, segment.start_s)
    return max(0.0, both) / (max(stop, segment.stop_s) - min(start, segment.start_s))


@cache
def _pairs(shared: Path, kind: str) -> tuple[Pair, ...]:
    with (shared / "data" / "mocap" / "segments.csv").open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["class"] == kind and row["file"].endswith((".c3d", ".bvh"))]
    found: dict[str, list[Segment]] = {}
    for name in {row["file"] for row in rows}:
        motion = _motion(shared, name)
        found[name] = find_segments(motion, limits=QUADRUPED if kind == "rat" else None)
    pairs = []
    for row in rows:
        best = max(found[row["file"]], key=lambda segment: _overlap(row, segment), default=None)
        pairs.append(Pair(row, best if best and _overlap(row, best) > 0.5 else None))
    return tuple(pairs)


@pytest.mark.parametrize(("kind", "share"), [("human", 1.0), ("dog", 0.93), ("rat", 1.0)])
def test_segments_of_the_table_are_found(shared: Path, kind: str, share: float) -> None:
    pairs = _pairs(shared, kind)
    hits = [pair for pair in pairs if pair.segment]
    assert len(hits) >= share * len(pairs) > 0
    speeds = [pair.segment.mean_speed_mps / float(pair.row["speed_mps"]) - 1 for pair in hits]
    # where two equally long stretches overlap, the other one may have been taken
    assert np.median(np.abs(speeds)) < 0.01
    assert np.percentile(np.abs(speeds), 90) < 0.05


def test_people_walk_and_run_as_labelled(shared: Path) -> None:
    pairs = [pair for pair in _pairs(shared, "human") if pair.segment]
    differ = [pair.row["file"] for pair in pairs if _human_gait(pair.segment) not in (_label(pair.row), "")]
    # its feet are never both off the ground: a walk by our definition and by its free fall
    assert set(differ) <= {"human/bvh/bandai2_run_elderly_001.bvh"}
    named = [pair for pair in pairs if _human_gait(pair.segment)]
    assert len(named) >= 0.9 * len(pairs)


def _human_gait(segment: Segment | None) -> str:
    return segment.gait.gait if segment else ""


def _label(row: dict[str, str]) -> str:
    return {"jog": "run"}.get(row["action_label"], row["action_label"])


def test_stride_frequencies_of_people(shared: Path) -> None:
    """The table gives spectral peaks, to about 0.1 Hz."""
    pairs = [pair for pair in _pairs(shared, "human") if pair.segment]
    differences = [pair.segment.gait.stride_frequency_hz - float(pair.row["stride_hz"]) for pair in pairs]
    assert not any(math.isnan(d) for d in differences)
    assert np.median(np.abs(differences)) < 0.05
    assert np.mean(np.abs(differences) < 0.1) > 0.85


def test_stride_frequencies_and_lags_of_dogs(shared: Path) -> None:
    """Against paw contacts found in other code, jumps and changes of gait left out."""
    pairs = [pair for pair in _pairs(shared, "dog") if pair.segment and not pair.row["footfall_note"]]
    ratios = [pair.segment.gait.stride_frequency_hz / float(pair.row["footfall_stride_hz"]) - 1 for pair in pairs]
    assert np.isfinite(ratios).mean() > 0.9
    assert np.nanmedian(np.abs(ratios)) < 0.025
    assert np.nanpercentile(np.abs(ratios), 90) < 0.10
    lags = []
    for pair in pairs:
        for name, lag in pair.segment.gait.phases.items():
            if pair.row[f"footfall_phase_{name}"]:
                wrong = lag - float(pair.row[f"footfall_phase_{name}"])
                lags.append(abs((wrong + 0.5) % 1 - 0.5))
    assert len(lags) > 2.5 * len(pairs)
    assert np.median(lags) < 0.03
    assert np.percentile(lags, 90) < 0.09


def test_gaits_of_dogs(shared: Path) -> None:
    """Symmetrical and asymmetrical gaits are never mixed up; pace, walk and trot differ only near their borders."""
    pairs = [pair for pair in _pairs(shared, "dog") if pair.segment and not pair.row["footfall_note"]]
    same = 0
    for pair in pairs:
        named, gait = pair.row["gait"], pair.segment.gait.gait
        fast = named == "canter/gallop/bound"
        if gait:
            assert (gait in ("canter", "gallop", "transverse_gallop", "bound")) == fast, pair.row["file"]
        same += gait == named or (fast and gait != "")
    assert same > 0.7 * len(pairs)


def test_motion_info_lists_segments(shared: Path) -> None:
    path = str(shared / "data" / "mocap" / "human" / "c3d" / "cmu_82_08.c3d")
    shown = CliRunner().invoke(app, ["motion", "info", path])
    (segment,) = json.loads(CliRunner().invoke(app, ["motion", "info", path, "--json"]).stdout)["segments"]
    # rows of the table: frames 1158 to 1596 at 120 Hz, 0.848 m/s, 0.75 Hz
    assert segment["start_s"] == pytest.approx(1158 / 120, abs=0.11)
    assert segment["stop_s"] == pytest.approx(1596 / 120, abs=0.11)
    assert segment["mean_speed_mps"] == pytest.approx(0.848, rel=0.02)
    assert segment["stride_frequency_hz"] == pytest.approx(0.75, rel=0.05)
    last = shown.stdout.strip().splitlines()[-1].split()
    assert last[:2] == ["1", f"{segment['start_s']:.6g}"]
    assert "walk" in last

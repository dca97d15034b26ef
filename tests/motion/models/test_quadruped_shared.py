"""Stride law and footfall phases of the quadruped model against the two dogs of the shared test data."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import find_peaks

from doppelgait.motion.models import quadruped_gait
from doppelgait.motion.models.quadruped_gaits import GAITS, froude_number, pick_gait, stride_length_m
from doppelgait.motion.readers import read

pytestmark = pytest.mark.shared

DOGS = {
    # Hip height in m, and by how much the stored lengths are too small (free fall in the gallop; breed standard).
    "mann-bvh": (0.46, 1.2),
    "tencent-bvh": (0.43, 1.0),
}


@pytest.fixture(scope="module")
def segments(shared: Path) -> list[dict[str, str]]:
    """Steady straight stretches with at least ten detected footfalls."""
    with (shared / "data/mocap/segments.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["class"] == "dog" and not row["footfall_note"]]
    return [row for row in rows if int(row["footfalls"] or 0) >= 10 and row["footfall_phase_lh_lf"]]


def lag(rows: list[dict[str, str]], column: str) -> float:
    """Circular mean of a phase lag, in strides, 0 to 1."""
    phases = np.array([float(row[column]) for row in rows])
    return float(np.angle(np.exp(2j * np.pi * phases).mean()) / (2 * np.pi) % 1)


def test_stride_frequency_follows_from_speed_and_size(segments: list[dict[str, str]]) -> None:
    ratios = []
    for row in segments:
        hip_m, factor = DOGS[row["file"].split("/")[1]]
        speed_mps = factor * float(row["speed_mps"])
        gait = GAITS[pick_gait(froude_number(speed_mps, hip_m))]
        ratios.append(speed_mps / stride_length_m(gait, speed_mps, hip_m) / float(row["footfall_stride_hz"]))
    assert len(ratios) == 25
    # The reference gives c to 8 % and the size of the dogs is known to about as much.
    assert np.median(ratios) == pytest.approx(1.0, abs=0.08)
    assert min(ratios) > 0.78  # the Labrador as it sets off, 0.84 m/s
    assert max(ratios) < 1.15


@pytest.mark.parametrize(
    ("folder", "gait", "count"),
    [("mann-bvh", "pace", 11), ("tencent-bvh", "walk", 2), ("tencent-bvh", "trot", 1), ("mann-bvh", "trot", 1)],
)
def test_footfall_phases_of_the_symmetrical_gaits(
    segments: list[dict[str, str]], folder: str, gait: str, count: int
) -> None:
    rows = [row for row in segments if folder in row["file"] and row["gait"] == gait]
    assert len(rows) == count
    motion = quadruped_gait(gait=gait, duration_s=3.0)
    footfalls, frequency_hz = motion.facts.footfalls, motion.facts.stride_frequency_hz
    start = footfalls["left_hind"][1]
    for foot, measured in (
        ("left_fore", lag(rows, "footfall_phase_lh_lf")),
        ("right_hind", lag(rows, "footfall_phase_lh_rh")),
        ("right_fore", lag(rows, "footfall_phase_lh_lf") + lag(rows, "footfall_phase_lf_rf")),
    ):
        model = (min(t for t in footfalls[foot] if t >= start - 1e-9) - start) * frequency_hz
        # Contacts of single segments are known to a frame or two: 0.03 to 0.05 strides.
        assert abs((model - measured + 0.5) % 1 - 0.5) < 0.05, foot


@pytest.mark.parametrize(
    ("gait", "speed_mps", "stride_hz", "lag"), [("walk", 1.58, 0.947, 0.24), ("trot", 2.88, 1.466, 0.46)]
)
def test_a_horse_strides_and_steps_as_the_recorded_one(
    shared: Path, gait: str, speed_mps: float, stride_hz: float, lag: float
) -> None:
    found = []
    for path in sorted((shared / "data/mocap/horse/vhdc-csv").glob(f"Horse1_M1_{gait}*.csv")):
        motion = read(path, units="mm", treadmill=True)
        x_m = {name: motion.position_m[:, list(motion.markers).index(name), 0] for name in ("Withers", "HFL", "HHL")}
        ahead_s = {}
        for hoof in ("HHL", "HFL"):
            peaks, _ = find_peaks(x_m[hoof] - x_m["Withers"], prominence=0.3)
            ahead_s[hoof] = motion.time_s[peaks]
        stride_s = float(np.median(np.diff(ahead_s["HHL"])))
        after_s = ahead_s["HFL"][ahead_s["HFL"] > ahead_s["HHL"][0]][0] - ahead_s["HHL"][0]
        went_m = x_m["Withers"][-1] - x_m["Withers"][0]
        found.append((went_m / motion.time_s[-1], 1 / stride_s, after_s / stride_s % 1))
    assert np.mean(found, axis=0) == pytest.approx((speed_mps, stride_hz, lag), rel=0.06)
    facts = quadruped_gait(build="horse", withers_m=1.28, gait=gait, speed_mps=speed_mps, duration_s=3.0).facts
    assert facts.stride_frequency_hz == pytest.approx(stride_hz, rel=0.03)
    assert facts.footfalls["left_fore"][0] * facts.stride_frequency_hz == pytest.approx(lag, abs=0.05)

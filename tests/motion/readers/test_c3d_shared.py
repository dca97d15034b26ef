"""Every C3D file of the shared test data: read as other readers do, or refused for a stated reason."""

import json
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from checkout import SHARED
from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion import Motion
from doppelgait.motion.clean import clean_motion
from doppelgait.motion.describe import describe_recording
from doppelgait.motion.readers import read
from doppelgait.motion.readers.c3d import parse_c3d
from doppelgait.motion.readers.text import Points
from recorded import read_manifests, read_quietly

pytestmark = pytest.mark.shared

REFUSED = {
    "angles_only.c3d": "no marker positions: its 24 points are model output",
    "bad_parameter_offset.c3d": "damaged parameter section",
    "bad_parameter_section.c3d": "damaged parameter section",
    "empty.c3d": "is empty",
    "macsample_sgi.c3d": "header scales by 0.0551",
    "no_points_emg.c3d": "holds no points",
    "one_frame.c3d": "1 frame",
    "pig_static_one_frame.c3d": "1 frame",
    "rotations_only.c3d": "rotation matrices but no points",
    "two_frames.c3d": "2 frame",
}
"""Edge cases that are refused, and a word of the reason; all other edge cases are read."""

UP_AXES = {
    **dict.fromkeys(["bts_missing_parameters.c3d", "bts_type1.c3d", "elite_undeclared_analog.c3d"], "y"),
    **dict.fromkeys(["motionmonitor.c3d", "scale_parameter_array.c3d"], "y"),
    "phoenix_dance.c3d": "x",
    # two hands in a plane; 54 rigid-body markers; a swing of golf: nothing in them tells what is up
    **dict.fromkeys(["bkin_kinarm.c3d", "optotrak_units_per_point.c3d", "phoenix_golfswing.c3d"]),
}
"""Of all others it is z."""
WARNED = {
    "bts_missing_parameters.c3d": "no length unit",
    "elite_undeclared_analog.c3d": "no length unit",
    "phasespace_no_parameters.c3d": "no length unit",
    "optotrak_units_per_point.c3d": "declares 1149 frames but holds 29",
}
NO_MOTION = {"parameter_overflow.c3d": "0 of 45 points.*never seen", "bkin_kinarm.c3d": "of 2 points"}
"""Read, but too little is left after cleaning: all samples are marked as missing, or two points are no body."""
EDGE = sorted({path.name for path in (SHARED / "data" / "c3d-edge-cases").glob("*.c3d")} - {*REFUSED})
MOCAP = read_manifests(SHARED, "human", "rat", formats=("c3d",)) if SHARED.is_dir() else {}


def _path(shared: Path, name: str) -> Path:
    return shared / "data" / ("mocap/" + MOCAP[name]["file"] if name in MOCAP else f"c3d-edge-cases/{name}")


def _read(shared: Path, name: str, **options: Any) -> Motion:
    return read_quietly(_path(shared, name), **options)


@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_a_reason(shared: Path, name: str) -> None:
    with pytest.raises(MotionError, match=REFUSED[name]) as error:
        read(_path(shared, name))
    assert name in str(error.value)


@pytest.mark.parametrize("name", EDGE)
def test_edge_case_is_read_and_clean_or_says_why_not(shared: Path, name: str) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DoppelgaitWarning)
        motion = read(_path(shared, name), clean=False)
    texts = [str(entry.message) for entry in caught]
    assert len(texts) == (name in WARNED)
    assert all(WARNED[name] in text for text in texts)
    report, up_axis = motion.report, UP_AXES.get(name, "z")
    assert up_axis in (None, report["up_axis"])
    assert len(motion.markers) + sum(map(len, report["dropped"].values())) == report["points_in_file"]
    assert len(EDGE) == 30
    if name in NO_MOTION:
        with pytest.raises(MotionError, match=NO_MOTION[name]):
            clean_motion(motion)
    else:
        assert np.isfinite(clean_motion(motion).position_m).all()


@pytest.mark.parametrize("name", [*NO_MOTION, "optotrak_units_per_point.c3d", "empty.c3d"])
def test_every_file_is_described_or_refused(shared: Path, name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", DoppelgaitWarning)
        try:
            facts = describe_recording(_path(shared, name))
        except MotionError:
            assert name in REFUSED
        else:
            assert name not in REFUSED
            json.dumps(facts, allow_nan=False)


@cache
def _content(shared: Path, name: str) -> Points:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return parse_c3d(_path(shared, name))


NOT_BY_EZC3D = {
    "bkin_kinarm.c3d", "optitrack_mocap36.c3d",  # descriptions are missing or too long
    "phoenix_dance.c3d", "phoenix_golfswing.c3d",  # ANALOG:OFFSET is stored as floats
    "sgi_int.c3d", "sgi_real.c3d",  # its author asks for such a file
    "bts_missing_parameters.c3d", "bts_type1.c3d", "elite_undeclared_analog.c3d",  # analog words in the header alone
    "phasespace_no_parameters.c3d",  # finds no points
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(NOT_BY_EZC3D - {"optitrack_mocap36.c3d"}))  # py-c3d fails
def test_coordinates_agree_with_another_reader(shared: Path, name: str) -> None:
    """Coordinates and missing samples of all points, model outputs included, in the units of the file."""
    reader = pytest.importorskip("c3d")
    with warnings.catch_warnings(), _path(shared, name).open("rb") as file:
        warnings.simplefilter("ignore")
        their = reader.Reader(file)
        theirs = np.array([points[:, :4].copy() for _, points, _ in their.read_frames()])
    ours = _content(shared, name).position
    assert _content(shared, name).rate_hz == pytest.approx(their.point_rate, rel=1e-6)
    assert ours.shape == (*theirs.shape[:2], 3)
    lost = np.isnan(ours).all(axis=2)
    assert np.array_equal(np.isnan(ours).any(axis=2), lost)
    empty = (theirs[:, :, 3] < 0) | (theirs[:, :, :3] == 0).all(axis=2) | np.isnan(theirs[:, :, :3]).any(axis=2)
    assert np.array_equal(lost, empty)
    # integers are scaled in single precision by one and in double by the other: a few units in the seventh digit
    np.testing.assert_allclose(ours[~lost], theirs[~lost][:, :3], rtol=2e-7, atol=1e-6)


@pytest.mark.parametrize("name", sorted({*EDGE, *MOCAP} - NOT_BY_EZC3D))
def test_coordinates_are_those_of_ezc3d_to_the_last_bit(shared: Path, name: str) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    raw, ours = ezc3d.c3d(str(_path(shared, name))), _content(shared, name).position
    assert _content(shared, name).rate_hz == pytest.approx(raw["parameters"]["POINT"]["RATE"]["value"][0], rel=1e-6)
    theirs = np.moveaxis(raw["data"]["points"][:3], 0, 2).swapaxes(0, 1).copy()
    lost = raw["data"]["meta_points"]["residuals"][0].T < 0
    lost |= ~np.isfinite(theirs).all(axis=2) | (theirs == 0.0).all(axis=2)
    theirs[lost] = np.nan
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    ("reference", "others", "step_m"),
    [
        ("pc_real", "dec_real sgi_real", 1e-9),
        ("pc_real", "dec_int pc_int sgi_int", 0.29e-3),
        ("eb015_pi", "eb015_testa eb015_testb eb015_testc eb015_testd", 0.0),
        ("btk_coda_walk", "coda_integer", 0.06e-3),
    ],
)
def test_formats_of_one_walk_agree(shared: Path, reference: str, others: str, step_m: float) -> None:
    first = _read(shared, f"{reference}.c3d", clean=False)
    for name in others.split():
        other = _read(shared, f"{name}.c3d", clean=False)
        assert other.markers == first.markers
        both = np.isfinite(other.position_m) & np.isfinite(first.position_m)
        assert both.sum() > 0.99 * np.isfinite(first.position_m).sum()
        assert np.abs(other.position_m - first.position_m)[both].max() <= step_m

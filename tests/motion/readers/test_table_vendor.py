"""Exports of motion-capture programs and TRC: the same body from every program, and what is missing or damaged."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion import Motion
from doppelgait.motion.readers import read
from motion_files import BODY_M, RATE_HZ, TEXTS, Text, deeplabcut, motive, nexus, opensim, qualisys, trc, visual3d
from walking_body import NAMES


def edit(write: Text, pattern: str, new: str, count: int = 0) -> Text:
    return lambda body: re.sub(pattern, new, write(body), count=count)


MOTIVE = motive("1.23", "Meters", 1.0)
UNTIMED = edit(trc, r"\n(\d+)\t\d\.\d+", r"\n\1\t")
"""A table without times."""


@pytest.mark.parametrize("name", TEXTS)
def test_exports_give_the_same_motion(tmp_path: Path, name: str) -> None:
    suffix, write, options = TEXTS[name]
    path = tmp_path / f"walk.{suffix}"
    path.write_bytes(write(BODY_M).encode())
    motion = read(path, clean=False, **options)
    assert (motion.report["format"], motion.rate_hz, motion.markers) == (name.split()[0], RATE_HZ, NAMES)
    np.testing.assert_allclose(motion.position_m, BODY_M, atol=2e-6)
    assert motion.facts.subject in ("", "Jim", "Rex")


@pytest.mark.filterwarnings("ignore:.*declares 40 frames:doppelgait.core.errors.DoppelgaitWarning")
@pytest.mark.parametrize(
    ("suffix", "text", "options", "says"),
    [
        ("csv", deeplabcut(), {}, r"states no frame rate and no length unit; give the frame rate: rate_hz=.*units="),
        ("csv", deeplabcut(), {"units": "cm"}, r"states no frame rate; give the frame rate: rate_hz="),
        ("csv", deeplabcut(coords="xyl"), {"units": "m"}, r"image coordinates .*triangulate"),
        ("csv", deeplabcut(individuals=True), {"units": "m", "rate_hz": 9.0, "subject": "Eva"}, r"no subject 'Eva'"),
        ("csv", TEXTS["table"][1], {}, r"no column of times .*rate_hz=.*units="),
        ("tsv", qualisys(kind="6D"), {}, "holds rigid bodies; export the 3D data of the markers"),
        ("tsv", edit(qualisys(), "LFHD\t", ""), {}, r"line \d+ has 48 cells; its header names 45 columns"),
        ("csv", edit(nexus(",", around=True), "Trajec", "Histor"), {}, "no block Trajectories"),
        ("csv", edit(nexus(",", around=False), "\n316,.*", ""), {}, "the time steps by"),
        ("sto", opensim("{name}_flexion{axis}"), {}, "no positions; let OpenSim report the marker locations"),
        ("sto", opensim("{name}_{axis}", "BodyVelocities"), {}, "holds BodyVelocities .* no positions"),
        ("csv", edit(MOTIVE, r"\Z", "41\r\n"), {}, r"line \d+ has 1 cells; its header names 50"),
        ("txt", edit(visual3d, "TARGET", "ANALOG"), {}, "positions are TARGET and LANDMARK"),
        ("txt", edit(visual3d, "a.c3d", "b.c3d", 1), {}, "holds 2 recordings"),
        ("csv", edit(motive("1.23", "Meters", 1.0, kind="Bone"), "Global", "Local"), {}, "Global"),
        ("csv", edit(MOTIVE, "Jim:", "Unlabeled 1"), {}, "a body needs 3 named points"),
        ("trc", edit(trc, r"(\n5\t.*?\t.*?\t)[^\t]*", r"\g<1>1 2"), {}, "line 11, column 'LFHD Y': '1 2' is not a n"),
        ("trc", edit(trc, r"\Z", "41\t0.6\t1.0"), {}, "line 47 has 3 cells; its header names 50 columns"),
        ("trc", edit(trc, r"\r\n\Z", "\t5.0"), {}, "line 46 has 51 cells"),
        ("trc", edit(trc, r"\n7\t[^\t]*", r"\n7\t"), {}, "line 13 has no time.*rate_hz="),
        ("trc", edit(trc, r"\n7\t[^\t]*", r"\n7\t0.0625"), {}, "line 13: the time does not increase.*rate_hz="),
        ("trc", edit(trc, r"\n15\t.*", ""), {}, "line 21: the time steps by 0.025 s, but most frames are 0.0125 s"),
        ("trc", edit(trc, "mm", "furlong"), {}, "'furlong' is not a known unit of length; set units to"),
        ("trc", edit(trc, "Frame#", "Bild"), {}, "no line that starts with Frame#"),
        ("trc", edit(UNTIMED, r"\n80\.", r"\nfast"), {}, "'fast"),
        ("trc", edit(trc, r"\n2\t(.|\n)*", ""), {}, "holds 1 frame"),
        ("trc", edit(trc, r"\n1\t(.|\n)*", ""), {}, "holds 0 frame"),
    ],
)
def test_what_is_missing_has_one_clear_error(
    tmp_path: Path, suffix: str, text: Text, options: dict[str, Any], says: str
) -> None:
    path = tmp_path / f"walk.{suffix}"
    path.write_bytes(text(BODY_M).encode())
    with pytest.raises(MotionError, match=says):
        read(path, clean=False, **options)


def test_a_first_or_last_point_that_is_not_seen_at_first_stays_in_its_place(tmp_path: Path) -> None:
    body = BODY_M.copy()
    body[:4, [0, -1]] = np.nan
    for columns in (0, 1, 2):
        for gap in ("", "NULL"):
            (tmp_path / "walk.tsv").write_bytes(qualisys(columns=columns, gap=gap)(body).encode())
            np.testing.assert_allclose(read(tmp_path / "walk.tsv", clean=False).position_m, body, atol=2e-6)


def read_trc(tmp_path: Path, write: Text = trc, body: np.ndarray = BODY_M, **options: Any) -> Motion:
    (tmp_path / "walk.trc").write_bytes(write(body).encode())
    return read(tmp_path / "walk.trc", clean=False, **options)


HEADER = "  80.0\t\t  80.0\t\t   40\t\t     16\t\t mm"  # as some programs align it


@pytest.mark.parametrize(
    ("tab", "point", "header"),
    [("\t", ",", ""), (";", ",", ""), (";", ".", ""), (",", ".", ""), ("\t", ".", HEADER)],
)
def test_decimal_commas_and_other_separators(tmp_path: Path, tab: str, point: str, header: str) -> None:
    lines = trc(BODY_M).split("\r\n")
    lines[2] = header or lines[2]
    rows = [*lines[:2], *(line.replace(".", point) for line in lines[2:])]
    motion = read_trc(tmp_path, lambda body: "\n".join(rows).replace("\t", tab))
    np.testing.assert_allclose(motion.position_m, BODY_M, atol=1e-6)
    assert (motion.rate_hz, motion.report["notes"]) == (RATE_HZ, [])


def test_y_is_taken_where_nothing_shows_what_is_up(tmp_path: Path) -> None:
    ball = np.random.default_rng(0).normal(size=(1, 16, 3)) + np.zeros((10, 1, 1))
    with pytest.warns(DoppelgaitWarning, match="which axis points up; y is assumed"):
        motion = read_trc(tmp_path, edit(trc, r"[LR][A-Z]{3}|C7|STRN", "P"), ball)
    np.testing.assert_allclose(motion.position_m, ball, atol=1e-6)


@pytest.mark.parametrize("titled", [True, False])
def test_zeros_and_unlabelled_columns(tmp_path: Path, titled: bool) -> None:
    body = BODY_M.copy()
    body[7, 4] = 0.0
    longer = edit(trc, r"(\n10\t.*?)\r", r"\1\t1.0\t2.0\t3.0\r")
    if titled:
        longer = edit(edit(longer, "Z16", r"Z16\tX17\tY17\tZ17"), r"(\n(?!10\t)\d+\t\d.*?)\r", r"\1\t\t\t\r")
    motion = read_trc(tmp_path, longer, body)
    lost = np.isnan(motion.position_m).any(axis=2)
    assert np.argwhere(lost).tolist() == [[5, 2], [6, 2], [7, 4]]
    report = motion.report
    assert report["dropped"] == {"unlabelled point": ["unlabelled 17"]}
    assert (report["points_in_file"], report["points_measured"], len(motion.markers)) == (17, 17, 16)


def test_times_decide_where_the_header_gives_another_rate(tmp_path: Path) -> None:
    with pytest.warns(DoppelgaitWarning, match=r"the header states 60\.0+ Hz, the times 80 Hz"):
        motion = read_trc(tmp_path, edit(trc, r"\n80\.", r"\n60."))
    assert motion.rate_hz == RATE_HZ
    assert "60.00" in motion.report["notes"][0]
    assert read_trc(tmp_path, rate_hz=50.0).rate_hz == 50.0
    assert read_trc(tmp_path, UNTIMED).rate_hz == RATE_HZ


@pytest.mark.parametrize(("declared", "shown"), [("40", "40"), ("9" * 5000, "9" * 18)])
def test_fewer_frames_than_a_header_declares_are_noted(tmp_path: Path, declared: str, shown: str) -> None:
    short = edit(edit(trc, r"\n40\t.*", ""), r"\t40\t", f"\t{declared}\t")
    with pytest.warns(DoppelgaitWarning, match=f"declares {shown} frames but holds 39"):
        assert read_trc(tmp_path, short).n_frames == 39


@pytest.mark.parametrize("rate_hz", [0.0, -5.0, 1e6, float("nan"), "fast", True])
def test_impossible_rates_are_refused(tmp_path: Path, rate_hz: Any) -> None:
    with pytest.raises(MotionError, match=r"must be (1 to 10000|a number)"):
        read_trc(tmp_path, rate_hz=rate_hz)

"""Exports of motion-capture programs and TRC: the same body from every program, and what is missing or damaged."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion.readers import read
from motion_files import BODY_M, RATE_HZ, TEXTS, Text, anipose, deeplabcut, motive, nexus, opensim, qualisys, visual3d
from walking_body import NAMES, walking_body, y_up

MOTIVE = motive("1.23", "Meters", 1.0)


def edit(write: Text, pattern: str, new: str, count: int = 0) -> Text:
    return lambda body: re.sub(pattern, new, write(body), count=count)


@pytest.mark.parametrize("name", TEXTS)
def test_exports_give_the_same_motion(tmp_path: Path, name: str) -> None:
    suffix, write, options = TEXTS[name]
    path = tmp_path / f"walk.{suffix}"
    path.write_bytes(write(BODY_M).encode())
    motion = read(path, clean=False, **options)
    assert (motion.report["format"], motion.rate_hz, motion.markers) == (name.split()[0], RATE_HZ, NAMES)
    np.testing.assert_allclose(motion.position_m, BODY_M, atol=2e-6)
    assert motion.facts.subject in ("", "Jim", "Rex")


@pytest.mark.parametrize(
    ("suffix", "text", "options", "says"),
    [
        ("csv", deeplabcut(), {}, r"states no frame rate and no length unit; give the frame rate: rate_hz=.*units="),
        ("csv", deeplabcut(), {"units": "cm"}, r"states no frame rate; give the frame rate: rate_hz="),
        ("csv", deeplabcut(coords="xyl"), {"units": "m"}, r"image coordinates .*triangulate"),
        ("csv", deeplabcut(individuals=True), {"units": "m", "rate_hz": 9.0, "subject": "Eva"}, r"no subject 'Eva'"),
        ("csv", anipose, {}, r"no column of times .*rate_hz=.*units="),
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


WHOLE_M = walking_body()


def write_trc(
    path: Path,
    position: np.ndarray,
    *,
    names: Sequence[str] = NAMES,
    rate: str = "100.00",
    times: Sequence[str] | None = None,
    edit: Callable[[list[str]], Any] = lambda lines: None,
) -> Path:
    """Write positions (T, P, 3) in file units; ``edit`` changes the lines, the first frame being lines[6]."""
    n_frames, n_points = position.shape[:2]
    axes = [f"{axis}{i + 1}" for i in range(n_points) for axis in "XYZ"]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        "\t".join([rate, rate, str(n_frames), str(len(names)), "mm", rate, "1", str(n_frames)]),
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(axes),
        "",
    ]
    for k, frame in enumerate(position):
        cells = ["" if np.isnan(value) else f"{value:.7g}" for value in frame.ravel()]
        lines.append("\t".join([str(k + 1), times[k] if times else f"{k / 100:.3f}", *cells]))
    edit(lines)
    path.write_text("\r\n".join(lines) + "\r\n", encoding="utf-8")
    return path


def change(line: int, cell: int, text: str) -> Callable[[list[str]], None]:
    """Editor that puts ``text`` into a cell."""

    def edit(lines: list[str]) -> None:
        cells = lines[line].split("\t")
        cells[cell] = text
        lines[line] = "\t".join(cells)

    return edit


HEADER = "  100.0\t\t  100.0\t\t   40\t\t     16\t\t mm\t  100.0\t      1\t    40"  # as some programs align it


@pytest.mark.parametrize(
    ("tab", "point", "header"),
    [("\t", ",", ""), (";", ",", ""), (";", ".", ""), (",", ".", ""), ("\t", ".", HEADER)],
)
def test_decimal_commas_and_other_separators(tmp_path: Path, tab: str, point: str, header: str) -> None:
    def edit(lines: list[str]) -> None:
        lines[2] = header or lines[2]
        lines[:] = [line.replace("\t", tab) for line in (*lines[:2], *(row.replace(".", point) for row in lines[2:]))]

    motion = read(write_trc(tmp_path / "walk.trc", y_up(WHOLE_M) * 1e3, edit=edit), clean=False)
    np.testing.assert_allclose(motion.position_m, WHOLE_M, atol=1e-6)
    assert (motion.rate_hz, motion.report["notes"]) == (100.0, [])


def test_y_is_taken_where_nothing_shows_what_is_up(tmp_path: Path) -> None:
    ball = np.random.default_rng(0).normal(size=(1, 12, 3)) + np.zeros((10, 1, 1))
    path = write_trc(tmp_path / "ball.trc", ball * 1e3, names=[f"P{i}" for i in range(12)])
    with pytest.warns(DoppelgaitWarning, match="which axis points up; y is assumed"):
        motion = read(path, clean=False)
    np.testing.assert_allclose(motion.position_m[..., 2], ball[..., 1], atol=1e-6)


def test_blanks_zeros_and_unlabelled_columns(tmp_path: Path) -> None:
    body = y_up(WHOLE_M)
    body[3:6, 2] = np.nan
    body[7, 4] = 0.0
    extra = np.full((len(body), 1, 3), np.nan)
    extra[4] = 0.7
    path = write_trc(tmp_path / "walk.trc", np.concatenate([body, extra], axis=1) * 1e3)
    motion = read(path, clean=False)
    lost = np.isnan(motion.position_m).any(axis=2)
    assert np.argwhere(lost).tolist() == [[3, 2], [4, 2], [5, 2], [7, 4]]
    report = motion.report
    assert report["dropped"] == {"unlabelled point": ["unlabelled 17"]}
    assert (report["points_in_file"], report["points_measured"], len(motion.markers)) == (17, 17, 16)


def test_columns_beyond_those_of_the_header_are_unlabelled_points(tmp_path: Path) -> None:
    def add(lines: list[str]) -> None:
        lines[9] += "\t1.0\t2.0\t3.0"

    report = read(write_trc(tmp_path / "w.trc", y_up(WHOLE_M) * 1e3, edit=add), clean=False).report
    assert report["dropped"] == {"unlabelled point": ["unlabelled 17"]}


def test_times_decide_where_the_header_gives_another_rate(tmp_path: Path) -> None:
    path = write_trc(tmp_path / "walk.trc", y_up(WHOLE_M) * 1e3, rate="60.00")
    with pytest.warns(DoppelgaitWarning, match=r"the header states 60\.00 Hz, the times 100 Hz"):
        motion = read(path, clean=False)
    assert motion.rate_hz == 100.0
    assert "60.00" in motion.report["notes"][0]
    assert read(path, clean=False, rate_hz=50.0).rate_hz == 50.0


@pytest.mark.parametrize(
    ("rate_hz", "has_times"), [*((hz, True) for hz in (59.94, 100, 120, 150, 239.76)), (240, False)]
)
def test_times_or_the_header_give_the_rate(tmp_path: Path, rate_hz: float, has_times: bool) -> None:
    times = [f"{k / rate_hz:.4f}" * has_times for k in range(40)]
    path = write_trc(tmp_path / "walk.trc", y_up(WHOLE_M) * 1e3, rate=f"{rate_hz:g}", times=times)
    assert read(path, clean=False).rate_hz == rate_hz


@pytest.mark.parametrize(("declared", "shown"), [("40", "40"), ("9" * 5000, "9" * 18)])
def test_fewer_frames_than_a_header_declares_are_noted(tmp_path: Path, declared: str, shown: str) -> None:
    def edit(lines: list[str]) -> None:
        lines[2] = lines[2].replace("40", declared)
        lines.pop()

    path = write_trc(tmp_path / "w.trc", y_up(WHOLE_M) * 1e3, edit=edit)
    with pytest.warns(DoppelgaitWarning, match=f"declares {shown} frames but holds 39"):
        assert read(path, clean=False).n_frames == 39


def jump(lines: list[str]) -> None:
    del lines[20]
    lines[2] = lines[2].replace("\t40\t", "\t39\t")


TRC_FAULTS: dict[str, tuple[Callable[[list[str]], Any], str]] = {
    "ragged row": (change(10, 3, "1 2"), "line 11, column 'LFHD Y': '1 2' is not a number"),
    "short row": (lambda lines: lines.append("41\t0.40\t1.0"), "line 47 has 3 cells; its header names 50 columns"),
    "long row": (lambda lines: lines.append(lines[-1] + "\t5.0"), "line 47 has 51 cells"),
    "text": (change(12, 3, "12,5"), "line 13, column 'LFHD Y': '12,5' is not a number"),
    "no time": (change(12, 1, ""), "line 13 has no time.*rate_hz="),
    "time stands": (change(12, 1, "0.050"), "line 13: the time does not increase.*rate_hz="),
    "dropped frame": (jump, r"line 21: the time steps by 0.02 s, but most frames are 0.01 s apart"),
    "unit": (change(2, 4, "furlong"), "'furlong' is not a known unit of length; set units to"),
    "no names": (change(3, 0, "Bild"), "no line that starts with Frame#"),
    "no rate": (
        lambda lines: [change(k, 1, "")(lines) for k in range(6, 46)] + [change(2, 0, "fast")(lines)],
        "'fast'",
    ),
    "one frame": (lambda lines: lines.__delitem__(slice(7, None)), "holds 1 frame"),
    "no frames": (lambda lines: lines.__delitem__(slice(5, None)), "holds 0 frame"),
}


@pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")
@pytest.mark.parametrize("fault", TRC_FAULTS)
def test_damage_has_one_clear_error(tmp_path: Path, fault: str) -> None:
    edit, text = TRC_FAULTS[fault]
    path = write_trc(tmp_path / "walk.trc", y_up(WHOLE_M) * 1e3, edit=edit)
    with pytest.raises(MotionError, match=text) as error:
        read(path, clean=False)
    assert "walk.trc" in str(error.value)


@pytest.mark.parametrize("rate_hz", [0.0, -5.0, 1e6, float("nan"), "fast", True])
def test_impossible_rates_are_refused(tmp_path: Path, rate_hz: Any) -> None:
    with pytest.raises(MotionError, match=r"must be (1 to 10000|a number)"):
        read(write_trc(tmp_path / "walk.trc", y_up(WHOLE_M) * 1e3), clean=False, rate_hz=rate_hz)

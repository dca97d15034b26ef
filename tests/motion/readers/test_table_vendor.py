"""Exports of motion-capture programs: the same body from every program, and what is missing."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion.readers import read
from motion_files import BODY_M, RATE_HZ, TEXTS, Text, anipose, deeplabcut, motive, nexus, opensim, qualisys, visual3d
from walking_body import NAMES


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
        (
            "tsv",
            lambda body: qualisys()(body).replace("LFHD\t", ""),
            {},
            r"line \d+ has 48 cells; its header names 45 columns",
        ),
        ("csv", lambda body: nexus(",", around=True)(body).replace("Trajec", "Histor"), {}, "no block Trajectories"),
        (
            "csv",
            lambda body: "\n".join(
                nexus(",", around=False)(body).split("\n")[:20] + nexus(",", around=False)(body).split("\n")[21:]
            ),
            {},
            "the time steps by",
        ),
        ("sto", opensim("{name}_flexion{axis}"), {}, "no positions; let OpenSim report the marker locations"),
        ("sto", opensim("{name}_{axis}", "BodyVelocities"), {}, "holds BodyVelocities .* no positions"),
        (
            "csv",
            lambda body: motive("1.23", "Meters", 1.0)(body) + "41\r\n",
            {},
            r"line \d+ has 1 cells; its header names 50",
        ),
        ("txt", lambda body: visual3d(body).replace("TARGET", "ANALOG"), {}, "positions are TARGET and LANDMARK"),
        ("txt", lambda body: visual3d(body).replace("a.c3d", "b.c3d", 1), {}, "holds 2 recordings"),
        ("csv", lambda body: motive("1.23", "Meters", 1.0, kind="Bone")(body).replace("Global", "Local"), {}, "Global"),
        (
            "csv",
            lambda body: (
                motive("1.23", "Meters", 1.0)(body).replace("Jim:L", "Unlabeled 1").replace("Jim:", "Unlabeled 2")
            ),
            {},
            "a body needs 3 named points",
        ),
    ],
)
def test_what_is_missing_has_one_clear_error(
    tmp_path: Path, suffix: str, text: Text, options: dict[str, Any], says: str
) -> None:
    path = tmp_path / f"walk.{suffix}"
    path.write_bytes(text(BODY_M).encode())
    with pytest.raises(MotionError, match=says):
        read(path, clean=False, **options)


def test_fewer_frames_than_a_header_declares_are_noted(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_bytes(b"\n".join(motive("1.23", "Meters", 1.0)(BODY_M).encode().split(b"\r\n")[:-5]))
    with pytest.warns(DoppelgaitWarning, match="declares 40 frames but holds 36"):
        assert read(path, clean=False).n_frames == 36


def test_a_first_or_last_point_that_is_not_seen_at_first_stays_in_its_place(tmp_path: Path) -> None:
    body = BODY_M.copy()
    body[:4, [0, -1]] = np.nan
    for columns in (0, 1, 2):
        for gap in ("", "NULL"):
            (tmp_path / "walk.tsv").write_bytes(qualisys(columns=columns, gap=gap)(body).encode())
            np.testing.assert_allclose(read(tmp_path / "walk.tsv", clean=False).position_m, body, atol=2e-6)

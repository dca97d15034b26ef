"""C3D reading on files that these tests write themselves."""

import math
import struct
import warnings
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion import boulic_walk, crawling_person, human_gait, quadruped_gait
from doppelgait.motion.readers import read
from doppelgait.motion.readers.points import AXES, find_up_axis
from doppelgait.motion.skeleton import find_parts, list_marker_sets
from walking_body import NAMES, walking_body

ezc3d = pytest.importorskip("ezc3d")

walker = partial(walking_body, n_frames=200)


def write_c3d(
    path: Path,
    position: np.ndarray,
    *,
    labels: list[str] | None = None,
    units: list[str] | None = ("mm",),
    rate_hz: float = 100.0,
    invalid: np.ndarray | None = None,
    texts: dict[str, list[str]] | None = None,
) -> Path:
    """Write positions (T, P, 3), in the unit of the file, with ezc3d; ``invalid`` (T, P) gets residual -1."""
    file = ezc3d.c3d()
    points = np.ones((4, position.shape[1], position.shape[0]))
    points[:3] = position.transpose(2, 1, 0)
    file["parameters"]["POINT"]["RATE"]["value"] = [rate_hz]
    file["parameters"]["POINT"]["UNITS"]["value"] = list(units or [])
    file["parameters"]["POINT"]["LABELS"]["value"] = labels or NAMES
    for name, values in (texts or {}).items():
        file.add_parameter("POINT", name, values)
    residuals = np.zeros((1, position.shape[1], position.shape[0]))
    if invalid is not None:
        residuals[0][invalid.T] = -1.0
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = residuals
    file.write(str(path))
    return path


def patch(path: Path, at: int, data: bytes) -> Path:
    content = bytearray(path.read_bytes())
    content[at : at + len(data)] = data
    path.write_bytes(content)
    return path


@pytest.fixture
def walk_mm(tmp_path: Path) -> Path:
    return write_c3d(tmp_path / "walk.c3d", walker() * 1000)


def test_positions_labels_and_rate_come_back(walk_mm: Path) -> None:
    motion = read(walk_mm, clean=False)
    assert motion.positions.dims == ("time", "marker", "space")
    assert motion.markers == NAMES
    assert motion.rate_hz == 100.0
    assert motion.facts.source == "walk.c3d"
    assert motion.time_s[1] == pytest.approx(0.01)
    np.testing.assert_allclose(motion.position_m, walker(), atol=2e-7)
    assert motion.positions.sel(marker="LTOE").part.item() == "left_foot"


UNITS = [("m", 1.0), ("mm", 1e3), ("cm", 1e2), ("mete", 1.0), ("Millimeters", 1e3), ("in", 1 / 0.0254)]


@pytest.mark.parametrize(("unit", "factor", "guess"), [*((*row, "") for row in UNITS), ("", 1e3, "mm"), ("", 1.0, "m")])
def test_units_are_converted_or_guessed_aloud(tmp_path: Path, unit: str, factor: float, guess: str) -> None:
    path = write_c3d(tmp_path / "a.c3d", walker() * factor, units=[unit] if unit else None)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DoppelgaitWarning)
        np.testing.assert_allclose(read(path, clean=False).position_m, walker(), atol=1e-5)
    assert [f"so {guess} is assumed" in str(entry.message) for entry in caught] == [True] * bool(guess)


def test_units_per_point_are_honoured_and_an_option_silences_the_guess(tmp_path: Path) -> None:
    position = walker()
    position[:, 1::2] *= 1000
    motion = read(write_c3d(tmp_path / "a.c3d", position, units=["m", "mm"] * (len(NAMES) // 2)), clean=False)
    np.testing.assert_allclose(motion.position_m, walker(), atol=1e-5)
    path = write_c3d(tmp_path / "a.c3d", walker() * 100, units=None)
    np.testing.assert_allclose(read(path, clean=False, units="cm").position_m, walker(), atol=1e-5)
    for bad, options in ((path, {"units": "parsec"}), (write_c3d(tmp_path / "b.c3d", walker(), units=["deg"]), {})):
        with pytest.raises(MotionError, match=r"'(parsec|deg)' is not a known unit of length"):
            read(bad, **options)


def test_every_encoding_of_a_gap_becomes_nan(tmp_path: Path) -> None:
    position = walker() * 1000
    invalid = np.zeros(position.shape[:2], dtype=bool)
    invalid[10, 0] = True
    position[20, 1] = 0.0
    position[30, 2] = np.nan
    position[40, 3, :2] = 0.0  # zero alone is a coordinate
    missing = np.isnan(read(write_c3d(tmp_path / "a.c3d", position, invalid=invalid), clean=False).position_m).all(
        axis=2
    )
    assert sorted(zip(*map(list, np.nonzero(missing)), strict=True)) == [(10, 0), (20, 1), (30, 2)]


@pytest.mark.parametrize(
    ("extra", "texts", "dropped", "measured"),
    [
        (
            ["LHipAngles", "Wobble", "Own"],
            {"ANGLES": ["LHipAngles"], "POWERS": ["Wobble"], "TYPE_GROUPS": ["QUIRKS", "QUIRK"], "QUIRKS": ["Own"]},
            {"model output (angles)": "LHipAngles", "model output (powers)": "Wobble", "model output (quirks)": "Own"},
            16,
        ),
        (
            ["PELO", "PELA", "PELL", "PELP", "CentreOfMass", "LKneeMoment"],
            {},
            {
                "model output (segment axes)": "PELO PELA PELL PELP",
                "model output (by its name)": "CentreOfMass LKneeMoment",
            },
            16,
        ),
        (["*12", "RFHD-1"], {}, {"unlabelled point": "*12", "ghost of marker RFHD": "RFHD-1"}, 18),
        (["B:LFHD", "B:RFHD"], {}, {"belongs to subject or prop 'B'": "B:LFHD B:RFHD"}, 18),
    ],
)
def test_points_that_are_no_markers_are_left_out(
    tmp_path: Path, extra: list[str], texts: dict[str, list[str]], dropped: dict[str, str], measured: int
) -> None:
    position = np.concatenate([walker(), np.full((200, len(extra), 3), 0.9)], axis=1) * 1000
    labels = [f"liu:{name}" for name in NAMES] if extra[0].startswith("B:") else NAMES
    motion = read(write_c3d(tmp_path / "a.c3d", position, labels=labels + extra, texts=texts), clean=False)
    report = motion.report
    assert (motion.markers, motion.facts.subject) == (NAMES, "liu" if labels != NAMES else "")
    assert report["dropped"] == {reason: names.split() for reason, names in dropped.items()}
    assert (report["points_in_file"], report["points_measured"]) == (16 + len(extra), measured)


CMU = sorted(list_marker_sets()["CMU 41"])
SEVERAL = [f"P{i}" for i in range(300)]


@pytest.mark.parametrize(
    ("labels", "markers"),
    [
        ([f"J:{name}" for name in CMU] + [f"J:LFEM{i}" for i in range(60)], CMU),  # computed from a complete set
        ([f"*{i}" for i in range(16)], [f"*{i}" for i in range(16)]),  # a file of unlabelled points alone
        (["T8", "T8", "", "T8_2", *NAMES[4:]], ["T8", "T8_2", "point_3", "T8_2_2", *NAMES[4:]]),
        (SEVERAL, SEVERAL),  # beyond 255 they continue in LABELS2
    ],
)
def test_names_of_points(tmp_path: Path, labels: list[str], markers: list[str]) -> None:
    position = np.random.default_rng(1).normal(1000, 100, (10, len(labels), 3))
    motion = read(write_c3d(tmp_path / "a.c3d", position, labels=labels), clean=False, up_axis="z")
    assert motion.markers == markers
    assert motion.report["points_measured"] == len(markers)


def test_rate_of_zero_needs_the_option(tmp_path: Path) -> None:
    path = write_c3d(tmp_path / "a.c3d", walker() * 1000)
    # ezc3d cannot write such a file; the first RATE is that of POINT, its value eight bytes on
    patch(path, path.read_bytes().index(b"RATE") + 8, bytes(4))
    patch(path, 20, bytes(4))
    with pytest.raises(MotionError, match=r"rate of 0 Hz.*rate_hz="):
        read(path)
    motion = read(path, clean=False, rate_hz=200.0)
    assert (motion.rate_hz, motion.time_s[-1]) == (200.0, pytest.approx(199 / 200))


FROM_Z_UP = {
    "z": lambda p: p,
    "y": lambda p: np.stack([p[..., 0], p[..., 2], -p[..., 1]], axis=-1),
    "x": lambda p: np.stack([p[..., 2], p[..., 0], p[..., 1]], axis=-1),
    "-z": lambda p: p * [1, -1, -1],
    "-y": lambda p: np.stack([p[..., 0], -p[..., 2], p[..., 1]], axis=-1),
    "-x": lambda p: np.stack([-p[..., 2], p[..., 0], -p[..., 1]], axis=-1),
}


@pytest.mark.parametrize("up_axis", AXES)
@pytest.mark.parametrize("named", [True, False])
def test_every_up_axis_is_found_and_turned(tmp_path: Path, up_axis: str, named: bool) -> None:
    labels = NAMES if named else [f"P{i}" for i in range(16)]
    # unnamed points must show the floor: heights from 0 upwards
    path = write_c3d(tmp_path / "a.c3d", FROM_Z_UP[up_axis](walker()) * 1000, labels=labels)
    motion = read(path, clean=False)
    assert motion.report["up_axis"] == up_axis
    assert motion.report["up_axis_from"] == ("body parts" if named else "points at rest")
    np.testing.assert_allclose(motion.position_m, walker(), atol=1e-5)


def test_declared_axis_is_taken_when_parts_are_unknown(tmp_path: Path) -> None:
    labels = [f"P{i}" for i in range(16)]
    flat = walker()
    flat[:, :, 2] *= 0.3
    path = write_c3d(tmp_path / "a.c3d", FROM_Z_UP["y"](flat) * 1000, labels=labels, texts={"Y_SCREEN": ["-Y"]})
    report = read(path, clean=False).report
    assert (report["up_axis"], report["up_axis_from"]) == ("y", "file")
    path = write_c3d(tmp_path / "b.c3d", FROM_Z_UP["y"](walker()) * 1000, texts={"Y_SCREEN": ["+Z"]})
    assert read(path, clean=False).report["up_axis"] == "y"  # of known parts, the body decides


BODIES = {
    "dog": quadruped_gait(duration_s=1.5),
    "crawler": crawling_person(duration_s=3.0),
    "walker": human_gait(duration_s=1.5),
}


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("known", ["_", "head", "trunk torso head", "nothing"])
@pytest.mark.parametrize(
    "objects", [[], [[7, 1, 3], [7.1, 1, 3]], [[5, -4, 3.1], [9, -4, 3.1], [9, 0, 3.1], [5, 0, 3.1]]]
)
def test_a_head_ahead_of_the_body_is_not_above_it(body: str, known: str, objects: list[list[float]]) -> None:
    # nor do markers on a wall or on tripods, which stand still
    still = np.tile(np.array(objects, dtype=float).reshape(1, -1, 3), (BODIES[body].n_frames, 1, 1))
    position = np.concatenate([np.add(BODIES[body].position_m, [7.0, -2.0, 1.5]), still], axis=1)
    parts = [part if any(word in part + "_" for word in known.split()) else "" for part in BODIES[body].parts] + [
        ""
    ] * len(objects)
    for up_axis, turn in FROM_Z_UP.items():
        assert find_up_axis(turn(position), parts)["up_axis"] == up_axis


OTHER = boulic_walk(duration_s=1.5)
TWO = np.concatenate([BODIES["walker"].position_m, np.add(OTHER.position_m, [0.0, 3.0, 0.0])], axis=1)
BARE = [*BODIES["walker"].markers, *OTHER.markers]
N_FIRST = len(BODIES["walker"].markers)


@pytest.mark.parametrize("apart_m", [1.0, 1.5, -2.5])
@pytest.mark.parametrize("stands", [False, True])
def test_people_without_names_side_by_side_are_two(tmp_path: Path, apart_m: float, stands: bool) -> None:
    walker, other = BODIES["walker"], np.add(OTHER.position_m, [0.3, apart_m, 0.0])
    if stands:  # and sways
        other = other[:1] + 0.02 * np.sin(np.arange(len(other)) / 40)[:, np.newaxis, np.newaxis]
    position = np.concatenate([walker.position_m, other], axis=1)[::4, np.random.default_rng(2).permutation(len(BARE))]
    path = write_c3d(tmp_path / "a.c3d", position * 1000, labels=[f"M{n}" for n in range(len(BARE))], rate_hz=50.0)
    with pytest.raises(
        MotionError, match=rf"holds several subjects: . \(({N_FIRST}|{len(BARE) - N_FIRST}) points\), ."
    ):
        read(path)


@pytest.mark.parametrize(
    ("first", "second", "subjects"),
    [
        ("{}_1", "{}_2", "1 2"), ("{}", "{}.2", "1 2"), ("{}", "{}", "1 2"), ("P1_{}", "P2_{}", "P1 P2"),
        ("Anna {}", "Ben {}", "Anna Ben"), ("{}-a", "{}-b", "a b"), ("M{n}", "M{n}", "1 2"),
        ("Jo:{}", "Al:{}", "Jo Al"),
    ],
)  # fmt: skip
def test_two_bodies_in_a_file_are_refused_or_read_one_by_one(
    tmp_path: Path, first: str, second: str, subjects: str
) -> None:
    labels = [(first if n < N_FIRST else second).format(name, n=n) for n, name in enumerate(BARE)]
    path = write_c3d(tmp_path / "a.c3d", TWO[::4] * 1000, labels=labels, rate_hz=BODIES["walker"].rate_hz / 4)
    with pytest.raises(MotionError, match=r"holds several subjects: .* points\), .*subject='\.\.\.'"):
        read(path)
    for chosen, points in zip(subjects.split(), (range(N_FIRST), range(N_FIRST, len(BARE))), strict=True):
        motion = read(path, subject=int(chosen) if chosen.isdecimal() else chosen, clean=False)
        np.testing.assert_allclose(motion.position_m, TWO[::4][:, points], atol=1e-4)
        assert motion.facts.subject == chosen
        assert sum(map(len, motion.report["dropped"].values())) == len(BARE) - len(points)
        assert "M{n}" in first or motion.parts == find_parts([BARE[n] for n in points])
    with pytest.raises(MotionError, match="holds no subject 'Eve'; allowed are"):
        read(path, subject="Eve")


@pytest.mark.parametrize("names", ["{}_1 {}_2", "RAW_{} FIT_{}"])
def test_two_points_of_each_segment_are_one_body(tmp_path: Path, names: str) -> None:
    walk = BODIES["walker"]
    labels = [name.format(marker) for name in names.split() for marker in walk.markers]
    position = np.concatenate([walk.position_m, np.add(walk.position_m, [0.03, 0.0, 0.05])], axis=1)
    path = write_c3d(tmp_path / "a.c3d", position[::4] * 1000, labels=labels, rate_hz=walk.rate_hz / 4)
    assert len(read(path, clean=False).markers) == len(labels)


def test_unclear_axis_is_assumed_aloud(tmp_path: Path) -> None:
    labels = [f"P{i}" for i in range(16)]
    cloud = np.random.default_rng(3).uniform(-500, 500, (1, 16, 3)) + np.zeros((100, 1, 1))
    path = write_c3d(tmp_path / "a.c3d", cloud, labels=labels)
    with pytest.warns(DoppelgaitWarning, match="z is assumed"):
        assert read(path, clean=False).report["up_axis_from"] == "assumed"
    read(path, clean=False, up_axis="-z")


def test_part_of_a_recording(walk_mm: Path) -> None:
    part = read(walk_mm, clean=False, start_s=0.5, stop_s=1.0)
    assert (part.n_frames, part.time_s[0]) == (51, 0.0)
    np.testing.assert_allclose(part.position_m, walker()[50:101], atol=1e-5)
    assert (part.report["read_from_s"], part.report["read_to_s"]) == (0.5, 1.0)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        *(({"start_s": a, "stop_s": b}, r"0 to 1\.99 s") for a, b in ((-0.1, 1), (1, 1), (0, 2.1), (math.nan, 1))),
        ({"scale": 2}, r"no option scale; allowed are clean.*subject, units, up_axis, rate_hz"),
        ({"up_axis": "w"}, "up_axis='w' is not allowed"),
    ],
)
def test_options_that_are_refused(walk_mm: Path, options: dict[str, Any], says: str) -> None:
    with pytest.raises(MotionError, match=says):
        read(walk_mm, **options)


@pytest.mark.parametrize(
    ("at", "data", "says"),
    [
        (512 + 3, bytes([86]), "truncated or damaged"),  # another processor
        (512 + 3, bytes([87]), "84 Intel, 85 DEC, 86 SGI"),
        (2, struct.pack("<H", 15), "header declares 15 points, its parameters 16"),
    ],
)
def test_a_damaged_file_is_refused_with_a_reason(walk_mm: Path, at: int, data: bytes, says: str) -> None:
    with pytest.raises(MotionError, match=says):
        read(patch(walk_mm, at, data))


def test_more_frames_than_the_header_can_count(tmp_path: Path) -> None:
    position = np.random.default_rng(1).normal(1000, 100, (65540, 3, 3))
    path = write_c3d(tmp_path / "a.c3d", position, labels=["LFHD", "C7", "LTOE"])
    motion = read(path, clean=False, up_axis="z")
    assert motion.n_frames == 65540
    np.testing.assert_allclose(motion.position_m[-1], position[-1] / 1000, rtol=1e-6)

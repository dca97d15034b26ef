"""Contract checks of motion models, motion readers and paths: every built-in passes, and a broken one is caught."""

import json
from contextlib import nullcontext
from inspect import signature
from pathlib import Path as FilePath
from typing import Literal

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.config import FrozenModel
from doppelgait.motion.models import MOTION_MODELS
from doppelgait.motion.models.registry import generate_all
from doppelgait.motion.paths import PATHS, CurveElement, Layout, Path, make_path
from doppelgait.motion.readers import MOTION_READERS
from doppelgait.testing import check_motion_model, check_motion_reader, check_path
from motion_files import BODY_M, JOINTS, TEXTS, glb, write_movement

TABLES = [
    {"kind": "straight"},
    {"kind": "arc", "radius_m": 2.0, "turn_deg": 150.0},
    {"kind": "polyline", "points_m": [[0, 0], [4, 0], [4, 4]]},
    {"kind": "stop_and_go", "stops": [{"at_m": 3.0, "pause_s": 1.0}]},
    {"kind": "wander", "room_m": [0.0, 6.0, -2.0, 2.0], "way": 0.3},
    {"kind": "turn_around", "out_m": 3.0},
]
FILES = {
    "amc": "human/amc/cmu_09_06.amc",
    "bvh": "dog/mann-bvh/D1_010_KAN01_002.bvh",
    "c3d": "human/c3d/cmu_16_08.c3d",
    "expmap": "human/cmu-expmap",
}
"""Recordings; of a folder, the smallest."""


# Models --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", MOTION_MODELS)
def test_every_motion_model_keeps_its_contract(kind):
    check_motion_model(kind)


class Hop(FrozenModel):
    """A hopping point."""

    kind: Literal["hop"] = "hop"
    height_m: float = 0.3


def hop(parameters, duration_s, rng, *, seconds=0.0, **facts):
    times_s = np.arange(round((duration_s + seconds) * 100) + 1) / 100
    position_m = np.zeros((times_s.size, 1, 3))
    position_m[:, 0, 2] = parameters.height_m * np.abs(np.sin(times_s))
    facts = {"source": "hop", "kind": "hop", **facts}
    return dg.motion.make_motion(position_m, rate_hz=100, markers=["point"], parts=[""], facts=facts)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda p, d, r: hop(p, d, r, seconds=1.0), "lasts 3 s"),
        (lambda p, d, r: hop(p, d, r, kind="jump"), "facts.kind"),
        (lambda p, d, r: hop(p, d, r, footfalls={"left_foot": [9.0]}), "footfalls"),
        (lambda p, d, r: hop(p, d, r, stride_frequency_hz=-1.0), "stride_frequency_hz"),
        (lambda p, d, r: hop(p, d, r).positions, "must be a doppelgait.motion.Motion"),
        (
            lambda p, d, r: (m := hop(p, d, r)).with_positions(m.position_m + np.random.default_rng().random()),
            "another",
        ),
        (lambda p, d, r: (m := hop(p, d, r)).with_positions(m.position_m * np.nan), "not finite"),
        (lambda p, d, r: hop(p, d, r).with_report(table=np.zeros(2)), "not plain"),
    ],
)
def test_a_broken_motion_model_is_caught(register, make, says):
    register("motion_model", parameters=Hop)(make)
    with pytest.raises(AssertionError, match=says):
        check_motion_model("hop")


def hop_together(parameters, durations_s, rngs):
    return [hop(*own) for own in zip(parameters, durations_s, rngs, strict=True)]


def drift(parameters, durations_s, rngs):
    """Motions that depend on the others of the batch."""
    motions = hop_together(parameters, durations_s, rngs)
    return [motion.with_positions(motion.position_m + len(motions)) for motion in motions]


def test_a_model_of_batches_is_called_once_and_that_of_a_single_motion_for_each(register):
    for calls, make in (([], hop), ([], lambda own, duration_s, rngs: hop(own, duration_s, rngs)), ([], hop_together)):

        def counted(*arguments, calls=calls, make=make):
            calls.append(arguments)
            return make(*arguments)

        counted.__signature__ = signature(make)
        register("motion_model", parameters=Hop)(counted)
        motions = generate_all([Hop(), Hop(height_m=0.2)], durations_s=[1.0, 1.5], rngs=[None, None])
        assert [motion.duration_s for motion in motions] == [1.0, 1.5]
        assert len(calls) == (1 if make is hop_together else 2)
        check_motion_model(Hop(height_m=0.2))
    assert dg.motion.generate({"kind": "hop"}, duration_s=1.0).duration_s == 1.0


def test_a_model_whose_motions_depend_on_each_other_is_caught(register):
    register("motion_model", parameters=Hop)(drift)
    with pytest.raises(AssertionError, match="another motion in a batch"):
        check_motion_model("hop")


# Readers -------------------------------------------------------------------------------------------------------------


WRITTEN = {name: facts for name, facts in (TEXTS | JOINTS).items() if " " not in name}


def walk_file(folder, name: str) -> FilePath:
    """A walk in a format that can be written here."""
    if name == "glb":
        return glb(folder / "walk.glb")
    if name == "keypoints":
        return write_movement(folder / "walk.nc", axes=("time", "space", "keypoint", "individual"), fps=80.0)
    if name == "arrays":
        np.savez(folder / "walk.npz", positions=BODY_M, rate_hz=80.0, units="m")
        return folder / "walk.npz"
    suffix, write, _ = WRITTEN[name]
    (folder / f"walk.{suffix}").write_text(write(BODY_M))
    return folder / f"walk.{suffix}"


@pytest.mark.parametrize("name", ["arrays", "glb", "keypoints", *WRITTEN])
def test_motion_readers_keep_their_contract(tmp_path, name):
    options = {"keypoints": {"units": "m", "subject": "Eva"}, "arrays": {"up_axis": "z"}}
    check_motion_reader(
        name, walk_file(tmp_path, name), **WRITTEN[name][2] if name in WRITTEN else options.get(name, {})
    )


@pytest.mark.shared
@pytest.mark.parametrize("name", FILES)
def test_motion_readers_of_recordings_keep_their_contract(shared, name):
    path = shared / "data" / "mocap" / FILES[name]
    check_motion_reader(name, min(path.rglob("*.txt"), key=lambda one: one.stat().st_size, default=path))


def test_no_motion_reader_is_left_out():
    assert {"arrays", "glb", "keypoints", *FILES, *WRITTEN} == set(MOTION_READERS)


@pytest.fixture
def steps_file(tmp_path):
    path = tmp_path / "a.steps"
    path.write_text(json.dumps({"steps": [0.0, 0.1, 0.2, 0.1] * 300}))
    return path


def read_steps(path, *, fault=""):
    """Reader of a JSON file of heights."""
    content = json.loads(path.read_text())
    position_m = np.zeros((len(content["steps"]), 4, 3))
    position_m[:, :, 2] = np.array(content["steps"])[:, None]
    facts = {"source": "other" if fault == "source" else path.name, "kind": "recording"}
    names = ["a", "a", "b", "c"] if fault == "names" else ["a", "b", "c", "d"]
    return dg.motion.make_motion(position_m, rate_hz=50, markers=names, parts=[""] * 4, facts=facts)


def guarded(path):
    try:
        return read_steps(path)
    except (ValueError, KeyError) as error:
        raise dg.core.errors.MotionError(f"{path}: {error}") from None


def sniff_steps(path, head):
    return head.startswith(b'{"steps"')


@pytest.mark.parametrize(
    ("reader", "sniff", "says"),
    [
        (guarded, sniff_steps, None),
        (guarded, lambda path, head: True, "takes a file"),
        (guarded, lambda path, head: False, "does not recognise"),
        (lambda path: read_steps(path), sniff_steps, "Expecting"),  # crashes on damage
        (lambda path: read_steps(path, fault="source"), sniff_steps, "facts.source"),
        (lambda path: read_steps(path, fault="names"), sniff_steps, "unique names"),
        (lambda path, units="m": guarded(path), sniff_steps, "keyword-only"),
    ],
)
def test_an_own_motion_reader_passes_and_a_broken_one_is_caught(register, steps_file, reader, sniff, says):
    register("motion_reader", "steps", sniff=sniff, suffixes=(".steps",))(reader)
    with pytest.raises((AssertionError, ValueError), match=says) if says else nullcontext():
        check_motion_reader("steps", steps_file)


# Paths ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table["kind"])
def test_every_path_keeps_its_contract(table):
    check_path(make_path(table))


def test_no_path_is_left_out():
    assert {table["kind"] for table in TABLES} == set(PATHS)


class Zigzag(Path):
    """Left and right again."""

    kind: Literal["zigzag"] = "zigzag"


@pytest.mark.parametrize(
    ("lay", "says"),
    [
        (lambda path: Layout((CurveElement(2.0, 0.5), CurveElement(2.0, -0.5), CurveElement(np.inf))), None),
        (lambda path: Layout((CurveElement(np.inf), CurveElement(2.0))), "endless"),
        (lambda path: Layout(()), "needs elements"),
        (lambda path: Layout((CurveElement(-1.0),)), "positive length"),
    ],
)
def test_an_own_path_passes_and_a_broken_one_is_caught(register, lay, says):
    register("path", parameters=Zigzag)(lay)
    with pytest.raises(AssertionError, match=says) if says else nullcontext():
        check_path(Zigzag())

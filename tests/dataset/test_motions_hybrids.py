"""Folders as hybrids: ranges, partners, subjects that share a split, licences, and the draw of every example."""

import warnings

import numpy as np
import pandas as pd
import pytest

import doppelgait.dataset.motions as motions
from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, DatasetError, DoppelgaitWarning
from doppelgait.core.rng import Streams
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.motions import add_hybrids, expand_folders, list_recording_paths
from doppelgait.dataset.plan import list_names, plan_dataset
from doppelgait.dataset.resolve import warn_of_recordings
from doppelgait.motion.gait import add_gait_facts
from doppelgait.motion.models import human_gait, quadruped_gait
from doppelgait.motion.readers import read as read_motion
from doppelgait.scene.placement import build_motion

WALKS = {"ann": 1.1, "ben": 1.2, "cat": 1.3, "dan": 1.4, "eva": 1.25}


def walk(speed_mps, seconds=3.0):
    return human_gait(speed_mps=speed_mps, duration_s=seconds, rate_hz=60)


@pytest.fixture(scope="module")
def takes(tmp_path_factory):
    """One take of each of five people, as tables."""
    folder = tmp_path_factory.mktemp("hybrids")
    (folder / "takes").mkdir()
    for name, speed_mps in WALKS.items():
        write_take(folder / "takes" / f"{name}_1.csv", walk(speed_mps))
    return folder


def write_take(path, motion, *, slower=1.0):
    header = ",".join(["time_s", *(f"{m}_{a}_m" for m in motion.markers for a in "xyz")])
    table = np.column_stack([slower * motion.time_s, motion.position_m.reshape(motion.n_frames, -1)])
    np.savetxt(path, table, delimiter=",", header=header, comments="")


def plan(mode="blend", **changes):
    table = {
        "dataset": {"name": "small", "examples_per_class": 40, "fractions": {"train": 0.5, "test": 0.5}},
        "classes": [{"label": "human", "motion": {"kind": "folder", "path": "takes", "hybrid": mode}}],
        "scene": {"duration_s": 1.5},
        "sources": [
            {"files": "takes/ann*", "subject": "takes/([a-z]+)_", "licence": "MIT"},
            {"files": "takes/*", "subject": "takes/([a-z]+)_", "licence": "CC-BY-4.0"},
        ],
        **changes,
    }
    return validate(PlanConfig, table, where="plan")


@pytest.fixture(scope="module")
def planned(takes):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        return plan_dataset(plan(), folder=takes)


def test_every_example_is_another_target_and_the_same_again(planned, takes):
    motions = [planned.example(number).run.scene.targets[0].motion for number in range(40)]
    factors = {(m["path"], m["hybrid"]["speed_factor"], m["hybrid"]["share"]) for m in motions}
    assert len(factors) == 40
    assert motions == [planned.example(number).run.scene.targets[0].motion for number in range(40)]
    first, again, other = (
        build_motion(motions[0], duration_s=1.5, folder=takes, rng=Streams(1, n).generator("motion", "targets.0"))
        for n in (0, 0, 1)
    )
    np.testing.assert_array_equal(first.position_m, again.position_m)
    # the strides of the loop are drawn per example, too
    assert np.abs(first.position_m - other.position_m).max() > 1e-3
    assert first.report["hybrid"]["speed_factor"] == motions[0]["hybrid"]["speed_factor"]
    assert {first.report["hybrid"]["first"], first.report["hybrid"]["second"]} == {
        path.rpartition("/")[2] for path in list_recording_paths(motions[0])
    }


def test_who_is_blended_shares_a_split(planned):
    splits = {}
    for number, entry in enumerate(planned.examples):
        row = planned.example(number).rows[0]
        assert row.subject == entry.subjects[0]
        for subject in (row.subject, *row.others):
            splits.setdefault(subject, set()).add(entry.split)
        both = row.recording.split(" + ")
        assert len(both) == 1 + len(row.others)
        # both licences where they differ
        licences = {"MIT" if "ann" in path else "CC-BY-4.0" for path in both}
        assert set(row.licence.split(" AND ")) == licences
    assert set(splits) == {f"person/{name}" for name in WALKS}
    assert all(len(found) == 1 for found in splits.values())
    assert splits["person/ann"] == splits["person/ben"] != splits["person/cat"]


def test_a_path_with_a_plus_is_one_recording():
    motion = '{"kind":"file","path":"a + b.bvh","hybrid":{"other":{"kind":"file","path":"c.bvh"}}}'
    index = pd.DataFrame({
        "recording": ["a + b.bvh", "a + b.bvh", "a + b.bvh + c.bvh", None],
        "motion": ['{"kind":"file","path":"a + b.bvh"}', None, motion, "{}"],
    })  # fmt: skip
    assert list_names(index, "recording") == [("a + b.bvh",), ("a + b.bvh",), ("a + b.bvh", "c.bvh"), ()]
    assert list_names(index, "subject") == [()] * 4
    with pytest.raises(DatasetError, match=r"index: motion 'walk' of 'a \+ b\.bvh' cannot be read"):
        list_names(index.assign(motion="walk"), "recording")


def test_retarget_blends_nobody(takes):
    laid_out = plan_dataset(plan("retarget"), folder=takes)
    assert all("other" not in table["hybrid"] for table in laid_out.config.classes[0].motion["cycle"])
    assert len({entry.group for entry in laid_out.examples}) == 5


def test_clips_are_read_again_for_another_skeleton_and_kept_without_motions_only(takes, monkeypatch):
    read, skeleton = [], takes / "takes" / "ann.ASF"
    monkeypatch.setattr(motions, "read", lambda file: read.append(file.suffix) or read_motion(file))
    for content, mode, n_read in (("a", "none", 5), ("a", "none", 5), ("bb", "none", 10), ("bb", "retarget", 15)):
        if not skeleton.is_file() or skeleton.read_text() != content:
            skeleton.write_text(content)
        with pytest.warns(DoppelgaitWarning, match="1 of 6 files are left out"):
            expand_folders(plan(mode), takes)
        assert read.count(".csv") == n_read
    assert motions._read_clips.cache_info().currsize == 0


def test_clips_of_other_points_and_gaits_are_no_partners():
    clips = [walk(1.2), walk(1.3), walk(2.9), quadruped_gait(gait="trot", speed_mps=1.6, duration_s=3.0, rate_hz=60)]
    clips = [add_gait_facts(clip) for clip in clips]
    tables = add_hybrids([{"path": str(n)} for n in range(4)], clips, ["a"] * 4, "blend")
    partners = [[other["path"] for other in t["hybrid"].get("other", {}).get("choice", [])] for t in tables]
    assert partners == [["1"], ["0"], [], []]
    assert tables[3]["hybrid"]["size_factor"] == {"log_uniform": [0.8, 1.25]}
    assert tables[0]["hybrid"]["size_factor"] == {"normal": [1.0, 0.056]}


@pytest.mark.parametrize(
    ("motion", "says"),
    [
        ({"kind": "folder", "path": "takes", "hybrid": "mix"}, r"hybrid.*'none', 'retarget' or 'blend'"),
        ({"kind": "file", "path": "takes/ann_1.csv", "hybrid": {"speed_factor": 3.0}}, r"hybrid\.speed_factor"),
        (
            {
                "kind": "file",
                "path": "takes/ann_1.csv",
                "hybrid": {"share": 0.3, "other": {"kind": "file", "path": "x.csv"}},
            },
            r"hybrid\.other\.path: 'x\.csv' is not allowed: there is no such file",
        ),
    ],
)
def test_wrong_hybrids_are_named(takes, motion, says):
    with pytest.raises(ConfigError, match=says):
        plan_dataset(plan(classes=[{"label": "human", "motion": motion}]), folder=takes)


def test_a_take_that_no_body_can_do_is_left_out_with_its_reason(tmp_path):
    (tmp_path / "takes").mkdir()
    write_take(tmp_path / "takes" / "ann_1.csv", walk(1.2))
    write_take(tmp_path / "takes" / "ben_1.csv", walk(1.2), slower=0.2)
    with pytest.warns(
        DoppelgaitWarning, match=r"1 of 2 files are left out: takes/ben_1\.csv: strides of .* 300 Hz is prob"
    ):
        motions = expand_folders(plan("none"), tmp_path).classes[0].motion["cycle"]
    assert {table["path"] for table in motions} == {"takes/ann_1.csv"}
    (tmp_path / "takes" / "ann_1.csv").unlink()
    recording = {"kind": "file", "path": "takes/ben_1.csv"}
    single = plan(
        classes=[{"label": "human", "motion": recording}],
        dataset={"name": "x", "examples_per_class": 1, "fractions": {"train": 1.0}},
    )
    with pytest.warns(DoppelgaitWarning, match=r"ben_1\.csv: strides of"):
        warn_of_recordings([plan_dataset(single, folder=tmp_path).example(0)], folder=tmp_path)

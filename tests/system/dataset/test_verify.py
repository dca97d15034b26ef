"""A small dataset, honest and tampered with: every check is seen to pass and to fail."""

import hashlib
import json
import shutil

import h5py
import numpy as np
import pandas as pd
import pytest

import dataset_plans
from checkout import ROOT
from command import run
from doppelgait import viz
from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, DatasetError, DoppelgaitWarning, OutputError
from doppelgait.core.files import hash_file
from doppelgait.dataset.build import build_dataset
from doppelgait.dataset.config import PlanConfig, load_plan
from doppelgait.dataset.finish import LOG, LOG_SUM, SUMS, make_index, write_splits, write_sums
from doppelgait.dataset.shard_files import ShardFiles, hash_contents
from doppelgait.dataset.verify import contents, verify_dataset
from figure_faults import faults
from tiny_dataset import TROT, WALK

N = 30
TARGET = {"range_m": {"uniform": [4, 5]}, "aspect_deg": {"uniform": [-30, 30]}}


def small_plan(**changes):
    dataset = {"name": "small", "examples_per_class": N, "shard_size": 20, "seed": 3}
    target = {**TARGET, "rcs": {"total_m2": {"log_uniform": [0.2, 1.0]}}}
    table = {
        "dataset": dataset,
        "classes": [{"label": "human", "motion": WALK}, {"label": "dog", "motion": TROT}],
        "scene": {"duration_s": 1.6},
        "radar": {"preset": "x4", "prf_hz": 900},
        "target": target,
        "noise": {"kind": "snr", "snr_db": {"uniform": [12, 25]}},
    }
    return validate(PlanConfig, table | changes, where="plan")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("verified") / "small"
    build_dataset(small_plan(), folder, executor="serial")
    return folder


@pytest.fixture
def copy(built, tmp_path):
    return shutil.copytree(built, tmp_path / "copy")


def verify(directory, **options):
    return verify_dataset(directory, **{"share": 0.0, "rng": np.random.default_rng(7), **options})


def failed(verification, status="failed"):
    return {check.name for check in verification.checks if check.status == status}


def tamper(folder, rows=None, arrays=None, *, restate=True):
    """Change rows and arrays of all shards, and make hashes, records, index and lists agree with it.

    ``restate``: the hash of the contents, too, so that the other checks show what they find.
    """
    records = []
    for path in sorted((folder / "shards").glob("*.json")):
        record, shard = json.loads(path.read_text()), path.with_suffix(".h5")
        for row in record["rows"] if rows else ():
            rows(row)
        if arrays:
            with h5py.File(shard, "r+") as file:
                arrays(file, record["rows"])
        files = ShardFiles(shard.parent)
        stored = [files.read_row(shard.stem, number) for number in range(len(record["rows"]))]
        files.close()
        record |= {"sha256": hash_file(shard), "bytes": shard.stat().st_size}
        record["contents_sha256"] = hash_contents(record["rows"], stored)
        path.write_text(json.dumps(record))
        records.append(record)
    order = list(dict.fromkeys(pd.read_parquet(folder / "index.parquet")["shard"]))
    index = make_index(sorted(records, key=lambda record: order.index(record["shard"])))
    write_splits(folder / "splits", index)
    put_index(folder, index)
    if restate:
        by_name = {record["shard"]: record["contents_sha256"] for record in records}
        text = "".join(by_name[name] for name in order)
        put_description(folder, contents_sha256=hashlib.sha256(text.encode()).hexdigest())


def put_index(folder, index):
    """Write an index that says which dataset it is of, and the hashes of all files."""
    dataset_plans.put_index(folder, index)
    restate_files(folder)


def put_description(folder, **changes):
    description = json.loads((folder / "dataset.json").read_text()) | changes
    (folder / "dataset.json").write_text(json.dumps(description))
    restate_files(folder)


def restate_files(folder):
    """Make the list of hashes fit what is there."""
    write_sums(folder, {path.stem: hash_file(path) for path in (folder / "shards").glob("*.h5")})


def states(folder):
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_an_honest_dataset_passes_every_check_and_is_left_as_it_was(built):
    before, seen = states(built), []
    found = verify(built, share=0.01, on_progress=lambda *step: seen.append(step))
    assert {check.name: check.status for check in found.checks if check.status != "passed"} == {}
    assert (found.passed, found.verdict, found.complete) == (True, "passed", True)
    assert states(built) == before
    assert found.check("re-simulation").summary == "6 examples made again: identical bytes"
    assert found.check("re-simulation").numbers["identical"] == 6
    assert found.check("class balance").numbers["counts"]["dog"] == {"train": 21, "validation": 5, "test": 4}
    assert seen[-1][0] == seen[-1][1]
    json.dumps(found.as_dict(), allow_nan=False)


def test_hashes_with_a_line_of_the_log_are_those_of_version_0_2(copy):
    (copy / LOG_SUM).unlink()
    assert failed(verify(copy)) == {"files"}
    log = (copy / LOG).rename(copy.parent / LOG)
    assert failed(verify(copy)) == {"files"}
    log.rename(copy / LOG)
    listed = [*(copy / SUMS).read_text().splitlines(), f"{hash_file(copy / LOG)}  {LOG}"]
    (copy / SUMS).write_text("".join(f"{line}\n" for line in sorted(listed, key=lambda line: line[66:])))
    assert failed(verify(copy)) == set()


@pytest.mark.parametrize(("form", "shown"), [("svg", 1), pytest.param("png", 3, marks=pytest.mark.release)])
def test_every_class_has_a_page_in_the_format_of_the_option(built, tmp_path, monkeypatch, form, shown):
    monkeypatch.setattr("doppelgait.dataset.verify.run.SHEET_SIZE", shown)  # 24 take 5 s to lay out and draw
    figures, save = [], viz.save_figure if form == "png" else lambda _, path: path
    monkeypatch.setattr(
        viz, "save_figure", lambda figure, path: figures.append(figure) or save(figure, path), raising=False
    )
    words = ["dataset", "verify", built, "--resimulate", "0", "--format", form, "--json", "--figures"]
    names = [tmp_path / "new" / f"{name}.{form}" for name in ("signatures-dog", "signatures-human", "features")]
    assert json.loads(run(*words, tmp_path / "new").stdout)["figures"] == [*map(str, names)]
    assert [faults(figure) for figure in figures] == [[], [], []]
    if form == "png":
        assert all(path.stat().st_size > 50_000 for path in names)
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(OutputError, match="file: cannot be written"):
        verify(built, figures=tmp_path / "file")


def test_a_half_built_dataset_is_checked_as_far_as_it_is_there(copy):
    for path in (copy / "shards").glob("validation-*"):
        path.unlink()
    (copy / "index.parquet").unlink()
    shutil.rmtree(copy / "splits")
    description = json.loads((copy / "dataset.json").read_text())
    (copy / "dataset.json").write_text(json.dumps({**description, "complete": False}))
    (copy / SUMS).unlink()
    found = verify(copy)
    assert (found.passed, found.verdict, found.complete) == (False, "not proven", False)
    assert "not built yet: validation-00000-of-00001" in found.check("shards").summary
    assert failed(found) == set()
    assert failed(found, "skipped") == {"files", "contents", "index", "splits", "class balance"}
    for path in (copy / "shards").iterdir():
        path.unlink()
    found = verify(copy)
    assert found.verdict == "not proven"
    assert "no row is there" in found.check("rows").summary


def test_damage_is_named_and_the_rest_is_checked(copy):
    shards = sorted((copy / "shards").glob("train-*.h5"))
    content = bytearray(shards[0].read_bytes())
    content[len(content) // 2] ^= 1
    shards[0].write_bytes(content)
    shards[1].with_suffix(".json").unlink()
    (copy / "shards" / "train-00002-of-00003.h5.partial").write_bytes(b"half")
    found = verify(copy)
    assert failed(found) == {"files", "shards", "contents", "leftovers"}
    words = found.check("shards").summary
    assert "train-00000-of-00003 (the file is not the one that its record describes" in words
    assert "train-00001-of-00003 (train-00001-of-00003.json is missing)" in words
    assert "train-00002-of-00003.h5.partial" in found.check("leftovers").summary
    assert found.check("duplicates").status == "passed"


def test_a_complete_dataset_may_miss_no_shard_and_no_index(copy):
    for path in (copy / "shards").glob("test-*"):
        path.unlink()
    found = verify(copy)
    assert failed(found) >= {"shards", "index"}
    assert "missing, though the dataset is marked as complete: test-00000-of-00001" in found.check("shards").summary
    (copy / "index.parquet").unlink()
    assert "index.parquet is missing, though" in verify(copy).check("index").summary
    (copy / "index.parquet").write_bytes(b"no parquet")
    assert "cannot be read" in verify(copy).check("index").summary


def test_another_value_or_order_and_a_missing_row_of_the_index_are_found(copy):
    index = pd.read_parquet(copy / "index.parquet")
    changed = index.copy()
    changed.loc[3, "feature_torso_velocity_mps"] += 1e-9
    put_index(copy, changed)
    found = verify(copy)
    assert failed(found) == {"index"}
    assert f"feature_torso_velocity_mps of {index.loc[3, 'id']} is" in found.check("index").summary
    put_index(copy, pd.concat([index[20:], index[:20]]))
    assert "another order" in verify(copy).check("index").summary
    put_index(copy, index.drop(index=5))
    found = verify(copy)
    assert failed(found) >= {"index", "splits", "class balance"}
    assert index.loc[5, "id"] in found.check("class balance").summary
    assert index.loc[5, "id"] in found.check("splits").summary


def test_a_changed_configuration_is_another_identity(copy):
    description = json.loads((copy / "dataset.json").read_text())
    description["config"]["noise"]["snr_db"] = {"uniform": [12, 26]}
    put_description(copy, **description)
    found = verify(copy, share=0.01)
    assert {"identity", "re-simulation", "planned SNR"} <= failed(found)
    assert description["id"] in found.check("identity").summary


def test_what_cannot_be_verified_is_one_clear_error(copy, tmp_path):
    with pytest.raises(DatasetError, match=r"dataset\.json is missing"):
        verify(tmp_path / "nothing")
    with pytest.raises(ConfigError, match="share = 2"):
        verify(copy, share=2)
    description = json.loads((copy / "dataset.json").read_text())
    (copy / "dataset.json").write_text(json.dumps({**description, "schema_version": 9}))
    with pytest.raises(DatasetError, match="in format version 9"):
        verify(copy)


def test_another_data_version_is_not_made_again_and_says_so(copy):
    put_description(copy, data_version=4)
    found = verify(copy, share=0.01)
    assert (failed(found), found.verdict) == (set(), "not proven")
    assert failed(found, "skipped") == {"identity", "re-simulation", "measured SNR"}
    assert all("data version 4" in check.summary for check in found.checks if check.status == "skipped")


def test_a_plan_of_far_more_examples_than_are_here_is_not_planned(copy, monkeypatch):
    description = json.loads((copy / "dataset.json").read_text())
    description["config"]["dataset"]["examples_per_class"] = 10_000_000
    put_description(copy, **description)
    monkeypatch.setattr(contents, "plan_dataset", None)  # it would take minutes, and gigabytes
    found = verify(copy)
    assert (failed(found), found.verdict) == (set(), "not proven")
    assert "names 20000000 examples, and only 60 rows are here" in found.check("identity").summary


def test_failed_examples_are_named_and_too_many_of_a_class_fail(tmp_path):
    (tmp_path / "broken.c3d").write_bytes(b"not a C3D file")
    walk = {"kind": "boulic", "speed_mps": {"uniform": [0.9, 1.6]}}
    mixed = {"cycle": [walk, {"kind": "file", "path": "broken.c3d"}, walk, walk]}
    classes = [small_plan().model_dump()["classes"][1], {"label": "human", "motion": mixed}]
    split = {"subjects": {"train": ["broken.c3d"]}}
    plan = small_plan(dataset={"name": "lossy", "examples_per_class": 12, "split": split}, classes=classes)
    build_dataset(plan, tmp_path / "d", folder=tmp_path, executor="serial")
    found = verify(tmp_path / "d", folder=tmp_path)
    assert failed(found) == {"class balance"}
    words = found.check("class balance").summary
    assert "3 examples failed" in words
    assert "broken.c3d" in words
    assert words.endswith("of human in train more than 5 %")
    elsewhere = verify(tmp_path / "d", folder=tmp_path / "d")
    for name in ("identity", "rows", "class balance"):
        assert elsewhere.check(name).status == "skipped"
        assert "there is no such file" in elsewhere.check(name).summary


def test_rounding_of_another_processor_is_within_tolerance_and_said_so(copy):
    def shake(file, rows):
        stored = file["signature"][:]
        stored[:, ::100] = np.nextafter(stored[:, ::100], np.float16(0))  # rounded the other way, here and there
        file["signature"][...] = stored

    tamper(copy, rows=lambda row: row.update(gait_frequency_hz=row["gait_frequency_hz"] * (1 + 1e-9)), arrays=shake)
    check = verify(copy, share=0.01).check("re-simulation")
    assert check.status == "passed"
    assert "0 of 6 rows identical" in check.summary
    assert 0 < check.numbers["worst_array_over_tolerance"] < 0.1


def louder(file, rows):
    file["signature"][...] = file["signature"][:] + np.float16(0.5)


@pytest.mark.parametrize(
    ("changes", "number", "wanted"),
    [
        ({"arrays": louder}, "worst_array_over_tolerance", pytest.approx((1 - 10**-0.05) / 2e-2, rel=0.02)),
        (
            {"rows": lambda row: row.update(feature_torso_velocity_mps=1.05 * row["feature_torso_velocity_mps"])},
            "largest_feature_difference",
            pytest.approx(0.05 / 1.05),
        ),
    ],
)
def test_other_arrays_and_features_are_found_when_made_again(copy, changes, number, wanted):
    tamper(copy, **changes)
    check = verify(copy, share=0.01).check("re-simulation")
    assert (check.status, check.numbers[number]) == ("failed", wanted)
    assert check.numbers["features_off"] == (6 if "rows" in changes else 0)


def of_dogs(column, change):
    """Change a column in the rows of dogs."""

    def change_row(row):
        if row["label"] == "dog" and row[column] is not None:
            row[column] = change(row[column])

    return change_row


def swap(row):
    row["label"] = {"human": "dog", "dog": "human"}[row["label"]]


def move_one(row):
    row.update({"truth_range_m": 1.0} if row["id"] == "dog-000000" else {})


@pytest.mark.parametrize(
    ("rows", "share", "names", "words"),
    [
        (of_dogs("feature_torso_velocity_mps", lambda v: -v), 0, ["torso velocity"], "whole: dog;"),
        (of_dogs("truth_gait_frequency_hz", lambda v: 2 * v), 0, ["gait frequency"], "whole: dog;"),
        (of_dogs("snr_frame_db", lambda v: v + 3), 0, ["planned SNR"], "whole: dog;"),
        (of_dogs("truth_aspect_deg", lambda v: v + 20), 0, ["aspect"], "whole: dog;"),
        (of_dogs("quality_snr_mu_db", lambda v: v - 60), 0, ["visible targets"], "noise instead of motion: dog"),
        (
            of_dogs("snr_frame_db", lambda v: v + 3),
            0.01,
            ["measured SNR", "re-simulation", "planned SNR"],
            "by -3.0 dB",
        ),
        (swap, 0.01, ["re-simulation", "rows"], "label is"),
        (move_one, 1.0, ["re-simulation"], "dog-000000: truth_range_m is 1.0"),
    ],
)
def test_changed_rows_fail_by_name(copy, rows, share, names, words):
    tamper(copy, rows=rows)
    found = verify(copy, share=share)
    assert failed(found) == set(names)
    assert words in found.check(names[0]).summary


def test_a_curtain_and_its_image_in_the_floor_are_no_part_of_the_snr(tmp_path):
    plan = small_plan(
        environment=[{"kind": "ground_bounce", "material": "concrete"}],
        dataset={"name": "room", "examples_per_class": 8, "shard_size": 8},
        background=[
            {"motion": {"kind": "curtain"}, "start_position_m": [3, 1], "heading_deg": 0, "rcs": {"total_m2": 0.1}}
        ],
    )
    build_dataset(plan, tmp_path / "room", executor="serial")
    check = verify(tmp_path / "room", share=1.0).check("measured SNR")
    assert check.status == "passed", check.summary
    assert check.numbers["largest_error_db"] < 0.1


def test_an_empty_room_is_allowed_and_judged_without_the_level_of_echoes(tmp_path):
    classes = [*small_plan().model_dump()["classes"][:1], {"label": "nobody", "motion": "none"}]
    plan = small_plan(dataset={"name": "room", "examples_per_class": 12}, classes=classes, noise={})
    build_dataset(plan, tmp_path / "room", executor="serial")
    found = verify(tmp_path / "room")
    assert failed(found) == set()
    assert found.check("visible targets").numbers["nobody"]["share_seen"] == 0
    assert set(found.check("nuisance").numbers) == {"all classes"}


@pytest.mark.parametrize(("scale", "noise", "how"), [(1.0, 0.0, "identical"), (3.0, 0.02, "0.999")])
def test_a_signature_in_two_splits_is_found_identical_or_louder(copy, scale, noise, how):
    index = pd.read_parquet(copy / "index.parquet")
    first, last = index[index["split"] == "train"].iloc[4], index[index["split"] == "test"].iloc[2]
    with h5py.File(copy / "shards" / f"{first['shard']}.h5") as file:
        source = file["signature"][first["row"]]
    shaken = 1 + noise * np.random.default_rng(0).standard_normal(source.shape)

    def replace(file, rows):
        for number, row in enumerate(rows):
            if row["id"] == last["id"]:
                file["signature"][number] = (source + 10 * np.log10(scale * shaken)).astype(source.dtype)

    tamper(copy, arrays=replace)
    found = verify(copy)
    assert failed(found) == {"duplicates"}
    assert f"{first['id']} (train) and {last['id']} (test) {how}" in found.check("duplicates").summary


def test_cross_sections_by_body_mass_fail_with_the_key_to_set(tmp_path):
    plan = small_plan(target=TARGET)
    with pytest.warns(DoppelgaitWarning, match=r"rcs_total_m2 .*list 'target.rcs' in dataset.leaks"):
        build_dataset(plan, tmp_path / "leaky", executor="serial")
    found = verify(tmp_path / "leaky")
    assert failed(found) == {"nuisance"}
    check = found.check("nuisance")
    assert "most predictive: rcs_total_m2 (dog 0." in check.summary
    assert "set [target] rcs" in check.summary
    assert check.numbers["classes"]["accuracy"] > 0.9 > 1e-3 > check.numbers["classes"]["p_value"]


def test_imported_recordings_are_warned_of_and_have_no_plan(copy):
    def measured(row):
        row.update(source="measured", prf_hz=900.0 if row["label"] == "dog" else 1000.0)

    tamper(copy, rows=measured)
    put_description(copy, origin="imported", config={})
    found = verify(copy)
    assert (found.passed, found.check("nuisance").status) == (True, "warning")
    assert "prf_hz (dog 900, human 1e+03; alone 1.00)" in found.check("nuisance").summary
    assert found.check("class balance").numbers["counts"]["dog/train"] == 21
    assert found.check("identity").status == "not applicable"


def test_rows_changed_after_the_end_are_noticed_even_where_everything_else_agrees(copy):
    def one(row):
        if row["id"] == "dog-000000":
            row["feature_doppler_bandwidth_hz"] = 999.0

    sums = (copy / SUMS).read_text()
    tamper(copy, rows=one, restate=False)
    assert failed(verify(copy)) == set()  # measured numbers are not in the hash of the contents
    (copy / SUMS).write_text(sums)
    assert failed(verify(copy)) == {"files"}
    tamper(copy, rows=lambda row: row.update(recording="x" if row["id"] == "dog-000000" else ""), restate=False)
    found = verify(copy)
    assert failed(found) == {"contents"}
    assert "not what the dataset was finished with" in found.check("contents").summary


@pytest.mark.parametrize(
    "plan",
    [
        "home-alarm",
        pytest.param("home-alarm-wide", marks=pytest.mark.release),
        pytest.param(str(ROOT / "examples" / "rooms-plan.toml"), id="rooms", marks=pytest.mark.release),
    ],
)
def test_every_shipped_plan_passes(plan, tmp_path):
    """The plans after the report need motion files: test_scenes."""
    config, folder = load_plan(plan, overrides=["dataset.examples_per_class=8"])
    assert build_dataset(config, tmp_path / "built", folder=folder, executor="serial").failures == []
    if plan == "home-alarm":  # stays inside the frame and never aliases
        assert set(pd.read_parquet(tmp_path / "built" / "index.parquet")["warnings"]) == {""}
    found = verify(tmp_path / "built", share=0.01, folder=folder)
    assert {check.name: check.summary for check in found.checks if check.status in ("failed", "skipped")} == {}
    assert (found.check("measured SNR").status, found.check("measured SNR").numbers["examples"]) == ("passed", 6)

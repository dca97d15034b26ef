"""Import of recordings with labels: the table of labels, parts of recordings, splits, rows, folders, identity."""

import errno
import json
import math
import os
import platform
import shutil
import sys
import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import processes
from doppelgait.core.config import validate
from doppelgait.core.errors import AnalysisError, ConfigError, DatasetError, DoppelgaitWarning, OutputError
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.core.rng import rng
from doppelgait.dataset import importing, open_dataset, shard
from doppelgait.dataset.card import list_blocked_recordings
from doppelgait.dataset.importing import ImportConfig, find_labelled_result, import_dataset, read_labels
from doppelgait.dataset.labels import find_recordings, hash_recording
from doppelgait.dataset.plan import plan_entries
from doppelgait.dataset.verify import verify_dataset
from doppelgait.dataset.windows import cut
from doppelgait.motion import boulic_walk, quadruped_gait
from doppelgait.pipeline import Result, analyze, simulate
from doppelgait.processing import Analysis
from doppelgait.radar import Radar, Recording, read_recording, write_recording
from doppelgait.radar.readers.arrays import write_arrays
from doppelgait.scene import Scene, Target

LIGHT_MPS = 299_792_458.0
CARRIER_HZ, PRF_HZ, BIN_M = 7.29e9, 250.0, 0.0514
RADAR = Radar.preset("x4", prf_hz=PRF_HZ, range_start_m=1.0, range_stop_m=1.0 + 20 * BIN_M)
IDS = ["slow-000000", "slow-000001", "fast-000000", "fast-000001"]
GATE = ImportConfig(gate=(1.0, 2.0), analysis=Analysis(cpi_s=0.1))


def point(velocity_mps=0.5, seconds=2.0, *, seed=0):
    """Recording of a point that approaches, with noise 20 dB below it; made by hand, not by the simulator."""
    times_s = np.arange(round(seconds * PRF_HZ)) / PRF_HZ
    ranges_m = 1.0 + BIN_M * np.arange(20)
    range_m = 1.5 + velocity_mps * (seconds / 2 - times_s) * 0.1  # phase as told, range nearly still
    phase = 4 * np.pi * velocity_mps * times_s * CARRIER_HZ / LIGHT_MPS
    noise = np.random.default_rng(seed).normal(size=(2, times_s.size, 20)) * 0.05
    echo = np.exp(1j * phase)[:, None] * np.exp(-(((ranges_m - range_m[:, None]) / 0.1) ** 2))
    values = (echo + noise[0] + 1j * noise[1]).astype(np.complex64)
    baseband = make_array(BASEBAND, values, {"slow_time": times_s, "range": ranges_m}, {"radar": "{}"})
    return Recording.from_baseband(baseband, RADAR, source="point")


@pytest.fixture
def recordings(tmp_path):
    """Four recordings; speeds as in the names."""
    place = tmp_path / "recordings"
    (place / "day 2").mkdir(parents=True)
    for seed, (name, speed) in enumerate((("slow1", 0.4), ("slow2", 0.5), ("fast1", 1.1), ("day 2/fast2", 1.2))):
        write_recording(point(speed, seed=seed), place / f"{name}.h5")
    return place


LABELS = """file,label,subject,licence,citation
slow1.h5,slow,anna,CC-BY-4.0,"Doe, J. 2020"
slow2.h5,slow,ben,CC-BY-4.0,
fast1.h5,fast,anna,CC-BY-4.0,"Doe, J. 2020"
day 2/fast2.h5,fast,ben,CC-BY-4.0,
"""


def write(place, text, *, encoding="utf-8"):
    path = place.parent / "labels.csv"
    path.write_bytes(text.encode(encoding))
    return path


def entries_of(place, text, **options):
    return read_labels(write(place, text), place, **options)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize(("encoding", "end"), [("utf-8", "\n"), ("utf-8-sig", "\r\n"), ("utf-16", "\r\n")])
def test_tables_of_spreadsheets_are_read_alike(recordings, delimiter, encoding, end):
    lines = ["File,LABEL,subject,start_s,Zimmer,", "slow1.h5,a,Jürgen,0.5,3,", "", ",,,,,", "fast1.h5,b,,,,,"]
    text = end.join(line.replace(",", delimiter) for line in lines)
    found = read_labels(write(recordings, text, encoding=encoding), recordings)
    lines = [(e.line, e.recording, e.label, e.subject, e.start_s) for e in found]
    assert lines == [(2, "slow1.h5", "a", "Jürgen", 0.5), (5, "fast1.h5", "b", "", None)]
    assert [e.further for e in found] == [{"meta_zimmer": "3"}, {"meta_zimmer": ""}]
    assert all(e.gate == "track" for e in found)


def test_quoted_cells_keep_delimiters_and_lines_are_counted_as_in_the_file(recordings):
    text = 'file,label,citation\n"slow1.h5","a","Doe, J.\n2020"\nslow2.h5,a,x\nabsent.h5,a,x\n'
    with pytest.raises(ConfigError, match=r"labels\.csv: line 5, file: 'absent\.h5'"):
        entries_of(recordings, text)
    found = entries_of(recordings, text.replace("absent", "fast1"))
    assert found[0].citation == "Doe, J.\n2020"
    assert [e.line for e in found] == [2, 4, 5]


def test_a_line_with_everything(recordings):
    text = (
        "file;label;subject;split;start_s;stop_s;gate;nobody;licence;citation;session;option.prf_hz;option.format;"
        "truth_gait_frequency_hz;truth_gait;meta_gate\n"
        "slow1.h5;big dog;rex;train;0.5;1.5;1.2:2.8;no;MIT;me;s1;1e3;doppelgait;1.85;trot;4\n"
    )
    (entry,) = entries_of(recordings, text)
    assert (entry.label, entry.subject, entry.split, entry.session) == ("big dog", "rex", "train", "s1")
    assert (entry.start_s, entry.stop_s, entry.gate, entry.nobody) == (0.5, 1.5, (1.2, 2.8), False)
    assert entry.options == {"prf_hz": 1000.0, "format": "doppelgait"}
    assert entry.further == {"truth_gait_frequency_hz": 1.85, "truth_gait": "trot", "meta_gate": "4"}


MISTAKES = [
    ("", r"is empty; the first line names the columns"),
    ("file,label\n", r"no line after"),
    ("path,label\nx,a\n", r"line 1 names no column 'file'; it names path, label"),
    ("file,label,label\nslow1.h5,a,b\n", r"column 'label' twice"),
    ("file,label,,subject\nslow1.h5,a,b,c\n", r"column 3 has no name"),
    ("file,label,subjct\nslow1.h5,a,b\n", r"line 1, column 'subjct'.*rename it subject, or meta_subjct"),
    ("file,label,license\nslow1.h5,a,MIT\n", r"column 'license'.*rename it licence"),
    ("file,label\nslow1.h5,a,b\n", r"line 2 has 3 cells, the first line names 2"),
    ('file,label\n"slow1.h5,a\n', r"line 2 is not CSV"),
    ("file,label\nslow1.h5,\n", r"line 2, label: '' is not allowed"),
    ("file,label\nslow1.h5,a/b\n", r"line 2, label: 'a/b' is not allowed"),
    ("file,label\n,a\n", r"line 2, file: .*is empty"),
    ("file,label\nslow3.h5,a\n", r"line 2, file: 'slow3\.h5': is not in .*near in spelling: slow"),
    ("file,label\n../x.h5,a\n", r"line 2, file: '\.\./x\.h5' is not allowed: it must be a path inside"),
    ("file,label\n" + "x" * 5000 + ",a\n", r"line 2, file: .*is not in"),
    ("file,label\na**/x,a\n", r"line 2, file: 'a\*\*/x'"),
    ("file,label\nslow1\0.h5,a\n", r"line 2, file: .*is not in"),
    ("file,label,start_s\nslow1.h5,a,-1\n", r"line 2, start_s: '-1' is not allowed; it must be 0 s or more"),
    ("file;label;start_s\nslow1.h5;a;0,5\n", r"line 2, start_s: '0,5' .*decimal point"),
    ("file,label,stop_s\nslow1.h5,a,nan\n", r"line 2, stop_s: 'nan'"),
    ("file,label,start_s,stop_s\nslow1.h5,a,2,1\n", r"line 2, stop_s: 1 is not allowed; it must be after start_s = 2"),
    ("file,label,split\nslow1.h5,a,valid\n", r"line 2, split: 'valid' .*train, validation, test"),
    ("file,label,split\nslow1.h5,a,\n", r"line 2, split: '' is not allowed"),
    ("file,label,gate\nslow1.h5,a,2.8:1.2\n", r"line 2, gate: '2\.8:1\.2' .*two rising ranges"),
    ("file,label,gate\nslow1.h5,a,truth\n", r"line 2, gate: 'truth' .*track or FROM:TO"),
    ("file,label,nobody\nslow1.h5,a,maybe\n", r"line 2, nobody: 'maybe' .*yes, no"),
    ("file,label,truth_speed_mps\nslow1.h5,a,quick\n", r"line 2, truth_speed_mps: 'quick'"),
    ("file,label\nslow1.h5,a\nslow2.h5,a\nslow1.h5,b\n", r"line 4, file: 'slow1\.h5' is already in line 2"),
    ("file,label\nslow*.h5,a\nslow1.h5,a\n", r"line 3, file: 'slow1\.h5' is already in line 2"),
    (
        "file,label,start_s,stop_s\nslow1.h5,a,1,2\nslow1.h5,b,0,1.5\n",
        r"line 3, file: 'slow1\.h5' is 'b' and in line 2 'a' at the same time",
    ),
]


@pytest.mark.parametrize(("text", "says"), MISTAKES, ids=range(len(MISTAKES)))
def test_every_mistake_is_named(recordings, text, says):
    with pytest.raises(ConfigError, match=says) as caught:
        entries_of(recordings, text)
    assert "labels.csv" in str(caught.value)


def test_all_mistakes_of_a_table_come_together(recordings):
    with pytest.raises(ConfigError, match=r"line 2, label: .*; line 3, stop_s: .*; line 4, file: .*and 15 more$"):
        entries_of(recordings, "file,label,stop_s\nslow1.h5,,\nslow1.h5,a,0\nno.h5,a,\n" + "no.h5,a,\n" * 20)
    # each refers to the first one: not every two are a message
    with pytest.raises(ConfigError, match=r"line 3, file: .* is already in line 2; .*and 992 more$"):
        entries_of(recordings, "file,label\n" + "slow1.h5,human\n" * 5000)


def test_text_that_is_no_utf8_and_absent_files_are_named(recordings):
    path = write(recordings, "file,label,subject\nslow1.h5,a,J\u00fcrgen\n", encoding="cp1252")
    for absent, says in (
        (path, r"line 2 is not UTF-8 text; save it as CSV in UTF-8"),
        (path / "none.csv", "none.csv: cannot"),
    ):
        with pytest.raises(ConfigError, match=says):
            read_labels(absent, recordings)


def test_parts_that_do_not_meet_and_other_gates_are_allowed(recordings):
    text = "file,label,start_s,stop_s,gate\nslow1.h5,a,0,1,\nslow1.h5,b,1,2,\nslow1.h5,b,1.5,2,\nslow1.h5,c,0,1,1:2\n"
    assert [e.label for e in entries_of(recordings, text)] == ["a", "b", "b", "c"]


def test_labels_near_in_spelling_are_told(recordings):
    with pytest.warns(DoppelgaitWarning, match=r"labels 'human' \(line 2\) and 'humam' \(line 4\) are near"):
        entries_of(recordings, "file,label\nslow1.h5,human\nslow2.h5,human\nfast1.h5,humam\n")
    with pytest.warns(DoppelgaitWarning, match="'Dog'"):
        entries_of(recordings, "file,label\nslow1.h5,dog\nfast1.h5,Dog\n")
    entries_of(recordings, "file,label\nslow1.h5,human\nslow2.h5,dog\nfast1.h5,cat\n")  # a warning is an error here


def test_a_pattern_names_many_and_a_pair_once(tmp_path):
    for name in ("b_RE.txt", "b_IM.txt", "a_IM.txt", "a_RE.txt", "c.sigmf-data", "c.sigmf-meta", "d.npz", "d.toml"):
        (tmp_path / name).write_text("1")
    assert find_recordings(tmp_path, "*") == ["a_RE.txt", "b_RE.txt", "c.sigmf-meta", "d.npz"]
    assert find_recordings(tmp_path, "b_IM.txt") == ["b_RE.txt"]
    (tmp_path / "sub").mkdir()
    for name in ("x[1].h5", "sub/y.h5"):
        (tmp_path / name).write_text("1")
        assert find_recordings(tmp_path, name.replace("/", "\\")) == [name]
    before = hash_recording(tmp_path, "a_RE.txt")
    (tmp_path / "b_IM.txt").write_text("2")
    assert hash_recording(tmp_path, "a_RE.txt") == before
    (tmp_path / "a_IM.txt").write_text("2")
    assert hash_recording(tmp_path, "a_RE.txt") != before


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"gate": "truth"}, r"gate: 'truth' is not allowed: must be track or FROM:TO"),
        (
            {"fields": ["truth_range_m"]},
            r"fields: .*'truth_range_m' is not one of signature, cadence_map, ti_frames, baseband",
        ),
        ({"fields": ["signature", "signature"]}, r"names a field twice"),
        ({"hop_s": 1}, r"set window_s, too"),
        ({"split": "val"}, r"split: 'val' is not allowed: must be one of train, validation, test"),
        ({"split": {"train": 0.5}}, r"shares must sum to 1"),
        ({"split": {"training": 1.0}}, r"must be one of"),
    ],
)
def test_wrong_settings_are_named(table, says):
    with pytest.raises(ConfigError, match=says):
        validate(ImportConfig, table)


def planned(place, text, config=GATE):
    return plan_entries(entries_of(place, text), config, "labels.csv")


def test_the_column_counts_and_tears_nobody(recordings):
    text = "file,label,subject,split\nslow1.h5,a,x,train\nslow2.h5,a,y,test\nfast1.h5,b,x,train\n"
    assert [one.split for one in planned(recordings, text)] == ["train", "test", "train"]
    torn = text + "day 2/fast2.h5,b,x,test\n"
    with pytest.raises(ConfigError, match=r"line 5, split: 'test' is not allowed: subject 'x' is in train already"):
        planned(recordings, torn)
    with pytest.raises(ConfigError, match=r"split = 'train': is not allowed, because labels.csv has a column split"):
        planned(recordings, text, ImportConfig(split="train"))


def test_a_recording_is_in_one_split_and_joins_its_subjects(recordings):
    windows = "file,label,split,start_s,stop_s\nslow1.h5,a,train,0,1\nslow1.h5,a,test,{start},2\n"
    for start in (0.5, 1):
        with pytest.raises(ConfigError, match=r"line 3, split: 'test' .*recording 'slow1\.h5' is in train already"):
            planned(recordings, windows.format(start=start))
    shared = (
        "file,label,subject,split,start_s,stop_s\nslow1.h5,a,x,train,0,1\nslow1.h5,a,y,train,1,2\nslow2.h5,a,y,test,,\n"
    )
    with pytest.raises(ConfigError, match=r"line 4, split: 'test' is not allowed: subject 'y' is in train already"):
        planned(recordings, shared)
    groups = {one.group for one in planned(recordings, shared.replace("test", "train"))}
    assert groups == {"person/x"}


def test_shares_keep_subjects_whole_and_refuse_too_few(tmp_path):
    place = tmp_path / "r"
    place.mkdir()
    lines = ["file,label,subject"]
    for n in range(40):
        (place / f"{n}.h5").write_text("")
        lines.append(f"{n}.h5,{'ab'[n % 2]},s{n // 4}")
    found = planned(place, "\n".join(lines), ImportConfig(split={"train": 0.7, "test": 0.3}))
    of_subject = {}
    for one in found:
        of_subject.setdefault(one.subjects, set()).add(one.split)
    assert len(of_subject) == 10
    assert all(len(splits) == 1 for splits in of_subject.values())
    assert sum(splits == {"train"} for splits in of_subject.values()) == 7
    few = "file,label,subject\n0.h5,a,s\n1.h5,a,s\n"
    with pytest.raises(DatasetError, match=r"labels\.csv: class 'a' has 1 subjects.*record more subjects"):
        planned(place, few, ImportConfig(split={"train": 0.5, "test": 0.5}))


def counted(times_s, **attrs):
    """Recording whose n-th pulse has the value n."""
    values = np.arange(len(times_s))[:, None] * np.ones((1, 2))
    attrs = {"radar": "{}", **attrs}
    coords = {"slow_time": np.asarray(times_s, dtype=float), "range": [1.0, 1.1]}
    return Recording.from_baseband(make_array(BASEBAND, values.astype(np.complex64), coords, attrs), RADAR)


def pulses(part):
    return part.recording.baseband.values[:, 0].real.astype(int)


@pytest.mark.parametrize(("window_s", "count"), [(2.5, 4), (10.0, 1), (0.1, 100), (None, 1)])
def test_a_recording_is_cut_into_all_that_fit_without_truth(window_s, count):
    recording = replace(counted(np.arange(1000) / 100.0), truth=["what a simulation knows"])
    parts = [*cut(recording, window_s=window_s, step_s=window_s)]
    assert [part.recording.truth for part in parts] == [()] * count
    assert (parts[0].start_s, parts[-1].stop_s) == (0.0, pytest.approx(10.0))


def test_bursts_are_not_cut():
    times_s = (0.2 * np.arange(15)[:, None] + np.arange(8)[None, :] / 3000.0).ravel()
    parts = [*cut(counted(times_s, burst_pulses=8), window_s=1.0, step_s=1.0)]
    assert [pulses(p).tolist() for p in parts] == [list(range(n, n + 40)) for n in (0, 40, 80)]
    assert parts[0].recording.baseband.attrs["burst_pulses"] == 8


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ({"stop_s": 10.5}, r"stop_s = 10\.5: the recording lasts 10 s"),
        ({"start_s": 10.0}, r"start_s = 10: the recording lasts 10 s"),
        ({"window_s": 11.0, "step_s": 1.0}, r"lasts 10 s, less than a window of 11 s"),
        ({"start_s": 5, "window_s": 6.0, "step_s": 1.0}, r"lasts 5 s, less than a window"),
        ({"start_s": 1.0, "stop_s": 1.01}, r"holds 1 pulses, at least 2"),
    ],
)
def test_parts_that_are_not_there_are_refused(limits, says):
    with pytest.raises(AnalysisError, match=says):
        cut(counted(np.arange(1000) / 100.0), **limits)


@pytest.fixture
def imported(recordings):
    target = recordings.parent / "mine"
    fields = ({"name": "signature", "dtype": "full"}, {"name": "baseband"})
    config = ImportConfig(gate=(1.0, 2.0), fields=fields, shard_size=3)
    return import_dataset(recordings, write(recordings, LABELS), target, config=config), target, recordings


def test_rows_are_what_the_analysis_says_of_each_recording(imported):
    report, target, recordings = imported
    assert (report.n_recordings, report.n_rows, report.n_failed, report.n_not_tracked) == (4, 4, 0, 0)
    assert report.counts == {"slow": 2, "fast": 2}
    dataset = open_dataset(target)
    assert dataset.index["id"].tolist() == IDS
    for example, speed in zip(dataset, (0.4, 0.5, 1.1, 1.2), strict=True):
        (alone,) = analyze(read_recording(recordings / example.row["recording"]), gate=(1.0, 2.0))
        assert example.features["torso_velocity_mps"] == pytest.approx(speed, abs=0.03)
        for name, value in alone.features.as_dict().items():
            np.testing.assert_equal(example.features[name], math.nan if value is None else value)
        np.testing.assert_array_equal(example.signature.values, alone.signature.values)
        np.testing.assert_allclose(example.signature.coords["velocity"], alone.signature.coords["velocity"])
        np.testing.assert_array_equal(
            example.baseband.values, read_recording(recordings / example.row["recording"]).baseband.values
        )
    assert dataset.features().groups.tolist() == ["person/anna", "person/ben", "person/anna", "person/ben"]


def test_the_folder_is_like_that_of_a_built_dataset(imported):
    report, target, recordings = imported
    description = json.loads((target / "dataset.json").read_text())
    assert description["id"] == report.dataset_id
    assert (description["origin"], description["schema_version"], description["complete"]) == ("imported", 3, True)
    assert description["shards"] == {"test": 2}
    found = verify_dataset(target, rng=np.random.default_rng(0))
    assert {check.status for check in found.checks} == {"passed", "not applicable"}
    index = pd.read_parquet(target / "index.parquet")
    assert index["source"].unique().tolist() == ["measured"]
    assert index["recording"].tolist()[3] == "day 2/fast2.h5"
    assert index["snr_frame_db"].isna().all()
    assert not [c for c in index if c.startswith("truth_")]
    assert [json.loads(line)["examples"] for line in (target / "build.jsonl").read_text().splitlines()] == [3, 1]
    everything = b"".join(p.read_bytes() for p in target.rglob("*") if p.is_file())
    assert str(recordings).encode() not in everything
    assert not list(target.parent.glob("*.partial"))


def test_the_card_tells_sources_and_what_blocks_a_release(imported, recordings):
    _, target, _ = imported
    card = (target / "README.md").read_text()
    assert "Doe, J. 2020" in card
    assert "CC-BY-4.0: 4 recordings" in card
    assert "Not for release" not in card
    assert list_blocked_recordings(open_dataset(target).index) == []
    other = target.with_name("unknown")
    import_dataset(recordings, write(recordings, "file,label\nslow1.h5,a\nfast1.h5,b\n"), other, config=GATE)
    card = (other / "README.md").read_text()
    assert "**Not for release**: 2 of 2 recordings" in card
    assert "licence unknown: 2 recordings" in card
    blocked = list_blocked_recordings(open_dataset(other).index)
    assert blocked == ["fast1.h5 (licence unknown)", "slow1.h5 (licence unknown)"]


def test_the_same_again_changes_nothing_and_anything_else_is_refused(imported):
    report, target, recordings = imported
    config = ImportConfig(gate=(1.0, 2.0), fields=({"name": "signature", "dtype": "full"}, "baseband"), shard_size=3)
    before = {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in target.rglob("*") if p.is_file()}
    again = import_dataset(recordings, recordings.parent / "labels.csv", target, config=config)
    assert again.was_there
    assert replace(again, was_there=False, seconds=0.0) == replace(report, seconds=0.0)
    assert {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in target.rglob("*") if p.is_file()} == before
    elsewhere = import_dataset(recordings, recordings.parent / "labels.csv", target.with_name("b"), config=config)
    assert elsewhere.dataset_id == report.dataset_id
    by_hand = ImportConfig(**{**vars(config), "analysis": Analysis(clutter="none")})
    for other in (GATE, by_hand):
        with pytest.raises(DatasetError, match=r"holds imported dataset .* of other recordings, labels or settings"):
            import_dataset(recordings, recordings.parent / "labels.csv", target, config=other)
    write(recordings, LABELS.replace("ben", "ken"))
    with pytest.raises(DatasetError, match=r"of other recordings"):
        import_dataset(recordings, recordings.parent / "labels.csv", target, config=config)
    write(recordings, LABELS)
    write_recording(point(0.41), recordings / "slow1.h5")
    with pytest.raises(DatasetError, match=r"of other recordings"):
        import_dataset(recordings, recordings.parent / "labels.csv", target, config=config)


def test_what_is_in_the_way_is_left_alone(recordings):
    labels = write(recordings, LABELS)
    target = recordings.parent / "mine"
    target.mkdir()
    (target / "thesis.txt").write_text("dear")
    with pytest.raises(DatasetError, match=r"mine: is not empty"):
        import_dataset(recordings, labels, target, config=GATE)
    assert [p.name for p in target.iterdir()] == ["thesis.txt"]
    (target / "thesis.txt").unlink()
    with processes.started([sys.executable, "-c", ""]) as ended:
        ended.wait(processes.LIMIT_S)
    theirs, left = (recordings.parent / f"mine.{platform.node()}-{pid}-0.partial" for pid in (os.getppid(), ended.pid))
    theirs.mkdir()  # of an import that runs
    left.mkdir()
    assert import_dataset(recordings, labels, target, config=GATE).n_rows == 4  # an empty folder is taken
    assert (theirs.exists(), left.exists()) == (True, False)
    theirs.rmdir()
    with pytest.raises(ConfigError, match="no such folder of recordings"):
        import_dataset(recordings / "none", labels, target, config=GATE)
    (target / "dataset.json").write_text("{")
    with pytest.raises(DatasetError, match="is damaged"):
        import_dataset(recordings, labels, target, config=GATE)


def test_a_full_disk_and_an_interruption_leave_nothing(recordings, monkeypatch):
    labels, target = write(recordings, LABELS), recordings.parent / "mine"
    kept = shard.write_shard

    def full(path, *arguments, **options):
        kept(path, *arguments, **options)
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(shard, "write_shard", full)
    with pytest.raises(OutputError, match=r"mine: cannot be written: .*No space left.*no partial"):
        import_dataset(recordings, labels, target, config=GATE)
    assert sorted(p.name for p in recordings.parent.iterdir()) == ["labels.csv", "recordings"]
    monkeypatch.setattr(shard, "write_shard", kept)

    def interrupted(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        import_dataset(recordings, labels, target, config=GATE, on_progress=interrupted)
    assert sorted(p.name for p in recordings.parent.iterdir()) == ["labels.csv", "recordings"]


def test_damaged_recordings_are_failures_with_reasons(recordings):
    content = (recordings / "slow2.h5").read_bytes()
    (recordings / "slow2.h5").write_bytes(content[: len(content) // 2])
    (recordings / "fast1.h5").write_bytes(b"")
    (recordings / "a.txt").write_text("hello")
    text = LABELS + "a.txt,fast,cleo,,\n"
    report = import_dataset(recordings, write(recordings, text), recordings.parent / "mine", config=GATE)
    assert (report.n_rows, report.n_failed) == (2, 3)
    reasons = {failure["id"]: failure["reason"] for failure in report.failures}
    assert set(reasons) == {"slow-000001", "fast-000000", "fast-000002"}
    assert reasons["slow-000001"].startswith("slow2.h5: ")
    assert "is empty" in reasons["fast-000000"]
    assert "no known recording format" in reasons["fast-000002"]
    assert json.loads(report.failures[0]["spec"])["line"] == 3
    description = json.loads((recordings.parent / "mine" / "dataset.json").read_text())
    assert (description["complete"], description["n_examples"]) == (False, 5)
    assert "**Incomplete**: 3 " in (recordings.parent / "mine" / "README.md").read_text()
    assert open_dataset(recordings.parent / "mine").index["id"].tolist() == ["slow-000000", "fast-000001"]
    again = import_dataset(recordings, recordings.parent / "labels.csv", recordings.parent / "mine", config=GATE)
    assert again.was_there
    assert again.failures == report.failures
    with pytest.raises(DatasetError, match=r"none of 1 recordings can be imported; the first, a-000000: .*is empty"):
        import_dataset(recordings, write(recordings, "file,label\nfast1.h5,a\n"), recordings.parent / "m", config=GATE)
    assert not (recordings.parent / "m").exists()


def test_an_internal_error_of_one_recording_is_its_failure(recordings, monkeypatch):
    def broken(recording, **options):
        if float(np.abs(recording.baseband.values[5, 10])) == broken.mark:
            raise ZeroDivisionError("oops")
        return analyze(recording, **options)

    broken.mark = float(np.abs(read_recording(recordings / "slow2.h5").baseband.values[5, 10]))
    monkeypatch.setattr(importing, "analyze", broken)
    report = import_dataset(recordings, write(recordings, LABELS), recordings.parent / "m", config=GATE)
    assert report.n_rows == 3
    assert report.failures[0]["reason"] == "internal error: ZeroDivisionError: oops"


def test_windows_of_a_recording_stay_together(recordings):
    text = "file,label,subject,start_s,stop_s,truth_gait_frequency_hz\nslow1.h5,a,x,0.5,,1.5\nfast1.h5,b,y,,,\n"
    config = ImportConfig(gate=(1.0, 2.0), window_s=0.75, hop_s=0.5, split={"train": 1.0})
    report = import_dataset(recordings, write(recordings, text), recordings.parent / "m", config=config)
    index = open_dataset(recordings.parent / "m").index
    assert report.n_rows == 5
    windows = ["a-000000-w0000", "a-000000-w0001", "b-000000-w0000", "b-000000-w0001", "b-000000-w0002"]
    assert index["id"].tolist() == windows
    assert index["window_start_s"].tolist() == [0.5, 1.0, 0.0, 0.5, 1.0]
    np.testing.assert_allclose(index["observation_s"], 0.75)
    assert index.groupby("scene_id")["split"].nunique().max() == 1
    assert index["truth_gait_frequency_hz"].tolist()[:2] == [1.5, 1.5]
    assert index["truth_gait_frequency_hz"].isna().tolist() == [False, False, True, True, True]
    np.testing.assert_allclose(index["feature_torso_velocity_mps"], [0.4] * 2 + [1.1] * 3, atol=0.05)
    short = config.model_copy(update={"window_s": 1.75, "hop_s": None})
    report = import_dataset(recordings, write(recordings, text), recordings.parent / "n", config=short)
    assert (report.n_rows, report.n_failed) == (1, 1)
    assert "lasts 1.5 s, less than a window of 1.75 s" in report.failures[0]["reason"]


def test_formats_and_options_of_the_reader_are_passed_on(recordings):
    write_arrays(point(0.7), recordings / "array.npz")
    (recordings / "array.toml").unlink()
    text = "file,label,option.radar,option.prf_hz,option.carrier_hz\narray.npz,a,x4,{prf},\nslow1.h5,b,,,\n"
    report = import_dataset(
        recordings, write(recordings, text.format(prf=PRF_HZ)), recordings.parent / "m", config=GATE
    )
    assert report.n_failed == 0, report.failures
    first = open_dataset(recordings.parent / "m").index.iloc[0]
    assert first["prf_hz"] == pytest.approx(PRF_HZ)
    assert first["notes"]
    wrong = "file,label,option.colour\narray.npz,a,red\nslow1.h5,b,\n"
    report = import_dataset(recordings, write(recordings, wrong), recordings.parent / "n", config=GATE)
    assert "no option colour" in report.failures[0]["reason"]


def test_the_label_goes_to_the_track_with_the_most_sure_seconds():
    long, short, faint = (
        Result(GATE.analysis, quality={"track_confidence": share, "track_start_s": start_s, "track_stop_s": stop_s})
        for share, start_s, stop_s in ((0.8, 0.0, 5.0), (1.0, 1.0, 4.0), (0.1, 0.0, 10.0))
    )
    still, unsure = (Result(GATE.analysis, quality={"breathing_confidence": share}) for share in (0.99, 0.5))
    assert find_labelled_result([still, short, faint, long]) is long
    assert find_labelled_result([still, unsure]) is still
    assert find_labelled_result([still, faint]) is faint
    assert find_labelled_result([]) is None


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    """A walker, a walker and a dog, and an empty room, found without the truth that their files hold."""
    place = tmp_path_factory.mktemp("tracked")
    walk = boulic_walk(speed_mps=1.2, height_m=1.75, duration_s=4.5)
    dog = quadruped_gait(gait="trot", withers_m=0.5, duration_s=4.5)
    radar = Radar.preset("x4")
    scenes = {
        "one": Scene([Target(walk, label="truth", range_m=6.5)]),
        "two": Scene(
            [Target(walk, label="truth", range_m=5.0), Target(dog, range_m=5.0, aspect_deg=180.0, bearing_deg=5.0)]
        ),
        "empty": Scene([], duration_s=3.0),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        for seed, (name, scene) in enumerate(scenes.items()):
            noise = {} if name == "empty" else {"snr_db": 25.0}
            write_recording(simulate(scene, radar, rng=rng(seed), **noise), place / f"{name}.h5")
    return place


def test_targets_are_found_and_who_is_missing_stays_a_row(tracked, tmp_path):
    text = "file,label,nobody\none.h5,human,\ntwo.h5,human,\nempty.h5,human,\nempty.h5,empty,yes\n"
    (tmp_path / "labels.csv").write_text(text.replace("empty.h5,human", "copy.h5,human"))
    shutil.copy(tracked / "empty.h5", tracked / "copy.h5")
    report = import_dataset(tracked, tmp_path / "labels.csv", tmp_path / "m")
    assert (report.n_rows, report.n_failed, report.n_not_tracked) == (4, 0, 1), report.failures
    dataset = open_dataset(tmp_path / "m")
    index = dataset.index.set_index("recording")
    assert index["n_tracks"].tolist()[2:] == [0, 0]
    assert index.loc["one.h5", "n_tracks"] == 1
    assert "several_tracks" not in index.loc["one.h5", "quality_flags"]
    assert index.loc["one.h5", "feature_torso_velocity_mps"] == pytest.approx(1.2, abs=0.1)
    assert index.loc["two.h5", "n_tracks"] >= 2
    assert "several_tracks:the_label_went_to_the_surest" in index.loc["two.h5", "quality_flags"].split(";")
    assert index.loc["copy.h5", "quality_flags"] == "not_tracked"
    assert index.loc["empty.h5", "quality_flags"] == "nobody:nothing_found"
    assert index["source"].tolist() == ["measured"] * 3 + ["none"]
    X, _, _ = dataset.features()
    assert X.shape == (4, 6)
    assert np.isnan(X[2:]).all()
    assert dataset.array("signature", 2).size == 0
    assert not [c for c in dataset.index if c.startswith("truth_")]  # the files' truth is not looked at
    card = (tmp_path / "m" / "README.md").read_text()
    assert "4 rows: targets were detected and tracked" in card

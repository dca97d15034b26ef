"""Files, links and values that nobody should trust: refused in one sentence, and nothing else is touched."""

import json
import os
import re
import socket
from pathlib import Path

import numpy as np
import pytest

import doppelgait as dg
import tiny_dataset
from checkout import ROOT
from doppelgait.classify.model_file import load_model, load_shipped_model, save_model
from doppelgait.cli.output import print_message, print_table, print_text
from doppelgait.core.config import validate
from doppelgait.core.documents import parse_json, read_document
from doppelgait.core.errors import ConfigError, DatasetError, DoppelgaitError, OutputError, explain_memory
from doppelgait.core.files import check_out, hash_file, list_files, write_atomically
from doppelgait.core.npz import load_npz
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.labels import read_rows
from doppelgait.dataset.lock import build_lock, list_running_builds
from doppelgait.pipeline.run import Run, parse_run
from doppelgait.radar.point_clouds import read_points

pytestmark = pytest.mark.skipif(os.name == "nt", reason="pipes and links of POSIX")
READERS = {
    "a.h5": dg.radar.read_recording, "a.npz": load_model, "a.bvh": dg.motion.read, "a.c3d": dg.motion.read,
    "a.toml": Run.from_toml, "b.toml": dg.dataset.load_plan, "a.csv": read_rows, "p.json": read_points,
    "a.sigmf-meta": dg.radar.read_recording, "r.toml": lambda path: parse_run({"radar": str(path), "targets": []}),
}  # fmt: skip


@pytest.mark.parametrize("kind", ["pipe", "folder", "device", "socket"])
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_regular_file_is_refused_at_once(tmp_path, monkeypatch, name, kind):
    monkeypatch.chdir(tmp_path)
    if kind == "socket":
        socket.socket(socket.AF_UNIX).bind(name)
    {"pipe": os.mkfifo, "folder": os.mkdir, "device": lambda name: os.symlink("/dev/zero", name)}.get(kind, id)(name)
    with pytest.raises(DoppelgaitError):
        READERS[name](Path(name))


@pytest.mark.parametrize("read", [hash_file, read_document])
def test_bytes_are_read_of_regular_files(tmp_path, read):
    os.mkfifo(tmp_path / "a")
    with pytest.raises(OSError, match="is no regular file"):
        read(tmp_path / "a")


@pytest.mark.parametrize("text", ['{"a": 1, "b": 2, "a": 3}', '[{"c": {"a": 1, "a": 1}}]'])
def test_a_key_of_json_stands_once(text):
    with pytest.raises(ValueError, match="the key 'a' twice"):
        parse_json(text)


def test_a_document_has_a_limited_size(tmp_path, monkeypatch):
    (tmp_path / "a.toml").write_text("# " + "x" * 2_000_000)
    monkeypatch.setenv("DOPPELGAIT_READ_LIMIT_MB", "1")
    with pytest.raises(ConfigError, match=r"a\.toml: has 2,000,002 bytes, at most 1,000,000 are read"):
        dg.dataset.load_plan(tmp_path / "a.toml")


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_an_array_of_npz_stands_once(tmp_path):
    import zipfile

    np.savez(tmp_path / "a.npz", x=np.zeros(2))
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive:
        archive.writestr("x.npy", archive.read("x.npy"))
    with pytest.raises(ValueError, match="two arrays have the same name"):
        load_npz(tmp_path / "a.npz", None, ValueError)


HELD = json.dumps({"pid": os.getppid(), "host": "node", "since": "now", "part": None, "begun": ""})
LOCKS = [None, [], {}, True, "x", 1e300, -1, 0, 10**30, 1.5, [1, 2, 3], ["a", "b"], [float("nan"), 1]]


@pytest.mark.parametrize(
    "name", ["build.lock", "build-1-of-2.lock", "build.log", "dataset.json", "shards", "x.partial"]
)
@pytest.mark.parametrize("kind", ["file", "folder", "nothing"])
def test_a_build_follows_no_link_in_its_folder(tmp_path, name, kind):
    precious, folder = tmp_path / "precious", tmp_path / "d"
    precious.write_text(HELD) if kind == "file" else precious.mkdir() if kind == "folder" else None
    folder.mkdir()
    (folder / name).symlink_to(precious)
    with pytest.raises(DatasetError, match=re.escape(f"{name}: is a link or no file")), build_lock(folder):
        pass
    assert precious.exists() == (kind != "nothing")
    assert (folder / name).is_symlink()


@pytest.mark.parametrize("key", ["pid", "host", "since", "part", "begun"])
def test_a_lock_of_any_content_holds_nothing_or_is_named(tmp_path, monkeypatch, key):
    monkeypatch.setattr("doppelgait.dataset.lock.WRITING_SECONDS", 0.0)
    for value in LOCKS:
        (tmp_path / "build.lock").write_text(json.dumps({**json.loads(HELD), key: value}))
        assert all(isinstance(holder.pid, int) for holder in list_running_builds(tmp_path))


def test_output_replaces_a_link_and_no_device(tmp_path):
    precious, link = tmp_path / "precious", tmp_path / "a.h5"
    precious.write_text("mine")
    link.symlink_to(precious)
    write_atomically(link, b"new")
    assert (precious.read_text(), link.read_bytes(), link.is_symlink()) == ("mine", b"new", False)
    os.mkfifo(tmp_path / "b.h5")
    with pytest.raises(OutputError, match="is a folder or a device"):
        dg.radar.write_recording(None, tmp_path / "b.h5")


def test_an_output_folder_is_no_link(tmp_path):
    (tmp_path / "precious").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "precious")
    with pytest.raises(ConfigError, match="is a file or a link"):
        check_out(tmp_path / "out", listing="a", file_format="b", command="c")


@pytest.mark.parametrize(
    ("root", "pattern", "said"), [("/", "*", "is a disk"), (".", "../*", "'../"), (".", "/*", "'/")]
)
def test_no_whole_disk_is_listed(tmp_path, monkeypatch, root, pattern, said):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=said):
        list_files(Path(root), pattern)


CONTROL = "\x1b]0;a\x07\r\x9b2J\u202e\ud800"


def test_control_characters_are_escaped_wherever_text_is_shown(capsys):
    print_text(f"a{CONTROL}\n\tb")
    print_table([{f"x{CONTROL}": f"y{CONTROL}\nz"}])
    print_message(CONTROL)
    out, err = capsys.readouterr()
    for text in (out, err, str(DatasetError(CONTROL))):
        assert "\\x1b]0;a\\x07\\r\\x9b2J\\u202e\\ud800" in text
        assert not set(text) & set(CONTROL[:1] + CONTROL[5:8])
    assert len(out.splitlines()) == 4


def test_commands_print_by_the_functions_that_escape():
    free = {"output.py", "app.py", "keys.py", "view.py", "live.py"}  # texts of the package, addresses, checked labels
    commands = [path for path in (ROOT / "src/doppelgait/cli").glob("*.py") if path.name not in free]
    assert [path.name for path in commands if re.search(r"(?<![\w.])print\(", path.read_text())] == []


SCENE = {
    "duration_s": 0.4,
    "targets": [{"label": "human", "motion": {"kind": "human", "speed_mps": 1.2}, "range_m": 3.0}],
}


@pytest.mark.parametrize("value", [1e300, -1e308, [1e300, 0.0, 0.0], [[1e40, 0.0], [0.0, 0.0]]])
@pytest.mark.parametrize("key", ["receiver_position_m", "targets.0.motion.speed_mps", "targets.0.start_position_m"])
def test_numbers_of_no_sensible_size_are_refused(key, value):
    with pytest.raises(ConfigError, match=re.escape(key)):
        parse_run(dg.core.config.apply_overrides(SCENE, [f"{key}={value}"]))


@pytest.mark.parametrize("kind", ["human", "boulic"])
def test_a_speed_of_almost_nothing_is_refused(kind):
    with pytest.raises(ConfigError, match="speed_mps: 5e-324 is not allowed"):
        dg.Target({"kind": kind, "speed_mps": 5e-324})


@pytest.mark.parametrize("kind", [[1], {}, None, True, 1.5, [], {"a": []}])
@pytest.mark.parametrize("group", ["rcs", "path", "motion"])
def test_a_kind_is_a_name(group, kind):
    target = {**SCENE["targets"][0], group: {"kind": kind}}
    with pytest.raises(ConfigError, match=group):
        parse_run({**SCENE, "targets": [target]})


@pytest.mark.parametrize("section", ["scene", "target", "noise", "analysis"])
def test_a_section_that_is_drawn_is_a_table(section):
    plan = tiny_dataset.tiny_plan(examples_per_class=2).model_dump(mode="json", exclude_none=True)
    plan[section] = {"choice": [[1], [2]]}
    with pytest.raises(ConfigError, match=rf"{section}"):
        dg.dataset.plan_dataset(validate(PlanConfig, plan)).example(0)


@pytest.mark.parametrize(
    ("key", "value"),
    [("x", "1e300"), ("y", "-1e6"), ("z", "1e30"), ("doppler", "1e9"), ("time_s", "1e300"), ("x", "inf")],
)
def test_points_beyond_any_sensor_are_refused(tmp_path, key, value):
    row = dict.fromkeys(("frame", "time_s", "x", "y", "z", "doppler", "snr", "track"), "1") | {key: value}
    (tmp_path / "a.csv").write_text(",".join(row) + "\n" + ",".join(row.values()) + "\n")
    with pytest.raises(DoppelgaitError, match=r"point 1 has no|is no number"):
        read_points(tmp_path / "a.csv")


@pytest.mark.parametrize(
    "change",
    [{"classes": ["human", "human"]}, {"conditions": {"prf_hz": [9.0, 1.0]}}, {"conditions": {"prf": [1.0, 2.0]}},
     {"conditions": {"snr": [-1.0, 2.0]}}, {"alarm": "cat"}, {"classes": [True, None]}, {"n_train": -1}],
    ids=str,
)  # fmt: skip
def test_a_model_whose_facts_contradict_each_other_is_refused(tmp_path, change):
    with np.load(save_model(load_shipped_model("x4"), tmp_path / "m.npz")) as file:
        arrays = dict(file)
    document = json.loads(arrays["model"].tobytes())
    document["facts"] |= change
    np.savez(tmp_path / "n.npz", **{**arrays, "model": np.frombuffer(json.dumps(document).encode(), np.uint8)})
    with pytest.raises(DatasetError, match=r"n\.npz: is"):
        load_model(tmp_path / "n.npz")


def test_too_little_memory_is_one_sentence():
    with pytest.raises(OutputError, match=r"does not have enough memory: Unable to allocate .* for an array"):
        explain_memory(np.zeros)((1 << 23, 1 << 23))
    assert all(hasattr(f, "__wrapped__") for f in (dg.simulate, dg.analyze, dg.motion.read, dg.dataset.build_dataset))

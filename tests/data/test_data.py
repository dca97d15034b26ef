"""Public recordings from a server of this computer, and the sample."""

import hashlib
import re
import sys
import tomllib
from functools import cache, partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import numpy as np
import pytest

import doppelgait as dg
from doppelgait import data
from doppelgait.core.errors import DatasetError
from doppelgait.core.files import hash_file

ROWS = tomllib.loads(data.TABLE.read_text())
hash_once = cache(hash_file)


@pytest.fixture
def served(tmp_path, monkeypatch):
    """Folder of a server that has the recording ``walk``, two files; the table names it alone."""
    pytest.importorskip("pooch")
    folder = tmp_path / "in a folder"
    folder.mkdir()
    handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        table = "[walk]\nwhat='a walk'\nlicence='CC-BY-NC-4.0'\n[walk.files]\n"
        for name, content in {"walk.bin": b"steps", "meta.bin": b"meta"}.items():
            (folder / name).write_bytes(content)
            url = f"http://127.0.0.1:{server.server_port}/in%20a%20folder/{name}"
            table += f"'{url}'='{hashlib.sha256(content).hexdigest()}'\n"
        (tmp_path / "table.toml").write_text(table)
        monkeypatch.setattr(data, "TABLE", tmp_path / "table.toml")
        monkeypatch.setenv("DOPPELGAIT_DATA", str(tmp_path / "cache"))
        yield folder
        server.shutdown()


def test_a_recording_is_fetched_once_and_its_licence_shown(served, tmp_path, capfd):
    path = data.fetch("walk")
    assert path == tmp_path / "cache" / "walk" / "walk.bin"
    assert path.read_bytes() == b"steps"
    assert (path.parent / "meta.bin").read_bytes() == b"meta"
    said = capfd.readouterr().err
    assert said.index("walk: a walk; licence: CC-BY-NC-4.0\n") < said.index("GET /in%20a%20folder/walk.bin")
    assert data.fetch("walk") == path
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("fault", ["other content", "no such file", "no network"])
def test_a_recording_that_cannot_be_had_is_put_there_by_hand(served, tmp_path, monkeypatch, fault):
    if fault == "other content":
        (served / "walk.bin").write_bytes(b"other")
    elif fault == "no such file":
        (served / "walk.bin").unlink()
    else:
        table = tmp_path / "table.toml"
        table.write_text(re.sub(r"127.0.0.1:\d+", "127.0.0.1:1", table.read_text()))
    place = tmp_path / "cache" / "walk" / "walk.bin"
    words = {"other content": "does not match", "no such file": "404", "no network": "refused"}[fault]
    with pytest.raises(
        DatasetError, match=rf"^walk: cannot be fetched: .*{words}.*/walk.bin by hand and put it at {place};"
    ):
        data.fetch("walk")
    assert not place.exists()
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(b"steps")
    place.with_name("meta.bin").write_bytes(b"meta")
    assert data.fetch("walk") == place


def test_wrong_names_and_a_missing_library_are_one_error(monkeypatch):
    with pytest.raises(DatasetError, match=r"no recording 'dog-wolk'; known are .*; did you mean dog-walk\?"):
        data.fetch("dog-wolk")
    monkeypatch.setitem(sys.modules, "pooch", None)
    with pytest.raises(DatasetError, match=r"pip install 'doppelgait\[data\]'"):
        data.fetch("dog-walk")


def test_every_row_states_its_licence_and_its_place():
    table = data.list_recordings().set_index("name")
    assert set(table.index) == set(ROWS)
    assert (table["licence"].str.len() > 2).all()
    pattern = re.compile(r"https://raw.githubusercontent.com/[\w-]+/[\w-]+/[0-9a-f]{40}/\S+ [0-9a-f]{64}")
    assert all(pattern.fullmatch(" ".join(file)) for row in ROWS.values() for file in row["files"].items())
    assert set(table["reader"]) <= {*dg.motion.readers.MOTION_READERS, *dg.radar.readers.RADAR_READERS}


@pytest.mark.shared
@pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")
@pytest.mark.parametrize("name", ROWS)
def test_every_recording_has_its_checksum_and_is_read(shared, tmp_path, name):
    files = {sha256: url.rpartition("/")[2] for url, sha256 in ROWS[name]["files"].items()}
    for path in (path for folder in ("mocap", "radar") for path in (shared / "data" / folder).rglob("*.*")):
        if path.is_file() and (found := files.get(hash_once(path))):
            (tmp_path / found).write_bytes(path.read_bytes())
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) == ROWS[name]["bytes"]
    path = tmp_path / next(iter(files.values()))
    found = eval(ROWS[name]["read"], {"dg": dg, "path": path})
    assert isinstance(found, dg.motion.Motion if "motion" in ROWS[name]["read"] else dg.Recording)


def test_the_sample_is_always_the_same():
    one, two = data.sample(), data.sample()
    assert [truth.label for truth in one.truth] == ["human", "dog"]
    assert np.array_equal(one.baseband.values, two.baseband.values)

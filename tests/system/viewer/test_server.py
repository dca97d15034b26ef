"""What the viewer opens, which parameters each address takes, and how it starts."""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

import doppelgait as dg
import processes
from doppelgait.core.errors import ConfigError, DoppelgaitError, RecordingError
from doppelgait.radar import write_recording
from doppelgait.viewer import server

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")

from command import run
from dataset_plans import put_index
from doppelgait.cli.output import explain_reader_options
from doppelgait.core.errors import DatasetError
from doppelgait.dataset import open_dataset
from doppelgait.radar import read_recording, write_sigmf
from doppelgait.viewer.settings import Settings
from doppelgait.viewer.source import open_path
from viewer_client import served

RUN_ADDRESSES = ("recording", "targets", "range-doppler", "sound", "detail", "decisions")
DATASET_ADDRESSES = ("dataset", "rows", "balance", "scatter", "sheet", "row-id")


@pytest.fixture(scope="module")
def walk(files):
    settings = Settings(gate="truth", gate_asked=True)
    with served(open_path(files / "walk.h5", settings), settings) as client:
        yield client


@pytest.fixture(scope="module")
def dataset(folder):
    with served(open_path(folder, Settings())) as client:
        yield client


def test_recording_is_opened(walk):
    session = walk.facts("session")
    assert (session["kind"], session["name"]) == ("recording", "walk.h5")
    assert session["default_gate"] == "truth"
    assert len(session["colour_maps"]["magma"]) == 256 * 6
    for address in ("recording", "targets", "range-doppler"):
        for gate in ("truth", "track", "3:6"):
            assert walk.facts(f"{address}?gate={gate}")["clutter"] == "median", (address, gate)
        assert walk.facts(f"{address}?clutter=none")["clutter"] == "none"
        assert walk.facts(f"{address}?clutter=mean")["clutter"] == "mean"
    assert walk.get("sound?clutter=none").body != walk.get("sound").body
    assert walk.facts("targets")["targets"][0]["gate"] == "truth"
    assert walk.facts("targets?gate=3:6")["targets"][0]["gate"] == "given"
    assert "outside the recorded frame" in walk.facts("targets?gate=90:91")["reason"]
    assert walk.facts("range-doppler?from=2&count=3")["count"] == 3
    sound = walk.get("sound?pitch=4&channels=sides")
    assert (sound.status, sound.body[:4]) == (200, b"RIFF")


def test_result_is_opened(files, walk):
    opened = open_path(files / "result.h5", Settings())
    with served(opened) as client:
        assert client.facts("session")["kind"] == "result"
        shown, expected = client.facts("targets")["targets"][0], walk.facts("targets?clutter=none")["targets"][0]
        for name in ("features", "flags", "quality", "signature", "cadence_map", "cadence_spectrum"):
            assert shown[name] == expected[name], name
        assert "has no recording" in client.facts("recording")["reason"]
        assert "has no recording" in client.facts("range-doppler")["reason"]
        assert "has no recording" in client.facts("targets?gate=track")["reason"]
        client.fault("sound", 422)


def test_dataset_is_opened(dataset):
    assert dataset.facts("session")["kind"] == "dataset"
    for path in ("dataset", "rows", "balance", "row-id?row=0", "sheet?limit=2"):
        dataset.facts(path)
    dataset.facts("scatter?x=feature_torso_velocity_mps&y=feature_step_length_m")
    example = dataset.facts("row-id?row=0")["id"]
    assert dataset.facts(f"targets?example={example}")["targets"]
    assert "name a run" in dataset.fault("targets")
    assert "nobody-1" in dataset.fault("recording?example=nobody-1", 422)


def test_nothing_is_opened():
    with served(None) as client:
        assert client.facts("session")["kind"] == "none"
        for path in DATASET_ADDRESSES:
            assert "no dataset is open" in client.fault(f"{path}?row=0" if path == "row-id" else path)
        assert "no dataset is open" in client.fault("recording?example=a")
        assert "no recording is open" in client.fault("recording")


@pytest.mark.parametrize("path", [*RUN_ADDRESSES, "session"])
def test_parameters_of_a_run_are_checked(walk, path):
    assert "'frobnicate' is not known" in walk.fault(f"{path}?frobnicate=1")
    assert "'../x' is not known" in walk.fault(f"{path}?../x=1")
    if path == "session":
        return
    assert "gate: comes twice" in walk.fault(f"{path}?gate=truth&gate=truth")
    for gate in ("", "nearby", "2:1", "1:nan", "1:inf", "1:2:3", ":", "1e999:2", "%D9%A1:%D9%A2x"):
        assert "gate: " in walk.fault(f"{path}?gate={gate}")
    assert "try: " in walk.fault(f"{path}?try=2")
    assert "try: " in walk.fault(f"{path}?try=1&example=a")
    assert "no dataset is open" in walk.fault(f"{path}?example=../../etc/passwd")


@pytest.mark.parametrize(
    ("path", "named"),
    [("recording?clutter=some", "clutter"), ("range-doppler?clutter=", "clutter"), ("targets?clutter=Kept", "clutter"),
     ("range-doppler?from=-1", "from"), ("range-doppler?from=1e3", "from"),
     ("range-doppler?from=%D9%A3", "from"), ("range-doppler?from=%2B1", "from"), ("range-doppler?from=1_0", "from"),
     ("range-doppler?from=999999", "from"), ("range-doppler?from=9999999999999999", "from"),
     ("range-doppler?count=0", "count"), ("range-doppler?count=257", "count"), ("range-doppler?count=", "count"),
     ("sound?target=1", "target"), ("sound?pitch=nan", "pitch"), ("sound?pitch=-1", "pitch"),
     ("sound?channels=mono", "channels"), ("sound?from=1", "from"), ("sound?segment=0:0", "segment"),
     ("targets?segment=0", "segment"), ("targets?segment=0:x", "segment"), ("targets?segment=5:0", "targets 0 to 0"),
     ("targets?segment=0:0", "shown as a whole")],
)  # fmt: skip
def test_parameters_of_an_address_are_checked(walk, path, named):
    assert named in walk.fault(path)


@pytest.mark.parametrize("path", DATASET_ADDRESSES)
def test_parameters_of_a_dataset_are_checked(dataset, path):
    assert "frobnicate" in dataset.fault(f"{path}?frobnicate=1&row=0" if path == "row-id" else f"{path}?frobnicate=1")
    for value in ("-1", "1.5", "9" * 20, "x"):
        if path == "row-id":
            assert "row" in dataset.fault(f"row-id?row={value}")
        elif path in ("rows", "sheet"):
            assert "offset" in dataset.fault(f"{path}?offset={value}")
            assert "limit" in dataset.fault(f"{path}?limit={value}")


def test_what_cannot_be_opened(files, tmp_path):
    settings = Settings()
    with pytest.raises(RecordingError, match="no such file"):
        open_path(tmp_path / "nothing.h5", settings)
    (tmp_path / "dataset.json").write_text("{}")
    with pytest.raises(DatasetError, match="no finished dataset"):
        open_path(tmp_path, settings)
    torn = tmp_path / "torn.h5"
    torn.write_bytes((files / "result.h5").read_bytes()[:5000])
    with pytest.raises(DoppelgaitError, match=r"torn\.h5"):
        open_path(torn, settings)
    with pytest.raises(
        ConfigError, match=r"--gate: gate 50 to 60 m: lies outside the recorded frame, -0\.03 to 9\.\d+ m"
    ):
        open_path(files / "walk.h5", Settings(gate=(50.0, 60.0), gate_asked=True))


@pytest.mark.parametrize("way", ["../../walk", "{outside}", "linked"])
def test_arrays_outside_the_dataset_are_refused(files, folder, tmp_path, way):
    """An index that was tampered with, and a link among the shards."""
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    shard = pd.read_parquet(folder / "index.parquet")["shard"].iloc[0]
    outside = tmp_path / "walk.h5"
    shutil.copy(folder / "shards" / f"{shard}.h5", outside)
    (copy / "shards" / "linked.h5").symlink_to(outside)
    index = pd.read_parquet(copy / "index.parquet")
    index["shard"] = way.format(outside=str(outside.with_suffix("")))
    put_index(copy, index)
    with pytest.raises(DatasetError, match="outside the folder"):
        open_dataset(copy).array("signature", 0)
    with served(open_path(copy, Settings())) as client:
        assert "outside the folder" in client.fault(f"targets?example={index['id'].iloc[0]}", 422)
    assert open_dataset(folder).array("signature", 0).size


def test_address_is_this_computer_alone_and_ports_are_not_shared():
    with server.open_socket(0) as listener:
        address, port = listener.getsockname()
        assert address == "127.0.0.1"
        with pytest.raises(ConfigError, match=f"--port {port}: cannot be taken"):
            server.open_socket(port)
        if sys.platform == "linux":  # where all of 127/8 is this computer
            with socket.socket() as other, pytest.raises(OSError, match="refused"):
                other.connect(("127.0.0.2", port))


def test_command_prints_the_address_and_ends_when_interrupted(files):
    command = [*processes.COMMAND, "view", str(files / "walk.h5"), "--gate", "truth", "--no-browser"]
    with processes.started(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        url = process.stdout.readline().strip()
        assert len(url.split("/")[-2]) >= 32
        with urllib.request.urlopen(f"{url}api/recording", timeout=processes.LIMIT_S) as answer:
            assert answer.read(4) == b"DGV1"
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=processes.LIMIT_S)
    assert (process.returncode, out, err) == (0, "", "")


BROWSER = """
import json, pathlib, stat, sys, urllib.parse, urllib.request
page = pathlib.Path(urllib.request.url2pathname(urllib.parse.urlsplit(sys.argv[2]).path))
modes = [stat.S_IMODE(place.stat().st_mode) for place in (page.parent, page)]
told = pathlib.Path(sys.argv[1])
told.with_suffix(".part").write_text(json.dumps([sys.argv[2], str(page), page.read_text(), modes]))
told.with_suffix(".part").rename(told)
"""


@pytest.mark.skipif(os.name != "posix", reason="the browser of a test is named by a command")
@pytest.mark.parametrize(("command", "ended_by", "status"), [("view", signal.SIGTERM, 0), ("live", signal.SIGINT, 130)])
def test_the_secret_is_not_on_the_command_line_of_the_browser(files, tmp_path, command, ended_by, status):
    (tmp_path / "browser.py").write_text(BROWSER)
    line = [*processes.COMMAND, command, str(files / "walk.h5")]
    line += ["--view"] if command == "live" else []
    told = tmp_path / "told.json"
    environment = {**os.environ, "BROWSER": f"{sys.executable} {tmp_path / 'browser.py'} {told} %s"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with processes.started(line, env=environment, **pipes) as process:
        said = process.stdout if command == "view" else process.stderr
        url = next(found[0] for text in said if (found := re.search(r"http://\S+", text)))
        processes.wait_until(told.exists)
        opened, page, content, modes = json.loads(told.read_text())
        assert opened == Path(page).as_uri()
        assert url.split("/")[-2] not in opened
        assert f"url={url}" in content
        assert modes == [0o700, 0o600]
        process.send_signal(ended_by)
        _, err = process.communicate(timeout=processes.LIMIT_S)
    assert process.returncode == status, err
    assert not Path(page).parent.exists()


def test_the_viewer_goes_on_where_no_file_can_be_written(monkeypatch, capsys):
    def fail(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(server.tempfile, "TemporaryDirectory", fail)
    monkeypatch.setattr("webbrowser.open", lambda url: pytest.fail("nothing to open"))
    with server.open_in_browser("http://127.0.0.1:1/token/"):
        said = capsys.readouterr().err
    assert "No space left on device; open the address yourself" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "named"), [(["--port", "8000"], "--port 8000"), (["--no-browser"], "--no-browser")]
)
def test_options_of_the_page_are_refused_without_it(options, named):
    with pytest.raises(ConfigError, match=f"^{named}: has no effect without --view"):
        run("live", "nothing.h5", *options)


def test_command_says_what_is_wrong_before_it_starts(files):
    write_recording(replace(read_recording(files / "walk.h5"), truth=()), files / "untold.h5")
    for says, words in (("no truth", ("untold.h5", "--gate", "truth")), ("no such file", ("bare.h5",))):
        with pytest.raises(DoppelgaitError, match=says):
            run("view", files / words[0], *words[1:])


def test_readers_ask_for_options_in_the_words_of_the_command(files):
    """A recording whose file does not tell the carrier."""
    write_sigmf(read_recording(files / "walk.h5"), files / "mute.sigmf-meta")
    place = files / "mute.sigmf-meta"
    told = json.loads(place.read_text())
    told["global"] = {key: value for key, value in told["global"].items() if "doppelgait" not in key}
    told["captures"] = [{"core:sample_start": 0}]
    place.write_text(json.dumps(told))
    for command, *words in (["view"], ["analyze"], ["listen", "-o", files / "a.wav"]):
        with pytest.raises(RecordingError, match="; here: --option carrier_hz="):
            run(command, place, *words)


@pytest.mark.parametrize(
    ("said", "wanted"),
    [("holds 4 subsweeps; give subsweep = 0 to 3 (0: profile 1)", "--option subsweep=0"),
     ("2 channels; give channel = 0 to 1", "--option channel=0"), ("If RF, give kind='rf'", "--option kind=rf"),
     ("apart; give range_start_m=... and bin_spacing_m=...", "--option range_start_m=... --option bin_spacing_m=..."),
     ("name it, format='arrays'", "--option format=arrays"),
     ("holds A_1 and A_2; give matrix='A_1' for the RF frames", "--option matrix=A_1"),
     ("do not state prf_hz; set counts_per_unit (1024 x pulses_per_step); prf_hz (17 Hz). They are in the script.",
      "--option counts_per_unit=... --option prf_hz=..."),
     ("burst_pulses must be given", "--option burst_pulses=..."),
     ("is not a recording; pass a file, or the folder", None), ("has no option start_s; allowed are stop_s", None)],
)  # fmt: skip
def test_options_that_readers_ask_for(said, wanted):
    with pytest.raises(RecordingError) as caught, explain_reader_options():
        raise RecordingError(f"walk.h5: {said}")
    ending = f"; here: {wanted}" if wanted else ""
    assert str(caught.value) == f"walk.h5: {said.replace('script.', 'script')}{ending}"


REAL = {
    "x4_baseband_iq_novelda/xethru_recording_20170913_150437_baseband_recording": "track",
    "a121_acconeer/breathing-sitting.h5": "0.2677",
    "a121_acconeer/surface_velocity_default.h5": "track",
    "cw24_kmkim036/211118/211118_kkm_1_1_RE.txt": "0:10",
}


@pytest.mark.shared
@pytest.mark.parametrize("name", REAL)
def test_measured_recordings_are_opened(shared, name):
    opened = open_path(shared / "data" / "radar" / name, Settings())
    with served(opened) as client:
        session, recording = client.facts("session"), client.facts("recording")
        assert session["default_gate"].startswith(REAL[name])
        assert "/" not in json.dumps(recording["notes"]).replace("frames/s", "").replace("samples/s", "")
        assert recording["reason"] is None
        assert (recording["no_sound"] is None) == (session["default_gate"] == "track")
        targets, frames = client.facts("targets"), client.facts("range-doppler")
        assert (targets["targets"] == []) == (targets["reason"] is not None)
        assert ("frames" in frames["arrays"]) == (frames["reason"] is None)
        assert (recording["range_time"] is None) == ("cw24" in name)
        if session["default_gate"] != "track":
            columns = targets["targets"][0]["signature"]["x"]
            assert columns["n"] > 1
            assert columns["first"] >= recording["start_s"]
            last_s = columns["first"] + (columns["n"] - 1) * columns["step"]
            assert last_s < recording["start_s"] + recording["duration_s"] < last_s + columns["step"]
            assert "in bursts" in client.fault("sound?pitch=5000", 422)
            assert "bursts" in dict(recording["facts"])


FRAME = {"Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "iframe", "Sec-Fetch-Site": "cross-site"}


@pytest.fixture(scope="module")
def recording() -> dg.Recording:
    scene = dg.Scene([dg.Target("boulic", label="human", range_m=4.0)], duration_s=2.0)
    return dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0), angles=False)


def get(url: str, **headers: str) -> tuple[bytes, dict[str, str]]:
    with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=60) as answer:
        return answer.read(), dict(answer.headers)


def test_a_recording_is_served_until_it_is_stopped(recording: dg.Recording) -> None:
    page = dg.view(recording)
    try:
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{20,}/", page.url)
        assert page._repr_html_() == f'<iframe src="{page.url}" width="100%" height="720" style="border:0"></iframe>'
        assert repr(page) == f"View of simulation: {page.url}"
        body, headers = get(page.url, **FRAME)
        assert b"<html" in body
        assert "frame-ancestors http://localhost:* http://127.0.0.1:*" in headers["content-security-policy"]
        assert b'"recording"' in get(page.url + "api/session")[0]
        with pytest.raises(urllib.error.HTTPError, match="403"):
            get(page.url + "api/session", **FRAME)
    finally:
        page.stop()
    assert "stopped" in page._repr_html_()
    with pytest.raises(urllib.error.URLError):
        get(page.url)


def test_a_path_is_opened_as_by_the_command_and_what_cannot_be_shown_is_one_error(
    recording: dg.Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_recording(recording, tmp_path / "walk.h5")
    with dg.view(tmp_path / "walk.h5", gate="truth") as page:
        assert repr(page).startswith("View of walk.h5: http://")
    with pytest.raises(RecordingError, match=r"^nothing\.h5: no such file or folder$"):
        dg.view("nothing.h5")
    with pytest.raises(ConfigError, match=r"^source: int is not allowed; give a recording, or the path"):
        dg.view(3)
    with pytest.raises(ConfigError, match=r"gate: 'trak' is not allowed"):
        dg.view(recording, gate="trak")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(DoppelgaitError, match=r"pip install 'doppelgait\[viewer\]'"):
        dg.view(recording)
    assert server.NO_SERVER

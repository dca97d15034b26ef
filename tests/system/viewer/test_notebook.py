"""The viewer from Python: a page served from a thread, for this computer alone."""

import re
import urllib.error
import urllib.request
from pathlib import Path

import pytest

import doppelgait as dg
from doppelgait.core.errors import ConfigError, DoppelgaitError, RecordingError
from doppelgait.radar import write_recording
from doppelgait.viewer import server

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

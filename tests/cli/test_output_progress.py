"""Progress of commands: none for short work, a bar or lines for longer work."""

import io
from collections.abc import Callable
from unittest.mock import Mock

import pytest

from doppelgait.cli import output
from doppelgait.cli.output import PROGRESS_DELAY_S, report_progress


def work(monkeypatch: pytest.MonkeyPatch, seconds_per_step: float) -> None:
    """Make eight steps, each as long as stated by a clock that does not wait."""
    now_s = 0.0
    monkeypatch.setattr(output, "monotonic", lambda: now_s)
    with report_progress("counting") as on_progress:
        for done in range(1, 9):
            now_s += seconds_per_step
            on_progress(done, 8)


def test_short_work_prints_no_progress(monkeypatch, capsys):
    work(monkeypatch, 0.99 * PROGRESS_DELAY_S / 8)
    assert capsys.readouterr().err == ""


def test_longer_work_prints_progress_from_the_delay_on(monkeypatch, capsys):
    work(monkeypatch, PROGRESS_DELAY_S / 4)
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(",")[0] for line in lines] == [f"counting: {done} of 8" for done in range(4, 9)]
    assert lines[0].endswith("4.0 per second, 1 s left")


class Terminal(io.StringIO):
    """Standard error of a terminal."""

    def isatty(self) -> bool:
        return True


def use_timer(monkeypatch: pytest.MonkeyPatch, *, fires: bool) -> None:
    """Replace the timer by one that fires at once, or never."""

    def make(delay_s: float, function: Callable[[], None]) -> Mock:
        assert delay_s == PROGRESS_DELAY_S
        return Mock(start=function if fires else Mock())

    monkeypatch.setattr(output, "Timer", make)


@pytest.mark.parametrize("fires", [False, True])
def test_only_longer_work_shows_a_bar(monkeypatch, fires):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("sys.stderr", terminal := Terminal())  # no fixture can: pytest replaces it again
    use_timer(monkeypatch, fires=fires)
    work(monkeypatch, 0.5 if fires else 0.01)
    shown = terminal.getvalue()
    assert ("counting" in shown, "8/8" in shown, bool(shown)) == (fires, fires, fires)

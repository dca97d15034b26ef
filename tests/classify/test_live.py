"""Live decisions: the same as of the file, gaps, clocks, and a slow analysis."""

import threading
from pathlib import Path

import numpy as np
import pytest

from doppelgait.classify import live as live_module
from doppelgait.classify import timeline
from doppelgait.classify.decide import Decision
from doppelgait.classify.live import live
from doppelgait.classify.timeline import classify_over_time
from doppelgait.core.errors import AnalysisError, ConfigError, DoppelgaitWarning, RecordingError
from doppelgait.core.rng import rng
from doppelgait.dataset.windows import Ring
from doppelgait.motion import boulic_walk
from doppelgait.pipeline import TargetList, simulate
from doppelgait.processing import Analysis
from doppelgait.radar import Radar
from doppelgait.radar.measured import label_measured
from doppelgait.scene import Scene, Target
from export_models import ALARM_MODEL as MODEL

PRF_HZ = 700.0
RADAR = Radar.preset("x4", prf_hz=PRF_HZ)


def judged(seen, _, number):
    """An answer that depends on the last bit of the features."""
    columns = seen.columns
    human = 0.5 + 0.4 * np.sin(1e3 * columns["feature_doppler_bandwidth_hz"])
    quality = {name: value for name, value in columns.items() if isinstance(value, float)}
    return Decision(
        target=number, label="human", probability=human, probabilities={"human": human, "dog": 1 - human},
        abstained=False, reason="", blocked=False, alarm=None, flags=seen.flags, quality=quality,
    )  # fmt: skip


@pytest.fixture(autouse=True)
def _answers(monkeypatch):
    monkeypatch.setattr(timeline, "decide", judged)


@pytest.fixture(scope="module")
def walk():
    scene = Scene([Target(boulic_walk(speed_mps=1.2, duration_s=4.2), range_m=5.0)])
    return simulate(scene, RADAR, rng=rng(3), snr_db=20.0)


def frames_of(recording):
    return zip(recording.slow_time_s, recording.samples.matrix, strict=True)


def live_of(recording, frames=None, **options):
    frames = frames_of(recording) if frames is None else frames
    return live(frames, recording.radar, MODEL, **{"window_s": 2.0, "hop_s": 0.7, "analysis": Analysis(), **options})


def same(found, expected):
    assert len(found) == len(expected) > 0
    for one, other in zip(found, expected, strict=True):
        assert repr(one) == repr(other)  # NaN equals NaN


def of_file(recording, **options):
    return classify_over_time(recording, MODEL, **{"window_s": 2.0, "hop_s": 0.7, "analysis": Analysis(), **options})


@pytest.mark.parametrize("hop_s", [0.7, 0.3333])
def test_a_stream_gives_the_decisions_of_its_file(walk, hop_s):
    found = live_of(walk, hop_s=hop_s)
    expected = of_file(walk, hop_s=hop_s)
    same(list(found), expected)
    assert len(expected) == int((4.2 - 2.0) / hop_s + 1e-9) + 1
    assert vars(found.counts) == {
        "frames": walk.n_pulses, "filled": 0, "malformed": 0, "late": 0, "jumps": 0, "windows": len(expected),
        "skipped": 0, "failed": 0,
    }  # fmt: skip


@pytest.mark.parametrize("gap", [12, 200], ids=["hole", "pause"])
def test_missing_and_malformed_frames_are_those_of_a_file_without_them(walk, gap):
    lost = np.r_[500 : 500 + gap, 900, 1200]
    frames = list(frames_of(walk))
    frames[900] = (frames[900][0], frames[900][1][:-1])
    frames[1200] = (frames[1200][0], np.full(walk.n_range_bins, np.nan))
    del frames[500 : 500 + gap]
    found = live_of(walk, frames)
    kept = np.delete(np.arange(walk.n_pulses), lost)
    with pytest.warns(DoppelgaitWarning, match="are missing at|1 pause"):
        file = label_measured(
            Path("walk"),
            walk.samples.matrix[kept],
            radar=walk.radar,
            slow_time_s=walk.slow_time_s[kept],
            range_m=walk.range_m,
        )
    for live_decision, decision in zip(list(found), of_file(file), strict=True):
        assert (live_decision.start_s, live_decision.label) == (decision.start_s, decision.label)
        assert live_decision.window.probability == pytest.approx(decision.window.probability, abs=0.02)
    counts = found.counts
    assert (counts.filled, counts.malformed, counts.frames) == (lost.size, 2, walk.n_pulses - gap)


def test_jitter_and_another_clock_lose_nothing(walk):
    jitter = np.random.default_rng(1).uniform(-0.3, 0.3, walk.n_pulses)
    times_s = (np.arange(walk.n_pulses) * 1.0005 + jitter) / PRF_HZ
    found = live_of(walk, zip(times_s - times_s[0], walk.samples.matrix, strict=True))
    same(list(found), of_file(walk))
    assert (found.counts.filled, found.counts.late) == (0, 0)


def test_frames_out_of_order_are_left_out(walk):
    frames = list(frames_of(walk))
    found = live_of(walk, [*frames[:1000], frames[990], frames[999], *frames[1000:]])
    same(list(found), of_file(walk))
    assert found.counts.late == 2


def test_a_clock_that_jumps_back_is_ignored(walk):
    times_s = walk.slow_time_s - np.where(np.arange(walk.n_pulses) < 1000, 0.0, 100.0)
    found = live_of(walk, zip(times_s, walk.samples.matrix, strict=True))
    assert [one.label for one in found] == [one.label for one in of_file(walk)]
    assert (found.counts.jumps, found.counts.late, found.counts.filled) == (1, 0, 0)


def test_after_a_gap_longer_than_a_window_windows_begin_anew(walk):
    times_s = walk.slow_time_s + np.where(np.arange(walk.n_pulses) < 1000, 0.0, 100.0)
    found = live_of(walk, zip(times_s, walk.samples.matrix, strict=True))
    assert [one.start_s for one in found] == pytest.approx([100.0 + 1000 / PRF_HZ, 100.7 + 1000 / PRF_HZ])
    assert found.counts.jumps == 1
    assert found.counts.filled == 0


@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_frames_of_another_rate_are_said(walk, rate, monkeypatch):
    monkeypatch.setattr(live_module, "analyze_window", lambda *_: TargetList())
    with pytest.warns(DoppelgaitWarning, match="prf_hz = 700 does not match their times"):
        list(live_of(walk, zip(walk.slow_time_s / rate, walk.samples.matrix, strict=True)))


class Analyses:
    """Analyses that wait until they may go on."""

    def __init__(self, monkeypatch):
        self.began, self.go_on, self.starts_s = threading.Semaphore(0), threading.Semaphore(0), []
        monkeypatch.setattr(live_module, "analyze_window", self)

    def __call__(self, window, *_):
        self.starts_s.append(window.start_s)
        self.began.release()
        assert self.go_on.acquire(timeout=20)
        return TargetList()


def test_an_analysis_that_is_behind_skips_hops_and_takes_the_newest(walk, monkeypatch):
    analyses, came, rest = Analyses(monkeypatch), threading.Event(), threading.Event()

    def sensor():
        for number, frame in enumerate(frames_of(walk)):
            if number == 1400 + 2 * 490:  # three windows are complete: the first is analysed, the second was waiting
                came.set()
                assert rest.wait(timeout=20)
            yield frame

    found = live_of(walk, sensor(), skip=True)
    done = threading.Thread(target=list, args=(found,))
    done.start()
    assert came.wait(timeout=20)
    rest.set()
    assert analyses.began.acquire(timeout=20)
    for _ in range(4):
        analyses.go_on.release()
    done.join(timeout=20)
    assert found.counts.windows + found.counts.skipped == 4
    assert found.counts.skipped >= 1
    assert analyses.starts_s[-1] == pytest.approx(3 * 0.7)


def test_a_file_waits_for_the_analysis(walk, monkeypatch):
    analyses, taken = Analyses(monkeypatch), []

    def file():
        for frame in frames_of(walk):
            taken.append(frame[0])
            yield frame

    found = live_of(walk, file())
    done = threading.Thread(target=list, args=(found,))
    done.start()
    assert analyses.began.acquire(timeout=20)
    assert len(taken) <= 1400 + 2 * 490  # the first window is analysed, the second in the slot, the third complete
    for _ in range(4):
        analyses.go_on.release()
    done.join(timeout=20)
    assert (found.counts.windows, found.counts.skipped, len(taken)) == (4, 0, walk.n_pulses)


def test_what_the_source_raises_is_raised(walk):
    def broken():
        yield from list(frames_of(walk))[:100]
        raise RecordingError("the sensor was unplugged")

    with pytest.raises(RecordingError, match="unplugged"):
        list(live_of(walk, broken()))


def test_a_window_that_cannot_be_analysed_is_counted_and_said_once(walk, monkeypatch):
    def refuse(*_):
        raise AnalysisError("no good")

    monkeypatch.setattr(live_module, "analyze_window", refuse)
    found = live_of(walk)
    with pytest.warns(DoppelgaitWarning, match="cannot be analysed: no good") as said:
        assert list(found) == []
    assert len(said) == 1
    assert (found.counts.failed, found.counts.windows) == (4, 4)


@pytest.mark.release
def test_memory_is_that_of_one_window():
    """Ten thousand windows' worth of frames change no array but the ring."""
    ring = Ring(RADAR, RADAR.range_axis_m()[:4], 0.01, 0.01)
    rows, row = ring._rows, np.zeros(4, dtype=np.complex64)
    windows = sum(1 for _ in ring.windows((n / PRF_HZ, row) for n in range(70_000)))
    assert windows == 10_000
    assert ring._rows is rows
    assert rows.shape == (8, 4)


def test_ranges_must_be_a_row():
    with pytest.raises(ConfigError, match="range_m"):
        live([], RADAR, MODEL, range_m=[[1.0]])


@pytest.fixture(scope="module")
def bursts():
    radar = Radar.preset("infineon-24-burst")
    scene = Scene([Target(boulic_walk(speed_mps=1.2, duration_s=6.2), range_m=5.0)])
    return simulate(scene, radar, rng=rng(3), snr_db=20.0)


def test_a_stream_in_bursts_gives_the_decisions_of_its_file(bursts):
    found = live_of(bursts)
    same(list(found), of_file(bursts))
    assert (found.counts.filled, found.counts.late, found.counts.jumps) == (0, 0, 0)


def test_missing_frames_of_bursts_are_filled_in_their_places(bursts):
    frames = list(frames_of(bursts))
    lost = [*range(200, 230), *range(500, 520), *range(1000, 1024)]  # within bursts, over the end of one, at its start
    kept = [frame for number, frame in enumerate(frames) if number not in lost]
    windows = [window for window, *_ in live_of(bursts, kept).windows()]
    filled = live_of(bursts, kept)
    whole = list(live_of(bursts).windows())
    assert [window.start_s for window in windows] == [window.start_s for window, *_ in whole]
    for window, (other, *_) in zip(windows, whole, strict=True):
        np.testing.assert_allclose(window.recording.slow_time_s, other.recording.slow_time_s, rtol=0, atol=1e-12)
    list(filled)
    assert filled.counts.filled == len(lost)
    rows = windows[0].recording.samples.matrix
    line = frames[199][1] + np.arange(1, 31)[:, None] / 31 * (frames[230][1] - frames[199][1])
    np.testing.assert_allclose(rows[200:230], line, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(rows[230:500], bursts.samples.matrix[230:500])


def test_after_a_long_gap_windows_begin_with_a_whole_burst(bursts):
    frames = list(frames_of(bursts))
    kept = frames[: 10 * 128] + [(time_s + 60.0, row) for time_s, row in frames[10 * 128 + 50 :]]
    running = live_of(bursts, kept)
    windows = [window for window, *_ in running.windows()]
    assert running.counts.jumps == 1
    after = next(window for window in windows if window.start_s > 30.0)
    np.testing.assert_array_equal(after.recording.samples.matrix[:128], bursts.samples.matrix[11 * 128 : 12 * 128])

"""Times of pulses as recorders stamp them: what is a hole, a pause, another rate, or only an imprecise clock."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import DoppelgaitWarning, RecordingError
from doppelgait.core.frames import SlowTime
from doppelgait.radar.measured import label_measured
from doppelgait.radar.recording import check_plausible
from doppelgait.radar.slow_time import place_pulses

N, RATE_HZ, TICK_S = 2400, 400.0, 1 / 64
RNG = np.random.default_rng(3)
EVEN_S = np.arange(N) / RATE_HZ
LOST = RNG.choice(np.arange(1, N - 1), 240, replace=False)
PAUSE_S = np.concatenate([EVEN_S[:1200], EVEN_S[1200:] + 1.0])
TWO_RATES_S = np.concatenate([EVEN_S[:1200], EVEN_S[1200] + np.arange(900) / 300.0])
BURSTS_S = (0.2 * np.arange(15)[:, None] + np.arange(128) / 3000.0).ravel()
KEPT = np.delete(np.arange(N), LOST)


def late_s():
    """Deliveries of 20 pulses at once, 40 ms after the first."""
    stamps = EVEN_S.copy()
    for first in RNG.choice(N - 60, 10, replace=False):
        stamps[first : first + 20] = np.maximum(stamps[first : first + 20], stamps[first] + 0.04)
    return np.maximum.accumulate(stamps)


def bloated(peak_s):
    """Deliveries that become late and catch up again."""
    late = peak_s * np.exp(-0.5 * ((EVEN_S - 3.0) / 0.25) ** 2)
    return np.maximum.accumulate(EVEN_S + late)


def floored(stamps_s, tick_s):
    return np.floor(stamps_s / tick_s) * tick_s


def jittered(stamps_s, steps):
    return stamps_s + steps / RATE_HZ * RNG.standard_normal(stamps_s.size)


@pytest.mark.parametrize(
    ("stamps_s", "rate_hz", "size", "pieces"),
    [
        pytest.param(EVEN_S, RATE_HZ, N, 1, id="even"),
        pytest.param(np.delete(EVEN_S, LOST), RATE_HZ, N, 1, id="ten per cent lost"),
        pytest.param(np.delete(EVEN_S, RNG.choice(N - 2, N // 2, False) + 1), RATE_HZ, N, 1, id="half lost"),
        pytest.param(np.delete(EVEN_S, np.s_[2 : N - 1 : 3]), RATE_HZ, N, 1, id="every third lost"),
        pytest.param(np.round(np.delete(EVEN_S, np.s_[20 : N - 1 : 50]), 3), RATE_HZ, N, 1, id="every 50th, ms"),
        pytest.param(bloated(0.3) + 2e-4 * RNG.random(N), RATE_HZ, N, 1, id="late for a second, jitter"),
        pytest.param(np.delete(np.arange(500) / 17.06, [100, 101, 300]), 17.06, 500, 1, id="slow radar, three lost"),
        pytest.param(floored(EVEN_S + 1.65e9, TICK_S), RATE_HZ, N, 1, id="clock of a PC since 1970"),
        pytest.param(floored(PAUSE_S, TICK_S), RATE_HZ, N, 2, id="clock of a PC, pause"),
        pytest.param(floored(np.delete(EVEN_S, np.s_[1000:1040]), TICK_S), RATE_HZ, N, 1, id="clock of a PC, 40 lost"),
        pytest.param(np.round(KEPT / 640.0, 3), 640.0, N, 1, id="whole milliseconds, ten per cent lost"),
        pytest.param(np.round(np.arange(N) / 2000.0, 3), 2000.0, N, 1, id="whole milliseconds, two in one"),
        pytest.param(floored(np.delete(np.arange(N), [300]) / 50.0, TICK_S), 50.0, N, 1, id="clock of a PC, one lost"),
        pytest.param(jittered(EVEN_S[KEPT], 0.1), RATE_HZ, N, 1, id="jitter, ten per cent lost"),
        pytest.param(np.sort(jittered(EVEN_S[KEPT], 0.2)), RATE_HZ, N, 1, id="much jitter, ten per cent lost"),
        pytest.param(EVEN_S[np.arange(N) % 64 < 60], RATE_HZ, N, 1, id="four of 64 lost, no bursts"),
        pytest.param(np.sort(jittered(EVEN_S, 0.3)), RATE_HZ, N, 1, id="jitter"),
        pytest.param(np.maximum.accumulate(jittered(EVEN_S, 3.0)), RATE_HZ, N, 1, id="jitter of several steps"),
        pytest.param(np.delete(jittered(EVEN_S, 0.3), np.s_[900:920]), RATE_HZ, N, 1, id="jitter, 20 lost"),
        pytest.param(late_s(), RATE_HZ, N, 1, id="late deliveries"),
        pytest.param(EVEN_S[np.minimum(np.arange(N) // 32 * 32 + 31, N - 1)], RATE_HZ, N, 1, id="packets of 32"),
        pytest.param(PAUSE_S, RATE_HZ, N, 2, id="pause"),
        pytest.param(EVEN_S[np.arange(N) % 200 < 165], RATE_HZ, N - 35, 1, id="holes of 0.1 s, no bursts"),
        pytest.param(np.where(EVEN_S < 3.0, EVEN_S, EVEN_S - 3600.0), RATE_HZ, N, 1, id="clock set back"),
        pytest.param(np.where(EVEN_S < 3.0, EVEN_S, EVEN_S + 3600.0), RATE_HZ, N, 2, id="clock set ahead"),
        pytest.param(np.round(TWO_RATES_S, 3), RATE_HZ, 2100, 2, id="another rate, milliseconds"),
        pytest.param(jittered(TWO_RATES_S, 0.3), RATE_HZ, 2100, 2, id="another rate, jitter"),
        pytest.param(BURSTS_S, 3000.0, 1920, 1, id="bursts"),
        pytest.param(np.delete(BURSTS_S, np.s_[896:1024]), 3000.0, 1792, 1, id="bursts, one lost"),
        pytest.param(np.delete(BURSTS_S, [700, 701]), 3000.0, 1792, 1, id="bursts, one incomplete"),
        pytest.param(jittered(BURSTS_S, 0.01), 3000.0, 1920, 1, id="bursts, jitter"),
    ],
)
def test_times_are_even_in_pieces_at_the_true_rate(stamps_s, rate_hz, size, pieces):
    placed = place_pulses(stamps_s, where="test")
    assert placed.rate_hz == pytest.approx(rate_hz, rel=1e-3)
    assert placed.row.size == size
    assert len(SlowTime(placed.time_s).find_pieces()) == pieces
    assert ("burst_pulses" in placed.facts) == (rate_hz == 3000.0)
    steps_s = np.diff(placed.time_s)
    odd = np.abs(steps_s * placed.rate_hz - 1.0) > 0.01
    assert odd.sum() <= (900 if size == 2100 else 14 if rate_hz == 3000.0 else pieces - 1)


def test_pulses_out_of_order_are_sorted_and_lost_ones_are_on_the_line_between_neighbours():
    order = np.arange(N)
    order[[100, 102]] = order[[102, 100]]
    placed = place_pulses(EVEN_S[order], where="test")
    np.testing.assert_array_equal(placed.fill(order[:, None])[:, 0], np.arange(N))
    kept = np.delete(np.arange(N), [500, 501, 900])
    placed = place_pulses(EVEN_S[kept], where="test")
    np.testing.assert_allclose(placed.fill(kept[:, None].astype(np.complex64))[:, 0], np.arange(N), rtol=1e-6)
    assert placed.facts["lost_frame_share"] == pytest.approx(3 / 1200)


@pytest.fixture(scope="module")
def walk():
    scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=6.0)
    return dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))


def read(recording, rows, times_s, prf_hz):
    radar = recording.radar.model_copy(update={"prf_hz": prf_hz})
    values = recording.baseband.values[rows]
    return label_measured(Path("walk"), values, radar=radar, slow_time_s=times_s, range_m=recording.range_m)


def test_a_wrong_stated_rate_is_corrected_by_the_times_and_said(walk):
    with pytest.warns(DoppelgaitWarning, match="states prf_hz = 700, but its times say 640 Hz"):
        read_back = read(walk, slice(None), walk.slow_time_s, 700.0)
    assert read_back.radar.prf_hz == pytest.approx(640.0)
    with pytest.raises(RecordingError, match="they are in ms"):
        read(walk, slice(None), 1e3 * walk.slow_time_s, 640.0)


def test_repeated_pulses_are_left_out_and_pulses_of_equal_stamps_stay(walk):
    doubled = np.repeat(np.arange(walk.n_pulses), 2)
    with pytest.warns(DoppelgaitWarning) as messages:
        read_back = read(walk, doubled, np.arange(doubled.size) / 640.0, 640.0)
    assert f"{walk.n_pulses} pulses repeat the one before" in str(messages[0].message)
    assert (read_back.n_pulses, read_back.radar.prf_hz) == (walk.n_pulses, pytest.approx(320.0))
    stuck = np.arange(walk.n_pulses)
    stuck[LOST] = stuck[LOST - 1]
    with pytest.warns(DoppelgaitWarning) as messages:
        read_back = read(walk, stuck, walk.slow_time_s, 640.0)
    assert read_back.n_pulses == walk.n_pulses
    assert "pulses are missing at" in str(messages[1].message)
    assert read_back.facts["lost_frame_share"] > 0.05
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        warnings.simplefilter("ignore", DoppelgaitWarning)
        assert read(walk, slice(None), floored(walk.slow_time_s, 1 / 64), 640.0).n_pulses == walk.n_pulses


def test_the_stated_rate_may_be_that_of_any_piece(walk):
    times_s = np.concatenate([np.arange(n) / rate_hz for n, rate_hz in ((900, 640.0), (1300, 500.0), (900, 640.0))])
    times_s += np.repeat([0.0, 900 / 640.0, 900 / 640.0 + 2.6], [900, 1300, 900])
    with pytest.warns(DoppelgaitWarning) as messages:
        read_back = read(walk, slice(0, times_s.size), times_s, 640.0)
    check_plausible(read_back, "test")
    assert read_back.radar.prf_hz == 640.0
    texts = [str(message.message) for message in messages]
    assert [text for text in texts if "the rate of the pulses changes: 640, 500, 640 Hz" in text] == texts


KEPT_S = EVEN_S[KEPT]
SPIKE_S = EVEN_S + 0.3 * (np.arange(N) == 1000)
READ_OUT_S = EVEN_S[np.arange(N) // 64 * 64] + np.arange(N) % 64 * 1e-4


@pytest.mark.parametrize(
    ("stamps_s", "prf_hz", "said", "rate_hz", "size"),
    [
        (KEPT_S, RATE_HZ, "240 of 2400 pulses are missing", RATE_HZ, N),  # a rate that agrees keeps the holes
        (KEPT_S, 500.0, "prf_hz = 500 is taken, but slow_time_s says 400 Hz", 500.0, KEPT_S.size),
        (SPIKE_S, None, "1 times are far from those about them", RATE_HZ, N),
        (np.cumsum(1 / np.linspace(300, 500, N)), None, "the rate drifts from 333.46 to 466.85 Hz", None, N),
        (READ_OUT_S, RATE_HZ, "from even ones, which are taken: 400", RATE_HZ, N),
        (READ_OUT_S, None, "37 bursts of 64 pulses at 10000 Hz.* if they are packets.* give prf_hz = 400", 1e4, 2368),
        (EVEN_S[np.arange(N) // 64 * 64] + np.arange(N) % 64 * 3e-6, None, "which are taken: 400", RATE_HZ, N),
        (np.datetime64("2026-11-28T12:00") + (1e9 * EVEN_S).astype("m8[ns]"), None, "", RATE_HZ, N),
        (np.insert(EVEN_S[1:], 7, np.nan), None, r"slow_time_s\[7\] is nan, as 1 of 2400 are", None, 0),
        (np.zeros(N), None, "leave them out and give prf_hz", None, 0),
        (1e3 * (1.7e9 + EVEN_S), None, "in ms since 1970", None, 0),
        (739_000 + EVEN_S / 86_400, RATE_HZ, "they are in days; give s", None, 0),
        (1e-318 * EVEN_S, None, "too fast to show motion", None, 0),
        (np.where((EVEN_S > 1) & (EVEN_S < 2), 1.0, EVEN_S), None, "from even ones, which are taken: 400", RATE_HZ, N),
    ],
)
def test_times_of_arrays(stamps_s, prf_hz, said, rate_hz, size):
    iq = np.exp(2j * np.pi * 50.0 * EVEN_S[: stamps_s.size])
    with warnings.catch_warnings(record=True) as messages:
        warnings.simplefilter("always")
        if not size:
            with pytest.raises(RecordingError, match=said):
                dg.Recording.from_array(iq, slow_time_s=stamps_s, prf_hz=prf_hz, carrier_hz=24e9)
            return
        recording = dg.Recording.from_array(iq, slow_time_s=stamps_s, prf_hz=prf_hz, carrier_hz=24e9)
    assert [one.category for one in messages if one.category is not DoppelgaitWarning] == []
    assert re.search(said, " ".join(str(one.message) for one in messages))
    assert recording.n_pulses == size
    assert rate_hz is None or recording.radar.prf_hz == pytest.approx(rate_hz, rel=1e-3)


@pytest.mark.parametrize("gate", ["track", (1.0, 9.0)])
def test_a_walk_is_measured_on_both_sides_of_a_pause_and_with_lost_pulses(walk, gate):
    whole = dg.analyze(walk, gate=gate)[0]
    kept = np.flatnonzero((walk.slow_time_s < 2.5) | (walk.slow_time_s >= 3.1))
    with pytest.warns(DoppelgaitWarning, match="1 pause of up to 0.6 s"):
        parts = dg.analyze(read(walk, kept, walk.slow_time_s[kept], 640.0), gate=gate)
    assert len(parts) == 1  # one body
    assert len(parts[0].segments) == 2
    assert parts[0].features.torso_velocity_mps == pytest.approx(whole.features.torso_velocity_mps, rel=0.05)
    names = ["doppler_bandwidth", "torso_velocity", "gait_frequency"]
    half = np.sort(RNG.permutation(walk.n_pulses)[: walk.n_pulses // 2])
    for kept, flagged in ((np.delete(np.arange(walk.n_pulses), LOST), names[:2]), (half, names)):
        with pytest.warns(DoppelgaitWarning, match="pulses are missing"):
            result = dg.analyze(read(walk, kept, walk.slow_time_s[kept], 640.0), gate=gate)[0]
        assert [flag.split(":")[0] for flag in result.flags if "were_lost" in flag] == flagged
        assert len(flagged) == 3 or result.gait_frequency_hz == pytest.approx(whole.gait_frequency_hz, rel=0.01)

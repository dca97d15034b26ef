"""Tracks of drawn detections: start, crossing, rest, end, and the gate that comes of them."""

from collections.abc import Callable

import numpy as np
import pytest

from doppelgait.core.config import validate
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.core.frames import Frames
from doppelgait.processing import Gate
from doppelgait.processing.track import Track, Tracker, track
from doppelgait.processing.track.live import Detection, Scan
from doppelgait.radar import Radar
from doppelgait.radar.simulate import label_baseband
from doppelgait.testing.tracking import compare_tracks

TIMES = np.arange(0.05, 6.0, 0.1)


def seen(range_m: float, velocity_mps: float, *, half_m: float = 0.3, half_mps: float = 1.0, **own: float) -> Detection:
    box = (range_m - half_m, range_m + half_m, velocity_mps - half_mps, velocity_mps + half_mps)
    values = {"power_v2": 1.0, "range_sd_m": 0.07, "velocity_sd_mps": 0.2, **own}
    return Detection(
        range_m, velocity_mps, values["power_v2"], values["range_sd_m"], values["velocity_sd_mps"], *box, 20
    )


def noisy(range_m: float, velocity_mps: float, rng: np.random.Generator) -> Detection:
    return seen(range_m + 0.07 * rng.standard_normal(), velocity_mps + 0.2 * rng.standard_normal())


def walk(start_m: float, velocity_mps: float, times_s: np.ndarray = TIMES) -> np.ndarray:
    return start_m - velocity_mps * times_s


def scans_of(bodies: list[tuple[np.ndarray, float]], rng: np.random.Generator, *, detected: float = 1.0) -> list[Scan]:
    return [
        Scan(float(t), tuple(noisy(r[n], v, rng) for r, v in bodies if rng.random() < detected))
        for n, t in enumerate(TIMES)
    ]


def table(tracks: list[Track], times_s: np.ndarray = TIMES) -> np.ndarray:
    found = np.full((times_s.size, len(tracks)), np.nan)
    for n, one in enumerate(tracks):
        found[np.searchsorted(times_s, one.times_s - 1e-6), n] = one.range_m
    return found


def test_one_walker_is_one_consistent_track() -> None:
    """A body with the white acceleration that the filter assumes: errors as claimed, NIS as a gated chi-square."""
    q, dt = 0.75, 0.1
    noise = np.linalg.cholesky(q * np.array([[dt**3 / 3, -(dt**2) / 2], [-(dt**2) / 2, dt]]))
    ratios, nis = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        states = [np.array([20.0, 1.2])]
        for _ in TIMES[1:]:
            range_m, velocity = states[-1]
            states.append(np.array([range_m - dt * velocity, velocity]) + noise @ rng.standard_normal(2))
        truth = np.array(states)
        scans = [
            Scan(float(t), (noisy(r, v, rng),) if rng.random() < 0.95 else ())
            for t, (r, v) in zip(TIMES, truth, strict=True)
        ]
        one = max(track(scans), key=lambda found: found.measured.sum())
        inside = np.searchsorted(TIMES, one.times_s - 1e-6)
        ratios.append(((one.range_m - truth[inside, 0]) / one.range_sd_m)[5:-5])
        ratios.append(((one.velocity_mps - truth[inside, 1]) / one.velocity_sd_mps)[5:-5])
        nis.append(one.mean_nis)
    assert np.std(np.concatenate(ratios)) == pytest.approx(1.0, abs=0.1)
    limit = -2 * np.log(0.01)
    assert np.mean(nis) == pytest.approx(2 - limit * 0.01 / 0.99, abs=0.12)  # mean of an exponential cut at the gate


def test_noise_alone_confirms_nothing_that_stays() -> None:
    rng = np.random.default_rng(4)
    scans = [
        Scan(0.1 * n, tuple(seen(rng.uniform(0.5, 9.5), rng.uniform(-8, 8)) for _ in range(rng.poisson(1.0))))
        for n in range(1200)
    ]
    assert len(track(scans)) <= 2  # in two minutes


def crossing_scans(rng: np.random.Generator, *, merge_mps: float) -> tuple[list[Scan], np.ndarray]:
    ranges = np.c_[walk(8, 1.0), walk(2, -1.0)]
    scans = []
    for t, (a_m, b_m) in zip(TIMES, ranges, strict=True):
        a, b = noisy(a_m, 1.0, rng), noisy(b_m, -1.0, rng)
        both = (a, b)
        if abs(a.range_m - b.range_m) < 0.8 and abs(a.velocity_mps - b.velocity_mps) < merge_mps:
            r, v = (a.range_m + b.range_m) / 2, (a.velocity_mps + b.velocity_mps) / 2
            low, high = min(a.range_low_m, b.range_low_m), max(a.range_high_m, b.range_high_m)
            slow, fast = min(d.velocity_low_mps for d in both), max(d.velocity_high_mps for d in both)
            both = (Detection(r, v, 2.0, 0.1, 0.3, low, high, slow, fast, 40),)
        scans.append(Scan(float(t), tuple(d for d in both if rng.random() < 0.95)))
    return scans, ranges


@pytest.mark.parametrize("merge_mps", [0.0, 2.0, 9.0])
def test_crossing_keeps_identities(merge_mps: float) -> None:
    """Detections apart throughout, merged at times and always merged; the demand is 90 % of runs."""
    good = 0
    for seed in range(20):
        scans, truth = crossing_scans(np.random.default_rng(seed), merge_mps=merge_mps)
        tracks = track(scans)
        result = compare_tracks(table(tracks), truth)
        good += len(tracks) == 2 and result.switches == 0 and result.gospa < 0.35
    assert good >= 19


def test_shared_detection_is_said_and_keeps_both() -> None:
    scans, _ = crossing_scans(np.random.default_rng(3), merge_mps=9.0)
    tracks = track(scans)
    assert len(tracks) == 2
    assert all(one.shared.any() or one.measured.all() for one in tracks)
    assert any(one.shared.sum() >= 2 for one in tracks)
    for one in tracks:
        middle = one.times_s[one.shared]
        assert ((middle > 2.3) & (middle < 3.7)).all()


@pytest.mark.parametrize("pause_s", [1.5, 5.0])
def test_rest_is_bridged(pause_s: float) -> None:
    """2 s of walking, slowing down in 1 s, unseen while slower than 0.2 m/s, and on."""
    times = np.arange(0.05, 6.0 + pause_s, 0.1)
    speed = np.interp(times, [0, 2, 3, 3 + pause_s, 4 + pause_s], [1.2, 1.2, 0, 0, 1.2])
    ranges = 8 - np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 * 0.1)])
    rng = np.random.default_rng(5)
    scans = [
        Scan(float(t), (noisy(r, v, rng),) if v > 0.2 else ()) for t, r, v in zip(times, ranges, speed, strict=True)
    ]
    (one,) = track(scans)
    assert np.abs(one.range_m - ranges).max() < 0.3
    assert (~one.measured).sum() >= 10 * pause_s - 2
    assert len(track(scans, Tracker(rest_speed_mps=0.0))) == 2


def test_walker_who_vanishes_ends_at_the_last_detection() -> None:
    rng = np.random.default_rng(6)
    scans = scans_of([(walk(8, 1.2), 1.2)], rng)
    scans[30:] = [Scan(scan.time_s) for scan in scans[30:]]
    (one,) = track(scans)
    assert one.last_s == pytest.approx(TIMES[29])
    again = scans[:30] + scans_of([(walk(8, 1.2), 1.2)], rng)[30:]
    again[30:45] = [Scan(scan.time_s) for scan in again[30:45]]
    assert [round(one.last_s, 2) for one in track(again)] == [2.95, 5.95]


def test_slow_confirmation_needs_four_of_six() -> None:
    body = [(walk(8, 1.2), 1.2)]
    scans = scans_of(body, np.random.default_rng(7))
    three_of_six = [scan if n % 6 in (0, 2, 4) else Scan(scan.time_s) for n, scan in enumerate(scans)]
    assert track(three_of_six) == []
    four_of_six = [scan if n % 6 in (0, 2, 3, 5) else Scan(scan.time_s) for n, scan in enumerate(scans)]
    (one,) = track(four_of_six)
    assert one.confirmed_at_s == pytest.approx(TIMES[5])
    assert one.detected_share == pytest.approx(40 / 60, abs=0.01)


def test_limb_far_from_the_body_keeps_the_track() -> None:
    """Every fifth scan the centre of the cluster jumps to a leg: outside the gate, its box still about the body."""
    rng = np.random.default_rng(8)
    scans = scans_of([(walk(8, 1.2), 1.2)], rng)
    for n in range(2, 60, 5):
        scans[n] = Scan(scans[n].time_s, (seen(walk(8, 1.2)[n] - 0.25, 3.6, half_mps=2.8),))
    (one,) = track(scans)
    assert one.measured[one.times_s > one.confirmed_at_s].all()
    assert np.abs(one.range_m - walk(8, 1.2)).max() < 0.2


def test_second_detection_of_a_body_starts_no_track() -> None:
    rng = np.random.default_rng(9)
    scans = [
        Scan(s.time_s, (*s.detections, seen(s.detections[0].range_m + 0.6, 3.0, power_v2=0.1)))
        for s in scans_of([(walk(8, 1.2), 1.2)], rng)
    ]
    assert len(track(scans)) == 1


def test_shadow_of_a_standing_body_is_no_target() -> None:
    still = [Scan(float(t), (seen(4.0, 0.0, half_mps=0.4),)) for t in TIMES]
    assert track(still) == []
    assert len(track(still, Tracker(still_travel_m=0.0))) == 1
    on_the_spot = [Scan(float(t), (seen(4.0, 0.0, half_mps=2.0),)) for t in TIMES]
    assert len(track(on_the_spot)) == 1


def test_what_changes_its_range_without_a_doppler_shift_is_no_target() -> None:
    """Drifting clutter: narrow, at 0 m/s, and now here and now there. A robot is as narrow and moves."""
    places = np.interp(TIMES, [0, 2, 2.5, 4, 4.5, 6], [1.0, 1.0, 1.3, 1.3, 1.6, 1.6])
    sure = {"velocity_sd_mps": 0.05}
    drifts = [Scan(float(t), (seen(float(r), 0.0, half_mps=0.3, **sure),)) for t, r in zip(TIMES, places, strict=True)]
    assert track(drifts) == []
    assert len(track(drifts, Tracker(still_speed_mps=0.0))) == 1
    robot = [Scan(float(t), (seen(float(4 - 0.2 * t), 0.2, half_mps=0.3, **sure),)) for t in TIMES]
    assert len(track(robot)) == 1


def test_who_stands_most_of_the_time_is_a_target_all_the_same() -> None:
    speed = np.interp(TIMES, [0, 1.2, 1.5], [1.2, 1.2, 0.0])
    ranges = 6 - np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 * 0.1)])
    scans = [
        Scan(float(t), (seen(float(r), float(v), half_mps=0.3 + 0.8 * v),))
        for t, r, v in zip(TIMES, ranges, speed, strict=True)
    ]
    (one,) = track(scans)
    assert np.median(np.abs(one.velocity_mps)) < 0.1


def test_at_most_as_many_as_asked_for() -> None:
    rng = np.random.default_rng(10)
    scans = scans_of([(walk(9, 1.2), 1.2), (walk(1.5, -0.2), -0.2)], rng)
    scans[:20] = [Scan(s.time_s, s.detections[:1]) for s in scans[:20]]
    assert len(track(scans)) == 2
    (one,) = track(scans, Tracker(max_targets=1))
    assert one.range_m[0] == pytest.approx(9, abs=0.2)


def with_velocities(scans: list[Scan], change: Callable[[float], float]) -> list[Scan]:
    return [Scan(s.time_s, tuple(seen(d.range_m, change(d.velocity_mps)) for d in s.detections)) for s in scans]


@pytest.mark.parametrize("velocity", [1.2, 4.4, -5.5])
def test_folded_velocities_are_unfolded_by_the_range(velocity: float) -> None:
    """300 frames/s at 7.29 GHz: 6.17 m/s of span, +-3.08 m/s."""
    span = 6.17
    start = 30.0 if velocity > 0 else 2.0
    scans = scans_of([(walk(start, velocity), velocity)], np.random.default_rng(11))
    folded = with_velocities(scans, lambda velocity_mps: (velocity_mps + span / 2) % span - span / 2)
    (one,) = track(folded, velocity_span_mps=span)
    assert one.velocity_mps.mean() == pytest.approx(velocity, abs=0.1)
    assert one.first_s == pytest.approx(TIMES[0])


def test_velocities_of_a_slow_radar_are_left_out() -> None:
    """17 frames/s: 0.35 m/s of span; what is told is not used."""
    rng = np.random.default_rng(12)
    scans = scans_of([(walk(8, 1.2), 1.2)], rng)
    (one,) = track(with_velocities(scans, lambda _: rng.uniform(-0.17, 0.17)), velocity_span_mps=0.35)
    assert one.velocity_mps[10:].mean() == pytest.approx(1.2, abs=0.1)


def test_faults_are_named() -> None:
    scan = Scan(1.0, (seen(3.0, 1.0),))
    with pytest.raises(AnalysisError, match="ascending, different times"):
        track([scan, scan])
    with pytest.raises(AnalysisError, match="at 1 s: range nan"):
        track([Scan(1.0, (seen(float("nan"), 1.0),))])
    with pytest.raises(ConfigError, match="confirm_hits = 7"):
        validate(Tracker, {"confirm_hits": 7})
    assert track([]) == []


def test_gate_covers_the_time_of_the_track_and_no_more() -> None:
    rng = np.random.default_rng(13)
    scans = scans_of([(walk(8, 1.2), 1.2)], rng)
    scans[:20] = [Scan(s.time_s) for s in scans[:20]]
    (one,) = track(scans)
    slow_time = np.arange(6000) / 1000.0
    gate = Gate.from_track(one, span_m=1.6, time_s=slow_time, cpi_s=0.1)
    assert gate.source == "track"
    assert gate.time_s[[0, -1]] == pytest.approx([2.0, 5.999], abs=2e-3)
    middle = (gate.low_m + gate.high_m) / 2
    np.testing.assert_allclose(middle, walk(8, 1.2, gate.time_s), atol=0.12)
    assert middle[0] - middle[50] == pytest.approx(0.05 * one.velocity_mps[0], rel=1e-6)
    np.testing.assert_allclose(gate.high_m - gate.low_m, 1.6)
    radar = Radar.preset("x4")
    baseband = label_baseband(np.zeros((6000, radar.n_range_bins), dtype=np.complex64), slow_time, radar)
    part = gate.crop(Frames.of(baseband)).label()
    np.testing.assert_array_equal(part["slow_time"].values, gate.time_s)
    with pytest.raises(AnalysisError, match="pulses"):
        Gate.from_track(one, span_m=1.6, time_s=slow_time[:1000])

"""Segments of a range track: change points, what is not cut, motion over ground."""

from itertools import combinations, pairwise

import numpy as np
import pytest

from doppelgait.core.errors import AnalysisError
from doppelgait.processing import track_segments
from doppelgait.processing.track_segments import SegmentationSettings, find_best_knots, find_track_segments

SD_M = 0.065


def noisy(track, seed):
    return track + np.random.default_rng(seed).normal(0, SD_M, track.size)


def change_points(segments):
    return [(left.stop_s + right.start_s) / 2 for left, right in pairwise(segments)]


def legs(source, *, n=4, leg_s=2.8, sd_m=SD_M):
    """Back and forth at one speed a leg, turns at once; 10 Hz."""
    times = np.arange(0, n * leg_s, 0.1)
    speeds = source.uniform(0.8, 1.6, n) * (-1.0) ** np.arange(n)
    corners = np.concatenate([[7.0], 7.0 - np.cumsum(speeds * leg_s)])
    track = np.interp(times, leg_s * np.arange(n + 1), corners)
    return times, track + source.normal(0, sd_m, times.size), leg_s * np.arange(1, n), speeds


def test_a_segment_has_the_velocity_and_leaves_out_the_time_about_a_turn():
    times, track, true, speeds = legs(np.random.default_rng(3), sd_m=1e-4)
    segments = find_track_segments(times, track)
    assert len(segments) == 4
    for segment, speed in zip(segments, speeds, strict=True):
        assert segment.radial_velocity_mps == pytest.approx(speed, abs=2e-3)
        assert segment.curvature_mps2 == pytest.approx(0, abs=5e-3)
        assert segment.residual_m < 5e-4
    for left, right, turn_s in zip(segments[:-1], segments[1:], true, strict=True):
        assert left.stop_s == pytest.approx(turn_s - 0.25, abs=0.051)
        assert right.start_s == pytest.approx(turn_s + 0.25, abs=0.051)
    assert (segments[0].start_s, segments[-1].stop_s) == (times[0], times[-1])
    assert [segment.usable for segment in segments] == [True, True, True, True]


@pytest.mark.parametrize("period_s", [3, 5, 8])
def test_a_sinusoidal_speed_is_not_cut(period_s):
    """Up to 5 per cent and 0.1 m/s^2: speed 1.2 + A sin(w t)."""
    times = np.arange(0, 12, 0.1)
    w = 2 * np.pi / period_s
    for seed in range(5):
        clean = 18 - 1.2 * times + min(0.06 / w, 0.1 / w**2) * np.cos(w * times + seed)
        assert len(find_track_segments(times, noisy(clean, seed))) == 1


@pytest.mark.parametrize("aspect_deg", [0, 30, 60, 90, 150])
@pytest.mark.parametrize("range_m", [1.5, 4.0])
def test_a_straight_walk_past_the_radar_is_one_segment(aspect_deg, range_m):
    """Constant velocity over ground, whatever the radial velocity does: R^2 is a parabola."""
    times = np.linspace(-2.5, 2.5, 51)
    along, across = 1.4 * np.cos(np.radians(aspect_deg)) * times, 1.4 * np.sin(np.radians(aspect_deg)) * times
    near = range_m if aspect_deg > 30 and aspect_deg < 150 else range_m + 3.0
    clean = np.sqrt((near - along) ** 2 + across**2 + 0.09)
    for seed in range(4):
        (segment,) = find_track_segments(times, noisy(clean, seed))
        assert segment.usable
    (segment,) = find_track_segments(times, clean)
    velocity = 1.4 * np.cos(np.radians(aspect_deg)) * near / np.hypot(near, 0.3)
    assert segment.radial_velocity_mps == pytest.approx(velocity, abs=1e-6)
    assert segment.curvature_mps2 == pytest.approx((1.4**2 - velocity**2) / np.hypot(near, 0.3), abs=1e-6)
    assert segment.residual_m < 1e-6


def lasting_errors(source, n, *, sd_m=0.02):
    """Gaussian errors that are alike within half a second, as a tracker's are."""
    return sd_m * np.convolve(source.normal(0, 1, n + 4), np.ones(5), "valid") / np.sqrt(5)


WALK_AND_STOP = {
    "for good": ([0, 3.0, 6.0], [8.0, 4.4, 4.4], [(0.0, 3.0)]),
    "and go": ([0, 3.0, 5.5, 9.0], [8.0, 4.4, 4.4, 0.8], [(0.0, 3.0), (5.5, 9.0)]),
    "turn": ([0, 4.0, 8.0], [4.0, 8.0, 4.0], [(0.0, 4.0), (4.0, 8.0)]),
    "slower": ([0, 4.0, 8.0], [8.0, 3.2, 1.2], [(0.0, 4.0), (4.0, 8.0)]),
}


@pytest.mark.parametrize("name", WALK_AND_STOP)
def test_usable_segments_hold_one_velocity(name):
    """Smoothed over 0.6 s, errors of 2 cm: what is used lies within one leg, with its velocity."""
    corners_s, corners_m, legs_s = WALK_AND_STOP[name]
    times = np.arange(0, corners_s[-1], 0.1)
    fine_s = np.arange(-1, corners_s[-1] + 1, 0.02)
    smooth = np.convolve(np.interp(fine_s, corners_s, corners_m), np.ones(31) / 31, "same")
    found = 0
    for seed in range(12):
        track = np.interp(times, fine_s, smooth) + lasting_errors(np.random.default_rng(seed), times.size)
        used = [segment for segment in find_track_segments(times, track, range_sd_m=0.02) if segment.usable]
        found += bool(used)
        for segment in used:
            (leg,) = [leg for leg in legs_s if leg[0] <= (segment.start_s + segment.stop_s) / 2 <= leg[1]]
            assert leg[0] - 0.35 <= segment.start_s < segment.stop_s <= leg[1] + 0.35
            slope = np.diff(np.interp(leg, corners_s, corners_m))[0] / (leg[1] - leg[0])
            assert segment.radial_velocity_mps == pytest.approx(-slope, abs=0.12)
    assert found >= 9


def test_a_path_that_the_partition_takes_for_one_is_cut_by_the_goodness_of_fit():
    """A circle beside the radar: smooth enough for the partition, but no straight walk."""
    times, cut, loose = np.arange(0, 5, 0.1), 0, SegmentationSettings(straight_level=0.0)
    for seed in range(20):
        clean = 5 + 0.5 * np.sin(0.9 * times + seed)
        track = clean + lasting_errors(np.random.default_rng(seed), times.size)
        whole = find_track_segments(times, track, range_sd_m=0.02, settings=loose)
        segments = find_track_segments(times, track, range_sd_m=0.02)
        cut += len(whole) == 1 and (len(segments) > 1 or not segments[0].usable)
        assert all(segment.straight_probability >= 1e-3 for segment in segments if segment.usable)
    assert cut >= 10


def test_who_stops_stands_still_and_a_short_rest_is_too_short():
    times = np.arange(0, 9, 0.1)
    track = np.interp(times, [0, 3, 6, 9], [8.0, 4.4, 4.4, 0.8]) + np.random.default_rng(1).normal(0, 0.03, times.size)
    assert [segment.reason for segment in find_track_segments(times, track)] == ["", "stands_still", ""]
    track = np.interp(times, [0, 4, 5.2, 9], [8.0, 3.2, 3.2, 7.0])
    assert [segment.reason for segment in find_track_segments(times, track)] == ["", "too_short", ""]


def test_no_segment_reaches_across_a_gap_and_uneven_times_do_not_matter():
    times = np.concatenate([np.arange(0, 3, 0.1), np.arange(4, 7, 0.1)])
    segments = find_track_segments(times, 10 - 1.2 * times)
    assert [(round(p.start_s, 3), round(p.stop_s, 3)) for p in segments] == [(0, 2.9), (4, 6.9)]
    uneven = np.sort(np.random.default_rng(2).uniform(0, 6, 60))
    track = np.interp(uneven, [0, 3, 6], [6.0, 2.4, 6.0])
    assert change_points(find_track_segments(uneven, track)) == [pytest.approx(3.0, abs=0.3)]


def test_faulty_tracks_are_refused_and_short_ones_have_no_segments():
    assert find_track_segments([], []) == ()
    assert find_track_segments([0.0, 0.1], [3.0, 3.0]) == ()
    assert [segment.reason for segment in find_track_segments([0.0, 0.1, 0.2], [3.0, 2.9, 2.8])] == ["too_short"]
    with pytest.raises(AnalysisError, match="as many times as ranges"):
        find_track_segments([0, 1, 2], [3, 3])
    with pytest.raises(AnalysisError, match="rising times"):
        find_track_segments([0, 2, 1], [3, 3, 3])
    with pytest.raises(AnalysisError, match="above 0 m; the smallest of these is -1 m"):
        find_track_segments([0, 1, 2], [3, -1, 3])
    with pytest.raises(AnalysisError, match="range_sd_m = 0"):
        find_track_segments([0, 1, 2], [3, 3, 3], range_sd_m=0)


def path_cost(times, ranges, knots, *, sd_m, smooth_mps2, penalty):
    """Least cost of one partition by dense least squares over start value, segment velocities and all departures."""
    n, value, noise = times.size, ranges**2, 2 * ranges * sd_m
    starts = [0, *knots]
    size = 1 + 2 * len(starts) + n - 1  # s_0; s' and s'' of every segment; a departure a step
    place, speed = np.zeros((n, size)), np.zeros(size)
    place[0, 0] = 1
    rows, wanted = [place[0] / noise[0]], [value[0] / noise[0]]
    for k in range(1, n):
        if k - 1 in starts:
            p = 1 + 2 * starts.index(k - 1)
            speed = np.eye(size)[p]
            rows += [np.eye(size)[p] / (2 * ranges[k - 1] * 3.0), np.eye(size)[p + 1] / (2 * 3.0**2)]
            wanted += [0, 0]
        dt = times[k] - times[k - 1]
        departure = np.eye(size)[1 + 2 * len(starts) + k - 1]
        kick = departure * 2 * ranges[k] * smooth_mps2 * np.sqrt(0.1 * dt)
        place[k] = place[k - 1] + dt * speed + dt**2 / 2 * np.eye(size)[p + 1] + dt / 2 * kick
        speed = speed + dt * np.eye(size)[p + 1] + kick
        rows += [place[k] / noise[k], departure]
        wanted += [value[k] / noise[k], 0]
    rows, wanted = np.array(rows), np.array(wanted)
    solution = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    return float(((rows @ solution - wanted) ** 2).sum()) + penalty * len(knots)


COSTS = {"smooth_mps2": 0.5, "penalty": 5.0}


@pytest.mark.parametrize("seed", range(9))
def test_no_other_partition_costs_less(seed):
    """All partitions of 14 uneven ranges with up to two corners, each solved by dense least squares."""
    source = np.random.default_rng(seed)
    times = np.cumsum(source.uniform(0.08, 0.12, 14))
    corners = times[0] + np.sort(source.uniform(0.2, 1.1, seed % 3))
    track = 6 + source.normal(0, 1) * times + source.normal(0, 0.03, 14)
    track += sum(source.normal(0, 4) * np.maximum(times - c, 0) for c in corners)

    def allowed(knots):
        return all(times[b] - times[a] >= 0.3 for a, b in pairwise([0, *knots, 13]))

    all_knots = [k for size in range(4) for k in combinations(range(1, 13), size) if allowed(k)]
    costs = {k: path_cost(times, track, k, sd_m=0.05, **COSTS) for k in all_knots}
    found, cost = find_best_knots(times, track, range_sd_m=0.05, min_segment_s=0.3, **COSTS)
    assert tuple(found) == min(costs, key=costs.get)
    assert cost == pytest.approx(min(costs.values()), rel=1e-4)


def test_hopeless_starts_are_given_up_and_the_change_points_stay(monkeypatch):
    """Walks to and fro, faster and slower, with lost ranges: as without giving up, of a part of the starts."""
    rng = np.random.default_rng(8)
    times = np.arange(0, 120, 0.1)
    speed = rng.choice([-2.0, -1.0, 0.0, 1.0, 1.5], 60)[(times / 2.5).astype(int)]
    ranges = np.abs(np.cumsum(speed * 0.1) % 14 - 7) + 1.0 + 0.02 * rng.normal(size=times.size)
    ranges[rng.random(times.size) < 0.01] += 1.0
    settings = {"range_sd_m": 0.02, "smooth_mps2": 0.45, "penalty": 20.0, "min_segment_s": 0.8}
    most, keep = [], track_segments._Filters.keep

    def counted(filters, starts):
        keep(filters, starts)
        most.append(filters.count)

    monkeypatch.setattr(track_segments._Filters, "keep", counted)
    found = find_best_knots(times, ranges, **settings)
    assert len(found[0]) > 20
    assert max(most) < times.size / 3
    for limit in ("HOPELESS", "LONGEST_S"):
        monkeypatch.setattr(track_segments, limit, np.inf)
    assert find_best_knots(times, ranges, **settings) == found

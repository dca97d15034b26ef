"""Paths over the ground (E-02b): curves, pace, posture on stopping, footfalls and what is refused."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from doppelgait.core.errors import MotionError
from doppelgait.motion import make_motion, paths
from doppelgait.motion.follow import follow, steady_speed_mps
from doppelgait.motion.models import boulic_walk, quadruped_gait
from doppelgait.motion.models.boulic import compute_support_fraction
from doppelgait.motion.retime import body_centre_m

SPEED_MPS = 1.2
PATHS = [
    paths.StraightPath(),
    paths.ArcPath(radius_m=1.5, turn_deg=200),
    paths.ArcPath(radius_m=2.0, turn_deg=-150, side_m=0.4, ahead_m=0.3),
    paths.PolylinePath(points_m=[(0, 0), (2, 0), (3, 2), (1, 3)], corner_radius_m=0.4),
    paths.StopAndGoPath(stops=[{"at_m": 1.5, "pause_s": 2.0}, {"at_m": 4.0, "pause_s": 0.4}]),
    paths.TurnAroundPath(out_m=2.0, turn_s=2.5),
    paths.TurnAroundPath(out_m=2.0, radius_m=0.8),
]
NAMES = [f"{path.kind}-{number}" for number, path in enumerate(PATHS)]


@pytest.fixture(scope="module")
def walk():
    return boulic_walk(speed_mps=SPEED_MPS, duration_s=9.0)


@pytest.fixture(scope="module")
def trot():
    return quadruped_gait(gait="trot", withers_m=0.5, duration_s=4.0, tail_sweep_deg=0)


def velocities(motion):
    return np.gradient(motion.position_m, axis=0) * motion.rate_hz


def stop_of(motion):
    (stop_m,) = motion.report["path"]["stops_m"]
    return stop_m


def ground(points):
    return np.hypot(points[..., 0], points[..., 1])


def steady_point(speed_mps, duration_s, rate_hz=250.0, **facts):
    """A body of two points without any sway: a torso, and a mark beside it."""
    t = np.arange(round(duration_s * rate_hz) + 1) / rate_hz
    position = np.zeros((t.size, 2, 3))
    position[..., 0] = speed_mps * t[:, None]
    position[:, 1] += [0.3, 0.2, 0.5]
    return make_motion(position, rate_hz=rate_hz, markers=["a", "b"], parts=["torso", "left_hand"], facts=facts)


def test_a_curve_is_the_integral_of_its_curvature():
    curve = paths.join(
        [paths.CurveElement(1.0), paths.make_arc(0.7, 1.2), paths.CurveElement(0.5), paths.make_arc(2.0, -0.9)],
        start_m=(3.0, -2.0),
        heading_rad=0.4,
    )

    def heading(s):
        return 0.4 + np.clip(s - 1.0, 0, 0.84) / 0.7 - max(s - 2.34, 0.0) / 2.0

    for s in (0.3, 1.4, 2.0, 3.9, 5.0):  # the last is beyond the end
        x, y = (
            quad(lambda u, f=f: f(heading(u)), 0, s, points=[1.0, 1.84, 2.34], epsabs=1e-12)[0]
            for f in (np.cos, np.sin)
        )
        np.testing.assert_allclose(paths.find_points(curve, np.array([s]))[0], [3 + x, y - 2], atol=1e-9)
        half = paths.HEADING_WINDOW_M / 2
        inside = [p for p in (1.0, 1.84, 2.34) if s - half < p < s + half] or None
        mean = quad(heading, s - half, s + half, points=inside, epsabs=1e-12)[0] / paths.HEADING_WINDOW_M
        assert paths.smooth_heading_rad(curve, np.array([s]))[0] == pytest.approx(mean, abs=1e-9)


def test_the_pace_keeps_its_acceleration_and_stands_where_it_should():
    top_mps2, v = 0.8, 1.3
    ramp_s = math.pi * v / (2 * top_mps2)
    pace = paths.Pace(v, ramp_s, (paths.Stop(3.0, 2.0), paths.Stop(9.0, 0.5)))
    t = np.arange(0, 20, 1e-3)
    s = paths.distance_m(pace, t)
    speed, acceleration = np.gradient(s, t), np.gradient(np.gradient(s, t), t)
    assert speed.min() > -1e-9
    assert speed.max() == pytest.approx(v, abs=1e-9)
    assert np.abs(acceleration).max() == pytest.approx(top_mps2, rel=1e-3)
    for stop in pace.stops:
        rests = t[np.abs(s - stop.at_m) < 1e-12]
        assert np.ptp(rests) == pytest.approx(stop.pause_s, abs=0.05)
    # a stop costs its pause and half of each ramp, twice
    assert s[-1] == pytest.approx(v * (t[-1] - 2.5 - 2 * ramp_s))


def test_a_straight_path_gives_back_the_motion(walk, trot):
    for motion in (walk, trot):
        followed = follow(motion, paths.StraightPath())
        assert followed.positions.shape == motion.positions.shape
        shift = followed.position_m - motion.position_m
        assert np.ptp(shift, axis=(0, 1)).max() < 1e-9
        assert shift[..., 2] == pytest.approx(0.0, abs=1e-12)
        # the mean line of the body starts at the origin, its sway stays
        assert np.abs(body_centre_m(followed)[:, 1]).max() < 0.05
        facts = replace(followed.facts, path=None, footfalls=motion.facts.footfalls)
        assert (facts, followed.rate_hz) == (motion.facts, motion.rate_hz)
        for foot, times in motion.facts.footfalls.items():
            np.testing.assert_allclose(followed.facts.footfalls[foot], times, atol=1e-9)


@pytest.mark.parametrize("path", PATHS, ids=NAMES)
def test_start_and_heading_move_the_whole_path(walk, path):
    plain = follow(walk, path)
    moved = follow(walk, path, start_position_m=(2.0, -1.0), heading_deg=65.0)
    c, s = math.cos(math.radians(65)), math.sin(math.radians(65))
    turned = plain.position_m @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [2.0, -1.0, 0]
    np.testing.assert_allclose(moved.position_m, turned, atol=1e-9)


@pytest.mark.parametrize("path", PATHS, ids=NAMES)
def test_blocks_of_frames_give_the_bytes_of_the_whole(walk, path, monkeypatch):
    whole = follow(walk, path, start_position_m=(1.0, -2.0), heading_deg=30.0)
    monkeypatch.setattr(sys.modules[follow.__module__], "BLOCK_FRAMES", 100)
    blocks = follow(walk, path, start_position_m=(1.0, -2.0), heading_deg=30.0)
    assert whole.n_frames > 300
    np.testing.assert_array_equal(blocks.position_m, whole.position_m)


def test_another_speed_keeps_the_stride_length(walk):
    fast = follow(walk, paths.StraightPath(speed_mps=1.25 * SPEED_MPS))
    assert steady_speed_mps(fast) == pytest.approx(1.25 * SPEED_MPS, rel=1e-9)
    for key in ("stride_frequency_hz", "step_frequency_hz", "gait_frequency_hz"):
        assert getattr(fast.facts, key) == pytest.approx(1.25 * getattr(walk.facts, key), rel=1e-9)
    later = np.array(fast.facts.footfalls["left_foot"]) * 1.25
    np.testing.assert_allclose(later, walk.facts.footfalls["left_foot"][: later.size], atol=1e-9)


@pytest.mark.parametrize("turn_deg", [300, -300])
def test_on_an_arc_the_body_stays_on_the_circle_beyond_its_own_sway(walk, turn_deg):
    radius_m, side = 2.0, math.copysign(1, turn_deg)
    straight = body_centre_m(follow(walk, paths.StraightPath()))
    followed = follow(walk, paths.ArcPath(radius_m=radius_m, turn_deg=turn_deg))
    t = followed.time_s
    frames = t.size
    ahead = straight[:frames, 0] - SPEED_MPS * t
    centre = body_centre_m(followed)[:, :2] - [0, side * radius_m]
    predicted = np.hypot(radius_m - side * straight[:frames, 1], ahead)
    np.testing.assert_allclose(ground(centre), predicted, atol=1e-6)
    assert t[-1] == pytest.approx(math.radians(300) * radius_m / SPEED_MPS, abs=1 / 250)
    # and it faces along the tangent: the line between the shoulders points to the centre
    across = (
        followed.positions.sel(marker="left_shoulder").values - followed.positions.sel(marker="right_shoulder").values
    )
    source = walk.positions.sel(marker="left_shoulder").values - walk.positions.sel(marker="right_shoulder").values
    heading = side * SPEED_MPS * t / radius_m
    turn = np.angle(np.exp(1j * (np.arctan2(across[:, 1], across[:, 0]) - heading)))
    np.testing.assert_allclose(turn, np.arctan2(source[:frames, 1], source[:frames, 0]), atol=1e-8)


def test_the_companion_on_the_outside_goes_further_in_the_same_time(walk):
    inner = follow(walk, paths.ArcPath(radius_m=2.0, turn_deg=180, side_m=0.5))
    outer = follow(walk, paths.ArcPath(radius_m=2.0, turn_deg=180, side_m=-0.5))
    assert inner.n_frames == outer.n_frames
    for motion, radius_m in ((inner, 1.5), (outer, 2.5)):
        centre = body_centre_m(motion) - [0, 2.0, 0]
        assert ground(centre).mean() == pytest.approx(radius_m, abs=5e-3)
        assert motion.report["path"]["length_m"] == pytest.approx(math.pi * radius_m, abs=0.01)
        # the stride length stays, hence the stride frequency follows the own speed
        scale = motion.facts.stride_frequency_hz / walk.facts.stride_frequency_hz
        assert scale == pytest.approx(radius_m / 2.0, rel=1e-9)


def test_a_polyline_passes_its_points_and_rounds_its_corners():
    v, r = 1.0, 0.5
    path = paths.PolylinePath(points_m=[(1, 1), (4, 1), (4, 5)], corner_radius_m=r)
    motion = follow(steady_point(v, 10.0), path)
    body = motion.position_m[:, 0, :2]
    np.testing.assert_allclose(body[0], [1, 1], atol=1e-9)
    length_m = 3 + 4 - 2 * r + r * math.pi / 2
    assert motion.time_s[-1] == pytest.approx(length_m / v, abs=1 / 250)
    distance = np.min(np.hypot(*(body - [4, 1]).T))
    assert distance == pytest.approx((math.sqrt(2) - 1) * r, abs=1e-5)  # nearest point of the corner's arc
    speeds = ground(np.gradient(body, axis=0)) * 250
    np.testing.assert_allclose(speeds[1:-1], v, atol=1e-4)


@pytest.mark.parametrize("path", PATHS, ids=NAMES)
def test_positions_and_velocities_are_continuous(walk, path):
    """Finer frames make velocity steps smaller in proportion: no step is left that is a jump."""
    steps = []
    for rate_hz in (250.0, 1000.0):
        motion = follow(boulic_walk(speed_mps=SPEED_MPS, duration_s=9.0, rate_hz=rate_hz), path)
        velocity = np.diff(motion.position_m, axis=0) * rate_hz
        steps.append(np.abs(np.diff(velocity, axis=0)).max())
    assert steps[1] < 0.3 * steps[0]
    source = np.abs(np.diff(walk.position_m, 2, axis=0)).max() * 250
    assert steps[0] < 1.5 * source  # at 250 Hz the walk itself has 0.18 m/s per frame


@pytest.mark.parametrize(("name", "height_m", "apart_m"), [("walk", 0.08, 0.03), ("trot", 0.05, 0.02)])
def test_at_a_stop_everything_is_still(request, name, height_m, apart_m):
    source = request.getfixturevalue(name)
    speed_mps = steady_speed_mps(source)
    motion = follow(source, paths.StopAndGoPath(stops=[{"at_m": 4.0, "pause_s": 2.0}]))
    stop_m = stop_of(motion)
    assert abs(stop_m - 4.0) <= speed_mps / source.facts.stride_frequency_hz / 4 + 1e-5
    rest_s = stop_m / speed_mps + math.pi * speed_mps / 4  # at 1 m/s2
    t = motion.time_s
    standing = (t > rest_s + 0.61) & (t < rest_s + 2.0 - 0.61)
    assert standing.sum() > 150
    assert np.abs(velocities(motion)[standing]).max() < 1e-9
    pose = motion.position_m[standing][0]
    for ends in ("foot",) if name == "walk" else ("hind_paw", "fore_paw"):
        feet = [n for n, part in enumerate(motion.parts) if part.endswith(ends)]
        assert np.ptp(pose[feet, 0]) < apart_m  # side by side
        assert pose[feet, 2].max() < height_m  # on or near the floor
    if name == "walk":
        settling = (t > rest_s) & (t < rest_s + 2.0)
        assert np.abs(velocities(motion)[settling]).max() < 1.1  # an ankle goes 0.4 m in 0.6 s on a half cosine
        assert np.ptp(body_centre_m(motion)[settling, 0]) < 0.02
    # phase follows distance: away from the stop the gait is the source's at another time
    reached = motion.report["path"]["length_m"] / speed_mps * 250
    low, part = int(reached), reached - int(reached)
    frames = follow(source, paths.StraightPath()).position_m[low : low + 2]
    np.testing.assert_allclose(motion.position_m[-1], (1 - part) * frames[0] + part * frames[1], atol=2e-4)


def test_a_stop_is_in_double_support(walk):
    """Independent of how it is found: a foot of the model stands from touchdown for the duty factor of a stride."""
    duty = compute_support_fraction(SPEED_MPS / (0.491 * 1.75))
    right = np.array(walk.facts.footfalls["right_foot"])
    for at_m in np.linspace(2.0, 3.4, 7):
        stop_m = stop_of(follow(walk, paths.StopAndGoPath(stops=[{"at_m": at_m, "pause_s": 0.2}])))
        phase = (stop_m / SPEED_MPS - right[0]) * walk.facts.stride_frequency_hz % 0.5
        assert 0 <= phase < duty - 0.5


@pytest.mark.parametrize("path", PATHS, ids=NAMES)
def test_touchdowns_are_when_their_phase_passes(walk, path):
    motion = follow(walk, path)
    report, end_s = motion.report["path"], float(motion.time_s[-1])
    layout = paths.lay_out(path)
    stops = tuple(paths.Stop(at, s.pause_s) for at, s in zip(report["stops_m"], layout.stops, strict=True))
    pace = paths.Pace(SPEED_MPS, math.pi * SPEED_MPS / (2 * layout.acceleration_mps2), stops)
    for foot, times in motion.facts.footfalls.items() if path.side_m == 0 else ():
        assert len(times) >= 3
        for when, phase_s in zip(times, walk.facts.footfalls[foot], strict=False):
            if 1e-9 < phase_s * SPEED_MPS < report["length_m"] - 1e-3:
                way_m = phase_s * SPEED_MPS
                root = brentq(lambda t, m=way_m: paths.distance_m(pace, np.array([t]))[0] - m, 0, end_s)
                assert when == pytest.approx(root, abs=1e-6)
    strides = report["length_m"] / SPEED_MPS * walk.facts.stride_frequency_hz
    assert motion.facts.stride_frequency_hz == pytest.approx(strides / (end_s - report["pause_s"]), rel=1e-9)
    assert motion.facts.gait == "walk"


@pytest.mark.parametrize("path", [PATHS[5], PATHS[6]], ids=["spot", "u"])
def test_turning_around_turns_the_sign_of_the_doppler_shift(walk, path):
    motion = follow(walk, path, start_position_m=(8.0, 0.0), heading_deg=180.0)
    t, centre = motion.time_s, body_centre_m(motion)
    velocity = -np.gradient(np.hypot(*centre[:, :2].T), t)
    one, last = t < 1.0, t > t[-1] - 1.0
    assert velocity[one].mean() == pytest.approx(SPEED_MPS, rel=0.05)
    assert velocity[last].mean() == pytest.approx(-SPEED_MPS, rel=0.05)
    # and it faces back
    across = motion.positions.sel(marker="left_shoulder").values - motion.positions.sel(marker="right_shoulder").values
    angle = np.unwrap(np.arctan2(across[:, 1], across[:, 0]))
    assert angle[last].mean() - angle[one].mean() == pytest.approx(math.pi, abs=0.05)
    offset_m = 2 * path.radius_m if path.radius_m else 0.0
    assert centre[last, 1].mean() == pytest.approx(-offset_m, abs=0.03)
    if not path.radius_m:
        assert motion.report["path"]["pause_s"] == pytest.approx(3.7)  # and 0.6 s before and after the turn
        rest_s = stop_of(motion) / SPEED_MPS + math.pi * SPEED_MPS / 4
        turning = (t > rest_s + 0.6) & (t < rest_s + 3.1)
        assert ground(centre[turning, :2] - [8.0 - stop_of(motion), 0]).max() < 0.05
        assert np.ptp(angle[turning]) == pytest.approx(math.pi, abs=1e-3)
        assert np.all(np.diff(angle[turning]) > -1e-9)


ROOM = {"kind": "wander", "room_m": [0, 6, -2, 2], "leg_m": [1.0, 3.0]}


def way_of(path, n=4000):
    layout = paths.lay_out(paths.make_path(path))
    curve = paths.join(layout.elements, start_m=layout.start_m, heading_rad=layout.heading_rad)
    return paths.find_points(curve, np.linspace(0.0, curve.length_m, n)), curve.length_m / (n - 1)


@pytest.mark.parametrize("way", [0.0, 0.3, 0.7, 1.0])
def test_a_walk_about_stays_in_its_room_and_turns_without_jumps(way):
    points, step_m = way_of(ROOM | {"way": way})
    low, high = np.array(ROOM["room_m"]).reshape(2, 2).T
    assert (points >= low - 1e-6).all()
    assert (points <= high + 1e-6).all()
    assert np.ptp(points, axis=0).min() > 2.0  # and goes everywhere
    steps = np.hypot(*np.diff(points, axis=0).T)
    assert steps.max() <= step_m * (1 + 1e-9)  # a chord is shorter than its arc
    assert steps.min() > 0.9 * step_m


def test_a_walk_about_is_as_long_as_it_should_starts_at_its_door_and_goes_by_its_way(walk):
    paths_m = [paths.lay_out(paths.make_path(ROOM | {"length_m": 60.0, "way": way})) for way in np.linspace(0, 1, 25)]
    lengths_m = [sum(element.length_m for element in layout.elements) for layout in paths_m]
    assert 60.0 <= min(lengths_m) < max(lengths_m) < 90.0
    with pytest.raises(MotionError, match="path kind 'wander'"):
        follow(walk, paths.make_path(ROOM | {"length_m": 3.0}), duration_s=8.0)
    same, again, other = (way_of(ROOM | {"way": way, "door_m": [7.5, 0.5]})[0] for way in (0.2, 0.2, 0.3))
    np.testing.assert_array_equal(same, again)
    assert np.stack([same[0], other[0]]) == pytest.approx(np.array([[7.5, 0.5]] * 2))
    assert np.abs(same - other).max() > 1.0


def test_a_walk_about_rests_where_the_motion_gets_to(walk):
    table = ROOM | {"rest_share": 1.0, "rest_s": [1.0, 1.5], "way": 0.4}
    rests_m = [stop.at_m for stop in paths.lay_out(paths.make_path(table)).stops]
    assert min(np.diff([0.0, *rests_m])) >= paths.REST_APART_M
    resting = follow(walk, paths.make_path(table), duration_s=8.0)
    assert resting.report["path"]["stops_m"] == pytest.approx([rests_m[0]], abs=0.4)  # at double support
    speeds = np.hypot(*np.gradient(body_centre_m(resting)[:, :2], axis=0).T) * resting.rate_hz
    assert (speeds < 0.02).mean() == pytest.approx(1.25 / 8.0, abs=0.06)
    moving = follow(
        walk, paths.make_path(table | {"room_m": [0, 9, -9, 9], "leg_m": [3.9, 4.0]}), duration_s=2.0
    )  # no rest within reach
    assert moving.duration_s == pytest.approx(2.0)


def test_a_polyline_with_a_stop_lasts_longer(walk):
    table = {"kind": "polyline", "points_m": [[0, 0], [3, 0], [3, 2]]}
    through = follow(walk, paths.make_path(table))
    table |= {"stops": [{"at_m": 1.5, "pause_s": 1.0}], "acceleration_mps2": 2.0}
    stopping = follow(walk, paths.make_path(table))
    assert stopping.duration_s - through.duration_s == pytest.approx(1.0 + math.pi * SPEED_MPS / 4.0, abs=0.02)
    assert body_centre_m(stopping)[-1] == pytest.approx(body_centre_m(through)[-1], abs=0.1)

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from doppelgait.motion.models import boulic_walk, human, human_body, human_gait
from doppelgait.motion.models.curves import walk_duty
from doppelgait.motion.models.strides import step_series
from walking_body import BONES

INDEX = {name: n for n, name in enumerate(human_body.POINTS)}
WALKS = (0.3, 0.8, 1.4, 2.0, 2.57)
RUNS = (1.9, 2.5, 3.0, 4.0, 5.0, 7.0, 9.0)


def gait(speed_mps, duration_s=4.0, **options):
    kind = "run" if speed_mps in RUNS else "walk"
    return human_gait(gait=kind, speed_mps=speed_mps, duration_s=duration_s, **options)


def duty(motion, speed_mps):
    """Share of a stride at rest on the ground, from the laws of the two gaits."""
    if motion.facts.gait == "run":
        return human.RUN.rest * human.interpolate_run(human.RUN.duty, speed_mps)
    return walk_duty(speed_mps / np.sqrt(9.81 * 0.491 * 1.75))


def points(motion, *names):
    return motion.position_m[:, [INDEX[name] for name in names]]


def foot_points(motion, side):
    """Heel, ankle and tip of a foot, (n, 3) each, and the pitch of its sole; heel and tip on its sole."""
    ankle, toe = np.moveaxis(points(motion, f"{side}_ankle", f"{side}_toe"), 1, 0)
    pitch = np.arctan2(toe[:, 2] - ankle[:, 2], toe[:, 0] - ankle[:, 0]) + human.STANDING_RAD
    foot_m = human.FOOT.length * motion.facts.height_m
    x = -human.FOOT.heel * foot_m * np.cos(pitch) + human.ANKLE * foot_m * np.sin(pitch)
    z = -human.FOOT.heel * foot_m * np.sin(pitch) - human.ANKLE * foot_m * np.cos(pitch)
    tip = toe - [0, 0, human.TIP * foot_m]
    return ankle + np.stack([x, 0 * x, z], axis=1), ankle, tip, pitch


def stance_speed_mps(motion, speed_mps):
    """Speed of what is on the floor: the heel while the sole comes down, then the ankle, then the tip."""
    landings, share = motion.facts.footfalls, duty(motion, speed_mps)
    stride_s, time = 1 / motion.facts.stride_frequency_hz, motion.time_s
    speeds = []
    for side in ("left", "right"):
        heel, ankle, tip, pitch = foot_points(motion, side)
        for landed in landings[f"{side}_foot"]:
            stance = (time - landed) / stride_s
            for point, on_floor in ((heel, pitch > 1e-9), (ankle, np.abs(pitch) < 1e-12), (tip, pitch < -1e-9)):
                still = (stance > 0.01) & (stance < share - 0.01) & on_floor
                still &= np.roll(still, 1) & np.roll(still, -1)
                still[[0, -1]] = False
                speeds.append(np.linalg.norm(np.gradient(point, time, axis=0)[still], axis=1))
    return np.concatenate(speeds)


@pytest.mark.parametrize(("speed_mps", "height_m"), [(1.2, 1.75), (0.3, 1.2), (0.41, 1.7), (2.4, 1.9)])
def test_with_all_options_off_it_is_the_boulic_walk_bit_for_bit(speed_mps, height_m):
    options = {"speed_mps": speed_mps, "height_m": height_m, "start_phase": 0.3, "rate_hz": 200}
    ours, boulic = human_gait(gait="walk", foot_lock=False, **options), boulic_walk(**options)
    np.testing.assert_array_equal(ours.position_m, boulic.position_m)
    assert replace(ours.facts, source="boulic", kind="boulic") == boulic.facts
    assert (ours.rate_hz, ours.report) == (boulic.rate_hz, boulic.report)


def check_lengths(motion):
    for a, b, bone in BONES:
        length_m = np.linalg.norm(np.diff(points(motion, a, b), axis=1), axis=2)
        share = human.FOOT.length if bone == "foot" else human_body.LENGTHS[bone]
        np.testing.assert_allclose(length_m, 1.75 * share, rtol=0, atol=1e-9, err_msg=f"{a} {b}")


@pytest.mark.parametrize("speed_mps", WALKS + RUNS)
def test_standing_feet_are_still_segments_keep_their_lengths_and_nothing_is_below_the_floor(speed_mps):
    motion = gait(speed_mps, rate_hz=1000)
    check_lengths(motion)
    assert motion.position_m[:, :, 2].min() > -1e-12
    assert stance_speed_mps(motion, speed_mps).max() < 1e-9
    if motion.facts.gait == "walk":
        sliding = gait(speed_mps, rate_hz=1000, foot_lock=False)
        assert stance_speed_mps(sliding, speed_mps).max() > 0.3, "Boulic's own feet slide"


@pytest.mark.parametrize("speed_mps", WALKS + RUNS)
def test_velocity_is_continuous(speed_mps):
    # A jump in velocity keeps its size as frames get closer; a smooth motion's steps shrink in proportion.
    steps = [
        np.abs(np.diff(gait(speed_mps, 1.5, rate_hz=rate).position_m, n=2, axis=0)).max() * rate
        for rate in (1000, 8000)
    ]
    assert steps[1] < 0.2 * steps[0]


@pytest.mark.parametrize("speed_mps", WALKS + RUNS)
def test_it_goes_at_its_speed_and_left_is_right_half_a_stride_later(speed_mps):
    stride_s = 1 / gait(speed_mps).facts.stride_frequency_hz
    motion = gait(speed_mps, 2 * stride_s, rate_hz=400 / stride_s)
    way = motion.position_m[400] - motion.position_m[0]
    np.testing.assert_allclose(way, np.tile([speed_mps * stride_s, 0, 0], (17, 1)), atol=1e-9)
    opposite = [
        name.replace("left", "tmp").replace("right", "left").replace("tmp", "right") for name in human_body.POINTS
    ]
    half = [speed_mps * stride_s / 2, 0, 0]
    np.testing.assert_allclose(motion.position_m[200], points(motion, *opposite)[0] * [1, -1, 1] + half, atol=1e-9)


@pytest.mark.parametrize("speed_mps", [1.4, 3.0])
def test_footfalls_are_when_the_foot_begins_to_stand(speed_mps):
    motion = gait(speed_mps, start_phase=0.2, rate_hz=2000)
    for side in ("left", "right"):
        still = np.zeros(motion.time_s.size, dtype=bool)
        for point in foot_points(motion, side)[:3]:
            still |= np.linalg.norm(np.gradient(point, motion.time_s, axis=0), axis=1) < 1e-6
        begins = motion.time_s[1:][still[1:] & ~still[:-1]]
        expected = [t for t in motion.facts.footfalls[f"{side}_foot"] if 0.01 < t < 3.99]
        assert len(expected) > 2
        for landed in expected:
            assert np.abs(begins - landed).min() < 0.002


@pytest.mark.parametrize(
    ("speed_mps", "steps_hz", "share"), [(2.5, 2.525, 0.381), (3, 2.65, 0.35), (4, 2.78, 0.30), (5, 2.92, 0.30)]
)
def test_a_run_has_the_usual_timing_and_flight(speed_mps, steps_hz, share):
    motion = gait(speed_mps, rate_hz=1000)
    assert motion.facts.step_frequency_hz == pytest.approx(steps_hz, rel=1e-9)
    soles = [point[:, 2] for side in ("left", "right") for point in foot_points(motion, side)[::2]]
    flight = np.min(soles, axis=0) > 1e-9
    assert flight.mean() == pytest.approx(1 - 2 * human.RUN.rest * share, abs=0.03)
    assert 0.05 < flight.mean() / steps_hz < 0.17, "flight of 0.05 to 0.14 s, and the end of a contact"
    rise_m = np.ptp(points(motion, "base")[:, 0, 2])
    assert 0.06 < rise_m < 0.11, "6 to 11 cm"
    walk = human_gait(gait="walk", speed_mps=2.5, rate_hz=1000)
    soles = [point[:, 2] for side in ("left", "right") for point in foot_points(walk, side)[::2]]
    assert np.min(soles, axis=0).max() < 1e-9


def test_the_height_of_a_run_solves_its_equation_of_motion():
    stride_s, share, g = 0.7, 0.33, 9.81
    contact_s, step_s = share * stride_s, stride_s / 2

    def force(t, y):
        push = np.pi * g * step_s / (2 * contact_s) * np.sin(np.pi * t / contact_s) * (t < contact_s)
        return np.stack([y[1], push - g])

    t = np.unique(np.append(np.linspace(0, step_s, 2001), contact_s))
    ends = lambda a, b: np.array([a[0], b[0]])  # noqa: E731
    solved = solve_bvp(force, ends, t, np.zeros((2, t.size)), tol=1e-8)
    expected = human.run_height_m(t[:-1] / stride_s, stride_s, share)
    np.testing.assert_allclose(expected, solved.sol(t[:-1])[0], atol=2e-6)
    assert solved.sol(0)[1] == pytest.approx(float(solved.sol(step_s)[1]), abs=1e-5), "the next step goes on from there"


def test_knees_elbows_and_lean_of_a_runner():
    for speed_mps, knee_deg, by_deg in ((3.0, 90, 15), (9.0, 125, 25)):  # feet are measured up to 3.5 m/s
        motion = gait(speed_mps)
        hip, knee, ankle = np.moveaxis(points(motion, "right_hip", "right_knee", "right_ankle"), 1, 0)
        assert angle_deg(hip - knee, ankle - knee).min() == pytest.approx(180 - knee_deg, abs=by_deg)
        shoulder, elbow, hand = np.moveaxis(points(motion, "left_shoulder", "left_elbow", "left_hand"), 1, 0)
        flexion = 180 - angle_deg(shoulder - elbow, hand - elbow)
        assert 60 < flexion.min() < flexion.max() < 160
        trunk = np.diff(points(motion, "base", "neck"), axis=1)[:, 0]
        lean = np.degrees(np.arctan2(trunk[:, 0], trunk[:, 2])).mean()
        assert 4.9 < lean < 10.1


def angle_deg(a, b):
    return np.degrees(np.arccos((a * b).sum(axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)))


def test_auto_runs_above_two_metres_per_second_and_smaller_people_sooner():
    for height_m, border in ((1.75, 2.0), (1.2, 2.0 * np.sqrt(1.2 / 1.75))):
        for factor, expected in ((0.99, "walk"), (1.01, "run")):
            motion = human_gait(speed_mps=factor * border, height_m=height_m, duration_s=0.5)
            assert motion.facts.gait == expected


def series(duration_s, stride_s, stride_m, rng=None, **asked):
    """Touchdowns of a single walker."""
    names = ("step_time_sd", "step_length_sd", "pace_sd", "time_asymmetry", "start_phase")
    columns = SimpleNamespace(**{name: np.array([[asked.get(name, 0.0)]]) for name in names})
    made = step_series(np.array([[duration_s]]), columns, np.array([[stride_s]]), np.array([[stride_m]]), [rng])
    return [rows[0] for rows in made[:3]]


def test_steps_on_the_floor_differ_as_asked():
    uneven = {"step_length_sd": 0.03, "length_asymmetry": 0.1, "step_time_sd": 0.02, "time_asymmetry": 0.05}
    motion = human_gait(speed_mps=1.3, duration_s=200, rate_hz=100, rng=np.random.default_rng(8), **uneven)
    landed = {}
    for side in ("left", "right"):
        for t in motion.facts.footfalls[f"{side}_foot"]:
            frame = int(t * 100 + 0.5) + 15  # 0.15 s later the sole is flat
            if frame < motion.positions.shape[0]:
                landed[t] = (side, motion.position_m[frame, INDEX[f"{side}_ankle"], 0])
    places = [landed[t] for t in sorted(landed)]
    lengths_m, left = np.diff([place for _, place in places]), np.array([side == "left" for side, _ in places[1:]])
    for steps, sd, asymmetry in ((lengths_m, 0.03, 0.1), (np.diff(sorted(landed)), 0.02, 0.05)):
        first, second = steps[left], steps[~left]
        mean = (first.mean() + second.mean()) / 2
        assert (first.mean() - second.mean()) / mean == pytest.approx(asymmetry, abs=0.012)
        assert np.concatenate([first - first.mean(), second - second.mean()]).std() / mean == pytest.approx(
            sd, rel=0.15
        )
    assert lengths_m.mean() * motion.facts.step_frequency_hz == pytest.approx(1.3, rel=0.01)


def test_the_pace_drifts_mostly_in_the_length_of_steps():
    asked = {"stride_s": 1.0, "stride_m": 1.4, "pace_sd": 0.04, "rng": np.random.default_rng(4)}
    times, _, way = series(20_000, **asked)
    time, length = np.diff(times) / 0.5 - 1, np.diff(way) / 0.7 - 1
    np.testing.assert_allclose(time, -length * 0.15 / 0.85, atol=1e-6)
    speed = (length - time)[: time.size // 2 * 2].reshape(-1, 2).mean(axis=1)
    assert speed.std() == pytest.approx(0.04, rel=0.04)
    assert np.corrcoef(speed[1:], speed[:-1])[0, 1] == pytest.approx(0.56, abs=0.03)


def test_one_side_of_trunk_and_arms_moves_more():
    still = {"speed_mps": 1.3, "duration_s": 12 / human_gait(speed_mps=1.3).facts.stride_frequency_hz / 2}
    motion = human_gait(**still, trunk_asymmetry=0.8, arm_asymmetry=0.4)
    phase = motion.time_s * motion.facts.stride_frequency_hz
    speed = np.gradient(points(motion, "base")[:, 0, 0], motion.time_s) / 1.3 - 1
    first, second = (np.abs(np.exp(-2j * np.pi * k * phase) @ speed) / speed.size * 2 for k in (1, 2))
    assert first / second == pytest.approx(0.8 / 4, rel=0.02)
    arms = [np.diff(points(motion, f"{side}_shoulder", f"{side}_elbow"), axis=1) for side in ("left", "right")]
    swings = [np.ptp(arm[:, 0, 0]) for arm in arms]
    assert swings[0] / swings[1] == pytest.approx(1.2 / 0.8, rel=0.02)


def test_standing_feet_stay_still_when_steps_differ():
    motion = human_gait(
        speed_mps=1.3, duration_s=8, step_time_sd=0.04, step_length_sd=0.04, time_asymmetry=0.1, length_asymmetry=0.1,
        rate_hz=1000, rng=np.random.default_rng(1),
    )  # fmt: skip
    for side in ("left", "right"):
        for t in [t for t in motion.facts.footfalls[f"{side}_foot"] if t < 7]:
            flat = points(
                replace(motion, positions=motion.positions.sel(time=slice(t + 0.2, t + 0.27))), f"{side}_ankle"
            )[:, 0]
            assert np.ptp(flat, axis=0).max() < 1e-9
    check_lengths(motion)


def test_arms_swing_less_or_more_and_hands_are_held():
    def angles(side, **options):
        """Flexion of the elbow, and angle of the upper arm in the trunk's own frame."""
        motion = human_gait(speed_mps=1.3, duration_s=3, **options)
        names = (f"{side}_shoulder", f"{side}_elbow", f"{side}_hand", "base", "neck")
        shoulder, elbow, hand, base, neck = np.moveaxis(points(motion, *names), 1, 0)
        return 180 - angle_deg(shoulder - elbow, hand - elbow), angle_deg(elbow - shoulder, base - neck)

    own, _ = angles("left")
    for factor in (0.0, 0.5, 1.5):
        flexion, _ = angles("left", arm_swing=factor)
        assert np.ptp(flexion) == pytest.approx(factor * np.ptp(own), abs=1e-4)
    _, upper_arm = angles("left", arm_swing=0.0)
    assert np.ptp(upper_arm) < 1e-4
    for hand, flexion_deg, share in (("carrying", 90, 0.1), ("pockets", 45, 0.15)):
        flexion, _ = angles("right", right_hand=hand)
        assert flexion.mean() == pytest.approx(flexion_deg, abs=0.5)
        assert np.ptp(flexion) == pytest.approx(share * np.ptp(own), rel=1e-3)
        np.testing.assert_allclose(angles("left", right_hand=hand)[0], own, atol=1e-6)


def test_a_child_walks_as_an_adult_at_the_same_froude_number():
    child = human_body.find_segment_lengths("child", 1.0)
    leg_m, adult_m = child["thigh"] + child["shank"], 0.491 * 1.75
    walk = human_gait(speed_mps=1.3 * np.sqrt(leg_m / adult_m), height_m=1.0, body="child")
    ratio = walk.facts.step_frequency_hz / human_gait(speed_mps=1.3).facts.step_frequency_hz
    assert ratio == pytest.approx(np.sqrt(adult_m / leg_m), rel=1e-6)
    thigh = np.diff(points(walk, "left_hip", "left_knee"), axis=1)
    np.testing.assert_allclose(np.linalg.norm(thigh, axis=2), child["thigh"], atol=1e-9)
    assert sum(child[part] for part in ("head", "torso", "thigh", "shank")) == pytest.approx(0.909)
    assert human_body.find_segment_lengths("child", 1.6) == pytest.approx(human_body.LENGTHS)
    assert human_body.find_segment_lengths("child", 0.9)["head"] > 1.3 * human_body.LENGTHS["head"]

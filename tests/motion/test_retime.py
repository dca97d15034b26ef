"""Scaling, placing, resampling (E-01, E-02) and variation of motions."""

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import ConfigError, MotionError
from doppelgait.motion import make_motion, retime


def motion_of(position, rate_hz=120.0, parts=("torso",), start_s=0.0, **facts):
    names = [f"m{n}" for n in range(np.shape(position)[1])]
    return make_motion(position, rate_hz=rate_hz, markers=names, parts=parts, start_s=start_s, facts=facts)


def swing(rate_hz=120.0, seconds=3.0):
    t = np.arange(0, seconds, 1 / rate_hz)
    x = 0.3 * np.sin(2 * np.pi * 2.0 * t)
    return motion_of(np.stack([x, 0 * t, 1 + 0 * t], axis=-1)[:, None], rate_hz)


def test_heights_only_scale_to_the_highest_point_where_no_stature_is_known():
    position = np.zeros((40, 2, 3))
    position[:, 0, 0] = np.linspace(0.0, 1.0, 40)
    position[:, 1, 2] = np.linspace(0.6, 0.8, 40)
    motion = motion_of(position, parts=("torso", "left_foot"))
    scaled = retime.scale_to_height(motion, height_m=0.2, mode="z_only")
    assert scaled.position_m[..., 2].max() == pytest.approx(0.2)
    assert np.array_equal(scaled.position_m[..., 0], position[..., 0])
    with pytest.raises(MotionError, match="height is unknown"):
        retime.scale_to_height(motion, height_m=0.2)


def test_velocity_of_a_swinging_marker_after_resampling_e02():
    wanted_s = np.arange(0, 2.9, 1e-3)
    position, velocity = retime.resample(swing(), wanted_s)
    inner = slice(200, -200)
    peak = 0.3 * 4 * np.pi
    error = velocity[inner, 0, 0] - peak * np.cos(4 * np.pi * wanted_s[inner])
    assert np.abs(error).max() < 0.005 * peak
    assert np.abs(position[inner, 0, 0] - 0.3 * np.sin(4 * np.pi * wanted_s[inner])).max() < 1e-4


def test_resampling_starts_at_the_first_frame_whatever_its_time():
    t = np.arange(0, 1, 0.01)
    late = motion_of(np.stack([t, 0 * t, 0 * t], axis=-1)[:, None], 100.0, start_s=7.0)
    position, velocity = retime.resample(late, [0.0, 0.5])
    np.testing.assert_allclose(position[:, 0, 0], [0, 0.5], atol=1e-12)
    np.testing.assert_allclose(velocity[:, 0, 0], 1.0)


def test_body_centre_is_that_of_the_torso_or_of_all_points():
    position = np.zeros((5, 3, 3))
    position[:, 0], position[:, 1], position[:, 2] = [1, 0, 1], [3, 0, 1], [8, 0, 4]
    torso = motion_of(position, parts=("torso", "torso", "left_hand"))
    np.testing.assert_allclose(retime.body_centre_m(torso), np.tile([2, 0, 1], (5, 1)))
    unknown = motion_of(position, parts=("", "", "left_hand"))
    np.testing.assert_allclose(retime.body_centre_m(unknown), np.tile([4, 0, 2], (5, 1)))


def test_travel_of_a_walk_and_of_a_body_in_place():
    t = np.arange(0, 2.0001, 0.01)
    way = t + 0.5 * t**2
    walk = motion_of(np.stack([0.6 * way, -0.8 * way, 1 + 0 * t], axis=-1)[:, None], 100.0)
    assert retime.travel_speed_mps(walk) == pytest.approx(2.0)
    assert retime.travel_speed_mps(walk, first_s=1.0) == pytest.approx(1.5)
    assert retime.travel_heading_rad(walk) == pytest.approx(np.arctan2(-0.8, 0.6))
    assert walk.duration_s == pytest.approx(2.0)
    assert retime.travel_heading_rad(swing()) == 0.0


@pytest.mark.parametrize("mode", ["uniform", "froude"])
def test_scaling_is_about_the_floor_below_the_start_e01(mode):
    t = np.arange(0, 1, 0.01)
    position = np.stack([5 + t, -2 + 0 * t, 1.2 + 0 * t], axis=-1)[:, None]
    motion = motion_of(position, 100.0, height_m=1.8, mass_kg=80.0)
    scaled = retime.scale_to_height(motion, height_m=0.9, mode=mode)
    np.testing.assert_allclose(scaled.position_m[0, 0], [5, -2, 0.6])
    np.testing.assert_allclose(scaled.position_m[-1, 0], [5 + 0.99 / 2, -2, 0.6])
    assert scaled.facts.mass_kg == pytest.approx(10.0)
    np.testing.assert_array_equal(motion.position_m, position)


def test_dynamically_similar_scaling_slows_time_and_footfalls_e01():
    t = np.arange(0, 1, 0.01)
    position = np.stack([t, 0 * t, 1 + 0 * t], axis=-1)[:, None]
    facts = {"height_m": 1.0, "step_frequency_hz": 2.0, "footfalls": {"left_foot": [3.2, 3.7]}}
    motion = motion_of(position, 100.0, start_s=3.0, **facts)
    scaled = retime.scale_to_height(motion, height_m=0.25, mode="froude")
    times = scaled.time_s
    assert times[0] == 3.0
    assert times[-1] == pytest.approx(3 + 0.99 / 2)
    assert scaled.positions.coords["time"].attrs["units"] == "s"
    assert scaled.facts.step_frequency_hz == 4.0
    assert scaled.rate_hz == 200.0
    np.testing.assert_allclose(scaled.facts.footfalls["left_foot"], [3.1, 3.35])
    assert retime.travel_speed_mps(scaled) == pytest.approx(0.5)


@pytest.mark.parametrize("gap", [slice(1, 4), slice(-3, -1)])
def test_a_gap_elsewhere_does_not_spread_to_the_whole_motion(gap):
    motion = swing()
    motion.position_m[gap] = np.nan
    scaled = retime.scale_to_height(motion, height_m=1.5, recorded_height_m=0.5)
    placed = retime.place(motion, position_m=(2.0, 0.0), heading_deg=30.0, at_s=0.0)
    np.testing.assert_allclose(scaled.position_m, 3.0 * motion.position_m)
    np.testing.assert_array_equal(np.isnan(placed.position_m), np.isnan(motion.position_m))


@pytest.mark.parametrize("at_s", [0.0, 0.5, 1.0 / 120, 1.234, 359 / 120, 99.0])
@pytest.mark.parametrize("frames", [1, 360])
def test_the_body_is_placed_by_interpolating_its_centre(at_s, frames):
    motion = swing().frames(0, frames)
    placed = retime.place(motion, position_m=(2.0, -1.0), heading_deg=0.0, at_s=at_s)
    times, centre = placed.time_s, retime.body_centre_m(placed)
    at = [np.interp(at_s, times, centre[:, axis]) for axis in (0, 1)]
    np.testing.assert_allclose(at, [2.0, -1.0], atol=1e-12)


@pytest.fixture(scope="module")
def walk():
    return dg.motion.human_gait(speed_mps=1.3, duration_s=8.0)


@pytest.fixture(scope="module")
def trot():
    return dg.motion.quadruped_gait(gait="trot", speed_mps=1.8, duration_s=8.0)


def varied(motion, seed=0, **amounts):
    return retime.vary(motion, retime.Variation(**amounts), np.random.default_rng(seed))


def about_trunk(motion, marker):
    """A point's place along the way, from the body centre's."""
    return motion.position_m[:, motion.markers.index(marker), 0] - retime.body_centre_m(motion)[:, 0]


def strongest_hz(values, rate_hz):
    spectrum = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size), 2**16))
    return np.argmax(spectrum) * rate_hz / 2**16


@pytest.mark.parametrize("name", ["walk", "trot"])
def test_no_amount_changes_nothing(name, request):
    motion = request.getfixturevalue(name)
    same = varied(motion)
    later_s = np.arange(same.n_frames) / motion.rate_hz + retime.TURN_MARGIN / motion.facts.stride_frequency_hz
    assert np.allclose(same.position_m, retime.resample(motion, later_s)[0], atol=1e-12)
    assert same.facts.stride_frequency_hz == motion.facts.stride_frequency_hz


@pytest.mark.parametrize("pace", [0.8, 1.25])
def test_pace_changes_the_rhythm_and_neither_speed_nor_the_standing_of_feet(walk, pace):
    found = varied(walk, pace=pace)
    assert retime.travel_speed_mps(found) == pytest.approx(retime.travel_speed_mps(walk), rel=0.01)
    new_hz = walk.facts.stride_frequency_hz * pace
    assert found.facts.stride_frequency_hz == pytest.approx(new_hz)
    assert strongest_hz(about_trunk(found, "left_ankle"), found.rate_hz) == pytest.approx(new_hz, rel=0.03)
    span = [np.ptp(about_trunk(motion, "left_ankle")) for motion in (walk, found)]
    assert span[1] == pytest.approx(span[0] / pace, rel=0.03)
    # a foot that stands goes backwards under the body as fast as the body goes on
    speeds = np.gradient(found.position_m[:, found.markers.index("left_ankle"), 0], 1.0 / found.rate_hz)
    assert np.quantile(np.abs(speeds), 0.1) < 0.1


def test_touchdowns_are_those_of_the_new_clock(walk):
    found = varied(walk, pace=1.2, phase_noise=0.03, swing_timing=0.05)
    heel, again = (m.position_m[:, m.markers.index("left_ankle"), 2] for m in (walk, found))
    falls, found_falls = (np.asarray(m.facts.footfalls["left_foot"]) for m in (walk, found))
    height = np.interp(falls, walk.time_s, heel)
    found_height = np.interp(found_falls, found.time_s, again)
    assert found_falls.size >= 5
    assert found_height == pytest.approx(height[1], abs=0.01)
    assert np.mean(np.diff(found_falls)) == pytest.approx(1.0 / found.facts.stride_frequency_hz, rel=0.03)


@pytest.mark.parametrize(
    ("amount", "marker", "factor"),
    [({"limb_swing": 1.5}, "left_ankle", 1.5), ({"arm_swing": 0.4}, "left_hand", 0.4),
     ({"limb_swing": 0.6}, "left_hand", 1)],
)  # fmt: skip
def test_swing_has_the_wanted_factor(walk, amount, marker, factor):
    plain, found = about_trunk(varied(walk), marker), about_trunk(varied(walk, **amount), marker)
    assert np.ptp(found) == pytest.approx(factor * np.ptp(plain), rel=0.02)


def test_ripple_and_turns_have_the_wanted_size(trot):
    plain = retime.body_centre_m(varied(trot))
    for name, times in (("ripple_once_m", 1), ("ripple_twice_m", 2)):
        added = retime.body_centre_m(varied(trot, **{name: 0.01})) - plain
        assert np.sqrt((added**2).sum(axis=1)).max() == pytest.approx(0.01, rel=0.02)
        axis = np.argmax(np.ptp(added, axis=0))
        assert strongest_hz(added[:, axis], trot.rate_hz) == pytest.approx(
            times * trot.facts.stride_frequency_hz, rel=0.03
        )
    nose = trot.markers.index("head")
    turned = varied(trot, yaw_deg=6.0).position_m[:, nose] - retime.body_centre_m(varied(trot, yaw_deg=6.0))
    even = varied(trot).position_m[:, nose] - plain
    angles = np.degrees(np.arctan2(turned[:, 1], turned[:, 0]) - np.arctan2(even[:, 1], even[:, 0]))
    assert np.abs(angles).max() == pytest.approx(6.0, rel=0.05)


def test_limbs_in_front_come_later(trot):
    marker = next(m for m, part in zip(trot.markers, trot.parts, strict=True) if part == "left_fore_paw")
    plain, found = about_trunk(varied(trot), marker), about_trunk(varied(trot, fore_timing=0.1), marker)
    lag = round(0.1 / trot.facts.stride_frequency_hz * trot.rate_hz)
    assert np.corrcoef(plain[lag:], found[:-lag])[0, 1] > 0.999


def test_speed_stays_for_all_amounts_at_once(trot):
    amounts = {"limb_swing": 1.4, "trunk_ripple": 2.4, "pitch_deg": 6, "phase_noise": 0.05, "swing_timing": -0.12}
    found = varied(trot, pace=0.8, fore_timing=-0.08, ripple_once_m=0.015, **amounts)
    assert retime.travel_speed_mps(found) == pytest.approx(1.8, rel=0.03)
    assert np.abs(np.diff(found.position_m, axis=0)).max() * found.rate_hz < 20


def test_a_scene_varies_by_its_seed_alone():
    target = dg.Target({"kind": "boulic"}, label="human", vary={"pace": 1.2, "phase_noise": 0.03})
    scene, radar = dg.Scene([target], duration_s=2.0), dg.Radar.preset("x4")
    once, again, other = (dg.simulate(scene, radar, rng=dg.rng(seed), snr_db=np.inf) for seed in (1, 1, 2))
    assert once.baseband.values.tobytes() == again.baseband.values.tobytes()
    assert once.baseband.values.tobytes() != other.baseband.values.tobytes()
    plain = dg.simulate(scene.model_copy(update={"targets": (target.model_copy(update={"vary": None}),)}), radar)
    ratio = once.truth[0].stride_frequency_hz / plain.truth[0].stride_frequency_hz
    assert ratio == pytest.approx(1.2, rel=0.06)  # of the strides that fall into the observation
    with pytest.raises(ConfigError, match=r"targets.0.vary draws random numbers: pass rng"):
        dg.simulate(scene, radar)

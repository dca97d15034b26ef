"""Varied motions against what each amount stands for."""

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import ConfigError, MotionError
from doppelgait.motion.retime import TURN_MARGIN, Variation, body_centre_m, resample, travel_speed_mps, vary


@pytest.fixture(scope="module")
def walk():
    return dg.motion.human_gait(speed_mps=1.3, duration_s=8.0)


@pytest.fixture(scope="module")
def trot():
    return dg.motion.quadruped_gait(gait="trot", speed_mps=1.8, duration_s=8.0)


def varied(motion, seed=0, **amounts):
    return vary(motion, Variation(**amounts), np.random.default_rng(seed))


def about_trunk(motion, marker):
    """A point's place along the way, from the body centre's."""
    return motion.position_m[:, motion.markers.index(marker), 0] - body_centre_m(motion)[:, 0]


def strongest_hz(values, rate_hz):
    spectrum = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size), 2**16))
    return np.argmax(spectrum) * rate_hz / 2**16


@pytest.mark.parametrize("name", ["walk", "trot"])
def test_no_amount_changes_nothing(name, request):
    motion = request.getfixturevalue(name)
    same = varied(motion)
    later_s = np.arange(same.n_frames) / motion.rate_hz + TURN_MARGIN / motion.facts.stride_frequency_hz
    assert np.allclose(same.position_m, resample(motion, later_s)[0], atol=1e-12)
    assert same.facts.stride_frequency_hz == motion.facts.stride_frequency_hz


@pytest.mark.parametrize("pace", [0.8, 1.25])
def test_pace_changes_the_rhythm_and_neither_speed_nor_the_standing_of_feet(walk, pace):
    found = varied(walk, pace=pace)
    assert travel_speed_mps(found) == pytest.approx(travel_speed_mps(walk), rel=0.01)
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
    plain = body_centre_m(varied(trot))
    for name, times in (("ripple_once_m", 1), ("ripple_twice_m", 2)):
        added = body_centre_m(varied(trot, **{name: 0.01})) - plain
        assert np.sqrt((added**2).sum(axis=1)).max() == pytest.approx(0.01, rel=0.02)
        axis = np.argmax(np.ptp(added, axis=0))
        assert strongest_hz(added[:, axis], trot.rate_hz) == pytest.approx(
            times * trot.facts.stride_frequency_hz, rel=0.03
        )
    nose = trot.markers.index("head")
    turned = varied(trot, yaw_deg=6.0).position_m[:, nose] - body_centre_m(varied(trot, yaw_deg=6.0))
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
    assert travel_speed_mps(found) == pytest.approx(1.8, rel=0.03)
    assert np.isfinite(found.position_m).all()
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


def test_what_cannot_be_varied_is_refused(walk):
    with pytest.raises(MotionError, match="stride frequency is unknown"):
        varied(walk.with_facts(stride_frequency_hz=float("nan")))
    with pytest.raises(MotionError, match="too short to be varied"):
        varied(walk.frames(0, 100))

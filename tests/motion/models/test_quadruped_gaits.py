"""Footfall patterns, symmetries, builds and variation of the quadruped model."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from doppelgait.core.errors import ConfigError
from doppelgait.motion.models import QuadrupedConfig, quadruped_gait
from doppelgait.motion.models.quadruped import compute_all_points, make_regular_course
from doppelgait.motion.models.quadruped_gaits import (
    BUILDS,
    GAITS,
    duty_factor,
    fit_gait_to_build,
    froude_speed_mps,
    hip_height_m,
    mass_kg,
    pick_gait,
    stride_length_m,
)
from doppelgait.motion.models.strides import Columns, make_column

FEET = ("left_hind", "left_fore", "right_hind", "right_fore")
PHASE = np.arange(1500) / 1500
SYMMETRICAL = ("walk", "pace", "trot")

PHASES = {
    # Lag behind the left hind foot of (left fore, right hind, right fore): published ranges, measured where known.
    "walk": ((0.15, 0.19), (0.5, 0.5), (0.65, 0.69)),
    "pace": ((0.0, 0.05), (0.48, 0.52), (0.50, 0.55)),
    "trot": ((0.42, 0.48), (0.46, 0.52), (0.90, 0.94)),
    "canter": ((0.25, 0.30), (0.25, 0.30), (0.50, 0.60)),
    "gallop": ((0.13, 0.196), (0.809, 0.855), (0.312, 0.376)),
    "transverse_gallop": ((0.35, 0.45), (0.10, 0.20), (0.50, 0.60)),
    "bound": ((0.40, 0.50), (0.0, 0.0), (0.40, 0.50)),
}
ORDER = {
    # Beats of one stride; feet in one beat land together.
    "walk": [{"left_hind"}, {"left_fore"}, {"right_hind"}, {"right_fore"}],
    "pace": [{"left_hind"}, {"left_fore"}, {"right_hind"}, {"right_fore"}],
    "trot": [{"left_hind"}, {"left_fore"}, {"right_hind"}, {"right_fore"}],
    "canter": [{"left_hind"}, {"left_fore", "right_hind"}, {"right_fore"}],
    "gallop": [{"left_hind"}, {"left_fore"}, {"right_fore"}, {"right_hind"}],
    "transverse_gallop": [{"left_hind"}, {"right_hind"}, {"left_fore"}, {"right_fore"}],
    "bound": [{"left_hind", "right_hind"}, {"left_fore", "right_fore"}],
}


def stride_points(name, froude, phase=PHASE, build="standard", asymmetry=0.0):
    """Points in units of hip height at given phases, the stride, and the duty factors."""
    build = BUILDS[build]
    gait, hip = fit_gait_to_build(name, build, asymmetry), hip_height_m(build, build.withers_m)
    speed = froude_speed_mps(froude, hip)
    stride = stride_length_m(gait, speed, hip)
    duty = {end: duty_factor(getattr(gait, end), speed / stride, hip) for end in ("hind", "fore")}
    stride /= hip
    gait, build, phase = Columns([gait]), Columns([build]), phase[None]
    course = make_regular_course(phase, gait, make_column([stride]))
    points = compute_all_points(
        phase, gait, build, course, duty, SimpleNamespace(neck_deg=42.0, tail_deg=-35.0), 0 * phase
    )
    return {name: place[0] for name, place in points.items()}, stride, duty


def beats(footfalls, start_s, period_s):
    """Feet in the order in which they land within one stride, those at the same time together."""
    events = [(t, foot) for foot, times in footfalls.items() for t in times if -1e-6 <= t - start_s < period_s - 1e-6]
    moments = sorted({round(t, 6) for t, _ in events})
    return [{foot for t, foot in events if abs(t - moment) < 2e-6} for moment in moments]


@pytest.mark.parametrize("name", GAITS)
def test_feet_land_in_the_order_and_at_the_phases_of_the_gait(name):
    motion = quadruped_gait(gait=name, duration_s=4.0)
    footfalls, period = motion.facts.footfalls, 1 / motion.facts.stride_frequency_hz
    start = footfalls["left_hind"][1]
    assert beats(footfalls, start, period) == ORDER[name]
    for foot, (low, high) in zip(FEET[1:], PHASES[name], strict=True):
        lag = next(t for t in footfalls[foot] if t >= start - 1e-9) - start
        assert low - 1e-6 <= lag / period <= high + 1e-6, foot


@pytest.mark.parametrize("name", GAITS)
def test_paws_leave_and_touch_the_ground_at_the_stated_times(name):
    motion = quadruped_gait(gait=name, duration_s=3.0, rate_hz=2000, start_phase=0.3)
    for foot in FEET:
        lifted = motion.positions.sel(marker=f"{foot}_paw", space="z").values > 1e-9
        landings = motion.time_s[1:][lifted[:-1] & ~lifted[1:]]
        truth = [t for t in motion.facts.footfalls[foot] if t > 1e-3]
        # The last quarter of a millimetre of the way down is below the threshold: the flight ends with zero slope.
        np.testing.assert_allclose(landings, truth, atol=0.006)


@pytest.mark.parametrize("build", ["standard", "cat", "dachshund"])
@pytest.mark.parametrize("name", SYMMETRICAL)
def test_walk_pace_and_trot_are_their_own_mirror_image_half_a_stride_later(name, build):
    other = {"left": "right", "right": "left"}
    for froude in GAITS[name].froude:
        now, stride, _ = stride_points(name, froude, build=build)
        later, _, _ = stride_points(name, froude, PHASE + 0.5, build=build)
        for point, path in now.items():
            side, _, rest = point.partition("_")
            mirrored = later[f"{other[side]}_{rest}" if side in other else point] * [1, -1, 1] - [stride / 2, 0, 0]
            np.testing.assert_allclose(path, mirrored, atol=1e-12, err_msg=point)


@pytest.mark.parametrize("name", [name for name in GAITS if name not in SYMMETRICAL])
def test_the_other_gaits_repeat_once_a_stride_and_not_twice(name):
    now, stride, _ = stride_points(name, GAITS[name].froude[2])
    later, _, _ = stride_points(name, GAITS[name].froude[2], PHASE + 1)
    half, _, _ = stride_points(name, GAITS[name].froude[2], PHASE + 0.5)
    for point, path in now.items():
        np.testing.assert_allclose(path, later[point] - [stride, 0, 0], atol=1e-12)
    assert np.abs(now["rump"][:, 2] - half["rump"][:, 2]).max() > 0.1


def test_the_bound_is_the_same_left_and_right():
    points, _, _ = stride_points("bound", 2.5)
    for point in [point for point in points if point.startswith("left")]:
        np.testing.assert_allclose(points[point], points[point.replace("left", "right")] * [1, -1, 1], atol=1e-12)


def supports(name, froude):
    """Number of paws that bear weight through one stride: those slower than half the body."""
    points, stride, _ = stride_points(name, froude)
    speeds = [np.gradient(points[f"{foot}_paw"][:, 0], PHASE) / stride for foot in FEET]
    return sum(speed < 0.5 for speed in speeds)


def test_a_walk_always_stands_on_two_feet_and_running_gaits_leave_the_ground():
    for froude in np.geomspace(0.05, 0.5, 5):
        assert supports("walk", froude).min() >= 2
    for name, froude in (("trot", 1.3), ("canter", 3.0), ("gallop", 4.0), ("transverse_gallop", 4.0), ("bound", 2.5)):
        assert supports(name, froude).min() == 0, name
    # One gathered suspension of about 0.2 strides in the measured rotary gallop.
    assert (supports("gallop", 4.1) == 0).mean() == pytest.approx(0.2, abs=0.04)


def test_auto_goes_through_the_gaits_with_speed():
    assert [pick_gait(froude) for froude in (0.05, 0.5, 0.51, 2.5, 2.6, 10)] == [
        "walk", "walk", "trot", "trot", "gallop", "gallop"
    ]  # fmt: skip
    for speed, gait in ((0.9, "walk"), (2.0, "trot"), (5.0, "gallop")):
        motion, named = (quadruped_gait(gait=g, speed_mps=speed, duration_s=1.0) for g in ("auto", gait))
        np.testing.assert_array_equal(motion.position_m, named.position_m)
        assert motion.facts.gait == gait
    for parameters, text in (
        ({}, "'auto' depends on the speed: give speed_mps or froude"),
        ({"speed_mps": 7.0}, "7 is not allowed: a dog with withers_m = 0.5 moves at 2.17 to 6.26 m/s in a gallop"),
        ({"speed_mps": 0.1}, "moves at 0.443 to 1.4 m/s in a walk"),
    ):
        with pytest.raises(ConfigError, match=text):
            quadruped_gait(gait="auto", **parameters)


def test_the_length_of_a_build_scales_limbs_but_not_the_hip_height():
    cat, dog = (stride_points("walk", 0.2, build=build)[0] for build in ("cat", "standard"))
    for a, b in (("hip", "knee"), ("elbow", "carpus"), ("carpus", "fore_paw")):
        lengths = [np.linalg.norm(p[f"left_{a}"] - p[f"left_{b}"], axis=1) for p in (cat, dog)]
        np.testing.assert_allclose(lengths[0], 1.15 * lengths[1], rtol=1e-12)
    dachshund = stride_points("walk", 0.2, build="dachshund")[0]
    trunks = [np.linalg.norm(p["neck_base"] - p["tail_base"], axis=1) for p in (dachshund, dog)]
    np.testing.assert_allclose(trunks[0] / trunks[1], 1.8, rtol=0.01)


@pytest.mark.parametrize("build", BUILDS)
def test_a_build_sets_size_mass_and_species(build):
    motion = quadruped_gait(build=build, gait="walk", duration_s=0.5)
    expected = BUILDS[build]
    facts = motion.facts
    assert (facts.height_m, facts.mass_kg) == pytest.approx((expected.withers_m, expected.mass_kg))
    assert facts.species == (build if build in ("cat", "horse", "cow") else "dog")
    twice = quadruped_gait(build=build, gait="walk", duration_s=0.5, withers_m=0.8)
    assert twice.facts.mass_kg == pytest.approx(expected.mass_kg * (0.8 / expected.withers_m) ** 3)
    assert mass_kg(expected, expected.withers_m) == expected.mass_kg
    # Over common breeds the withers height is 0.15 to 0.20 m (mass / kg)^(1/3); two short-legged ones lie below.
    short = build in ("chihuahua", "dachshund")
    assert (0.10 if short else 0.15) <= expected.withers_m / expected.mass_kg ** (1 / 3) <= (0.15 if short else 0.205)


def test_a_cat_walks_and_trots_as_published():
    # Comfortable walk 0.54 to 0.74 m/s: duty factor 0.6 to 0.7, diagonal couplets; trot at 1 to 2.7 m/s with 2 to 2.5
    # strides per second, gallop with 3 to 4.
    walk = quadruped_gait(build="cat", gait="walk", speed_mps=0.7)
    assert walk.facts.gait == "walk"
    assert 1.35 < walk.facts.stride_frequency_hz < 1.7
    still = np.diff(walk.positions.sel(marker="left_hind_paw", space="x").values)[:500] * 250 < 0.5 * 0.7
    assert 0.58 < still.mean() < 0.72
    lag = walk.facts.footfalls["left_fore"][0] * walk.facts.stride_frequency_hz
    assert 0.25 < lag < 0.5
    assert 2.0 < quadruped_gait(build="cat", gait="trot", speed_mps=1.8).facts.stride_frequency_hz < 2.5
    assert 3.0 < quadruped_gait(build="cat", gait="gallop", speed_mps=3.5).facts.stride_frequency_hz < 4.0
    with pytest.raises(ConfigError, match=r"a cat with withers_m = 0\.25"):
        quadruped_gait(build="cat", gait="walk", speed_mps=2.0)


def test_asymmetry_delays_the_right_feet_and_leaves_the_left():
    plain, late = (quadruped_gait(asymmetry=a, duration_s=3.0, start_phase=0.05) for a in (0.0, 0.03))
    period = 1 / plain.facts.stride_frequency_hz
    for foot in FEET:
        first, second = (np.array(m.facts.footfalls[foot][:3]) for m in (plain, late))
        shift = 0.03 * period if foot.startswith("right") else 0.0
        np.testing.assert_allclose(second - first, shift, atol=1e-9)
    assert (
        np.ptp(
            late.positions.sel(marker="left_hind_paw").values - plain.positions.sel(marker="left_hind_paw").values,
            axis=0,
        ).max()
        == 0
    )
    with pytest.raises(ConfigError, match="asymmetry"):
        quadruped_gait(asymmetry=0.2)


def test_stride_times_vary_with_the_given_deviation_and_memory():
    sd, runs, count = 0.04, 5, 160
    period = 1 / quadruped_gait().facts.stride_frequency_hz
    deviations, lengths = [], []
    for seed in range(runs):
        motion = quadruped_gait(
            stride_variation=sd, rng=np.random.default_rng(seed), duration_s=count * period, rate_hz=50
        )
        deviations.append(np.diff(motion.facts.footfalls["left_hind"]) / period - 1)
        way_m = float(np.diff(motion.positions.sel(marker="rump", space="x").values[[0, -1]])[0])
        lengths.append(way_m / float(motion.time_s[-1]) / motion.facts.stride_frequency_hz)
    first, second = (np.concatenate([d[part] for d in deviations]) for part in (slice(None, -1), slice(1, None)))
    # Correlation 0.5 from stride to stride: the mean of n scatters by sd (3 / n)^0.5, the relative deviation by
    # (5 / 6 n)^0.5, the correlation itself by less than (1 / n)^0.5; four of each.
    n = len(first)
    assert abs(first.mean()) < 4 * sd * np.sqrt(3 / n)
    assert first.std() == pytest.approx(sd, rel=4 * np.sqrt(5 / 6 / n))
    assert np.corrcoef(first, second)[0, 1] == pytest.approx(0.5, abs=4 / np.sqrt(n))
    # L = c h at Fr = 1, whatever the stride times; the trunk's surge, under 0.1 h, is not whole at the end of a run.
    np.testing.assert_allclose(lengths, 2.6 * 0.4, rtol=0.1 / count)


@pytest.mark.parametrize("name", GAITS)
def test_paws_stand_still_in_stance_at_exact_footfalls_when_strides_vary(name):
    motion = quadruped_gait(gait=name, stride_variation=0.05, rng=np.random.default_rng(3), duration_s=8, rate_hz=1000)
    time_s, duty = motion.time_s, stride_points(name, GAITS[name].froude[2])[2]
    for foot in FEET:
        path, footfalls = motion.positions.sel(marker=f"{foot}_paw").values, np.array(motion.facts.footfalls[foot])
        speed = np.linalg.norm(np.diff(path, axis=0), axis=1) * 1000
        for start, following in itertools.pairwise(footfalls):
            # Lift-off comes at the duty factor in phase; in time a stride that speeds up moves it by under a tenth.
            end = start + 0.9 * duty[foot.split("_")[1]] * (following - start)
            stance = (time_s[:-1] >= start) & (time_s[1:] <= end)
            assert stance.any()
            assert speed[stance].max() < 1e-6
            # Ten milliseconds earlier the paw is in the air: the footfall is neither early nor late.
            assert path[np.searchsorted(time_s, start) - 12, 2] > 0 or start < 0.02


def test_without_variation_the_seed_does_not_matter():
    first, second = (quadruped_gait(gait="walk", rng=np.random.default_rng(seed)) for seed in (1, 2))
    np.testing.assert_array_equal(first.position_m, second.position_m)
    assert QuadrupedConfig().stride_variation == 0

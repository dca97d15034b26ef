import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from doppelgait.core.errors import ConfigError
from doppelgait.motion.models import MOTION_MODELS, QuadrupedConfig, quadruped_gait
from doppelgait.motion.models.quadruped import POINTS
from doppelgait.motion.models.quadruped_gaits import (
    DUTY_LIMITS,
    GAITS,
    duty_factor,
    froude_speed_mps,
    hip_height_m,
    paw_path,
    stride_length_m,
)
from doppelgait.motion.models.quadruped_limbs import (
    FEMUR,
    FOREARM,
    HUMERUS,
    MANUS,
    METATARSUS,
    STRETCH,
    TIBIA,
    all_points,
    crouch,
)
from doppelgait.motion.skeleton import DOG_PARTS

SIDES = ("left", "right")
FEET = [f"{side}_{end}" for side in SIDES for end in ("hind", "fore")]
SIZES = (0.2, 0.35, 0.57, 0.8, 0.9)
PHASE = np.arange(2000) / 2000


def froudes(name, count=7):
    low, high, _ = GAITS[name].froude
    return np.geomspace(low, high, count)


CASES = [(name, fr, withers) for name in GAITS for fr in froudes(name) for withers in SIZES]


def settings(name, froude, withers_m):
    """Gait, speed, stride, stride frequency and duty factors, in SI units."""
    gait, speed = GAITS[name], froude_speed_mps(froude, withers_m)
    stride = stride_length_m(gait, speed, withers_m)
    hip = hip_height_m(withers_m)
    duty = {end: duty_factor(getattr(gait, end), speed / stride, hip) for end in ("hind", "fore")}
    return gait, speed, stride, speed / stride, duty


def closed_form(name, froude, phase=PHASE, withers_m=0.575):
    """All points at given phases with the tail at rest, in units of hip height, and the stride in the same unit."""
    gait, _, stride, _, duty = settings(name, froude, withers_m)
    stride /= hip_height_m(withers_m)
    lowered = crouch(gait, stride, duty)
    return all_points(phase, gait, stride=stride, duty=duty, lowered=lowered, wag_rad=0 * phase), stride


def dog(name, froude, withers_m, **options):
    speed = froude_speed_mps(froude, withers_m)
    return quadruped_gait(gait=name, speed_mps=speed, withers_m=withers_m, **{"duration_s": 3.0, **options})


def paw(motion, foot):
    return motion.sel(marker=f"{foot}_paw").values


def test_points_and_parts():
    motion = quadruped_gait(duration_s=0.1)
    assert 20 <= motion.sizes["marker"] <= 28
    assert set(motion.part.values) == set(DOG_PARTS)
    assert len(set(POINTS)) == len(POINTS)


@pytest.mark.parametrize(("name", "froude", "withers_m"), CASES)
def test_stance_paws_stay_where_they_landed(name, froude, withers_m):
    _, _, stride, frequency, duty = settings(name, froude, withers_m)
    motion = dog(name, froude, withers_m, start_phase=0.37)
    time_s = motion.time.values
    for foot in FEET:
        touchdowns = motion.attrs["footfalls"][foot]
        assert len(touchdowns) >= 2
        for start in touchdowns:
            end = start + duty[foot.split("_")[1]] / frequency
            stance = paw(motion, foot)[(time_s >= start + 1e-9) & (time_s <= end - 1e-9)]
            if len(stance):
                assert np.ptp(stance, axis=0) == pytest.approx([0, 0, 0], abs=1e-9)
                assert stance[0, 2] == 0.0
        places = [paw(motion, foot)[np.searchsorted(time_s, t + 0.01), 0] for t in touchdowns if t < 2.9]
        np.testing.assert_allclose(np.diff(places), stride, atol=1e-9)


@pytest.mark.parametrize(("name", "froude", "withers_m"), CASES)
def test_paws_move_only_between_their_stances_and_never_under_the_floor(name, froude, withers_m):
    _, _, _, frequency, duty = settings(name, froude, withers_m)
    motion = dog(name, froude, withers_m, tail_sweep_deg=0)
    height_m = motion.sel(space="z").values
    assert height_m.min() >= 0
    for foot in FEET:
        end = foot.split("_")[1]
        still = np.linalg.norm(np.diff(paw(motion, foot), axis=0), axis=1) < 1e-9
        whole = int(3.0 * frequency) / frequency * 250
        assert still[: int(whole)].mean() == pytest.approx(duty[end], abs=0.05)
        clearance = getattr(GAITS[name], end).clearance * hip_height_m(withers_m)
        assert paw(motion, foot)[:, 2].max() == pytest.approx(clearance, rel=0.01)


@pytest.mark.parametrize("name", GAITS)
def test_a_swing_starts_and_ends_without_speed(name):
    for girdle in (GAITS[name].hind, GAITS[name].fore):
        for duty in (0.15, 0.3, 0.55):
            near = np.array([duty, 1.0])[:, None] + [-1e-4, 1e-4]
            advance, height = paw_path(near, girdle, duty)
            assert np.abs(np.diff(advance, axis=1)).max() < 1e-6
            assert np.abs(np.diff(height, axis=1)).max() < 1e-6
            fine = np.linspace(0, 2, 40_001)
            speed = np.gradient(paw_path(fine, girdle, duty)[0], fine)
            assert speed.max() * (1 - duty) == pytest.approx(girdle.swing_peak, rel=1e-4)
            assert speed.min() >= -1e-9
            assert np.abs(np.diff(speed)).max() < 0.02, "no jump of speed"


@pytest.mark.parametrize(("name", "froude", "withers_m"), CASES)
def test_stride_length_times_frequency_is_speed_and_follows_the_froude_law(name, froude, withers_m):
    facts = dog(name, froude, withers_m).attrs
    hip, factor = 0.8 * withers_m, {"trot": 2.5, "gallop": 2.7}[name]
    speed = np.sqrt(froude * 9.81 * hip)
    assert facts["stride_frequency_hz"] == pytest.approx(speed**0.4 * 9.81**0.3 / (factor * hip**0.7), rel=1e-9)
    assert facts["gait_frequency_hz"] / facts["stride_frequency_hz"] == {"trot": 2, "gallop": 1}[name]
    if name == "trot":
        assert facts["step_frequency_hz"] == 2 * facts["stride_frequency_hz"]
    else:
        assert np.isnan(facts["step_frequency_hz"])


@pytest.mark.parametrize("name", GAITS)
def test_the_trunk_goes_at_the_given_speed(name):
    _, speed, _, frequency, _ = settings(name, 1.5, 0.5)
    motion = dog(name, 1.5, 0.5, duration_s=4 / frequency, rate_hz=1000 * frequency, start_phase=0.9)
    for point in ("rump", "withers", "nose"):
        x = motion.sel(marker=point, space="x").values
        assert (x[-1] - x[0]) * frequency / 4 == pytest.approx(speed, rel=1e-9)
    trunk = motion.values[0, motion.part.values == "trunk"]
    assert trunk[:, :2].mean(axis=0) == pytest.approx([0, 0], abs=0.1)


ORDER = {
    "trot": ["left_hind", "left_fore", "right_hind", "right_fore"],
    "gallop": ["left_hind", "left_fore", "right_fore", "right_hind"],
}


@pytest.mark.parametrize("name", GAITS)
def test_order_of_the_feet(name):
    footfalls = dog(name, 1.5, 0.5, duration_s=3).attrs["footfalls"]
    events = sorted((time, foot) for foot, times in footfalls.items() for time in times)
    first = next(n for n, (_, foot) in enumerate(events) if foot == "left_hind")
    assert [foot for _, foot in events[first : first + 8]] == ORDER[name] * 2


def test_measured_phases_of_the_feet():
    frequency = settings("gallop", 4.0, 0.5)[3]
    footfalls = dog("gallop", 4.0, 0.5).attrs["footfalls"]
    for foot, phase in (("left_fore", 0.163), ("right_hind", 0.832), ("right_fore", 0.344)):
        assert footfalls[foot][0] * frequency == pytest.approx(phase, abs=1e-6)


def test_the_trot_is_its_own_mirror_image_half_a_stride_later():
    for froude in froudes("trot"):
        now, stride = closed_form("trot", froude)
        later, _ = closed_form("trot", froude, PHASE + 0.5)
        for point, path in now.items():
            twin = {"left": "right", "right": "left"}
            side, _, rest = point.partition("_")
            mirrored = later[f"{twin[side]}_{rest}" if side in twin else point] * [1, -1, 1] - [stride / 2, 0, 0]
            np.testing.assert_allclose(path, mirrored, atol=1e-12, err_msg=point)


def test_the_gallop_repeats_once_a_stride_and_not_twice():
    now, stride = closed_form("gallop", 4.0)
    later, _ = closed_form("gallop", 4.0, PHASE + 1)
    half, _ = closed_form("gallop", 4.0, PHASE + 0.5)
    for point, path in now.items():
        np.testing.assert_allclose(path, later[point] - [stride, 0, 0], atol=1e-12)
    assert np.abs(now["rump"][:, 2] - half["rump"][:, 2]).max() > 0.2


def included_deg(points, a, b, c):
    first, second = points[a] - points[b], points[c] - points[b]
    cosine = (first * second).sum(1) / np.linalg.norm(first, axis=1) / np.linalg.norm(second, axis=1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


LINKS = [
    ("hip", "knee", FEMUR), ("knee", "hock", TIBIA), ("hock", "hind_paw", METATARSUS),
    ("shoulder", "elbow", HUMERUS), ("elbow", "carpus", FOREARM), ("carpus", "fore_paw", MANUS),
]  # fmt: skip


@pytest.mark.parametrize(("name", "froude"), [(name, fr) for name in GAITS for fr in froudes(name, 25)])
def test_limbs_reach_bend_the_right_way_and_keep_their_lengths(name, froude):
    points, _ = closed_form(name, froude)
    for side in SIDES:
        for a, b, length in LINKS:
            distance = np.linalg.norm(points[f"{side}_{a}"] - points[f"{side}_{b}"], axis=1)
            np.testing.assert_allclose(distance, length, atol=1e-12, err_msg=f"{side} {a} {b}")
        for top, joint, low, forward in (("hip", "knee", "hock", 1), ("shoulder", "elbow", "carpus", -1)):
            upper, lower = (points[f"{side}_{p}"] - points[f"{side}_{top}"] for p in (joint, low))
            # Sign of the turn from the whole limb to its upper link: forward of the line for a knee.
            turn = upper[:, 0] * -lower[:, 2] + upper[:, 2] * lower[:, 0]
            assert (forward * turn).min() > 0
            angle = included_deg(points, f"{side}_{top}", f"{side}_{joint}", f"{side}_{low}")
            assert 40 < angle.min() < 80
            assert angle.max() < 155
        # The joint at the trunk is fixed to it.
        hip = np.linalg.norm(points[f"{side}_hip"] - points["rump"], axis=1)
        assert np.ptp(hip) < 1e-12
    for a, b in (("rump", "withers"), ("withers", "chest"), ("belly", "neck_base")):
        assert np.ptp(np.linalg.norm(points[a] - points[b], axis=1)) < 1e-12


def test_a_limb_that_cannot_reach_lowers_the_trunk_and_never_stretches():
    for name in GAITS:
        for froude in froudes(name, 25):
            gait, _, stride, _, duty = settings(name, froude, 0.5)
            assert 0.0 < crouch(gait, stride / hip_height_m(0.5), duty) < 0.22
            points, _ = closed_form(name, froude)
            spans = [np.linalg.norm(points[f"{s}_shoulder"] - points[f"{s}_carpus"], axis=1).max() for s in SIDES]
            spans += [np.linalg.norm(points[f"{s}_hip"] - points[f"{s}_hock"], axis=1).max() for s in SIDES]
            share = np.array(spans) / np.repeat([HUMERUS + FOREARM, FEMUR + TIBIA], 2)
            assert share.max() == pytest.approx(STRETCH, abs=1e-4)


def test_a_step_beyond_the_limb_is_refused():
    with pytest.raises(ConfigError, match="too long for the limb"):
        crouch(GAITS["trot"], 6.0, {"hind": 0.4, "fore": 0.4})


MEASURED_PEAKS = {
    # Highest forward speed over V of one measured dog.
    ("trot", 1.3): {"fore_paw": 2.8, "carpus": 2.35, "hind_paw": 2.0, "hock": 1.7, "knee": 1.5},
    ("gallop", 4.1): {"fore_paw": 2.2, "carpus": 1.9, "hind_paw": 1.8, "hock": 1.5, "knee": 1.4},
}


@pytest.mark.parametrize(("name", "froude"), MEASURED_PEAKS)
def test_peak_speeds_are_near_the_measured_ones(name, froude):
    step = 1e-5
    ahead, stride = closed_form(name, froude, PHASE + step)
    behind, _ = closed_form(name, froude, PHASE - step)
    for point, expected in MEASURED_PEAKS[name, froude].items():
        tolerance = 0.03 if "paw" in point else 0.17
        for side in SIDES:
            speed = (ahead[f"{side}_{point}"] - behind[f"{side}_{point}"])[:, 0] / (2 * step * stride)
            assert speed.max() == pytest.approx(expected, rel=tolerance), point
    rump = (ahead["rump"] - behind["rump"])[:, 0] / (2 * step * stride)
    assert (rump.max(), rump.min()) == pytest.approx((1.15, 0.88), abs=0.06)


def test_trunk_moves_as_measured():
    for name, froude, expected in (("trot", 1.3, (0.125, 0.10, 0.11)), ("gallop", 4.1, (0.25, 0.22, 0.39))):
        points, _ = closed_form(name, froude)
        heave = [np.ptp(points[p][:, 2]) for p in ("rump", "neck_base", "head")]
        np.testing.assert_allclose(heave, expected, rtol=0.25)


def test_duty_factor_follows_the_swing_time_rule_within_its_limits():
    trot = GAITS["trot"].fore
    assert duty_factor(trot, 2.0, 0.46) == pytest.approx(1 - 0.3 * 2.0 + trot.duty_offset)
    assert duty_factor(trot, 0.1, 0.46) == DUTY_LIMITS[1]
    assert duty_factor(trot, 9.0, 0.46) == DUTY_LIMITS[0]


@pytest.mark.parametrize("withers_m", [0.2, 0.5])
@pytest.mark.parametrize("name", GAITS)
def test_default_rate_is_fast_enough_for_the_paws(name, withers_m):
    for froude in froudes(name, 3):
        coarse = dog(name, froude, withers_m, duration_s=1.2)
        fine = dog(name, froude, withers_m, duration_s=1.2, rate_hz=10_000)
        time_s = np.arange(0.1, 1.1, 1e-4)
        for foot in FEET:
            speed = CubicSpline(coarse.time, paw(coarse, foot)[:, 0])(time_s, 1)
            exact = CubicSpline(fine.time, paw(fine, foot)[:, 0])(time_s, 1)
            assert speed.max() == pytest.approx(exact.max(), rel=0.005)
            assert np.abs(speed - exact).max() < 0.01 * exact.max()


def test_positions_have_no_jumps():
    for name in GAITS:
        for froude in froudes(name, 3):
            motion = dog(name, froude, 0.5, rate_hz=2000)
            velocity = np.diff(motion.values, axis=0) * 2000
            assert np.abs(np.diff(velocity, axis=0)).max() < 0.05 * np.abs(velocity).max()


def test_strides_vary_when_asked_and_paws_still_stand():
    motion = quadruped_gait(stride_variation=0.04, rng=np.random.default_rng(2), duration_s=20)
    strides = np.diff(motion.attrs["footfalls"]["left_hind"])
    assert 0.02 < strides.std() / strides.mean() < 0.06
    path, time_s = paw(motion, "right_fore"), motion.time.values
    for start in motion.attrs["footfalls"]["right_fore"][:-1]:
        stance = path[(time_s >= start + 1e-6) & (time_s <= start + 0.12)]
        assert np.ptp(stance, axis=0) == pytest.approx([0, 0, 0], abs=1e-9)


def test_the_tail_swings_at_its_own_frequency_and_nothing_else_depends_on_it():
    still, wagging = (quadruped_gait(tail_sweep_deg=sweep, tail_frequency_hz=2.0) for sweep in (0, 30))
    moved = np.abs(still.values - wagging.values).max(axis=(0, 2)) > 1e-12
    assert list(still.marker.values[moved]) == ["tail_middle", "tail_tip"]
    side_m = (wagging - still).sel(marker="tail_tip", space="y").values
    assert np.argmax(np.abs(np.fft.rfft(side_m[:-1]))) == 10


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"gait": "trot", "withers_m": 0.5, "speed_mps": 5.0}, ["5", "trot", "1.08 to 3.13 m/s"]),
        ({"gait": "gallop", "withers_m": 0.5, "speed_mps": 1.0}, ["1", "gallop", "2.17 to 6.26 m/s"]),
        ({"gait": "canter"}, ["gait", "canter", "trot"]),
        ({"withers_m": 1.2}, ["withers_m", "1.2", "0.9"]),
        ({"start_phase": -0.1}, ["start_phase", "-0.1"]),
        ({"duration_s": -1}, ["duration_s", "-1"]),
        ({"stride_variation": 0.02}, ["stride_variation", "rng"]),
    ],
)
def test_what_is_out_of_range_is_refused_with_the_value_and_the_range(parameters, expected):
    with pytest.raises(ConfigError) as caught:
        quadruped_gait(**parameters)
    for text in expected:
        assert text in str(caught.value)


def test_it_is_a_registered_model_whose_name_alone_gives_a_motion():
    model = MOTION_MODELS["quadruped"]
    assert model.config is QuadrupedConfig
    motion = model.generate(model.config(), 5.0, None)
    np.testing.assert_array_equal(motion, quadruped_gait())
    facts = motion.attrs
    assert (facts["species"], facts["gait"], facts["height_m"]) == ("dog", "trot", 0.5)
    assert facts["mass_kg"] == pytest.approx((0.5 / 0.175) ** 3)
    assert all("assumed" in text for text in facts["report"].values())
    assert float(motion.time[-1]) == 5.0


def test_a_froude_number_sets_the_speed():
    by_number = quadruped_gait(gait="trot", froude=1.5, withers_m=0.4, duration_s=1.0)
    by_speed = quadruped_gait(gait="trot", speed_mps=(1.5 * 9.81 * 0.32) ** 0.5, withers_m=0.4, duration_s=1.0)
    np.testing.assert_allclose(by_number.values, by_speed.values, atol=1e-12)
    with pytest.raises(ConfigError, match="speed_mps or froude, not both"):
        quadruped_gait(froude=1.0, speed_mps=2.0)

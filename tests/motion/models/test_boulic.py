import numpy as np
import pytest

from doppelgait.core.errors import ConfigError
from doppelgait.motion.models import boulic, boulic_walk
from doppelgait.motion.models.boulic import compute_boulic_points
from doppelgait.motion.models.human_body import POINTS
from walking_body import BONES

PHASE = np.arange(1000) / 1000
SPEEDS = (0.25, 0.5, 0.9, 1.3, 1.31, 2.0, 3.0)
INDEX = {name: n for n, name in enumerate(POINTS)}


def velocity(q, height_m, phase, name, **options):
    """Exact forward speed of a point, m/s: central difference of the closed form over two millionths of a cycle."""
    leg_m, step = boulic.LEG_LENGTH * height_m, 1e-6
    ahead, behind = (
        compute_boulic_points(phase + d, q, height_m, offset_scale_m=leg_m, **options)[:, INDEX[name], 0]
        for d in (step, -step)
    )
    return q * leg_m + (ahead - behind) / (2 * step * boulic.cycle_duration_s(q))


@pytest.mark.parametrize(("q", "height_m"), [(0.3, 1.2), (1.0, 1.8), (1.7, 1.65), (2.9, 1.9)])
def test_timing_identities(q, height_m):
    leg_m, cycle_s = boulic.LEG_LENGTH * height_m, boulic.cycle_duration_s(q)
    speed_mps = q * leg_m
    assert speed_mps * cycle_s == pytest.approx(1.346 * np.sqrt(q) * leg_m)
    assert boulic.compute_support_fraction(q) * cycle_s == pytest.approx(0.752 * cycle_s - 0.143)
    walk = boulic_walk(speed_mps=speed_mps, height_m=height_m, duration_s=7)
    facts = walk.facts
    assert facts.stride_frequency_hz == pytest.approx(0.743 * np.sqrt(speed_mps / leg_m), rel=1e-4)
    assert facts.step_frequency_hz == facts.gait_frequency_hz == 2 * facts.stride_frequency_hz
    assert speed_mps / facts.step_frequency_hz == pytest.approx(0.673 * np.sqrt(speed_mps * leg_m), rel=1e-4)


@pytest.mark.parametrize(
    ("q", "ankle", "toe"),
    [
        (0.25, 3.93, 4.58), (0.50, 5.63, 7.00), (0.75, 4.76, 5.86), (1.00, 4.24, 5.18), (1.25, 3.89, 4.72),
        (1.50, 3.66, 4.42), (1.75, 3.50, 4.21), (2.00, 3.37, 4.04), (2.50, 3.18, 3.79), (3.00, 3.04, 3.61),
    ],
)  # fmt: skip
def test_peak_speed_of_ankle_and_toe_over_body_speed(q, ankle, toe):
    # The row below q = 0.5 is for the published signs of the body offsets; above, they are the default ones.
    phase, mean = np.arange(20_000) / 20_000, q * boulic.LEG_LENGTH * 1.8
    for name, expected in (("right_ankle", ankle), ("right_toe", toe)):
        peak = velocity(q, 1.8, phase, name, offset_signs="published").max() / mean
        assert peak == pytest.approx(expected, abs=0.0051)


@pytest.mark.parametrize("q", SPEEDS)
def test_left_is_right_mirrored_half_a_cycle_later(q):
    for signs in ("continuous", "published", "pendulum"):
        now, later = (
            compute_boulic_points(PHASE + d, q, 1.75, offset_scale_m=0.86, offset_signs=signs) for d in (0, 0.5)
        )
        opposite = [name.replace("left", "tmp").replace("right", "left").replace("tmp", "right") for name in POINTS]
        mirrored = later[:, [INDEX[name] for name in opposite]] * [1, -1, 1]
        np.testing.assert_allclose(now, mirrored, rtol=0, atol=2e-13)


@pytest.mark.parametrize("q", SPEEDS)
def test_segments_keep_their_lengths(q):
    points = compute_boulic_points(PHASE, q, 1.8, offset_scale_m=1.0)
    for a, b, bone in BONES:
        length_m = np.linalg.norm(points[:, INDEX[a]] - points[:, INDEX[b]], axis=1)
        np.testing.assert_allclose(length_m, 1.8 * boulic.LENGTHS[bone], rtol=0, atol=1e-12, err_msg=f"{a} {b}")


@pytest.mark.parametrize("q", [0.5, 1.3])
def test_regimes_meet(q):
    below, above = q * (1 - 1e-9), q * (1 + 1e-9)
    for joint, knots in boulic.find_joint_knots(below).items():
        values = {round(p, 6) % 1: v for p, v in knots}
        for p, v in boulic.find_joint_knots(above)[joint]:
            assert values[round(p, 6) % 1] == pytest.approx(v, abs=1e-6), (joint, p)
    for name, curve in boulic.limb_angles_deg(PHASE, below).items():
        # At 1.3 the one hip knot at 0.9 splits in two, which tilts the curve there: the model's own small step.
        step_deg = 0.7 if (name, q) == ("hip", 1.3) else 1e-6
        np.testing.assert_allclose(boulic.limb_angles_deg(PHASE, above)[name], curve, atol=step_deg, err_msg=name)
    for name, curve in boulic.trunk_angles_deg(PHASE, below).items():
        np.testing.assert_allclose(boulic.trunk_angles_deg(PHASE, above)[name], curve, atol=1e-6, err_msg=name)
    for signs in ("continuous", "pendulum"):
        np.testing.assert_allclose(
            boulic.compute_body_offset(PHASE, below, signs=signs),
            boulic.compute_body_offset(PHASE, above, signs=signs),
            atol=1e-6,
        )


def test_published_offsets_change_sign_at_one_half_and_the_default_leans_over_the_standing_leg():
    below, above = (boulic.compute_body_offset(PHASE, q, signs="published")[1] for q in (0.4999, 0.5001))
    assert np.corrcoef(below, above)[0, 1] < -0.99
    for q in SPEEDS:
        # The right leg stands around p = 0.3: the body is then to the right, y < 0.
        assert boulic.compute_body_offset(np.array([0.35]), q)[1, 0] < 0


@pytest.mark.parametrize("form", ["consistent", "pendulum", "chen2011"])
@pytest.mark.parametrize(("speed_mps", "height_m"), [(1.4, 1.75), (2.4, 1.9)])
def test_it_travels_at_its_speed_along_x_over_the_floor(speed_mps, height_m, form):
    q = speed_mps / (boulic.LEG_LENGTH * height_m)
    cycle_s = boulic.cycle_duration_s(q)
    timing = {"duration_s": 2 * cycle_s, "start_phase": 0.3, "rate_hz": 500 / cycle_s}
    walk = boulic_walk(speed_mps=speed_mps, height_m=height_m, form=form, **timing)
    base = walk.positions.sel(marker="base").values
    speed_mps = q if form == "chen2011" else speed_mps  # the published program leaves out the length of the leg
    assert (base[-1, 0] - base[0, 0]) / (2 * cycle_s) == pytest.approx(speed_mps)
    assert walk.position_m[0, 0, :2] == pytest.approx([0, 0], abs=0.04)
    assert np.ptp(base[:, 2]) == pytest.approx(0.03 * speed_mps, rel=1e-3)
    feet = walk.position_m[:, [n for n, m in enumerate(POINTS) if m.endswith(("ankle", "toe"))], 2]
    assert feet.min() == pytest.approx(0, abs=1e-4)
    assert walk.positions.sel(space="z").values.min() > -1e-5


@pytest.mark.parametrize("q", [0.0, -1.0, 3.01, float("nan")])
def test_points_refuse_a_relative_speed_outside_the_model(q):
    with pytest.raises(ConfigError, match="relative speed"):
        compute_boulic_points(PHASE, q, 1.8, offset_scale_m=1.0)

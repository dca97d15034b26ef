"""Measured curves over a cycle: sums, integrals, asymmetry, and a dog's curves by gait and duty factor."""

import numpy as np
import pytest

from doppelgait.motion.models import curves as phases
from doppelgait.motion.models.quadruped_gaits import GAITS

DOGS = phases.load_tables()["dogs"]
COARSE = np.arange(400) / 400 - 0.3
PHASE = np.arange(2000) / 2000


def test_joined_curves_are_the_sums_of_their_harmonics():
    curves = [phases.make_measured_curve("walk", name, 0.4) for name in ("ankle_speed", "ankle_height", "foot_pitch")]
    turns = 2 * np.pi * np.arange(10)[:, None] * COARSE
    expected = [one.coefficients.real @ np.cos(turns) - one.coefficients.imag @ np.sin(turns) for one in curves]
    np.testing.assert_allclose(phases.join_curves(*curves)(COARSE), expected, rtol=0, atol=1e-11)
    np.testing.assert_allclose([one(COARSE) for one in curves], expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("asymmetry", [0.0, 0.5])
def test_an_integral_has_the_slope_of_its_curve_less_the_mean(asymmetry):
    speed, way = (
        phases.make_measured_curve("run", "pelvis_speed", 1.0, integral=integral, asymmetry=asymmetry)
        for integral in (False, True)
    )
    nudge = 1e-6
    slope = (way(COARSE + nudge) - way(COARSE - nudge)) / (2 * nudge)
    np.testing.assert_allclose(slope, speed(COARSE) - speed(COARSE).mean(), atol=1e-8)


@pytest.mark.parametrize("gait", DOGS)
@pytest.mark.parametrize("end", ["hind", "fore"])
def test_the_surge_integrates_the_measured_speed(gait, end):
    curve, begins = phases.find_trunk_curve(gait, f"{end}_surge", GAITS[gait].touchdown)
    speed = (curve(PHASE + 1e-5) - curve(PHASE - 1e-5)) / 2e-5
    measured = DOGS[gait][f"{end}_surge"]
    samples = np.tile(measured, 20 // len(measured))
    np.testing.assert_allclose(speed[::100], samples - samples.mean(), atol=0.003)
    assert begins == pytest.approx(0.0, abs=0.055)  # lag of the fore feet of two dogs


@pytest.mark.parametrize("name", ["sway", "yaw", "roll"])
def test_girdles_move_sideways_by_the_lead_of_their_feet(name):
    """As in the recorded rotary gallop, mirrored in the other order, not in a bound; by halves if symmetrical."""
    for end in ("hind", "fore"):
        rotary, transverse, bound = (
            phases.find_trunk_curve("gallop", f"{end}_{name}", GAITS[gait].touchdown)[0](PHASE)
            for gait in ("gallop", "transverse_gallop", "bound")
        )
        np.testing.assert_allclose(rotary[::100], DOGS["gallop"][f"{end}_{name}"], atol=0.02 * np.ptp(rotary) + 0.1)
        factor = transverse @ rotary / (rotary @ rotary)
        np.testing.assert_allclose(transverse, factor * rotary, atol=1e-12)
        assert factor == pytest.approx(-0.92 if end == "hind" else 0.89, abs=0.02)
        np.testing.assert_allclose(bound, 0.0, atol=1e-12)
        for gait in ("walk", "pace", "trot"):
            curve, _ = phases.find_trunk_curve(gait, f"{end}_{name}", GAITS[gait].touchdown)
            np.testing.assert_allclose(curve(PHASE + 0.5), -curve(PHASE), atol=0.15 if name != "sway" else 2e-3)


@pytest.mark.parametrize("gait", DOGS)
@pytest.mark.parametrize("segment", ["manus", "metatarsus", "scapula"])
def test_segments_follow_their_tables_and_stretch_with_the_duty_factor(gait, segment):
    measured = DOGS[gait]["duty"][segment != "metatarsus"]
    own = np.degrees(phases.segment_elevation_rad([gait], [segment], PHASE, measured))[0, 0, 0]
    np.testing.assert_allclose(own[::100], DOGS[gait][segment], atol=3.5)
    longer = 1.2 * measured
    scaled = np.degrees(phases.segment_elevation_rad([gait], [segment], np.array([longer, 1.0 - 1e-9]), longer))[0, 0]
    expected = np.degrees(phases.segment_elevation_rad([gait], [segment], np.array([measured, 1.0 - 1e-9]), measured))[
        0, 0
    ]
    np.testing.assert_allclose(scaled, expected, atol=1e-5)
    rate = np.diff(phases.segment_elevation_rad([gait], [segment], np.linspace(0, 2, 40_001), longer)[0, 0, 0])
    assert np.abs(np.diff(rate)).max() < 3e-5, "no jump of the angular speed"


@pytest.mark.parametrize("gait", DOGS)
@pytest.mark.parametrize("end", ["hind", "fore"])
def test_a_swing_covers_the_stride_as_measured(gait, end):
    swing = phases.find_swing_curve([gait], end, 1.0)
    assert swing(np.array([0.0, 1.0])) == pytest.approx([0.0, 1.0])
    np.testing.assert_allclose(swing(np.arange(13) / 12, 1), DOGS[gait]["swings"][end], atol=0.02)

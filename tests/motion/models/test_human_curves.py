"""Measured curves over a cycle: joined, integrated, asymmetric."""

import numpy as np
import pytest

from doppelgait.motion.models.human_curves import join_curves, make_measured_curve

PHASE = np.arange(400) / 400 - 0.3


def test_joined_curves_are_the_sums_of_their_harmonics():
    curves = [make_measured_curve("walk", name, 0.4) for name in ("ankle_speed", "ankle_height", "foot_pitch")]
    turns = 2 * np.pi * np.arange(10)[:, None] * PHASE
    expected = [one.coefficients.real @ np.cos(turns) - one.coefficients.imag @ np.sin(turns) for one in curves]
    np.testing.assert_allclose(join_curves(*curves)(PHASE), expected, rtol=0, atol=1e-11)
    np.testing.assert_allclose([one(PHASE) for one in curves], expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("asymmetry", [0.0, 0.5])
def test_an_integral_has_the_slope_of_its_curve_less_the_mean(asymmetry):
    speed, way = (
        make_measured_curve("run", "pelvis_speed", 1.0, integral=integral, asymmetry=asymmetry)
        for integral in (False, True)
    )
    nudge = 1e-6
    slope = (way(PHASE + nudge) - way(PHASE - nudge)) / (2 * nudge)
    np.testing.assert_allclose(slope, speed(PHASE) - speed(PHASE).mean(), atol=1e-8)

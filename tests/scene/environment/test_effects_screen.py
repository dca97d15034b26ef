"""Furniture in the way: shadows by hand, Fresnel's integral, the two edges."""

import numpy as np
import pytest
from scipy.special import fresnel

from doppelgait.scene.environment import Screen, Setting, apply_environment
from doppelgait.scene.environment.effects import knife_edge_db
from echo_table import LAMBDA_M, echo_table

SOFA = Screen(from_m=(3.0, -1.0), to_m=(3.0, 1.0), height_m=0.8, loss_db=200.0)


def levels_db(places_m, spec=SOFA, radar_m=(0.0, 0.0, 1.0)):
    """One-way loss of scatterers at places (n, 3) of the room."""
    before = echo_table(np.asarray(places_m, dtype=float)[None, :, :], radar_m)
    after = apply_environment(before, (spec,), Setting(LAMBDA_M, radar_m, 0.0))
    assert after["range"].identical(before["range"])
    return -5.0 * np.log10(after["path_gain"].values / before["path_gain"].values)[0]


def test_a_knife_edge_is_within_0_7_db_of_fresnels_integral():
    v = np.linspace(0.0, 20.0, 400)
    sine, cosine = fresnel(v)
    exact = -20 * np.log10(np.abs((0.5 - cosine) - 1j * (0.5 - sine)) / np.sqrt(2))
    assert np.abs(knife_edge_db(v) - exact).max() < 0.7
    assert knife_edge_db(np.array([-0.9, -50.0])).tolist() == [0.0, 0.0]


def test_the_loss_of_the_material_is_the_most():
    board = SOFA.model_copy(update={"loss_db": 2.5})
    assert levels_db([[5, 0, 0.1]], board)[0] == pytest.approx(2.5)


def test_the_shadow_begins_without_a_jump_at_the_top_and_at_both_ends():
    heights = np.linspace(0.0, 1.5, 3001)
    up = levels_db(np.stack([np.full(3001, 5.0), np.zeros(3001), heights], axis=1))
    sideways = np.linspace(-4.0, 4.0, 8001)
    across = levels_db(np.stack([np.full(8001, 5.0), sideways, np.full(8001, 0.0)], axis=1))
    for line in (up, across):
        assert np.abs(np.diff(line)).max() < 0.1
        assert line.max() > 10
        assert line.min() == 0.0
    np.testing.assert_allclose(across, across[::-1], atol=1e-9)
    # at the edge itself half the field arrives: 6 dB
    edge = levels_db([[5, 0, 1 - 0.2 * 5 / 3]])[0]
    assert edge == pytest.approx(6.03, abs=0.1)


def test_a_screen_may_stand_anywhere_and_in_any_order_of_its_ends():
    turn = np.radians(37.0)
    rotate = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    places = np.random.default_rng(0).uniform([3.2, -2, 0], [7, 2, 1.8], (50, 3))
    moved = places.copy()
    moved[:, :2] = places[:, :2] @ rotate.T + [10.0, -4.0]
    ends = [tuple(rotate @ np.array(end) + [10.0, -4.0]) for end in (SOFA.to_m, SOFA.from_m)]
    other = SOFA.model_copy(update={"from_m": ends[0], "to_m": ends[1]})
    np.testing.assert_allclose(levels_db(moved, other, (10.0, -4.0, 1.0)), levels_db(places), atol=1e-9)


def test_an_image_by_the_floor_sees_the_screens_image():
    np.testing.assert_allclose(levels_db([[5, 0.2, -0.1]], radar_m=(0, 0, 0)),
                               levels_db([[5, 0.2, 0.1]], radar_m=(0, 0, 0)))  # fmt: skip

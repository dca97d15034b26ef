"""Lists of environment effects: tables and models, order, errors, what comes after what."""

from typing import Literal

import numpy as np
import pytest

from doppelgait.core.config import FrozenModel, validate
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.scene import environment as surroundings
from echo_table import LAMBDA_M, echo_table

SETTING = surroundings.Setting(LAMBDA_M, (0.0, 0.0, 1.0))


class Room(FrozenModel):
    """Anything that holds effects."""

    environment: surroundings.Environment = ()


TABLES = [
    {"kind": "ground_bounce", "material": "wood", "roughness_m": 0.002},
    {"kind": "wall_ghost", "material": {"permittivity": 4.0}, "thickness_m": 0.1, "side_m": 2.0},
    {"kind": "wall", "material": "brick", "thickness_m": 0.115, "range_m": 2.5},
    {"kind": "visibility", "gain_db": [[0.0, -6.0], [10.0, -6.0]]},
]


@pytest.mark.parametrize(
    ("effects", "text"),
    [
        ([{"kind": "wal"}], r"environment.0: .*environment kind 'wal' is not allowed: known are ground_bounce"),
        ([{"material": "brick"}], "environment kind None is not allowed"),
        ([TABLES[0], {"kind": "wall", "loss": 3}], r"environment\.1\.loss: unknown key; allowed are delay_m"),
        ([{"kind": "wall_ghost", "material": "wood", "thickness_m": 0.1}], "set either side_m"),
        ([{**TABLES[1], "position_m": [1, 2]}], "belong together"),
        ([{**TABLES[1], "material": "gold"}], r"'gold' is not allowed: must be concrete, brick.*permittivity"),
        ([{**TABLES[0], "roughness_m": -1}], "roughness_m: -1 is not allowed"),
        ([TABLES[2], TABLES[0]], "'ground_bounce' is listed after 'wall', but reflections must be listed first"),
        ([TABLES[3], TABLES[1]], "'wall_ghost' is listed after 'visibility'"),
        ([Room()], r"unknown environment .None.; known are"),
        ([3], "environment.0: 3 is not allowed"),
    ],
)
def test_lists_that_are_refused(effects, text):
    with pytest.raises(ConfigError, match=text):
        validate(Room, {"environment": effects})


WALL = {"kind": "wall", "material": "brick", "thickness_m": 0.1}


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({"kind": "wall"}, "give either material and thickness_m, or loss_db"),
        ({"kind": "wall", "material": "brick"}, "material and thickness_m belong together"),
        ({**WALL, "loss_db": 3}, "give either material"),
        ({"kind": "wall", "delay_m": 0.1}, "delay_m needs loss_db"),
        ({**WALL, "material": "gold"}, "material: 'gold' is not allowed: must be concrete, brick"),
        ({**WALL, "material": {"permittivity": 0.5}}, r": material\.permittivity: 0.5 is not allowed"),
        ({"kind": "visibility", "gain_db": [[1, 0], [1, -3]]}, "1 m follows 1 m"),
        ({"kind": "visibility", "gain_db": [[2, 0], [1, -3]]}, "1 m follows 2 m"),
        ({"kind": "visibility", "gain_db": [[1, -301]]}, "-300"),
        ({"kind": "visibility", "gain_db": [[1, float("-inf")]]}, "finite"),
        ({"kind": "screen", "from_m": [1, 1], "to_m": [1, 1], "height_m": 1, "loss_db": 3}, r"at least 0\.01 m"),
    ],
)
def test_effects_that_are_refused(table, text):
    with pytest.raises(ConfigError, match=f"environment kind '{table['kind']}'.*{text}"):
        surroundings.make_effect(table)


def test_effects_act_in_order_and_none_is_the_table_itself():
    table = echo_table([[[4.0, 0.5, 1.0], [2.0, 0.0, 1.5]]], SETTING.radar_position_m)
    assert surroundings.apply_environment(table, [], SETTING) is table
    near = surroundings.Visibility(gain_db=[(4.0, 0.0), (4.2, -40.0)])
    delay = surroundings.Wall(loss_db=0.0, delay_m=0.3)
    first = surroundings.apply_environment(table, [near, delay], SETTING)["path_gain"].values[0]
    last = surroundings.apply_environment(table, [delay, near], SETTING)["path_gain"].values[0]
    delayed = (1 + 0.3 / table["range"].values[0]) ** 4  # delay, but no spreading
    np.testing.assert_allclose(first, delayed * [10 ** (-0.1 * 40 * (np.hypot(4, 0.5) - 4) / 0.2), 1.0])
    np.testing.assert_allclose(last, delayed * [1e-4, 1.0])  # the wall took it beyond the edge


def test_order_is_checked_where_no_model_did():
    table = echo_table([[[4.0, 0.5, 1.0]]], SETTING.radar_position_m)
    with pytest.raises(ConfigError, match="move 'ground_bounce' before 'wall'"):
        surroundings.apply_environment(table, [surroundings.Wall(loss_db=1), surroundings.GroundBounce()], SETTING)
    with pytest.raises(ConfigError, match="is not an environment effect"):
        surroundings.apply_environment(table, [Room()], SETTING)


class Haze(FrozenModel):
    kind: Literal["haze"] = "haze"


@pytest.mark.parametrize(
    ("returned", "text"),
    [
        (lambda table: None, "returns NoneType, not a scatterer table"),
        (lambda table: table["range"], "returns DataArray, not a scatterer table"),
        (lambda table: table.drop_vars("path_gain"), "returns a table without path_gain"),
        (lambda table: table.isel(slow_time=slice(1, None)), "returns 2 pulses instead of 3; it must keep the pulses"),
    ],
)
def test_an_effect_of_a_plugin_that_returns_no_table_is_named(register, returned, text):
    register("environment", parameters=Haze)(lambda table, parameters, setting: returned(table))
    table = echo_table(np.array([[[3.0, 0.0, 1.0]]] * 3), SETTING.radar_position_m)
    with pytest.raises(AnalysisError, match=f"^environment effect 'haze' of tests {text}"):
        surroundings.apply_environment(table, [Haze()], SETTING)


def test_which_effects_need_angles():
    wall, near = surroundings.Wall(loss_db=3), surroundings.Visibility(gain_db=[(0, 0)])
    assert not surroundings.needs_angles([wall, near])
    for table in (TABLES[0], TABLES[1], TABLES[2], {"kind": "wall", "loss_db": 3, "range_m": 2}):
        assert surroundings.needs_angles([wall, surroundings.make_effect(table)])

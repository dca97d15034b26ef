"""Contract checks of radar cross sections and environment effects: built-in ones pass, broken ones are caught."""

from contextlib import nullcontext
from typing import Literal

import numpy as np
import pytest

from doppelgait.core.config import FrozenModel
from doppelgait.scene import RcsSpec
from doppelgait.scene.environment import ENVIRONMENT
from doppelgait.scene.rcs import RCS
from doppelgait.testing import check_environment, check_rcs

EFFECTS = {
    "ground_bounce": {"roughness_m": 0.01},
    "screen": {"from_m": [3.0, -1.0], "to_m": [3.0, 1.0], "height_m": 0.8, "loss_db": 20.0},
    "visibility": {"gain_db": [[1.0, -20.0], [3.0, 0.0]]},
    "wall": {"material": "brick", "thickness_m": 0.1, "range_m": 2.0},
    "wall_ghost": {"material": "concrete", "thickness_m": 0.2, "side_m": 2.0},
}


@pytest.mark.parametrize("kind", RCS)
def test_every_cross_section_keeps_its_contract(kind):
    check_rcs(kind)


def test_every_effect_keeps_its_contract():
    assert set(EFFECTS) == set(ENVIRONMENT)
    for kind, parameters in EFFECTS.items():
        check_environment({"kind": kind, **parameters})
    check_environment({"kind": "wall", "loss_db": 3.0, "delay_m": 0.1})


class Bright(RcsSpec):
    """One bright point."""

    kind: Literal["bright"] = "bright"
    share: float = 0.5


def scatter_bright(view, parameters):
    """Give the first point its share."""
    weights = np.full(len(view.motion.parts), (1 - parameters.share) / (len(view.motion.parts) - 1))
    weights[0] = parameters.share
    return view.motion, (parameters.total_m2 or 0.8) * weights


@pytest.mark.parametrize(
    ("broken", "text"),
    [
        (scatter_bright, None),
        (lambda v, p: (v.motion, -scatter_bright(v, p)[1]), "not finite and 0 or larger"),
        (lambda v, p: (v.motion, np.ones(3)), "shape"),
        (lambda v, p: (v.motion, np.ones(len(v.motion.parts))), "four times total_m2"),
        (lambda v, p: (v.motion, scatter_bright(v, p)[1] * np.random.default_rng().random()), "other cross sections"),
        (lambda v, p: (v.motion, 0 * scatter_bright(v, p)[1]), "nothing scatters"),
    ],
)
def test_an_own_cross_section_passes_and_a_broken_one_is_caught(register, broken, text):
    register("rcs", parameters=Bright)(broken)
    with pytest.raises(AssertionError, match=text) if text else nullcontext():
        check_rcs({"kind": "bright", "share": 0.9})


class Haze(FrozenModel):
    """An effect for tests."""

    kind: Literal["haze"] = "haze"
    gain: float = 0.5


def _gain(table, value):
    return table.assign(path_gain=table["path_gain"].copy(data=table["path_gain"].values * value))


def _in_place(table, spec, setting):
    table["path_gain"] = table["path_gain"] * 0.5
    return table


@pytest.mark.parametrize(
    ("apply", "text"),
    [
        (lambda t, p, s: _gain(t, p.gain), None),
        (lambda t, p, s: _gain(t, -1.0), "path_gain is negative"),
        (lambda t, p, s: _gain(t, np.nan), "path_gain is not finite"),
        (lambda t, p, s: t.isel(scatterer=slice(1, None)), "drops scatterers"),
        (lambda t, p, s: t.isel(scatterer=slice(None, None, -1)), "first rows"),
        (lambda t, p, s: _gain(t, np.random.default_rng().random()), "gives another one"),
        (_in_place, "changes the table"),
    ],
)
def test_a_broken_effect_is_caught(register, apply, text):
    register("environment", parameters=Haze)(apply)
    with pytest.raises(AssertionError, match=text) if text else nullcontext():
        check_environment({"kind": "haze", "gain": 0.3})

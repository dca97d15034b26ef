"""A run takes the kinds and parameters of plug-ins from KEY=VALUE overrides."""

from typing import Literal

import pytest

import doppelgait as dg
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError
from doppelgait.pipeline import Run, run_simulation
from doppelgait.scene import RcsSpec
from doppelgait.scene.rcs import total_rcs_m2

SCENE = """
duration_s = 0.2
[[targets]]
motion = { kind = "boulic", speed_mps = 1.2 }
range_m = 3.0
rcs = { total_m2 = 0.5 }
[[environment]]
kind = "visibility"
gain_db = [[0.0, 0.0]]
[noise]
kind = "none"
"""


class FirstPoint(RcsSpec):
    """All of the cross section in one point."""

    kind: Literal["first_point"] = "first_point"
    gain: float = 1.0


class Fog(FrozenModel):
    """Loss of all echoes."""

    kind: Literal["fog"] = "fog"
    loss: float = 1.0


@pytest.fixture(autouse=True)
def _own_plugins(register):
    @register("rcs", parameters=FirstPoint)
    def scatter_first(view, spec):
        rcs_m2 = 0.0 * view.motion.position_m[0, :, 0]
        rcs_m2[0] = spec.gain * total_rcs_m2(spec, view.motion.facts.mass_kg)
        return view.motion, rcs_m2

    @register("environment", parameters=Fog)
    def apply_fog(scatterers, spec, setting):
        return scatterers.assign(path_gain=scatterers["path_gain"] * spec.loss)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def test_overrides_choose_a_plugin_and_set_its_parameters(path):
    changes = ["targets.0.rcs.kind=first_point", "targets.0.rcs.gain=3", "environment.0={kind='fog', loss=0.25}"]
    run = Run.from_toml(path, overrides=changes)
    assert run.scene.targets[0].rcs == FirstPoint(total_m2=0.5, gain=3.0)
    assert run.environment == (Fog(loss=0.25),)
    table = run_simulation(run).truth[0].scatterers
    assert table["rcs"].values[0].sum() == table["rcs"].values[0, 0] == 1.5
    assert (table["path_gain"].values == 0.25).all()
    again = path.with_name("again.toml")
    again.write_text(run.to_toml())
    assert Run.from_toml(again) == run


def test_a_parameter_of_an_effect_can_be_changed_alone(path):
    run = Run.from_toml(path, overrides=["environment.0.gain_db=[[0.0, -6.0]]"])
    assert run.environment[0].gain_db == ((0.0, -6.0),)


def test_the_radar_of_a_run_is_a_name_or_a_file(tmp_path):
    scene = dg.Scene(duration_s=0.5)
    assert Run(scene=scene, radar="x4-255fps").radar == dg.Radar.preset("x4-255fps")
    (tmp_path / "own.toml").write_text('preset = "x4"\n[[impairments]]\nkind = "adc"\n')
    run = Run(scene=scene, radar=str(tmp_path / "own.toml"), seed=2)
    assert [entry.kind for entry in run.impairments] == ["adc"]
    assert Run(scene=scene, radar=str(tmp_path / "own.toml"), impairments=()).impairments == ()
    with pytest.raises(ConfigError, match=r"^Run: radar\.preset x5: unknown radar preset 'x5'; known are"):
        Run(scene=scene, radar="x5")

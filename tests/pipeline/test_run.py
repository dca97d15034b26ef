"""A run takes the kinds and parameters of plug-ins from KEY=VALUE overrides."""

from typing import Literal

import numpy as np
import pytest

import doppelgait as dg
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


def test_overrides_choose_a_plugin_and_set_its_parameters(register, tmp_path):
    @register("rcs", parameters=FirstPoint)
    def scatter_first(view, spec):
        rcs_m2 = 0.0 * view.motion.position_m[0, :, 0]
        rcs_m2[0] = spec.gain * total_rcs_m2(spec, view.motion.facts.mass_kg)
        return view.motion, rcs_m2

    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    changes = ["targets.0.rcs.kind=first_point", "targets.0.rcs.gain=3", "environment.0={kind='wall', loss_db=6}"]
    run = Run.from_toml(path, overrides=changes)
    assert run.scene.targets[0].rcs == FirstPoint(total_m2=0.5, gain=3.0)
    table = run_simulation(run).truth[0].scatterers
    assert table["rcs"].values[0].sum() == table["rcs"].values[0, 0] == 1.5
    np.testing.assert_allclose(table["path_gain"].values, 10 ** (-12 / 10))
    again = path.with_name("again.toml")
    again.write_text(run.to_toml())
    assert Run.from_toml(again) == run


def test_the_radar_of_a_run_is_a_name_or_a_file(tmp_path):
    scene = dg.Scene(duration_s=0.5)
    assert Run(scene=scene, radar="x4-255fps").radar == dg.Radar.preset("x4-255fps")
    (tmp_path / "own.toml").write_text('preset = "x4"\n[[impairments]]\nkind = "adc"\n')
    run = Run(scene=scene, radar=str(tmp_path / "own.toml"), seed=2)
    assert [entry.kind for entry in run.impairments] == ["adc"]
    assert Run(scene=scene, radar=str(tmp_path / "own.toml"), impairments=()).impairments == ()
    with pytest.raises(ConfigError, match=r"^Run: radar\.preset x5: unknown radar preset 'x5'; known are"):
        Run(scene=scene, radar="x5")

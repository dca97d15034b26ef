"""Ellipsoids from the markers of a recording in the shared test data."""

import numpy as np
import pytest

from doppelgait.core.labels import read_axis
from doppelgait.motion import read
from doppelgait.motion.models.boulic import LENGTHS
from doppelgait.scene import RcsSpec, Scene, Target, assemble
from doppelgait.scene.bodies import build_skeleton

pytestmark = pytest.mark.shared


def test_a_recorded_person_has_the_ellipsoids_of_a_person(shared):
    take = read(shared / "data" / "mocap" / "human" / "c3d" / "cmu_07_12.c3d")
    skeleton = build_skeleton(take)
    lengths_m = dict(zip([s.name for s in skeleton.segments], 2 * skeleton.semi_axes_m[:, 2], strict=True))
    for side in ("left", "right"):
        for name in ("thigh", "shank", "upper_arm", "forearm"):
            # skin markers are some centimetres off the joints, and people differ
            assert lengths_m[f"{side}_{name}"] / take.facts.height_m == pytest.approx(LENGTHS[name], rel=0.25), name
    scene = Scene([Target(take, aspect_deg=90.0, rcs=RcsSpec(kind="surfaces", total_m2=0.8, occlusion=True))])
    table = assemble(scene, np.arange(0, 2.0, 0.01), wavelength_m=0.0411, rng=np.random.default_rng(3))
    assert 0.5 < table["rcs"].values.sum(axis=1).mean() < 1.1  # other sides, 0.57 to 0.96
    gain = dict(zip(read_axis(table, "marker").tolist(), table["path_gain"].values.mean(axis=0), strict=True))
    assert min(gain["left_upper_arm"], gain["right_upper_arm"]) < 0.3
    assert max(gain["left_upper_arm"], gain["right_upper_arm"]) > 0.9

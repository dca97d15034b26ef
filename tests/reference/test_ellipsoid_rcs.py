"""Ellipsoids against the tables of the published program (Chen 2011)."""

import numpy as np
import pandas as pd
import pytest

from doppelgait.motion.models.human_body import POINTS
from doppelgait.scene.bodies import PERSON, TABLES, ellipsoid_rcs_m2

pytestmark = pytest.mark.shared
RADAR_M = np.array([10.0, 0.0, 2.0])
# The program puts these scatterers at an end of their segment, the others at its middle (as we all of them).
AT_END = ("head", "shoulder", "foot")
CHEN_TORSO_M = 0.15


def test_the_ellipsoid_routine(shared):
    table = pd.read_csv(shared / "reference" / "boulic" / "ellipsoid_rcs.csv")
    theta, phi = table["theta_rad"], table["phi_rad"]
    direction = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    ours = ellipsoid_rcs_m2(table[["a_m", "b_m", "c_m"]].to_numpy(), direction)
    assert len(table) > 100
    np.testing.assert_allclose(ours, table["rcs_m2"], rtol=1e-8)


def test_every_segment_of_the_walker(shared):
    folder = shared / "reference" / "boulic"
    table = pd.read_csv(folder / "segment_rcs_range_rv1.00_h1.80.csv")
    with np.load(folder / "boulic_rv1.00_h1.80.npz") as data:
        place = dict(zip(POINTS, data["pos_forward_asis"].transpose(0, 2, 1), strict=True))
    for segment in (s for s in PERSON if not s.joint and s.limb is None):
        kind = segment.name.removeprefix("left_").removeprefix("right_")
        start, end = place[segment.start], place[segment.end]
        scatterer = end if kind in AT_END else (start + end) / 2
        half_m = float(np.linalg.norm(end[0] - start[0])) / 2
        along = (end - start) / np.linalg.norm(end - start, axis=-1, keepdims=True)
        radius_m = (
            CHEN_TORSO_M if kind == "torso" else segment.across * TABLES["person"]["unit_m"]
        )  # our torso is elliptic
        sight = RADAR_M - scatterer
        range_m = np.linalg.norm(sight, axis=-1)
        cosine = (sight * along).sum(axis=-1) / range_m
        direction = np.stack([np.sqrt(1 - cosine**2), 0 * cosine, cosine], axis=-1)
        rcs_m2 = ellipsoid_rcs_m2([radius_m, radius_m, half_m], direction)  # of a plane wave, as the program's
        name = segment.name[0] + kind if segment.name != kind else kind
        np.testing.assert_allclose(rcs_m2, table[f"{name}_rcs_m2"], rtol=1e-6, err_msg=segment.name)
        np.testing.assert_allclose(range_m, table[f"{name}_range_m"], rtol=1e-8, err_msg=segment.name)

"""What must not change in a scatterer table, for every way to scatter (hypothesis, the same examples every time)."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.motion.models.quadruped import quadruped_gait
from doppelgait.scene import RcsSpec, Scene, Target, assemble, bodies

WALK, DOG = boulic_walk(duration_s=0.5), quadruped_gait(duration_s=0.5)
T = np.arange(0, 0.45, 0.05)
SPECS = {
    "split": RcsSpec(kind="body_parts"),
    "surfaces": RcsSpec(kind="surfaces"),
    "surfaces, hidden": RcsSpec(kind="surfaces", occlusion=True),
    "points, hidden": RcsSpec(kind="body_parts", occlusion=True),
    "surfaces, fluctuating": RcsSpec(kind="surfaces", fluctuation="swerling1", total_spread_db=3.0),
    "fluctuating": RcsSpec(kind="body_parts", fluctuation="swerling1", total_spread_db=3.0),
}
VARIABLES = ("range", "radial_velocity", "rcs", "path_gain")

every_way = pytest.mark.parametrize("spec", SPECS.values(), ids=list(SPECS))
both = pytest.mark.parametrize("motion", [WALK, DOG], ids=["person", "dog"])


def always(*strategies, examples=8):
    def wrap(test):
        return settings(derandomize=True, deadline=None, max_examples=examples)(given(*strategies)(test))

    return wrap


def table(motion, spec, start, heading_deg, radar_m):
    target = Target(motion, rcs=spec, start_position_m=start, heading_deg=heading_deg)
    scene = Scene([target], radar_position_m=radar_m, duration_s=0.45)
    return assemble(scene, T, angles=False, wavelength_m=0.0411, rng=np.random.default_rng(1))


def assert_same(one, other, order=slice(None)):
    for name in VARIABLES:
        np.testing.assert_allclose(one[name].values[:, order], other[name].values, rtol=1e-8, atol=1e-8, err_msg=name)


@every_way
@both
@always(st.floats(-50, 50), st.floats(-50, 50))
def test_moving_the_scene_with_the_radar_changes_nothing(motion, spec, east, north):
    here = table(motion, spec, (4.0, 1.0), 200.0, (0.0, 0.0, 1.2))
    assert_same(here, table(motion, spec, (4.0 + east, 1.0 + north), 200.0, (east, north, 1.2)))


@every_way
@both
@always(st.floats(-180, 180))
def test_turning_the_scene_with_the_radar_changes_nothing(motion, spec, turn_deg):
    cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))

    def turned(x, y):
        return float(cos * x - sin * y), float(sin * x + cos * y)

    here = table(motion, spec, (4.0, 1.0), 20.0, (0.5, -0.3, 1.2))
    there = table(motion, spec, turned(4.0, 1.0), (20.0 + turn_deg) % 360, (*turned(0.5, -0.3), 1.2))
    assert_same(here, there)


@pytest.mark.parametrize("name", [n for n in SPECS if n != "fluctuating"])
@both
@always(st.integers(0, 2**32 - 1), examples=5)
def test_permuting_the_markers_permutes_the_rows(motion, name, seed):
    order = np.random.default_rng(seed).permutation(len(motion.markers))
    here, there = (
        table(m, SPECS[name], (4.0, 1.0), 200.0, (0.0, 0.0, 1.2))
        for m in (motion, replace(motion, positions=motion.positions.isel(marker=order)))
    )
    # surfaces keep the order of the body's segments
    assert_same(here, there, slice(None) if SPECS[name].kind == "surfaces" else order)


@both
@always(st.floats(1e-3, 1e3))
def test_another_unit_of_length_scales_areas_by_its_square_and_hides_the_same(motion, unit):
    other = motion.with_positions(motion.position_m * unit).with_facts(height_m=motion.facts.height_m * unit)
    radar = np.array([4.0, 2.0, 1.1])
    one, two = (bodies.compute_ellipsoids(bodies.build_skeleton(m)) for m in (motion, other))
    np.testing.assert_allclose(
        bodies.see_ellipsoids(two, unit * radar)[1], unit**2 * bodies.see_ellipsoids(one, radar)[1], rtol=1e-9
    )
    gains = [
        bodies.compute_visible_power(
            m.position_m, body, bodies.find_own_points(m.position_m, body), k * radar, edge_m=k * 0.05
        )
        for m, body, k in ((motion, one, 1.0), (other, two, unit))
    ]
    np.testing.assert_allclose(gains[1], gains[0], atol=1e-9)

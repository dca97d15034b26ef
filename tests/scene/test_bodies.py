"""Ellipsoid scatterers (E-08c): closed forms, means over directions, which segment lies where, the scaled total."""

from dataclasses import replace

import numpy as np
import pytest

from doppelgait.core.errors import ConfigError
from doppelgait.core.labels import axis
from doppelgait.motion import make_motion
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.motion.models.quadruped import quadruped_gait
from doppelgait.scene import RcsSpec, Scene, Target, assemble, place
from doppelgait.scene.bodies import (
    ANIMAL,
    BODIES,
    PERSON,
    Ellipsoids,
    centres,
    ellipsoid_rcs_m2,
    ellipsoids_at,
    ellipsoids_of_frames,
    horizontal_mean_rcs_m2,
    seen_rcs_m2,
    skeleton_of,
)

T = np.arange(0, 0.9, 0.01)


def sphere_directions(n=200_000):
    """Directions spread evenly over the sphere (Fibonacci)."""
    z = 1 - (2 * np.arange(n) + 1) / n
    azimuth = np.pi * (1 + 5**0.5) * np.arange(n)
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), z], axis=-1)


# --- Closed forms ---------------------------------------------------------------------------------------------------


def test_limits_sphere_broadside_end_on():
    np.testing.assert_allclose(ellipsoid_rcs_m2([0.3] * 3, sphere_directions(50)), np.pi * 0.09, rtol=1e-12)
    a, c = 0.07, 0.22
    assert ellipsoid_rcs_m2([a, a, c], [0.6, 0.8, 0]) == pytest.approx(np.pi * c**2)
    assert ellipsoid_rcs_m2([a, a, c], [0, 0, 1]) == pytest.approx(np.pi * a**4 / c**2)
    # optical limit: pi times the two radii of curvature where the surface faces the radar
    assert ellipsoid_rcs_m2([0.1, 0.2, 0.4], [0, 1, 0]) == pytest.approx(np.pi * (0.1**2 / 0.2) * (0.4**2 / 0.2))


@pytest.mark.parametrize("axes", [(0.1, 0.1, 0.3), (0.07, 0.115, 0.15), (0.3, 0.3, 0.05)])
def test_mean_over_all_directions_is_a_quarter_of_the_surface(axes):
    """Optical backscatter of a convex body: mean of pi over the Gaussian curvature = surface / 4."""
    a, b, c = axes
    u = np.linspace(0, np.pi, 2001)[:, None]
    v = np.linspace(0, 2 * np.pi, 2001)[None, :]
    bent = (b * c * np.sin(u) * np.cos(v)) ** 2 + (a * c * np.sin(u) * np.sin(v)) ** 2 + (a * b * np.cos(u)) ** 2
    area = np.trapezoid(np.trapezoid(np.sin(u) * np.sqrt(bent), v[0], axis=1), u[:, 0])
    assert ellipsoid_rcs_m2(axes, sphere_directions()).mean() == pytest.approx(area / 4, rel=1e-4)


def turned(seed, axes):
    """One ellipsoid of random attitude at the origin."""
    frame = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    return Ellipsoids(np.zeros((1, 1, 3)), frame[None, None, 2], frame[None, None, 0], np.array([axes])), frame


@pytest.mark.parametrize("seed", range(4))
def test_horizontal_mean_against_the_sum_over_azimuths(seed):
    axes = (0.07, 0.115, 0.15)
    body, frame = turned(seed, axes)
    azimuth = np.arange(3600) * np.pi / 1800
    level = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=-1)
    wanted = ellipsoid_rcs_m2(axes, level @ frame.T).mean()
    assert horizontal_mean_rcs_m2(body)[0, 0] == pytest.approx(wanted, rel=1e-10)


def test_what_the_radar_sees_is_the_ellipsoid_in_its_own_axes():
    axes, radar = (0.07, 0.115, 0.15), np.array([3.0, -2.0, 1.0])
    body, frame = turned(7, axes)
    along = frame @ (radar / np.linalg.norm(radar))
    assert seen_rcs_m2(body, radar)[0, 0] == pytest.approx(float(ellipsoid_rcs_m2(axes, along)), rel=1e-12)


# --- Bodies ---------------------------------------------------------------------------------------------------------


def test_every_segment_joins_known_joints_and_is_there_once():
    for body in BODIES.values():
        names = [s.name for s in body.segments]
        assert len(set(names)) == len(names)
        assert {j for s in body.segments for j in (s.start, s.end, *(s.sideways or ()))} <= set(body.joints)
        uneven = [s for s in body.segments if s.across != s.upright]
        assert all(s.sideways is not None for s in uneven)
    assert (len(PERSON), len(ANIMAL)) == (16, 17)


def test_a_person_is_chens_with_radii_that_scale_with_stature():
    walk = boulic_walk(height_m=1.80, duration_s=1.0)
    size = dict(zip([s.name for s in PERSON], skeleton_of(walk).semi_axes_m, strict=True))
    np.testing.assert_allclose(size["torso"], [0.15, 0.15, 0.288 * 1.8 / 2])
    np.testing.assert_allclose(size["left_shank"], [0.06, 0.06, 0.246 * 1.8 / 2])
    np.testing.assert_allclose(size["right_hip"], [0.07, 0.07, 0.0955 * 1.8 / 2])
    child = skeleton_of(boulic_walk(height_m=0.90, duration_s=1.0)).semi_axes_m
    np.testing.assert_allclose(child, skeleton_of(walk).semi_axes_m / 2, rtol=1e-9)


def test_scatterers_are_at_the_middle_of_their_segments():
    walk = boulic_walk(duration_s=1.0)
    middle = centres(skeleton_of(walk))
    thigh = walk.positions.sel(marker=["left_hip", "left_knee"]).mean("marker")
    np.testing.assert_allclose(middle.positions.sel(marker="left_thigh").values, thigh.values, atol=1e-15)
    assert str(middle.positions.sel(marker="left_thigh").coords["part"].values) == "left_thigh"
    table = assemble(Scene([Target(walk, rcs="ellipsoids")]), T)
    assert table.sizes == {"slow_time": T.size, "scatterer": 16}
    assert axis(table, "marker").tolist() == [s.name for s in PERSON]


def test_the_axes_follow_the_joints_between_frames():
    walk = boulic_walk(duration_s=1.0)
    skeleton = skeleton_of(walk)
    body = ellipsoids_at(skeleton, walk.time_s[10:20])
    np.testing.assert_allclose(body.along, ellipsoids_of_frames(skeleton).along[10:20], atol=1e-9)
    np.testing.assert_allclose((body.along**2).sum(axis=-1), 1.0)
    line = (walk.positions.sel(marker="head") - walk.positions.sel(marker="neck")).values[10:20]
    np.testing.assert_allclose(body.along[:, 0], line / np.linalg.norm(line, axis=1)[:, None], atol=1e-9)


def test_the_trunk_of_an_animal_is_narrower_from_side_to_side_than_upright():
    dog = quadruped_gait(withers_m=0.5, duration_s=1.0)
    skeleton = skeleton_of(dog)
    thorax = ellipsoids_of_frames(skeleton)
    np.testing.assert_allclose(skeleton.semi_axes_m[0], [0.07, 0.115, 0.15])
    assert np.abs(thorax.across[:, 0, 1]).min() > 0.9  # the dog goes along x
    assert np.abs((thorax.across[:, 0] * thorax.along[:, 0]).sum(axis=-1)).max() < 1e-12
    side, front = (seen_rcs_m2(thorax, at)[:, 0].mean() for at in ((0, 1000, 0.5), (1000, 0, 0.5)))
    assert side / front > 10


def marker_person(prefix=""):
    """The walker's joints as a marker set of a recording."""
    walk = boulic_walk(duration_s=1.0)
    at = {joint: walk.positions.sel(marker=joint).values for joint in walk.markers}
    pairs = {"LFHD RBHD": "head", "RFHD LBHD": "head", "C7 CLAV": "neck"}
    for side, letter in (("left", "L"), ("right", "R")):
        skin = {"SHO": "shoulder", "ELB": "elbow", "WRA WRB": "hand", "KNE": "knee", "ANK": "ankle", "TOE": "toe"}
        pairs |= {" ".join(letter + n for n in names.split()): f"{side}_{joint}" for names, joint in skin.items()}
        # above the hip, so that a fifth of the way to the knee it is there
        at[f"{side}_waist"] = at[f"{side}_hip"] + (at[f"{side}_hip"] - at[f"{side}_knee"]) / 4
        pairs[f"{letter}FWT {letter}BWT"] = f"{side}_waist"
    position = {}
    for markers, joint in pairs.items():
        shift = np.array([0.02, 0.01, 0]) if " " in markers else np.zeros(3)
        for marker, sign in zip(markers.split(), (1, -1), strict=False):
            position[marker] = at[joint] + sign * shift
    names = list(position)
    facts = {"height_m": walk.facts.height_m, "source": "take.c3d"}
    values = np.stack([position[n] for n in names], axis=1)
    parts = [""] * len(names)
    return walk, make_motion(values, rate_hz=250, markers=[prefix + n for n in names], parts=parts, facts=facts)


def test_marker_sets_give_the_same_body_as_the_joints_they_surround():
    walk, take = marker_person("liu:")
    ours, wanted = skeleton_of(take), skeleton_of(walk)
    assert [s.name for s in ours.segments] == [s.name for s in wanted.segments]
    bodies = ellipsoids_of_frames(ours), ellipsoids_of_frames(wanted)
    np.testing.assert_allclose(bodies[0].centre_m, bodies[1].centre_m, atol=1e-12)
    np.testing.assert_allclose(bodies[0].along, bodies[1].along, atol=1e-12)


def test_unknown_joints_and_unknown_height_are_refused():
    walk, take = marker_person()
    with pytest.raises(ConfigError, match=r"take\.c3d.*nearest set is CMU 41, which lacks LKNE, RELB; use rcs kind"):
        skeleton_of(replace(take, positions=take.positions.drop_sel(marker=["LKNE", "RELB"])))
    nameless = make_motion(np.zeros((5, 2, 3)), rate_hz=10, markers=["a", "b"], parts=["", ""])
    for rcs in (RcsSpec(kind="ellipsoids"), RcsSpec(occlusion=True)):
        with pytest.raises(ConfigError, match="joints are known"):
            assemble(Scene([Target(nameless, rcs=rcs)]), [0.0])
    walk = walk.with_facts(height_m=float("nan"))
    with pytest.raises(ConfigError, match="height is unknown"):
        skeleton_of(walk)
    flat = boulic_walk(duration_s=1.0)
    flat.position_m[:] = 0.0
    with pytest.raises(ConfigError, match="segment head has no length"):
        skeleton_of(flat)


def test_merging_ellipsoids_is_refused():
    with pytest.raises(ConfigError, match="merge_closer_than_m is for points"):
        Target(boulic_walk(duration_s=1.0), rcs={"kind": "ellipsoids", "merge_closer_than_m": 0.01})


# --- Total ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mover", [boulic_walk(speed_mps=1.3, duration_s=1.2), quadruped_gait(duration_s=1.2)])
def test_the_total_is_the_mean_over_horizontal_directions(mover):
    """Brute force: far radars at the height of the body all round, all frames of the motion."""
    motion = place(Scene([Target(mover)])).targets[0].motion
    target = Target(mover, rcs=RcsSpec(kind="ellipsoids", total_m2=0.6))
    times = mover.time_s - mover.time_s[0]
    centre = motion.position_m.mean(axis=(0, 1))
    sums = []
    for azimuth in np.arange(36) * np.pi / 18:
        radar = 1e6 * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        scene = Scene([Target(mover, rcs=target.rcs, start_position_m=(0, 0), heading_deg=0.0)], tuple(radar + centre))
        sums.append(assemble(scene, times, angles=False)["rcs"].values.sum(axis=1).mean())
    assert np.mean(sums) == pytest.approx(0.6, rel=2e-3)
    assert np.max(sums) > 1.1 * np.min(sums)


def test_the_default_total_follows_the_mass_e08b():
    walk = boulic_walk(height_m=1.8, duration_s=1.0)
    by_mass = assemble(Scene([Target(walk, rcs="ellipsoids")]), T)["rcs"].values
    given = assemble(Scene([Target(walk, rcs=RcsSpec(kind="ellipsoids", total_m2=1.0))]), T)["rcs"].values
    np.testing.assert_allclose(by_mass, given * 0.01 * walk.facts.mass_kg, rtol=1e-12)

"""Ellipsoid scatterers (E-08c, E-08f, E-08g) against closed forms and integrals."""

from dataclasses import replace

import numpy as np
import pytest

from doppelgait.core.errors import ConfigError
from doppelgait.core.labels import read_axis
from doppelgait.motion import make_motion
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.motion.models.quadruped import quadruped_gait
from doppelgait.motion.retime import fit_spline
from doppelgait.scene import RcsSpec, Scene, Target, assemble, place
from doppelgait.scene.bodies import (
    PERSON,
    Ellipsoids,
    Segment,
    Skeleton,
    build_skeleton,
    compute_ellipsoids,
    ellipsoid_rcs_m2,
    find_nearest_points,
    mean_rcs_m2,
    see_ellipsoids,
)
from doppelgait.scene.observe import fill_ranges

T = np.arange(0, 0.9, 0.01)


def seen(wavelength_m=0.0411):
    """Options of a scatterer table before a radar."""
    return {"wavelength_m": wavelength_m, "rng": np.random.default_rng(3)}


def test_limits_sphere_broadside_end_on():
    assert ellipsoid_rcs_m2([0.3] * 3, [0.48, 0.6, -0.64]) == pytest.approx(np.pi * 0.09)
    a, c = 0.07, 0.22
    assert ellipsoid_rcs_m2([a, a, c], [0.6, 0.8, 0]) == pytest.approx(np.pi * c**2)
    assert ellipsoid_rcs_m2([a, a, c], [0, 0, 1]) == pytest.approx(np.pi * a**4 / c**2)
    # optical limit: pi times the two radii of curvature where the surface faces the radar
    assert ellipsoid_rcs_m2([0.1, 0.2, 0.4], [0, 1, 0]) == pytest.approx(np.pi * (0.1**2 / 0.2) * (0.4**2 / 0.2))


def turned(seed, axes):
    """One ellipsoid of random attitude at the origin."""
    frame = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    return Ellipsoids(np.zeros((1, 1, 3)), frame[None, None, 2], frame[None, None, 0], np.array([axes])), frame


def test_what_the_radar_sees_is_the_ellipsoid_in_its_own_axes():
    axes, radar = (0.07, 0.115, 0.15), np.array([3e7, -2e7, 1e7])
    body, frame = turned(7, axes)
    along = frame @ (radar / np.linalg.norm(radar))
    assert see_ellipsoids(body, radar)[1][0, 0] == pytest.approx(float(ellipsoid_rcs_m2(axes, along)), rel=1e-7)


def test_scatterers_are_the_segments_where_they_face_the_radar():
    walk = boulic_walk(duration_s=1.0)
    table = assemble(Scene([Target(walk, rcs="surfaces")]), T, **seen())
    assert table.sizes == {"slow_time": T.size, "scatterer": 20}
    assert read_axis(table, "marker").tolist() == [s.name for s in PERSON]
    skeleton = build_skeleton(walk)
    points = find_nearest_points(skeleton, compute_ellipsoids(skeleton), (1000.0, 0.0, 1.0))
    ahead = (
        points.positions.sel(marker="torso").values - walk.positions.sel(marker=["base", "neck"]).mean("marker").values
    )
    np.testing.assert_allclose(ahead[:, 0], 0.13 * walk.facts.height_m / 1.8, rtol=0.03)
    assert np.abs(ahead[:, 1:]).max() < 0.04
    assert str(points.positions.sel(marker="left_thigh").coords["part"].values) == "left_thigh"


@pytest.mark.parametrize("build", ["standard", "cat"])
def test_the_ends_of_an_animals_trunk_are_blunt(build):
    """The chest ends at the shoulders, the rump at the tail's root."""
    animal = quadruped_gait(build=build, duration_s=1.0)
    skeleton, withers_m = build_skeleton(animal), animal.facts.height_m
    body = compute_ellipsoids(skeleton)
    for number, (name, joint, sign) in {0: ("chest", "left_shoulder", 1), 3: ("rump", "tail", -1)}.items():
        assert skeleton.segments[number].name == name
        at = (sign * 1e5, 0.0, body.centre_m[:, number, 2].mean())
        end = find_nearest_points(skeleton, body, at).positions.sel(marker=name).values[:, 0]
        joint_m = animal.positions.sel(marker=joint).values[:, 0]
        assert abs((end - joint_m).mean()) < 0.055 * withers_m
        across, upright, along = skeleton.semi_axes_m[number]
        curved = np.pi * (across**2 / along) * (upright**2 / along)  # pi R1 R2
        assert see_ellipsoids(body, at)[1][:, number].mean() == pytest.approx(curved, rel=0.1)
    parts = np.array([s.part for s in skeleton.segments])
    seen = see_ellipsoids(body, (1e5, 0, 0.7 * withers_m))[1].mean(axis=0)
    assert seen[parts == "trunk"].sum() / seen.sum() > 0.4


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
    ours, wanted = build_skeleton(take), build_skeleton(walk)
    assert [s.name for s in ours.segments] == [s.name for s in wanted.segments]
    bodies = compute_ellipsoids(ours), compute_ellipsoids(wanted)
    np.testing.assert_allclose(bodies[0].centre_m, bodies[1].centre_m, atol=1e-12)
    np.testing.assert_allclose(bodies[0].along, bodies[1].along, atol=1e-12)


def test_unknown_joints_and_unknown_height_are_refused():
    walk, take = marker_person()
    with pytest.raises(ConfigError, match=r"take\.c3d.*no own point of the motion is right_elbow, left_knee; name"):
        build_skeleton(replace(take, positions=take.positions.drop_sel(marker=["LKNE", "RELB"])))
    nameless = make_motion(np.zeros((5, 2, 3)), rate_hz=10, markers=["a", "b"], parts=["", ""])
    for rcs in (RcsSpec(kind="surfaces"), RcsSpec(occlusion=True)):
        with pytest.raises(ConfigError, match="with known joints"):
            assemble(Scene([Target(nameless, rcs=rcs)]), [0.0], **seen())
    with pytest.raises(ConfigError, match="pass wavelength_m"):
        assemble(Scene([Target(walk, rcs="surfaces")]), [0.0])
    with pytest.raises(ConfigError, match="height is unknown"):
        build_skeleton(walk.with_facts(height_m=float("nan")))
    with pytest.raises(ConfigError, match="segment head has no length; use rcs kind 'body_parts'"):
        build_skeleton(walk.with_positions(0.0 * walk.position_m))


def test_the_mean_of_an_ellipsoid_is_that_over_horizontal_directions():
    body = compute_ellipsoids(build_skeleton(quadruped_gait(duration_s=1.2)))
    centre = body.centre_m.mean(axis=(0, 1))
    turns = np.arange(180) * np.pi / 90
    around = [see_ellipsoids(body, 1e6 * np.array([np.cos(a), np.sin(a), 0.0]) + centre)[1].mean(axis=0) for a in turns]
    np.testing.assert_allclose(mean_rcs_m2(body), np.mean(around, axis=0), rtol=0.02)
    total = np.sum(around, axis=1)
    assert total.max() > 1.1 * total.min()


def surface(axes, n=900):
    """Return points, outward normals and areas in the ellipsoid's axes."""
    a, b, c = axes
    polar, azimuth = (np.arange(n) + 0.5) * np.pi / n, np.arange(2 * n) * np.pi / n
    u, v = np.meshgrid(polar, azimuth, indexing="ij")
    sphere = np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], axis=-1).reshape(-1, 3)
    normal = sphere / [a, b, c]
    stretch = np.sqrt((normal**2).sum(axis=1))
    area = a * b * c * stretch * np.sin(u).ravel() * (np.pi / n) ** 2
    return sphere * [a, b, c], normal / stretch[:, None], area


def swinging(axes, angle_rad):
    """Return an ellipsoid swinging in x and z, and its frames."""
    zero, one = np.zeros_like(angle_rad), np.ones_like(angle_rad)
    along = np.stack([np.sin(angle_rad), zero, -np.cos(angle_rad)], axis=-1)
    side = np.stack([zero, one, zero], axis=-1)
    centre = np.array([0.0, 0.0, 0.8]) + axes[2] * along
    return Ellipsoids(centre[:, None], along[:, None], side[:, None], np.array([axes])), np.stack(
        [side, np.cross(along, side), along], axis=-1
    )


def one_segment(body):
    """The skeleton of one swinging ellipsoid, 250 frames a second."""
    ends = np.stack(
        [body.centre_m[:, 0] + sign * body.semi_axes_m[0, 2] * body.along[:, 0] for sign in (-1, 1)], axis=1
    )
    joints = make_motion(ends, rate_hz=250.0, markers=["top", "end"], parts=["", ""])
    return Skeleton(joints, (Segment("limb", "left_thigh", "top", "end", 1.0, 1.0),), body.semi_axes_m)


def integral(point, normal, area, radar, wavelength_m, back=None):
    """Sum the currents on the lit side with their own distances.

    Physical optics, with the receiver at ``back`` if it is elsewhere. The square of the result is the cross section
    over the fourth power of the range.
    """
    ways = [np.asarray(end) - point for end in (radar, radar if back is None else back)]
    there, home = (np.sqrt((way**2).sum(axis=1)) for way in ways)
    cosines = [(way * normal).sum(axis=1) / far for way, far in zip(ways, (there, home), strict=True)]
    lit = np.where(np.minimum(*cosines) > 0, sum(cosines) / 2, 0.0)
    phase = np.exp(-2j * np.pi / wavelength_m * (there + home))
    return np.sqrt(4 * np.pi) / wavelength_m * (lit * area / there / home * phase).sum()


SWING = 0.5 * np.sin(2 * np.pi * 1.0 * np.arange(0, 0.5, 1 / 250))


def test_phase_and_doppler_are_those_of_the_physical_optics_integral():
    """The mesh is far above resonance (k a = 90)."""
    axes = (0.16, 0.13, 0.26)
    body, frames = swinging(axes, SWING)
    wavelength_m, radar, every = 0.01, np.array([4.0, 0.5, 0.9]), 5
    k, times = 2 * np.pi / wavelength_m, np.arange(SWING.size)[::every] / 250
    point, normal, area = surface(axes, 360)
    echo = np.empty(times.size, dtype=complex)
    for i in range(times.size):
        frame = frames[i * every]
        place = body.centre_m[i * every, 0] + point @ frame.T
        echo[i] = integral(place, normal @ frame.T, area, radar, wavelength_m)
    points = find_nearest_points(one_segment(body), body, radar)
    range_m, approach_mps, other_m, middle_mps = np.empty((4, times.size))
    fill_ranges(fit_spline(points), times, radar, range_m[:, None], approach_mps[:, None])
    error = np.unwrap(np.angle(echo * np.exp(2j * k * range_m)))
    assert np.ptp(error) < 0.02
    doppler_mps = -np.gradient(range_m - error / (2 * k), times, edge_order=2)
    assert np.abs(doppler_mps - approach_mps)[2:-2].max() < 0.005
    middle = fit_spline(points.with_positions(body.centre_m))
    fill_ranges(middle, times, radar, other_m[:, None], middle_mps[:, None])
    assert np.abs(middle_mps - doppler_mps)[2:-2].max() > 0.15  # so far off is the middle of the segment
    level_db = 20 * np.log10(np.abs(echo) * range_m**2) - 10 * np.log10(see_ellipsoids(body, radar)[1][::every, 0])
    assert np.abs(level_db).max() < 0.1


@pytest.mark.parametrize("distance_m", [0.1, 1.0, 8.0])
def test_the_echo_of_a_sphere_spreads_from_behind_its_surface(distance_m):
    """A long one is curved by a and by c^2 / a."""
    a, c = 0.13, 6.0
    ball, rod = (Ellipsoids(*np.eye(3)[[1, 2, 0]][:, None, None] * [[[0]], [[1]], [[1]]], np.array([axes]))
                 for axes in ((a, a, a), (a, a, c)))  # fmt: skip
    radar = np.array([0.0, a + distance_m, 0.0])
    near = 1 + a / distance_m
    assert see_ellipsoids(ball, radar)[1][0, 0] == pytest.approx(np.pi * a**2 / near**2, rel=1e-9)
    long = np.pi * c**2 / near / (1 + c**2 / a / distance_m)
    assert see_ellipsoids(rod, radar)[1][0, 0] == pytest.approx(long, rel=1e-9)
    assert see_ellipsoids(ball, [0.0, 0.0, 0.01])[1][0, 0] == 0.0  # inside


TORSO = Ellipsoids(np.zeros((1, 1, 3)), np.eye(3)[2:, None], np.eye(3)[:1, None], np.array([(0.16, 0.13, 0.28)]))
"""Its axes are those of space."""


@pytest.mark.parametrize("direction", [(0.0, 1.0, 0.0), (0.4, 0.8, 0.3), (0.3, 0.5, -0.7)])
@pytest.mark.parametrize("range_m", [1.0, 2.0, 4.0, 8.0])
def test_the_level_near_the_radar_is_that_of_the_physical_optics_integral(range_m, direction):
    radar = range_m * np.array(direction) / np.linalg.norm(direction)
    amplitude = np.abs(integral(*surface(TORSO.semi_axes_m[0], 400), radar, wavelength_m=0.01))
    distance_m = np.linalg.norm(find_nearest_points(one_segment(TORSO), TORSO, radar).position_m[0, 0] - radar)
    level_db = 20 * np.log10(amplitude * distance_m**2) - 10 * np.log10(see_ellipsoids(TORSO, radar)[1][0, 0])
    assert abs(level_db) < 0.1


@pytest.mark.parametrize(("there_m", "back_m"), [(1.0, 1.0), (1.5, 4.0)])
def test_the_level_at_a_receiver_elsewhere_follows_the_bisector(there_m, back_m):
    """Seen from where the bisector of 30 degrees meets the baseline."""
    side, ahead = np.sin(np.radians(15.0)), np.cos(np.radians(15.0))
    ends = np.array([[there_m], [back_m]]) * [[side, ahead, 0.0], [-side, ahead, 0.0]]
    foot = (ends[0] * back_m + ends[1] * there_m) / (there_m + back_m)
    amplitude = np.abs(integral(*surface(TORSO.semi_axes_m[0], 400), ends[0], 0.01, back=ends[1]))
    point = find_nearest_points(one_segment(TORSO), TORSO, foot).position_m[0, 0]
    ways_m = np.linalg.norm(ends - point, axis=1)
    level_db = 20 * np.log10(amplitude * ways_m.prod()) - 10 * np.log10(see_ellipsoids(TORSO, foot)[1][0, 0])
    assert abs(level_db) < 0.3  # the integral's own edge of the shadow gives ripples of 0.1 to 0.2 dB


@pytest.mark.parametrize("range_m", [0.6, 1.5, 20.0, 1e5])
def test_nearest_points_against_a_minimum_found_blindly(range_m):
    rng = np.random.default_rng(5)
    for seed in range(6):
        axes = tuple(rng.uniform(0.03, 0.3, 3))
        body, frame = turned(seed, axes)
        radar = rng.standard_normal(3)
        radar *= range_m / np.linalg.norm(radar)
        found = find_nearest_points(one_segment(body), body, radar).position_m[0, 0]
        assert (((found @ frame.T) / axes) ** 2).sum() == pytest.approx(1.0, abs=1e-9)
        point = surface(axes, 200)[0] @ frame
        least_m = np.linalg.norm(point - radar, axis=1).min()
        assert least_m - 1e-3 < np.linalg.norm(found - radar) <= least_m + 1e-9 * range_m
        if range_m == 1e5:
            u = radar / range_m
            q = frame.T @ np.diag(np.array(axes) ** 2) @ frame
            np.testing.assert_allclose(found, q @ u / np.sqrt(u @ q @ u), atol=1e-6)


@pytest.mark.parametrize("body", [boulic_walk(speed_mps=1.3, duration_s=1.2), quadruped_gait(duration_s=1.2)])
def test_radial_velocity_is_the_rate_of_the_range_of_the_surface(body):
    """The spline through the frames adds little to ranges at pulse times."""
    times, step_s = np.arange(0.3, 0.9, 0.013), 1e-4
    scene = Scene([Target(body, rcs="surfaces", range_m=3.0, aspect_deg=25.0)])
    motion, radar = place(scene).targets[0].motion, np.array(scene.radar_position_m)
    round_ones = [n for n, segment in enumerate(build_skeleton(motion).segments) if segment.limb is None]

    def surface_range_m(at_s):
        body = compute_ellipsoids(build_skeleton(motion), at_s)
        return np.linalg.norm(see_ellipsoids(body, radar)[0] - radar, axis=-1)[:, round_ones]

    table = assemble(scene, times, **seen()).isel(scatterer=round_ones)
    assert np.abs(table["range"].values - surface_range_m(times)).max() < 1e-5
    rate = (surface_range_m(times + step_s) - surface_range_m(times - step_s)) / (2 * step_s)
    difference = table["radial_velocity"].values + rate
    assert np.abs(difference).max() < 2e-3


def test_a_bistatic_echo_takes_the_shortest_way_over_the_surface():
    walk = boulic_walk(duration_s=1.0)
    receiver = (0.0, 3.0, 1.0)
    scene = Scene([Target(walk, rcs="surfaces", range_m=4.0)], receiver_position_m=receiver)
    motion, times = place(scene).targets[0].motion, np.array([0.2, 0.6])
    table = assemble(scene, times, **seen())
    body = compute_ellipsoids(build_skeleton(motion), times)
    for n in (1, 7):  # torso and a foot
        shape = surface(body.semi_axes_m[n], 300)[0]
        for i in range(times.size):
            along = body.along[i, n]
            side = body.across[i, n] if np.any(body.across[i, n]) else np.cross(along, [1.0, 0, 0])
            side = side / np.linalg.norm(side)
            point = body.centre_m[i, n] + shape @ np.stack([side, np.cross(along, side), along])
            ways = sum(np.linalg.norm(point - np.array(at), axis=1) for at in (scene.radar_position_m, receiver))
            assert table["range"].values[i, n] == pytest.approx(ways.min() / 2, abs=2e-3)

"""Bodies: ellipsoids (E-08c, E-08f, E-08g), limbs and what hides them (E-08e), by closed forms, integrals and rays."""

from dataclasses import replace

import numpy as np
import pytest

from doppelgait.core.errors import ConfigError
from doppelgait.core.labels import read_axis
from doppelgait.motion import make_motion, read
from doppelgait.motion.models import human_gait
from doppelgait.motion.models.boulic import LENGTHS, boulic_walk
from doppelgait.motion.models.quadruped import quadruped_gait
from doppelgait.pipeline import choose_lowest_prf
from doppelgait.radar import Radar
from doppelgait.scene import RcsSpec, Scene, Target, assemble, bodies, place
from doppelgait.scene.bodies import (
    ROUND_SHARE,
    Ellipsoids,
    Limb,
    Segment,
    Skeleton,
    build_skeleton,
    compute_ellipsoids,
    draw_surface,
    ellipsoid_rcs_m2,
    find_nearest_points,
    make_limbs,
    see_ellipsoids,
)

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
        frame = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
        body = Ellipsoids(np.zeros((1, 1, 3)), frame[None, None, 2], frame[None, None, 0], np.array([axes]))
        radar = rng.standard_normal(3)
        radar *= range_m / np.linalg.norm(radar)
        found = find_nearest_points(one_segment(body), body, radar).position_m[0, 0]
        assert (((found @ frame.T) / axes) ** 2).sum() == pytest.approx(1.0, abs=1e-9)
        least_m = np.linalg.norm(surface(axes, 200)[0] @ frame - radar, axis=1).min()
        assert least_m - 1e-3 < np.linalg.norm(found - radar) <= least_m + 1e-9 * range_m
        if range_m == 1e5:  # of a plane wave
            along = frame @ (radar / range_m)
            assert see_ellipsoids(body, radar)[1][0, 0] == pytest.approx(ellipsoid_rcs_m2(axes, along), rel=1e-4)
    assert see_ellipsoids(body, [0.0, 0.0, 0.001])[1][0, 0] == 0.0  # inside


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


SMOOTH = np.zeros((2, 128))
PULSES_S = np.arange(0.0, 1.0, 0.002)


def fade(s):
    return np.sin(0.5 * np.pi * np.minimum(1.0, np.minimum(s, 1 - s) / ROUND_SHARE)) ** 2


@pytest.mark.parametrize("wavelength_m", [0.0411, 0.005])
def test_a_cylinder_reflects_as_physical_optics_has_it(wavelength_m):
    """Its cross section is k a l^2 broadside, and the spectrum of its fading ends aside (a third of the main lobe)."""
    limb, k = Limb(0.4, (0.06, 0.06), 0.0, SMOOTH), 2 * np.pi / wavelength_m
    s = (np.arange(2000) + 0.5) / 2000
    for sine in np.array([0.0, 0.2, 0.4]) * wavelength_m / limb.length_m:
        size, _ = limb.compute_field(np.array([sine]), np.array([1e6]), wavelength_m)
        spectrum = abs((fade(s) * np.exp(2j * k * limb.length_m * sine * s)).mean())
        assert size[0] == pytest.approx(limb.length_m * np.sqrt(k * 0.06) * spectrum, rel=0.01)


def test_a_bulging_limb_is_an_ellipsoid_about_its_middle():
    limb = Limb(0.4, (0.05, 0.05), 0.04, SMOOTH)
    size, _ = limb.compute_field(np.zeros(1), np.full(1, 1e6), 0.005)
    assert size[0] ** 2 == pytest.approx(np.pi * 0.05 * 0.4 / (8 * 0.04), rel=0.1)  # pi R1 R2


RUN = human_gait(gait="run", speed_mps=3.5, duration_s=1.2)
GALLOP = quadruped_gait(gait="gallop", speed_mps=4.0, duration_s=1.2)


def test_roughness_has_the_drawn_height_and_correlation(monkeypatch):
    skeleton, lag_m = build_skeleton(boulic_walk(duration_s=1.0)), 0.02
    for name, law in {"ROUGHNESS_M": (0.002, 0.002), "CORRELATION_M": (lag_m, lag_m)}.items():
        monkeypatch.setattr(bodies, name, law)
    waves_m = np.array([draw_surface(skeleton, np.random.default_rng(n)).waves_m for n in range(400)])
    power = 0.5 * np.square(waves_m).sum(axis=2).mean(axis=0)  # of each limb's waves
    length_m = np.array([limb.length_m for limb in make_limbs(skeleton, draw_surface(skeleton, None), 1.75).values()])
    turns = 2 * np.pi * 0.8 * np.arange(1, 129) * lag_m / length_m[:, None]
    np.testing.assert_allclose(power.sum(axis=1), 0.002**2, rtol=0.1)
    alike = (power * np.cos(turns)).sum(axis=1) / power.sum(axis=1)
    np.testing.assert_allclose(alike, np.exp(-1), atol=0.13)  # the longest waves of 1.25 limbs are missing


@pytest.mark.parametrize("motion", [boulic_walk(duration_s=1.2), RUN, GALLOP], ids=["walk", "run", "gallop"])
@pytest.mark.parametrize("wavelength_m", [0.0411, 0.0125, 0.005])
def test_the_mean_over_directions_is_the_total(motion, wavelength_m):
    totals, rcs = [], {"kind": "surfaces", "total_m2": 0.5}
    for number in range(36):
        target = Target(motion, rcs=rcs, start_position_m=(90.0, 0.0), heading_deg=10.0 * number)
        rows = assemble(Scene([target]), PULSES_S[::5], wavelength_m=wavelength_m, rng=np.random.default_rng(3))
        totals.append(float(rows["rcs"].sum("scatterer").mean()))
    assert np.mean(totals) == pytest.approx(0.5, rel=0.04)


@pytest.mark.parametrize(("receiver_m", "least"), [(None, 0.999), ((0.0, 3.0, 1.0), 0.9985), ((0.0, 8.0, 1.0), 0.99)])
def test_the_echo_of_a_limb_is_the_integral_along_its_rough_line(receiver_m, least):
    wavelength_m, times = 0.0411, PULSES_S[:700]
    walk = human_gait(speed_mps=1.4, duration_s=2.0)
    scene = Scene([Target(walk, rcs="surfaces", range_m=4.0, aspect_deg=20.0)], receiver_position_m=receiver_m)
    rows = assemble(scene, times, wavelength_m=wavelength_m, rng=np.random.default_rng(1))
    skeleton, k = build_skeleton(place(scene).targets[0].motion), 2 * np.pi / wavelength_m
    body, surface = compute_ellipsoids(skeleton, times), draw_surface(skeleton, np.random.default_rng(1))
    ends = np.array([scene.radar_position_m, receiver_m or scene.radar_position_m])
    s = (np.arange(1500) + 0.5) / 1500
    turns = 2 * np.pi * 0.8 * np.outer(s, np.arange(1, 129))  # waves of 1.25 limbs and shorter
    for n, limb in make_limbs(skeleton, surface, walk.facts.height_m).items():
        along = body.along[:, n, None]
        line = body.centre_m[:, n, None] + (s - 0.5)[:, None] * limb.length_m * along
        sight = sum((end - line) / np.linalg.norm(end - line, axis=-1, keepdims=True) for end in ends)
        side = sight - (sight * along).sum(axis=-1, keepdims=True) * along
        side /= np.linalg.norm(side, axis=-1, keepdims=True)
        radius = limb.radii_m[0] + (limb.radii_m[1] - limb.radii_m[0]) * s
        height = limb.bulge * limb.length_m * (1 - (2 * s - 1) ** 2)
        height += np.cos(turns) @ limb.waves_m[0] + np.sin(turns) @ limb.waves_m[1]
        skin = line + (radius + height)[:, None] * side
        ways = sum(np.linalg.norm(end - skin, axis=-1) for end in ends)
        wanted = (fade(s) * np.sqrt(radius) * np.exp(-1j * k * ways)).mean(axis=1)
        echo, phase = rows["rcs"].values[:, n] ** 0.5, rows["path_phase"].values[:, n]
        echo = echo * np.exp(1j * (phase - 2 * k * rows["range"].values[:, n]))
        alike = abs(np.vdot(wanted, echo)) / np.linalg.norm(wanted) / np.linalg.norm(echo)
        assert alike > least, (skeleton.segments[n].name, alike)


def test_the_lowest_frame_rate_is_that_of_the_ends_of_limbs():
    scenes = [Scene([Target(RUN, rcs=kind)]) for kind in ("surfaces", "auto", "equal")]
    assert len({choose_lowest_prf(scene, Radar.preset("x4"), cpi_s=0.1).prf_hz for scene in scenes}) == 1


def ball(centre, radius=0.2):
    shape = (1, 1, 3)
    z = np.broadcast_to([0.0, 0.0, 1.0], shape)
    return bodies.Ellipsoids(
        np.broadcast_to(centre, shape).astype(float), z.copy(), np.zeros(shape), np.full((1, 3), radius)
    )


def none_own(n_points, n_ellipsoids=1):
    return np.zeros((n_points, n_ellipsoids), dtype=bool)


def matrices(body):
    """Inverse shape matrices of all ellipsoids from their axes, shape (I, S, 3, 3)."""
    across, upright, along = np.moveaxis(body.semi_axes_m, -1, 0)
    side = body.across.copy()
    bare = (np.abs(side).sum(axis=-1) == 0)[..., None]
    # an ellipsoid of revolution has any side
    guess = np.cross(body.along, np.where(np.abs(body.along[..., :1]) < 0.9, [1.0, 0, 0], [0, 1.0, 0]))
    side = np.where(bare, guess / np.linalg.norm(guess, axis=-1, keepdims=True), side)
    up = np.cross(body.along, side)
    return sum(
        np.einsum("isj,isk->isjk", e, e) / (s**2)[None, :, None, None]
        for e, s in ((side, across), (up, upright), (body.along, along))
    )


def marched(points, body, own, radar, n_steps=1500):
    """Smallest quadratic form along every line of sight over all ellipsoids that may hide, shape (I, P)."""
    inverse = matrices(body)
    smallest = np.full(points.shape[:2], np.inf)
    for step in np.linspace(0, 1, n_steps) ** 2 * 0.5:  # the nearer half, finer near the point
        ray = points + step * (radar - points)
        offset = ray[:, :, None] - body.centre_m[:, None]
        form = np.einsum("ipsj,isjk,ipsk->ips", offset, inverse, offset)
        smallest = np.minimum(smallest, np.where(own[None], np.inf, form).min(axis=-1))
    return smallest


@pytest.mark.parametrize("aspect_deg", [0.0, 60.0, 90.0, 170.0])
@pytest.mark.parametrize("body", [boulic_walk(duration_s=1.0), quadruped_gait(duration_s=1.0)])
def test_who_is_hidden_is_what_marched_rays_say(body, aspect_deg):
    scene = Scene([Target(body, aspect_deg=aspect_deg)])
    placed = place(scene).targets[0].motion
    motion = replace(placed, positions=placed.positions.isel(time=slice(0, 250, 50)))
    body = bodies.compute_ellipsoids(bodies.build_skeleton(motion))
    points, radar = motion.position_m, np.array(scene.radar_position_m)
    own = bodies.find_own_points(points, body)
    gain = bodies.compute_visible_power(points, body, own, radar, edge_m=1e-5)
    form = marched(points, body, own, radar)
    within = marched(points, body, own, points, n_steps=1) < 1  # in another limb of the model: not a line past it
    clear = (np.abs(form - 1) > 1e-2) & ~within  # the steps of the march are not finer than that
    hidden = form < 1
    np.testing.assert_array_equal(gain[clear] < 0.5, hidden[clear])
    assert clear[~within].mean() > 0.98
    assert within.mean() < 0.06  # shoulders and elbows of a dog reach into its chest, which bends with the trunk
    assert set(np.unique(gain[clear])) <= {0.0, 1.0}
    assert (hidden.any(), (~hidden).any()) == (True, True)


def test_the_border_of_a_ball_is_where_and_as_wide_as_stated():
    radius, radar = 0.2, np.array([1e8, 0.0, 0.0])
    height = np.linspace(0, 0.4, 401)
    points = np.stack([np.full(401, -2.0), np.zeros(401), height], axis=-1)[None]
    gain = bodies.compute_visible_power(points, ball([0, 0, 0], radius), none_own(401), radar)[0]
    assert (gain[height < radius - bodies.EDGE_M * 1.2] == 0).all()
    assert (gain[height > radius + bodies.EDGE_M * 1.2] == 1).all()
    assert (np.diff(gain) >= 0).all()
    assert gain[200] == pytest.approx(0.25, abs=0.01)  # at the edge half the amplitude
    # first-order clearance of a ball, (h^2 - r^2) / (2 h), and the ramp of degree 5
    clearance = (height[1:] ** 2 - radius**2) / (2 * height[1:])
    x = np.clip((clearance + bodies.EDGE_M) / (2 * bodies.EDGE_M), 0, 1)
    np.testing.assert_allclose(gain[1:], (6 * x**5 - 15 * x**4 + 10 * x**3) ** 2, atol=1e-6)


def test_an_ellipsoid_does_not_hide_what_it_contains():
    walk = boulic_walk(duration_s=1.0)
    skeleton = bodies.build_skeleton(walk)
    own = bodies.find_own_points(walk.position_m, bodies.compute_ellipsoids(skeleton))
    names, points = [s.name for s in skeleton.segments], walk.markers
    for n, segment in ((n, s) for n, s in enumerate(skeleton.segments) if not s.joint):
        assert own[points.index(segment.start), n], names[n]
        assert own[points.index(segment.end), n], names[n]
    assert not own[points.index("left_hand"), names.index("torso")]
    assert own.sum() < 0.25 * own.size


@pytest.mark.shared
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

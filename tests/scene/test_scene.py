"""Geometry (E-03 to E-05), radar cross sections (E-08), placing of targets, truth."""

import math

import numpy as np
import pytest

from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, DoppelgaitWarning, MotionError
from doppelgait.core.labels import read_axis
from doppelgait.motion import make_motion
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.motion.models.quadruped import quadruped_gait
from doppelgait.motion.paths import TurnAroundPath
from doppelgait.motion.retime import body_centre_m
from doppelgait.pipeline import Run, simulate
from doppelgait.radar import Radar
from doppelgait.radar.link import received_power_w
from doppelgait.radar.simulate import synthesise
from doppelgait.scene import (
    RcsSpec,
    Scene,
    Target,
    assemble,
    compute_body_track,
    compute_part_weights,
    compute_scatterers,
    line_of_sight,
    place,
    scatterer_rcs_m2,
)
from doppelgait.scene.observe import compute_bistatic_spreading
from doppelgait.scene.placement import leashed_dog, side_by_side


def points(paths, rate_hz=100.0, parts=None, **facts):
    """Motion of points given as functions of time over 2 s."""
    t = np.arange(0, 2.0 + 0.5 / rate_hz, 1 / rate_hz)
    position = np.stack([np.stack(np.broadcast_arrays(*path(t)), axis=-1) for path in paths], axis=1)
    names = [f"p{n}" for n in range(len(paths))]
    return make_motion(position, rate_hz=rate_hz, markers=names, parts=parts or ["torso"] * len(paths), facts=facts)


def test_aspect_is_undefined_for_a_point_that_stands_e04():
    sight = line_of_sight(np.tile([5.0, 0, 0], (2, 1)), np.array([[0.049, 0, 0], [0.051, 0, 0]]), [0, 0, 1])
    assert np.isnan(sight.aspect_rad[0])
    assert np.isfinite(sight.aspect_rad[1])


def test_radial_velocity_is_minus_the_derivative_of_range_e04():
    motion = points(
        [
            lambda t: (1.0 * t, 0.3 * np.sin(4 * t), 1 + 0.1 * np.cos(5 * t)),
            lambda t: (1.0 * t + 0.3 * np.sin(6 * t), 0.2 + 0 * t, 0.5 + 0 * t),
        ]
    )
    scene = Scene([Target(motion, range_m=4.0, bearing_deg=25.0, aspect_deg=40.0)], radar_position_m=(0.5, -1, 1.3))
    t = np.arange(0, 1.9, 1e-4)
    table = assemble(scene, t)
    derivative = np.gradient(table["range"].values, 1e-4, axis=0)
    np.testing.assert_allclose(-derivative[5:-5], table["radial_velocity"].values[5:-5], atol=2e-6)
    placed = place(scene).targets[0].motion
    start = placed.position_m[0]
    distance = np.sqrt(((start - np.array([0.5, -1, 1.3])) ** 2).sum(axis=-1))
    np.testing.assert_allclose(table["range"].values[0], distance, rtol=1e-12)


@pytest.mark.parametrize("bearing_deg", [0.0, 30.0, -100.0])
@pytest.mark.parametrize("aspect_deg", [0.0, 45.0, -90.0, 180.0])
def test_target_is_where_it_was_asked_to_be_at_mid_observation(bearing_deg, aspect_deg):
    motion = points([lambda t: (2 + 0.6 * t, 0.8 * t, 1 + 0 * t)])  # 1 m/s along (0.6, 0.8)
    scene = Scene(
        [Target(motion, range_m=4.0, bearing_deg=bearing_deg, aspect_deg=aspect_deg)], radar_position_m=(1.0, 2.0, 1.0)
    )
    sight = compute_body_track(place(scene).targets[0], scene, [0.999, 1.0, 1.001])
    assert sight.range_m[1] == pytest.approx(4.0)
    assert np.degrees(sight.azimuth_rad[1]) == pytest.approx(bearing_deg)
    assert np.degrees(sight.aspect_rad[1]) == pytest.approx(abs(aspect_deg), abs=1e-4)
    assert sight.radial_velocity_mps[1] == pytest.approx(np.cos(np.radians(aspect_deg)), abs=1e-9)


def test_positive_aspect_turns_the_walk_counter_clockwise():
    motion = points([lambda t: (t, 0 * t, 1 + 0 * t)])
    scene = Scene([Target(motion, range_m=4.0, aspect_deg=90.0)])
    placed = place(scene).targets[0].motion
    # approaching is -x; 90 degrees counter-clockwise of that is -y
    np.testing.assert_allclose(placed.position_m[-1, 0, :2] - placed.position_m[0, 0, :2], [0, -2], atol=1e-12)


def test_a_target_follows_its_path_from_its_start():
    motion = points([lambda t: (t, 0 * t, 1 + 0 * t)])
    arc = {"kind": "arc", "radius_m": 1.0, "turn_deg": 90}
    scene = Scene([Target(motion, start_position_m=(3.0, -1.0), heading_deg=90.0, path=arc)], duration_s=1.5)
    placed = place(scene).targets[0].motion
    t = placed.time_s
    # a left turn from heading +y: the centre of the circle is 1 m in -x
    expected = np.stack([2 + np.cos(t), -1 + np.sin(t), np.ones_like(t)], axis=-1)
    np.testing.assert_allclose(placed.position_m[:, 0], expected, atol=1e-6)


def test_a_path_of_a_scene_file_and_its_mistakes(tmp_path):
    target = """
[[targets]]
motion = { kind = "boulic" }
start_position_m = [6.0, 0.0]
heading_deg = 180
path = { kind = "turn_around", out_m = 2.5, radius_m = 0.5 }
"""
    path = tmp_path / "scene.toml"
    path.write_text("duration_s = 4.0" + target)
    assert Run.from_toml(path).scene.targets[0].path == TurnAroundPath(out_m=2.5, radius_m=0.5)
    path.write_text("duration_s = 4.0" + target.replace("out_m = 2.5", "out_m = -1"))
    with pytest.raises(ConfigError, match=r"targets\.0\.path\.out_m \(line 6\): -1 is not allowed: must be"):
        Run.from_toml(path)


def test_paths_that_do_not_suit_their_target():
    walk = boulic_walk(duration_s=3.0)
    with pytest.raises(ConfigError, match="a path needs start_position_m and heading_deg"):
        Target(walk, path={"kind": "straight"})
    start = {"start_position_m": (5.0, 0.0), "heading_deg": 180.0}
    short = Target(walk, path={"kind": "arc", "radius_m": 1, "turn_deg": 90}, **start)
    with pytest.raises(MotionError, match=r"targets\.0: path kind 'arc': is 1\.57 m long and takes 1\.309 s, but 2 s"):
        place(Scene([short], duration_s=2.0))
    assert place(Scene([short])).observation_s == pytest.approx(1.308)
    with pytest.raises(MotionError, match=r"targets\.0: boulic: lasts 3\.000 s on its path, but 4 s are wanted"):
        place(Scene([Target(walk, path={"kind": "straight"}, **start)], duration_s=4.0))


@pytest.mark.parametrize(
    "path",
    [None, {"kind": "arc", "radius_m": 3.0, "turn_deg": 90}, {"kind": "turn_around", "out_m": 2.0, "radius_m": 2.0}],
    ids=["none", "arc", "u"],
)
def test_a_leashed_dog_keeps_its_place_beside_the_person(path):
    walk, dog = boulic_walk(speed_mps=1.3, duration_s=8.0), quadruped_gait(speed_mps=1.3, duration_s=9.0)
    person = Target(walk, label="human", start_position_m=(7, 1), heading_deg=170, path=path)
    scene = Scene(leashed_dog(person, dog, side_m=-0.5, ahead_m=0.0), duration_s=3.0)
    assert [t.label for t in scene.targets] == ["human", "dog"]
    bodies = [body_centre_m(t.motion)[:600, :2] for t in place(scene).targets]
    apart = bodies[1] - bodies[0]
    assert np.hypot(*apart.T).mean() == pytest.approx(0.5, abs=0.02)
    heading = np.gradient(bodies[0], axis=0)
    right = (heading[:, 1] * apart[:, 0] - heading[:, 0] * apart[:, 1]) / np.hypot(*heading.T)
    assert right[5:-5].min() > 0.4


def test_companions_that_cannot_keep_together_are_refused():
    walk = boulic_walk(speed_mps=1.3, duration_s=4.0)
    person = Target(walk, start_position_m=(7, 1), heading_deg=170)
    turning = person.replace(path={"kind": "turn_around", "out_m": 2})
    for make, says in (
        (lambda: side_by_side(Target(walk), Target(walk)), "needs start_position_m"),
        (lambda: leashed_dog(person, quadruped_gait(speed_mps=2.5, duration_s=4.0)), r"1\.3 m/s .* within 30 %"),
        (lambda: side_by_side(turning, person), "two targets side by side cannot turn on the spot"),
    ):
        with pytest.raises(ConfigError, match=says):
            make()
    behind = Scene(side_by_side(person, Target(walk, label="second"), side_m=0.0, ahead_m=-1.5))
    first, second = (body_centre_m(t.motion)[:, :2] for t in place(behind).targets)
    np.testing.assert_allclose(np.hypot(*(first - second).T), 1.5, atol=1e-6)


def test_default_range_keeps_the_closest_approach_at_2_m():
    slow, fast = (points([lambda t, v=v: (v * t, 0 * t, 1 + 0 * t)]) for v in (0.5, 4.0))
    for motion, middle in ((slow, 5.0), (fast, 6.0)):
        scene = Scene([Target(motion)])
        assert compute_body_track(place(scene).targets[0], scene, [1.0]).range_m[0] == pytest.approx(middle)


def test_observation_is_the_shortest_motion_unless_given():
    walkers = [Target(boulic_walk(duration_s=s)) for s in (1.0, 2.0)]
    assert place(Scene(walkers)).observation_s == pytest.approx(1.0)
    assert place(Scene(walkers, duration_s=0.7)).observation_s == 0.7
    with pytest.raises(ConfigError, match=r"targets\.0.*lasts 1\.000 s.*1\.5 s.*duration_s to 1\.0 or less"):
        place(Scene(walkers, duration_s=1.5))
    with pytest.raises(MotionError, match=r"1\.000 s"):
        assemble(Scene(walkers), [0.0, 1.2])


PERSON = ["torso", "head", "left_thigh", "right_thigh", "left_shank", "right_shank", "left_foot", "right_foot"]
PERSON += ["left_upper_arm", "right_upper_arm", "left_forearm", "right_forearm", "left_hand", "right_hand"]


BODY, SHARES = PERSON[:10], [0.5, 0.1, 0.07, 0.07, 0.055, 0.055, 0.015, 0.015, 0.03, 0.03]


@pytest.mark.parametrize(
    ("parts", "wanted"),
    [
        ([*BODY, "left_hand", "right_hand"], [*SHARES, 0.03, 0.03]),  # forearms leave their share to the hands
        ([*BODY, "left_hand", "left_hand", "right_hand", "", "wand"], [*SHARES, 0.015, 0.015, 0.03, 0, 0]),
        (["torso", "head", "", ""], [0.5, 0.1, 0.2, 0.2]),  # unknown points share what absent parts would get
        (["", "left_foot", ""], [1 / 3] * 3),  # without a known trunk all points alike
    ],
)
def test_shares_of_points_by_part_e08(parts, wanted):
    np.testing.assert_allclose(scatterer_rcs_m2(RcsSpec(total_m2=1.0), parts, 80.0), wanted, atol=1e-12)
    whole = compute_part_weights(PERSON)
    assert whole[[10, 12]].sum() == pytest.approx(0.03)  # forearm and hand
    assert whole.sum() == pytest.approx(1.0)


def test_total_rcs_follows_the_mass_with_one_law_for_every_class_e08b():
    for spec, parts, mass_kg, total_m2 in (
        (RcsSpec(), PERSON, 80.0, 0.8),
        (RcsSpec(), ["trunk", "head"], 20.0, 0.2),
        (RcsSpec(), ["trunk"], 4.5, 0.045),
        (RcsSpec(total_m2=0.3), PERSON, 80.0, 0.3),
        (RcsSpec(), PERSON, float("nan"), 0.8),
    ):
        assert scatterer_rcs_m2(spec, parts, mass_kg).sum() == pytest.approx(total_m2)
    np.testing.assert_allclose(scatterer_rcs_m2(RcsSpec(kind="equal"), PERSON, 80.0), 0.8 / 14)
    with pytest.raises(ConfigError, match="body_parts"):
        scatterer_rcs_m2(RcsSpec(kind="body_parts"), ["", "nose"], 80.0)


@pytest.mark.parametrize(
    ("unknown", "message"),
    [
        ("left_toe", r"points without a known body part: left_toe\. They share"),
        ("base neck left_hip right_hip left_shoulder right_shoulder", "the trunk is unknown.*base, neck"),
    ],
)
def test_points_of_unknown_parts_are_warned_of_by_name_e08(unknown, message):
    walk = boulic_walk(speed_mps=1.2, duration_s=1.0)
    parts = ["" if name in unknown.split() else part for name, part in zip(walk.markers, walk.parts, strict=True)]
    partly = walk.with_points(walk.position_m, walk.markers, parts)
    with pytest.warns(DoppelgaitWarning, match=message):
        compute_scatterers(partly, RcsSpec(), np.array([0.0, 0.1]), [3.0, 0.0, 1.0])


def test_truth_is_the_geometry_that_the_radar_saw():
    walkers = [Target(boulic_walk(speed_mps=1.3, height_m=1.8, duration_s=2.0), label="human", aspect_deg=20.0)]
    walkers.append(Target(boulic_walk(speed_mps=0.7, height_m=1.2, duration_s=2.0), bearing_deg=30.0))
    scene = Scene(walkers)
    recording = simulate(scene, Radar.preset("x4"))
    slow_time_s, wavelength_m = recording.slow_time_s, recording.radar.wavelength_m
    table = assemble(scene, slow_time_s, wavelength_m=wavelength_m)
    assert [t.label for t in recording.truth] == ["human", ""]
    for number, (truth, speed_mps) in enumerate(zip(recording.truth, (1.3, 0.7), strict=True)):
        rows = table.isel(scatterer=table.coords["target"].values == number)
        np.testing.assert_array_equal(truth.scatterers["range"], rows["range"])
        centre = compute_body_track(place(scene).targets[number], scene, slow_time_s)
        np.testing.assert_array_equal(truth.centre_range_m, centre.range_m)
        np.testing.assert_array_equal(truth.centre_velocity_mps, centre.radial_velocity_mps)
        facts = walkers[number].motion.facts
        assert truth.gait_frequency_hz == facts.gait_frequency_hz == 2 * truth.stride_frequency_hz
        assert truth.step_frequency_hz == 2 * truth.stride_frequency_hz
        assert truth.ground_speed_mps == pytest.approx(speed_mps, rel=0.03)
        np.testing.assert_allclose(truth.doppler_hz(wavelength_m), 2 * rows["radial_velocity"].values / wavelength_m)


def test_the_body_to_draw_stands_where_the_radar_saw_it():
    motion = boulic_walk(speed_mps=1.3, height_m=1.8, duration_s=2.0)
    walk = Target(motion, label="human", aspect_deg=50.0, rcs="body_parts")  # the points that are drawn
    scene = Scene([walk], radar_position_m=(0.3, -0.2, 1.4), radar_azimuth_deg=12.0, radar_tilt_deg=-5.0)
    recording = simulate(scene, Radar.preset("x4"))
    truth = recording.truth[0]
    assert (recording.radar_azimuth_deg, recording.radar_tilt_deg) == (12.0, -5.0)
    times = truth.body.coords["time"].values
    assert 50.0 < (times.size - 1) / times[-1] <= 60.0
    range_m = np.linalg.norm(truth.body.values - np.array(recording.radar_position_m), axis=2)
    pulses = np.searchsorted(recording.baseband.coords["slow_time"].values, times)
    np.testing.assert_allclose(range_m, truth.scatterers["range"].values[pulses], atol=2e-6)
    assert list(truth.body.coords["part"].values) == list(truth.scatterers.coords["part"].values)
    assert simulate(scene, Radar.preset("x4"), angles=False).truth[0].body is None


SPEED_OF_LIGHT = 299_792_458.0
TRANSMITTER, RECEIVER = (0.3, -0.4, 1.2), (2.1, 1.5, 0.7)


def observe(scene, times, **options):
    """Scatterer table, and the line of sight of every observed target."""
    placed = place(scene)
    return assemble(placed, times, wavelength_m=0.0411, **options), [
        compute_body_track(one, scene, times) for one in placed.observed
    ]


TIMES = np.arange(60) / 50
VARIABLES = ("range", "radial_velocity", "aspect", "azimuth", "elevation", "rcs", "path_gain")
SURFACES = {"kind": "surfaces", "occlusion": True}


def walker(**options):
    place = {"start_position_m": (5.0, 0.7), "heading_deg": 160.0}
    return Target(boulic_walk(duration_s=1.4), **{**place, **options})


def point(position_m, velocity_mps):
    """Motion of one point in a straight line."""
    return points([lambda t: [a + v * t for a, v in zip(position_m, velocity_mps, strict=True)]])


def test_table_and_centre_track_follow_the_two_ways():
    velocity = np.array([-0.9, 0.5, 0.0])
    motion = point((0, 0, 0.8), velocity)
    heading = math.degrees(math.atan2(velocity[1], velocity[0]))
    target = Target(motion, start_position_m=(4.0, 1.0), heading_deg=heading)
    scene = Scene([target], radar_position_m=TRANSMITTER, receiver_position_m=RECEIVER)
    table, (track,) = observe(scene, TIMES)
    position = np.array([4.0, 1.0, 0.8]) + velocity * TIMES[:, None]
    ways = [position - np.array(end) for end in (TRANSMITTER, RECEIVER)]
    lengths = [np.sqrt((way**2).sum(axis=-1)) for way in ways]
    np.testing.assert_allclose(table["range"].values[:, 0], sum(lengths) / 2, rtol=1e-12)
    closing = -sum((velocity * way).sum(axis=-1) / length for way, length in zip(ways, lengths, strict=True)) / 2
    np.testing.assert_allclose(table["radial_velocity"].values[:, 0], closing, rtol=1e-9)
    np.testing.assert_allclose(table["azimuth"].values[:, 0], np.arctan2(ways[0][:, 1], ways[0][:, 0]), rtol=1e-12)
    np.testing.assert_allclose(np.sin(table["elevation"].values[:, 0]), ways[0][:, 2] / lengths[0], rtol=1e-12)
    away = (velocity * ways[0]).sum(axis=-1) / lengths[0] / np.linalg.norm(velocity)
    np.testing.assert_allclose(np.cos(table["aspect"].values[:, 0]), -away, rtol=1e-9)
    for name, of_table in (("range_m", "range"), ("radial_velocity_mps", "radial_velocity"), ("aspect_rad", "aspect")):
        np.testing.assert_allclose(getattr(track, name), table[of_table].values[:, 0], rtol=1e-9)
    np.testing.assert_array_equal(compute_body_track(place(scene).targets[0], scene, TIMES).range_m, track.range_m)


@pytest.mark.parametrize("rcs", ["auto", {**SURFACES, "fluctuation": "swerling3", "total_spread_db": 3.0}])
def test_a_receiver_at_the_transmitter_is_a_monostatic_radar(rcs):
    alone = Scene([walker(rcs=rcs)], radar_position_m=TRANSMITTER)
    both = alone.replace(receiver_position_m=TRANSMITTER)
    seen, expected = (observe(s, TIMES, rng=np.random.default_rng(5)) for s in (both, alone))
    for name in VARIABLES:
        np.testing.assert_array_equal(seen[0][name].values, expected[0][name].values)
    for name in ("range_m", "radial_velocity_mps", "aspect_rad", "azimuth_rad", "elevation_rad"):
        np.testing.assert_allclose(getattr(seen[1][0], name), getattr(expected[1][0], name), rtol=1e-12, atol=1e-9)
    assert (seen[0].attrs, expected[0].attrs) == ({"bistatic": True}, {})


@pytest.mark.parametrize(("there", "back"), [(3.0, 7.0), (7.0, 3.0), (5.0, 5.0), (0.1, 4.0), (0.05, 0.1)])
def test_echo_has_the_power_of_the_bistatic_radar_equation(there, back):
    radar = Radar.preset("x4")
    power_w = received_power_w(radar, range_m=(there + back) / 2, rcs_m2=0.6 * compute_bistatic_spreading(there, back))
    gain = 10 ** ((radar.tx_gain_dbi + radar.rx_gain_dbi) / 10)
    near = [max(length, 0.2) for length in (there, back)]  # the far field starts at 0.2 m
    wavelength = SPEED_OF_LIGHT / radar.carrier_hz
    expected = 1e-3 * 10 ** (radar.tx_power_dbm / 10) * gain * wavelength**2 * 0.6 / (4 * np.pi) ** 3
    assert power_w == pytest.approx(expected / near[0] ** 2 / near[1] ** 2, rel=1e-12)


def test_occlusion_is_that_of_both_ways():
    target = walker(rcs={"kind": "body_parts", "occlusion": True})
    scene = Scene([target], radar_position_m=(0.0, 0.0, 1.0), receiver_position_m=(3.0, 6.0, 1.0))
    table = assemble(scene, TIMES)
    ways = [assemble(Scene([target], radar_position_m=end), TIMES) for end in ((0.0, 0.0, 1.0), (3.0, 6.0, 1.0))]
    spreading = compute_bistatic_spreading(ways[0]["range"].values, ways[1]["range"].values)
    one, other = (way["path_gain"].values for way in ways)
    np.testing.assert_allclose(table["path_gain"].values, np.sqrt(one * other) * spreading, rtol=1e-9, atol=1e-15)
    assert (np.abs(one - other) > 0.5).any()


def test_background_targets_scatter_but_are_no_targets():
    fan = Target(point((0, 0, 2.0), (0.3, 0, 0)), start_position_m=(3.0, -2.0), heading_deg=90.0, background=True)
    people = [walker(label="first"), walker(label="second", start_position_m=(7.0, 0.0))]
    scene = Scene([people[0], fan, people[1]])
    table, tracks = observe(scene, TIMES)
    numbers = read_axis(table, "target")
    assert numbers.tolist() == [0] * 20 + [-2] + [1] * 20
    assert [target.label for target in scene.observed_targets] == ["first", "second"]
    assert len(tracks) == 2
    for number, target in enumerate(people):
        alone, (track,) = observe(Scene([target]), TIMES)
        np.testing.assert_array_equal(table["range"].values[:, numbers == number], alone["range"].values)
        np.testing.assert_array_equal(tracks[number].range_m, track.range_m)
    assert observe(Scene([fan]), TIMES, angles=False)[1] == []
    fan_m = np.array([3.0, -2.0, 2.0]) + np.array([0, 0.3, 0]) * TIMES[:, None] - np.array(scene.radar_position_m)
    np.testing.assert_allclose(table["range"].values[:, 20], np.linalg.norm(fan_m, axis=-1), rtol=1e-12)


@pytest.mark.parametrize("angles", [True, False])
def test_an_empty_room_has_a_table_without_scatterers(angles):
    scene = Scene([], duration_s=1.5)
    assert place(scene).observation_s == 1.5
    table, tracks = observe(scene, TIMES, angles=angles)
    filled = assemble(Scene([walker()]), TIMES, angles=angles)
    assert (tracks, table.sizes) == ([], {"slow_time": 60, "scatterer": 0})
    assert set(table.data_vars) == set(filled.data_vars)
    for name in filled.variables:
        kinds = [(one[name].dims, one[name].attrs, one[name].dtype.kind) for one in (table, filled)]
        assert kinds[0] == kinds[1]
    np.testing.assert_array_equal(read_axis(table, "slow_time"), TIMES)
    assert not synthesise(table, Radar.preset("x4")).values.any()


def test_a_scene_file_knows_receiver_boresight_and_background():
    walk = {"motion": {"kind": "boulic"}}
    keys = {"radar_azimuth_deg": 30, "radar_tilt_deg": -10, "receiver_position_m": [1.0, 2.0, 0.5], "duration_s": 1.0}
    scene = validate(Scene, {"targets": [walk, {**walk, "background": True, "range_m": 3.0}], **keys})
    assert Scene.model_validate_json(scene.model_dump_json()) == scene
    assert [target.background for target in scene.targets] == [False, True]
    assert (scene.radar_azimuth_deg, scene.radar_tilt_deg) == (30, -10)
    assert scene.receiver_position_m == (1.0, 2.0, 0.5)
    assert Scene(duration_s=2.0).targets == validate(Scene, {"duration_s": 2.0, "targets": []}).targets == ()
    with pytest.raises(ConfigError, match=r"^targets: .* at least 1 item .*, or give duration_s"):
        validate(Scene, {"targets": []})


BOTH = {"start_position_m": (1, 1), "heading_deg": 0.0}


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Target("boulic", start_position_m=(1, 1)), "belong together"),
        (lambda: Target("boulic", aspect_deg=3.0, **BOTH), "set either"),
        (lambda: Scene([]), "at least 1 item"),
        (lambda: Scene(duration_s=1.0, radar_tilt_deg=91.0), "radar_tilt_deg"),
        (lambda: Scene(duration_s=1.0, radar_azimuth_deg=400.0), "radar_azimuth_deg"),
        (lambda: Scene(duration_s=1.0, receiver_position_m=(1.0, 2.0, math.inf)), "receiver_position_m"),
    ],
)
def test_places_that_make_no_sense_are_refused(make, says):
    with pytest.raises(ConfigError, match=says):
        make()

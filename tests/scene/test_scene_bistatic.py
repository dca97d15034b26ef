"""A receiver elsewhere than the transmitter, targets of the background, rooms without targets, the boresight."""

import math

import numpy as np
import pytest

from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError
from doppelgait.core.labels import read_axis
from doppelgait.motion import make_motion
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.radar import Radar
from doppelgait.radar.link import received_power_w
from doppelgait.radar.simulate import synthesise
from doppelgait.scene import Scene, Target, assemble, compute_body_track, place
from doppelgait.scene.observe import compute_bistatic_spreading

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
BODY = {"kind": "surfaces", "occlusion": True}


def walker(**options):
    place = {"start_position_m": (5.0, 0.7), "heading_deg": 160.0}
    return Target(boulic_walk(duration_s=1.4), **{**place, **options})


def point(position_m, velocity_mps, duration_s=1.4):
    """Motion of one point in a straight line."""
    t = np.arange(0, duration_s + 0.005, 0.01)[:, None]
    path = np.asarray(position_m, dtype=float) + np.asarray(velocity_mps, dtype=float) * t
    return make_motion(path[:, None], rate_hz=100.0, markers=["p"], parts=["torso"])


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


@pytest.mark.parametrize("rcs", ["auto", {**BODY, "fluctuation": "swerling3", "total_spread_db": 3.0}])
def test_a_receiver_at_the_transmitter_is_a_monostatic_radar(rcs):
    target = walker(rcs=rcs)
    alone = Scene([target], radar_position_m=TRANSMITTER)
    both = Scene([target], radar_position_m=TRANSMITTER, receiver_position_m=TRANSMITTER)
    seen, expected = (observe(s, TIMES, rng=np.random.default_rng(5)) for s in (both, alone))
    for name in VARIABLES:
        np.testing.assert_array_equal(seen[0][name].values, expected[0][name].values)
    for name in ("range_m", "radial_velocity_mps", "aspect_rad", "azimuth_rad", "elevation_rad"):
        np.testing.assert_allclose(getattr(seen[1][0], name), getattr(expected[1][0], name), rtol=1e-12, atol=1e-9)
    assert seen[0].attrs == {"bistatic": True}
    assert expected[0].attrs == {}


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
    assert tracks == []
    assert table.sizes == {"slow_time": 60, "scatterer": 0}
    assert set(table.data_vars) == set(filled.data_vars)
    for name in filled.variables:
        assert table[name].dims == filled[name].dims
        assert table[name].attrs == filled[name].attrs
        assert table[name].dtype.kind == filled[name].dtype.kind
    np.testing.assert_array_equal(read_axis(table, "slow_time"), TIMES)
    assert not synthesise(table, Radar.preset("x4")).values.any()


def test_a_scene_file_knows_receiver_boresight_and_background():
    fan = {"motion": {"kind": "boulic"}, "background": True, "range_m": 3.0}
    keys = {
        "duration_s": 1.0, "radar_azimuth_deg": 30, "radar_tilt_deg": -10, "receiver_position_m": [1.0, 2.0, 0.5],
    }  # fmt: skip
    scene = validate(Scene, {"targets": [{"motion": {"kind": "boulic"}}, fan], **keys})
    assert Scene.model_validate_json(scene.model_dump_json()) == scene
    assert [target.background for target in scene.targets] == [False, True]
    assert (scene.radar_azimuth_deg, scene.radar_tilt_deg) == (30, -10)
    assert scene.receiver_position_m == (1.0, 2.0, 0.5)
    plain = validate(Scene, {"targets": [{"motion": {"kind": "boulic"}}], "duration_s": 1.0})
    assert (plain.radar_azimuth_deg, plain.radar_tilt_deg, plain.receiver_position_m) == (0.0, 0.0, None)
    empty = validate(Scene, {"duration_s": 2.0, "targets": []})
    assert empty.targets == ()
    assert place(empty).observation_s == 2.0
    assert Scene(duration_s=2.0).targets == ()
    with pytest.raises(ConfigError, match=r"^targets: .* at least 1 item .*, or give duration_s"):
        validate(Scene, {"targets": []})


@pytest.mark.parametrize(
    ("key", "value"),
    [("radar_tilt_deg", 91.0), ("radar_azimuth_deg", 400.0), ("receiver_position_m", (1.0, 2.0, math.inf))],
)
def test_places_of_the_radar_that_make_no_sense_are_refused(key, value):
    with pytest.raises(ConfigError, match=key):
        Scene(duration_s=1.0, **{key: value})

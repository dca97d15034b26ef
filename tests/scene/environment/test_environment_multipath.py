"""Echoes by the floor and by a wall beside the scene, against explicit mirror geometry and the two-ray closed form."""

import numpy as np
import pytest

from doppelgait.core.errors import ConfigError, DoppelgaitWarning
from doppelgait.scene.environment import GroundBounce, Setting, Wall, WallGhost, apply_environment
from echo_table import LAMBDA_M, echo_table, echoes, rows

K = 2 * np.pi / LAMBDA_M
RADAR = np.array([0.3, -0.2, 1.1])
SETTING = Setting(LAMBDA_M, tuple(RADAR), 0.4)
GLASS = {"permittivity": 6.0, "conductivity_s_per_m": 0.05}
DOWN = np.array([1.0, 1.0, -1.0])


def two_ray(direct_m, image_m, coefficient):
    """Field of all four paths: there and back by either way."""
    one_way = np.exp(-1j * K * direct_m) / direct_m + coefficient * np.exp(-1j * K * image_m) / image_m
    return one_way**2


def moving(n_points=5, n_pulses=600, seed=3):
    """Positions and velocities of points on smooth closed ways in front of the radar, well above the floor."""
    rng = np.random.default_rng(seed)
    t = np.arange(n_pulses) / 1000.0
    centre = rng.uniform([3, -0.8, 0.8], [5, 1.2, 1.6], (n_points, 3))
    swing, rate = rng.uniform(0.1, 0.5, (2, n_points, 3)) * np.array([1.0, 20.0])[:, None, None]
    phase = rng.uniform(0, 6, (n_points, 3))
    angle = rate * t[:, None, None] + phase
    return t, centre + swing * np.sin(angle), swing * rate * np.cos(angle)


def mirrored(position, point, normal):
    """Image of points in a plane."""
    return position - 2 * ((position - point) @ normal)[..., None] * normal


@pytest.mark.parametrize("polarisation", ["vertical", "horizontal"])
def test_floor_is_the_two_ray_field(polarisation):
    _, position, _ = moving()
    after = apply_environment(
        echo_table(position, RADAR),
        [GroundBounce(material=GLASS, roughness_m=0.004, polarisation=polarisation)],
        SETTING,
    )
    direct = np.linalg.norm(position - RADAR, axis=-1)
    image = np.linalg.norm(position * DOWN - RADAR, axis=-1)
    sine = (position[..., 2] + RADAR[2]) / image
    eps = 6.0 - 1j * 0.05 / (2 * np.pi * 7.29e9 * 8.8541878e-12)
    root = np.sqrt(eps - 1 + sine**2)
    scale = eps if polarisation == "vertical" else 1.0
    fresnel = (scale * sine - root) / (scale * sine + root)
    coefficient = fresnel * np.exp(-2 * (K * 0.004 * sine) ** 2)
    total = echoes(after).reshape(600, 3, 5).sum(axis=1)
    np.testing.assert_allclose(total, two_ray(direct, image, coefficient), rtol=2e-5)


def test_floor_images_lie_and_move_as_the_mirrored_points():
    t, position, velocity = moving()
    after = apply_environment(echo_table(position, RADAR, t, velocity_mps=velocity), [GroundBounce()], SETTING)
    expected = echo_table(position * DOWN, RADAR, t, velocity_mps=velocity * DOWN)
    twice, once = rows(after, ":double_bounce"), rows(after, ":bounce")
    for name in ("range", "azimuth", "elevation"):
        np.testing.assert_allclose(twice[name], expected[name].values, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(twice["radial_velocity"], expected["radial_velocity"].values, atol=1e-3)
    direct = after.isel(scatterer=slice(0, 5))
    for name in ("range", "radial_velocity"):
        mean = 0.5 * (direct[name].values + expected[name].values)
        np.testing.assert_allclose(once[name], mean, atol=1e-3 if "vel" in name else 1e-12)
    np.testing.assert_allclose(once["azimuth"], direct["azimuth"].values, atol=1e-12)
    middle = 0.5 * (direct["elevation"].values + expected["elevation"].values)  # same azimuth: halfway is the mean
    np.testing.assert_allclose(once["elevation"], middle, atol=1e-12)


def test_points_on_or_under_the_floor_reflect_in_themselves():
    table = echo_table([[[4.0, 0.0, 0.0], [4.0, 1.0, -0.02]]], RADAR)
    after = apply_environment(table, [GroundBounce(material="metal", polarisation="horizontal")], SETTING)
    expected = np.tile(table["range"].values[0], 3)
    np.testing.assert_allclose(after["range"].values[0], expected, rtol=1e-12)
    assert np.abs(echoes(after).reshape(3, 2).sum(axis=0)).max() < 1e-4  # the bounce cancels the direct way


def test_floor_needs_a_radar_above_it_angles_and_one_antenna_place():
    table = echo_table([[[4.0, 0.0, 1.0]]], RADAR)
    with pytest.raises(ConfigError, match="'ground_bounce': the radar is at a height of 0 m"):
        apply_environment(table, [GroundBounce()], Setting(LAMBDA_M, (0, 0, 0.0)))
    with pytest.raises(ConfigError, match="'ground_bounce' needs azimuth and elevation"):
        apply_environment(table.drop_vars(["azimuth", "elevation"]), [GroundBounce()], SETTING)
    apart = table.assign_attrs(bistatic=True)
    for effect in (GroundBounce(), Wall(loss_db=3, range_m=2), WallGhost(material="wood", thickness_m=0.1, side_m=2)):
        with pytest.raises(ConfigError, match=f"{effect.kind!r} needs a monostatic radar"):
            apply_environment(apart, [effect], SETTING)
    np.testing.assert_allclose(apply_environment(apart, [Wall(loss_db=3)], SETTING)["path_gain"], 10**-0.6)


POINT, NORMAL_DEG = np.array([1.0, 3.0, 0.0]), 100.0
NORMAL = np.array([np.cos(np.radians(NORMAL_DEG)), np.sin(np.radians(NORMAL_DEG)), 0.0])
BESIDE = {"position_m": (1.0, 3.0), "normal_azimuth_deg": NORMAL_DEG, "material": GLASS, "thickness_m": 0.05}


@pytest.mark.parametrize("normal_deg", [NORMAL_DEG, NORMAL_DEG + 180.0])
def test_ghosts_lie_and_move_as_the_mirrored_points(normal_deg):
    t, position, velocity = moving()
    table = echo_table(position, RADAR, t, velocity_mps=velocity)
    after = apply_environment(table, [WallGhost(**{**BESIDE, "normal_azimuth_deg": normal_deg})], SETTING)
    image = mirrored(position, POINT, NORMAL)
    expected = echo_table(image, RADAR, t, velocity_mps=mirrored(velocity, 0.0, NORMAL))
    ghost, mixed = rows(after, ":ghost"), rows(after, ":ghost_mixed")
    for name in ("range", "azimuth", "elevation"):
        np.testing.assert_allclose(ghost[name], expected[name].values, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(ghost["radial_velocity"], expected["radial_velocity"].values, atol=1e-3)
    mean = 0.5 * (table["radial_velocity"].values + expected["radial_velocity"].values)
    np.testing.assert_allclose(mixed["radial_velocity"], mean, atol=1e-3)
    np.testing.assert_allclose(mixed["range"], 0.5 * (table["range"].values + expected["range"].values), rtol=1e-12)
    one, other = ((p - RADAR) / np.linalg.norm(p - RADAR, axis=-1, keepdims=True) for p in (position, image))
    between = one + other
    np.testing.assert_allclose(mixed["azimuth"], np.arctan2(between[..., 1], between[..., 0]), atol=1e-12)
    share = (POINT - RADAR) @ NORMAL / ((image - RADAR) @ NORMAL)  # where the way to the image meets the wall
    specular = RADAR + share[..., None] * (image - RADAR)
    np.testing.assert_allclose((specular - POINT) @ NORMAL, 0.0, atol=1e-12)
    legs = np.linalg.norm(specular - RADAR, axis=-1) + np.linalg.norm(position - specular, axis=-1)
    np.testing.assert_allclose(ghost["range"], legs, rtol=1e-12)


def test_ghosts_are_the_two_ray_field_of_a_vertical_radar_in_a_level_scene():
    _, position, _ = moving()
    position = position * [1.0, 1.0, 0.0] + [0.0, 0.0, RADAR[2]]  # level rays: purely te
    after = apply_environment(echo_table(position, RADAR), [WallGhost(**BESIDE)], SETTING)
    image = mirrored(position, POINT, NORMAL)
    direct, length = (np.linalg.norm(p - RADAR, axis=-1) for p in (position, image))
    cosine = (image - RADAR) @ NORMAL / length
    eps = 6.0 - 1j * 0.05 / (2 * np.pi * 7.29e9 * 8.8541878e-12)
    root = np.sqrt(eps - 1 + cosine**2)
    inside = (cosine - root) / (cosine + root)
    turn = np.exp(-2j * K * 0.05 * root)
    coefficient = inside - (1 - inside**2) * inside * turn * sum((inside**2 * turn) ** n for n in range(40))
    total = echoes(after).reshape(600, 3, 5).sum(axis=1)
    np.testing.assert_allclose(total, two_ray(direct, length, coefficient), rtol=2e-4)


@pytest.mark.parametrize("polarisation", ["vertical", "horizontal"])
def test_ghost_of_metal_is_the_image_of_the_field_in_a_perfect_conductor(polarisation):
    _, position, _ = moving(n_points=40, n_pulses=1)
    wall = WallGhost(**{**BESIDE, "material": "metal", "polarisation": polarisation})
    after = apply_environment(echo_table(position, RADAR), [wall], SETTING)
    image = mirrored(position, POINT, NORMAL)
    out = (image - RADAR) / np.linalg.norm(image - RADAR, axis=-1, keepdims=True)
    back = out - 2 * (out @ NORMAL)[..., None] * NORMAL

    def field(u):
        across = np.cross([0.0, 0.0, 1.0], u)
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        return across if polarisation == "horizontal" else np.cross(u, across)

    # the tangential field turns over, the normal one stays
    normal_part = (field(out) @ NORMAL)[..., None] * NORMAL
    reflected = 2 * normal_part - field(out)
    coefficient = (reflected * field(back)).sum(axis=-1)
    direct, length = (np.linalg.norm(p - RADAR, axis=-1) for p in (position, image))
    mixed = echoes(rows(after, ":ghost_mixed"))
    expected = 2 * coefficient * np.exp(-1j * K * (direct + length)) / (direct * length)
    np.testing.assert_allclose(mixed, expected, rtol=0, atol=4e-3 * np.abs(expected).max())


@pytest.mark.parametrize(("side", "sign"), [("left", 1), ("right", -1)])
def test_wall_on_a_side_of_the_boresight(side, sign):
    after = apply_environment(
        echo_table([[[0.0, 5.0, 0.0]]], (0, 0, 0.0)),  # the boresight is +y, left of it is -x
        [WallGhost(material="wood", thickness_m=0.1, side_m=2.0, side=side)],
        Setting(LAMBDA_M, (0, 0, 0.0), np.pi / 2),
    )
    ghost = rows(after, ":ghost")
    assert ghost["range"].item() == pytest.approx(np.hypot(5, 4))
    assert ghost["azimuth"].item() == pytest.approx(np.arctan2(5, -4 * sign))


def test_who_is_behind_the_wall_has_no_ghost_and_who_crosses_it_is_told():
    t = np.arange(50) / 50
    y = np.stack([1.0 + 0 * t, 4.0 + 0 * t, 1.01 + 2 * t], axis=-1)  # in front, behind, through a wall at y = 2
    position = np.stack([3.0 + 0 * y, y, 1.0 + 0 * y], axis=-1)
    table = echo_table(position, (0, 0, 1.0), t, names=["near", "far", "walker"])
    wall = WallGhost(material="brick", thickness_m=0.1, side_m=2.0)
    crossing = r"1 of 3 scatterers cross the wall, first walker at 0.50 s"
    with pytest.warns(DoppelgaitWarning, match=crossing) as caught:
        after = apply_environment(table, [wall], Setting(LAMBDA_M, (0, 0, 1.0)))
    assert caught[0].filename == __file__
    assert list(after["marker"].values[3:]) == [
        f"{n}:{k}" for k in ("ghost_mixed", "ghost") for n in ("near", "walker")
    ]
    gain = after["path_gain"].values[:, 3:]
    assert (gain[:25] > 0).all()
    assert (gain[25:, [1, 3]] == 0).all()
    assert (gain[25:, [0, 2]] > 0).all()
    assert np.isfinite(after["range"].values).all()


def test_images_have_no_images_and_cross_walls():
    _, position, _ = moving(n_points=2, n_pulses=3)
    table = echo_table(position, RADAR)
    table["target"] = ("scatterer", [0, -2])  # a target and a body of the background
    ghost = WallGhost(**BESIDE)
    both = apply_environment(table, [GroundBounce(), ghost], SETTING)
    other = apply_environment(table, [ghost, GroundBounce()], SETTING)
    assert both.sizes["scatterer"] == other.sizes["scatterer"] == 10
    np.testing.assert_allclose(np.sort(both["range"]), np.sort(other["range"]), rtol=1e-12)
    assert list(both["target"].values[2:]) == [-1, -2] * 4
    behind = apply_environment(table, [GroundBounce(), Wall(loss_db=10)], SETTING)
    alone = apply_environment(table, [GroundBounce()], SETTING)
    np.testing.assert_allclose(behind["path_gain"], 0.01 * alone["path_gain"].values, rtol=1e-12)


def test_a_wall_that_goes_through_the_radar_is_refused():
    wall = WallGhost(material="brick", thickness_m=0.1, position_m=(RADAR[0] + 1, RADAR[1]), normal_azimuth_deg=90)
    with pytest.raises(ConfigError, match="passes through the radar"):
        apply_environment(echo_table([[[4.0, 0.0, 1.0]]], RADAR), [wall], SETTING)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("effect", [GroundBounce(), WallGhost(**BESIDE), Wall(material="wood", thickness_m=0.1)])
def test_single_pulses(effect):
    single = apply_environment(echo_table([[[4.0, 0.0, 1.0]]], RADAR), [effect], SETTING)
    assert np.isfinite(single["radial_velocity"].values).all()

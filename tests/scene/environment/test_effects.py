"""Materials and walls (ITU-R P.2040), furniture in the way, gain by range."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import fresnel

from doppelgait.core.errors import ConfigError, DoppelgaitWarning
from doppelgait.scene.environment import Screen, Setting, Wall, apply_environment, materials
from doppelgait.scene.environment.effects import Visibility, apply_visibility, knife_edge_db
from doppelgait_conformance.theory import refracted_radii_m
from echo_table import C_MPS, LAMBDA_M, echo_table

K = 2 * np.pi / LAMBDA_M
ANGLES_DEG = np.array([0.0, 12.0, 30.0, 47.0, 63.0, 80.0])
COSINES = np.cos(np.radians(ANGLES_DEG))
SLAB = {"permittivity": 5.24 - 0.54j, "thickness_m": 0.043, "wavelength_m": LAMBDA_M}
SETTING = Setting(LAMBDA_M, (0.0, 0.0, 1.0), 0.0)


def film(permittivity, thickness_m, angle_deg, mode):
    """Reflection and transmission of a film by its characteristic matrix (Born and Wolf, 1.6)."""
    cosine = np.cos(np.radians(angle_deg))
    index_cosine = np.sqrt(complex(permittivity - np.sin(np.radians(angle_deg)) ** 2))
    outside, inside = (cosine, index_cosine) if mode == "te" else (1 / cosine, permittivity / index_cosine)
    beta = K * thickness_m * index_cosine
    m = np.array([[np.cos(beta), 1j * np.sin(beta) / inside], [1j * inside * np.sin(beta), np.cos(beta)]])
    front = m @ np.array([1.0, outside])
    t = 2 * outside / (outside * front[0] + front[1])
    r = (outside * front[0] - front[1]) / (outside * front[0] + front[1])
    return (r if mode == "te" else -r), t  # its tm coefficient is of the tangential field, ours of the upright one


@pytest.mark.parametrize(
    ("name", "real", "conductivity"),
    [
        ("concrete", 5.24, 0.25766), ("brick", 3.91, 0.033826), ("plasterboard", 2.73, 0.066978),
        ("wood", 1.99, 0.049528), ("glass", 6.31, 0.068299), ("chipboard", 2.58, 0.12044),
    ],
)  # fmt: skip
def test_materials_at_9_ghz_are_those_of_another_programs_table(name, real, conductivity):
    # MATLAB's buildingMaterialPermittivity, documented example at 9 GHz
    eps = materials.relative_permittivity(name, wavelength_m=C_MPS / 9e9)
    assert eps.real == pytest.approx(real, rel=1e-3)
    assert -eps.imag * 9 / 17.98 == pytest.approx(conductivity, rel=1e-4)


def test_own_material_and_its_loss_and_the_ground_by_frequency():
    own = materials.Dielectric(permittivity=4.0, conductivity_s_per_m=0.1)
    eps = materials.relative_permittivity(own, wavelength_m=C_MPS / 5e9)
    assert eps == pytest.approx(4.0 - 1j * 0.1 / (2 * np.pi * 5e9 * 8.8541878e-12), rel=3e-4)
    low, high = (materials.relative_permittivity("medium_dry_ground", wavelength_m=C_MPS / f) for f in (2e9, 8e9))
    assert high.real / low.real == pytest.approx(4.0**-0.1)
    assert high.imag / low.imag == pytest.approx(4.0**0.63)


def test_band_of_a_material():
    with pytest.warns(DoppelgaitWarning, match=r"floorboard: .* 50 to 100 GHz, but the carrier is 7.29 GHz"):
        materials.relative_permittivity("floorboard", wavelength_m=LAMBDA_M)
    with pytest.raises(ConfigError, match=r"wet_ground: .* 1 to 10 GHz, but the carrier is 24 GHz"):
        materials.relative_permittivity("wet_ground", wavelength_m=C_MPS / 24e9)
    with pytest.raises(ConfigError, match="'gold' is not known; known are concrete"):
        materials.relative_permittivity("gold", wavelength_m=LAMBDA_M)
    assert {"concrete", "glass", "very_dry_ground"} <= set(materials.MATERIALS)


@pytest.mark.parametrize("mode", ["te", "tm"])
def test_slab_equals_the_characteristic_matrix(mode):
    r = materials.slab_reflection(COSINES, mode=mode, **SLAB)
    t = materials.slab_transmission(COSINES, mode=mode, **SLAB)
    expected = [film(SLAB["permittivity"], SLAB["thickness_m"], angle, mode) for angle in ANGLES_DEG]
    np.testing.assert_allclose(r, [one[0] for one in expected], rtol=1e-9)
    np.testing.assert_allclose(t, [one[1] for one in expected], rtol=1e-9)


def test_delay_at_an_angle_is_that_of_the_refracted_way():
    eps, d, wall_m, far_m, aside_m = 3.91, 0.115, 2.0, 6.0, 2.4

    def way(x, y):  # crosses the faces x and x + y aside
        rest = far_m - wall_m - d
        return np.hypot(wall_m, x) + np.sqrt(eps) * np.hypot(d, y) + np.hypot(rest, aside_m - x - y)

    shortest = minimize(lambda at: way(*at), [0.8, 0.02], tol=1e-12).fun  # Fermat
    straight = np.hypot(far_m, aside_m)
    delay = materials.slab_delay_m(far_m / straight, permittivity=eps + 0j, thickness_m=d)
    assert delay == pytest.approx(shortest - straight, rel=3e-3)


@pytest.mark.parametrize("thickness_m", [0.004, 0.3])
@pytest.mark.parametrize("mode", ["te", "tm"])
def test_many_rays_by_fewer_values(mode, thickness_m):
    cosines = np.random.default_rng(1).uniform(0.1, 1.0, (300, 400))
    options = {"permittivity": 6.31 - 0.13j, "thickness_m": thickness_m, "wavelength_m": LAMBDA_M, "mode": mode}
    calls = []

    def coefficient(c):
        calls.append(c.size)
        return materials.insertion_coefficient(c, **options)

    for rays in (cosines, cosines[:1, :5]):
        quick = materials.interpolate_coefficient(coefficient, rays, thickness_m=thickness_m, wavelength_m=LAMBDA_M)
        np.testing.assert_allclose(quick, materials.insertion_coefficient(rays, **options), rtol=0, atol=3e-5)
    assert calls[0] < cosines.size / 10
    assert calls[1] == 5


def places(n=7, seed=2):
    """Points in front of and behind a wall at x = 3."""
    rng = np.random.default_rng(seed)
    return rng.uniform([1.0, -2.0, 0.0], [6.0, 2.0, 2.0], (1, n, 3))


def spreading(range_m, angle_deg, eps, thickness_m):
    """Two-way power against free space of a bundle of rays through a slab, by Snell's law."""
    radii = [
        refracted_radii_m(r, np.radians(a), index=np.sqrt(eps.real), thickness_m=thickness_m)
        for r, a in zip(range_m, angle_deg, strict=True)
    ]
    return (np.array(range_m) ** 2 / np.prod(radii, axis=1)) ** 2


def test_wall_touches_only_what_is_behind_it():
    table = echo_table(places(40), SETTING.radar_position_m)
    table["path_phase"] = (("slow_time", "scatterer"), np.full((1, 40), 0.3), {"units": "rad"})
    after = apply_environment(table, [Wall(material="brick", thickness_m=0.1, range_m=3.0)], SETTING)
    front = places(40)[0, :, 0] < 3.0
    assert 5 < front.sum() < 35
    for name in table:
        before, then = table[name].values[0], after[name].values[0]
        assert np.array_equal(before[front], then[front])
        if name in ("range", "path_gain", "path_phase"):
            assert (before[~front] != then[~front]).all()
        else:
            assert np.array_equal(before[~front], then[~front])
    assert (after["path_gain"].values[0][~front] < 1).all()
    assert after["slow_time"].equals(table["slow_time"])


def test_wall_turns_with_the_boresight_or_stands_where_it_is_told():
    turn = 0.7
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    wall = Wall(material="wood", thickness_m=0.04, range_m=3.0, polarisation="horizontal")
    straight = apply_environment(echo_table(places(), (0, 0, 1.0)), [wall], SETTING)
    turned = echo_table(places() @ rotation.T, (0, 0, 1.0))
    by_boresight = apply_environment(turned, [wall], Setting(LAMBDA_M, (0, 0, 1.0), turn))
    told = wall.model_copy(update={"normal_azimuth_deg": np.degrees(turn)})
    by_itself = apply_environment(turned, [told], SETTING)
    for other in (by_boresight, by_itself):
        for name in ("range", "path_gain", "path_phase"):
            np.testing.assert_allclose(other[name].values, straight[name].values, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("polarisation", ["vertical", "horizontal"])
def test_oblique_rays_cross_by_their_te_and_tm_parts(polarisation):
    position = places(12) + np.array([0.0, 0.0, 1.5])  # rays that rise
    turn = 0.3
    wall = Wall(material="glass", thickness_m=0.01, normal_azimuth_deg=np.degrees(turn), polarisation=polarisation)
    before = echo_table(position, SETTING.radar_position_m)
    after = apply_environment(before, [wall], SETTING)
    echo = after["path_gain"].values[0] * (before["range"] / after["range"]).values[0] ** 4
    normal, eps = (
        np.array([np.cos(turn), np.sin(turn), 0.0]),
        materials.relative_permittivity("glass", wavelength_m=LAMBDA_M),
    )
    for n, place in enumerate(position[0] - SETTING.radar_position_m):
        u = place / np.linalg.norm(place)
        level = np.cross([0.0, 0.0, 1.0], u)
        field = level if polarisation == "horizontal" else np.cross(u, level)
        field /= np.linalg.norm(field)
        te = np.cross(u, normal) / np.linalg.norm(np.cross(u, normal))
        tm = np.cross(u, te)
        angle = np.degrees(np.arccos(u @ normal))
        t_te, t_tm = (film(eps, 0.01, angle, mode)[1] for mode in ("te", "tm"))
        copolar = t_te * (field @ te) ** 2 + t_tm * (field @ tm) ** 2
        tube = spreading([np.linalg.norm(place)], [angle], eps, 0.01)[0]
        assert echo[n] == pytest.approx(tube * abs(copolar) ** 4, rel=1e-6)


def test_measured_wall_without_and_with_a_place():
    table = echo_table(places(), SETTING.radar_position_m)
    everywhere = apply_environment(table.drop_vars(["azimuth", "elevation"]), [Wall(loss_db=10, delay_m=0.2)], SETTING)
    echo = everywhere["path_gain"] * (table["range"] / everywhere["range"]) ** 4  # the radar equation takes the delay
    np.testing.assert_allclose(echo, 0.01, rtol=1e-12)  # 10 dB each way
    np.testing.assert_allclose(everywhere["range"], table["range"] + 0.2)
    assert "path_phase" not in everywhere
    behind = places()[0, :, 0] > 3.0
    placed = apply_environment(table, [Wall(loss_db=10, delay_m=0.2, range_m=3.0)], SETTING)
    echo = placed["path_gain"] * (table["range"] / placed["range"]) ** 4
    np.testing.assert_allclose(echo.values[0], np.where(behind, 0.01, 1.0))
    np.testing.assert_allclose(placed["range"].values[0], table["range"].values[0] + 0.2 * behind)


def test_radial_velocity_stays_minus_the_rate_of_the_range():
    t = np.arange(400) / 500
    x = np.stack([4.0 + 0.3 * np.sin(5 * t), 2.0 * np.sin(3 * t), 1.0 + 0.2 * np.cos(4 * t)], axis=-1)[:, None]
    v = np.stack([1.5 * np.cos(5 * t), 6.0 * np.cos(3 * t), -0.8 * np.sin(4 * t)], axis=-1)[:, None]
    table = echo_table(x, SETTING.radar_position_m, t, velocity_mps=v)
    after = apply_environment(table, [Wall(material="concrete", thickness_m=0.3)], SETTING)
    rate = np.gradient(after["range"].values[:, 0], t)
    np.testing.assert_allclose(after["radial_velocity"].values[2:-2, 0], -rate[2:-2], atol=1e-3)
    assert np.abs(after["radial_velocity"] - table["radial_velocity"]).max() > 0.02


SOFA = Screen(from_m=(3.0, -1.0), to_m=(3.0, 1.0), height_m=0.8, loss_db=200.0)


def levels_db(places_m, spec=SOFA, radar_m=(0.0, 0.0, 1.0)):
    """One-way loss of scatterers at places (n, 3) of the room."""
    before = echo_table(np.asarray(places_m, dtype=float)[None, :, :], radar_m)
    after = apply_environment(before, (spec,), Setting(LAMBDA_M, radar_m, 0.0))
    assert after["range"].identical(before["range"])
    return -5.0 * np.log10(after["path_gain"].values / before["path_gain"].values)[0]


def test_a_knife_edge_is_within_0_7_db_of_fresnels_integral():
    v = np.linspace(0.0, 20.0, 400)
    sine, cosine = fresnel(v)
    exact = -20 * np.log10(np.abs((0.5 - cosine) - 1j * (0.5 - sine)) / np.sqrt(2))
    assert np.abs(knife_edge_db(v) - exact).max() < 0.7
    assert knife_edge_db(np.array([-0.9, -50.0])).tolist() == [0.0, 0.0]


def test_the_loss_of_the_material_is_the_most():
    board = SOFA.model_copy(update={"loss_db": 2.5})
    assert levels_db([[5, 0, 0.1]], board)[0] == pytest.approx(2.5)


def test_the_shadow_begins_without_a_jump_at_the_top_and_at_both_ends():
    heights = np.linspace(0.0, 1.5, 3001)
    up = levels_db(np.stack([np.full(3001, 5.0), np.zeros(3001), heights], axis=1))
    sideways = np.linspace(-4.0, 4.0, 8001)
    across = levels_db(np.stack([np.full(8001, 5.0), sideways, np.full(8001, 0.0)], axis=1))
    for line in (up, across):
        assert np.abs(np.diff(line)).max() < 0.1
        assert line.max() > 10
        assert line.min() == 0.0
    np.testing.assert_allclose(across, across[::-1], atol=1e-9)
    # at the edge itself half the field arrives: 6 dB
    edge = levels_db([[5, 0, 1 - 0.2 * 5 / 3]])[0]
    assert edge == pytest.approx(6.03, abs=0.1)


def test_a_screen_may_stand_anywhere_and_in_any_order_of_its_ends():
    turn = np.radians(37.0)
    rotate = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    places = np.random.default_rng(0).uniform([3.2, -2, 0], [7, 2, 1.8], (50, 3))
    moved = places.copy()
    moved[:, :2] = places[:, :2] @ rotate.T + [10.0, -4.0]
    ends = [tuple(rotate @ np.array(end) + [10.0, -4.0]) for end in (SOFA.to_m, SOFA.from_m)]
    other = SOFA.model_copy(update={"from_m": ends[0], "to_m": ends[1]})
    np.testing.assert_allclose(levels_db(moved, other, (10.0, -4.0, 1.0)), levels_db(places), atol=1e-9)


def test_an_image_by_the_floor_sees_the_screens_image():
    np.testing.assert_allclose(levels_db([[5, 0.2, -0.1]], radar_m=(0, 0, 0)),
                               levels_db([[5, 0.2, 0.1]], radar_m=(0, 0, 0)))  # fmt: skip


def test_every_echo_at_every_time_by_its_own_range():
    ranges = np.random.default_rng(0).uniform(0.1, 10, (50, 7))
    before = echo_table(ranges[..., None] * [1.0, 0.0, 0.0] + [0.0, 0.0, 1.0], (0.0, 0.0, 1.0))
    before["path_gain"] = before["path_gain"] * 0.3
    points = [(0.5, -200.0), (0.6, -3.0), (8.0, 0.0)]
    seen = apply_visibility(before, Visibility(gain_db=points), SETTING)
    levels_db = np.interp(ranges, *zip(*points, strict=True))
    np.testing.assert_allclose(seen["path_gain"], 0.3 * 10 ** (levels_db / 10), rtol=1e-9)
    np.testing.assert_array_equal(seen["range"], before["range"])

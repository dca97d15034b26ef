"""Limbs as surfaces against a numerical surface integral and closed forms."""

import numpy as np
import pytest

from doppelgait.core.errors import ConfigError
from doppelgait.motion.models import boulic_walk, human_gait, quadruped_gait
from doppelgait.pipeline import choose_lowest_prf
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target, assemble, bodies, place
from doppelgait.scene.bodies import ROUND_SHARE, Limb, build_skeleton, compute_ellipsoids, draw_surface, make_limbs

SMOOTH = np.zeros((2, 128))
T = np.arange(0.0, 1.0, 0.002)


def fade(s):
    return np.sin(0.5 * np.pi * np.minimum(1.0, np.minimum(s, 1 - s) / ROUND_SHARE)) ** 2


def integrate_surface(limb, angle_rad, range_m, wavelength_m):
    """Physical optics of the lit side of a cone, point by point: sqrt(sigma) and phase against the specular point."""
    k, (first, last) = 2 * np.pi / wavelength_m, limb.radii_m
    s = (np.arange(1200) + 0.5) / 1200
    turn = (np.arange(700) + 0.5) / 700 * np.pi - np.pi / 2
    radius = first + (last - first) * s[:, None]
    slope = (last - first) / limb.length_m
    place = np.stack([radius * np.cos(turn), radius * np.sin(turn), (s[:, None] - 0.5) * limb.length_m + 0 * turn], -1)
    normal = np.stack(
        [np.cos(turn) + 0 * s[:, None], np.sin(turn) + 0 * s[:, None], -slope + 0 * radius + 0 * turn], -1
    )
    normal /= np.sqrt(1 + slope**2)
    radar = range_m * np.array([np.cos(angle_rad), 0.0, np.sin(angle_rad)])
    sight = radar - place
    apart = np.linalg.norm(sight, axis=-1)
    lit = np.maximum((normal * sight).sum(-1) / apart, 0.0)
    area = radius * np.sqrt(1 + slope**2) * (limb.length_m / s.size) * (np.pi / turn.size)
    phase = -2 * k * (apart - range_m + (first + last) / 2 * np.cos(angle_rad))
    field = np.sqrt(4 * np.pi) / wavelength_m * (lit * area * fade(s)[:, None] * np.exp(1j * phase)).sum()
    return abs(field), np.angle(field)


@pytest.mark.parametrize("carrier_hz", [7.29e9, 60e9])
@pytest.mark.parametrize(("range_m", "most_db"), [(1.5, 1.5), (40.0, 0.5)])
def test_a_cone_reflects_like_the_integral_over_its_surface(carrier_hz, range_m, most_db):
    wavelength_m, rng = 299792458.0 / carrier_hz, np.random.default_rng(int(range_m))
    for _ in range(3):
        limb = Limb(rng.uniform(0.2, 0.45), tuple(rng.uniform(0.03, 0.09, 2)), 0.0, SMOOTH)
        broadside = -np.arctan((limb.radii_m[1] - limb.radii_m[0]) / limb.length_m)
        for angle in broadside + np.linspace(-0.8, 0.8, 5) * wavelength_m / (2 * limb.length_m):
            size, phase = limb.compute_field(np.array([np.sin(angle)]), np.array([range_m]), wavelength_m)
            wanted, wanted_phase = integrate_surface(limb, angle, range_m, wavelength_m)
            if wanted > 0.3 * limb.length_m:  # main lobe
                assert 20 * np.log10(size[0] / wanted) == pytest.approx(0.0, abs=most_db)
                turned = np.angle(np.exp(1j * (phase[0] - wanted_phase)))
                assert turned == pytest.approx(np.pi / 4, abs=0.3)  # of the circumference, the same for all limbs


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
        rows = assemble(Scene([target]), T[::5], wavelength_m=wavelength_m, rng=np.random.default_rng(3))
        totals.append(float(rows["rcs"].sum("scatterer").mean()))
    assert np.mean(totals) == pytest.approx(0.5, rel=0.04)


@pytest.mark.parametrize(("receiver_m", "least"), [(None, 0.999), ((0.0, 3.0, 1.0), 0.9985), ((0.0, 8.0, 1.0), 0.99)])
def test_the_echo_of_a_limb_is_the_integral_along_its_rough_line(receiver_m, least):
    wavelength_m, times = 0.0411, T[:700]
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


def test_one_point_for_two_joints_is_no_body():
    for motion, name in ((boulic_walk(duration_s=1.0), "neck"), (quadruped_gait(duration_s=1.0), "nose")):
        kept = [n for n, marker in enumerate(motion.markers) if marker != name]
        poor = motion.with_points(
            motion.position_m[:, kept], *([v[n] for n in kept] for v in (motion.markers, motion.parts))
        )
        assert assemble(Scene([Target(poor)]), T[:10], wavelength_m=0.0411).sizes["scatterer"] == len(kept)
        with pytest.raises(ConfigError, match=r"no own point of the motion is (head|nose)"):
            build_skeleton(poor)

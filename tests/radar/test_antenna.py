"""Antenna patterns: beam widths, directivity, rotation of the boresight, their place in the echo."""

import json
import math

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from doppelgait.core.config import format_canonical_json
from doppelgait.core.errors import ConfigError
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.radar import Radar
from doppelgait.radar.antenna import Antenna, apply_antenna, rotate_to_boresight
from doppelgait.radar.link import echo_amplitude_v
from doppelgait.scene import Scene, Target, assemble

RNG = np.random.default_rng(3)


def cosine(azimuth_deg=65.0, elevation_deg=65.0, **options):
    return Antenna(kind="cosine", hpbw_azimuth_deg=azimuth_deg, hpbw_elevation_deg=elevation_deg, **options)


def vectors(azimuth, elevation):
    return np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)


def table(azimuth_rad, elevation_rad, **others):
    """Scatterer table of one frame and no more than what a pattern needs."""
    values = {"azimuth": azimuth_rad, "elevation": elevation_rad, "path_gain": 1.0, "range": 3.0, "rcs": 1.0, **others}
    shape = (1, np.size(azimuth_rad))
    return xr.Dataset(
        {k: (("slow_time", "scatterer"), np.broadcast_to(v, shape), {"units": "1"}) for k, v in values.items()}
    )


def compute_gain(antenna, azimuth_rad, elevation_rad):
    """One-way gain of directions."""
    azimuth_rad, elevation_rad = np.broadcast_arrays(azimuth_rad, elevation_rad)
    return np.sqrt(apply_antenna(table(azimuth_rad, elevation_rad), antenna)["path_gain"].values[0])


def test_equal_beam_widths_make_a_pattern_of_rotation():
    antenna = cosine(50.0, 50.0, floor_db=-100)
    around = RNG.uniform(0, 2 * np.pi, 200)
    off = RNG.uniform(0, np.radians(80), 200)  # true angle off the boresight
    d = np.stack([np.cos(off), np.sin(off) * np.cos(around), np.sin(off) * np.sin(around)])
    gain_db = 10 * np.log10(compute_gain(antenna, np.arctan2(d[1], d[0]), np.arcsin(d[2])))
    # the dB of a power of the cosine are proportional to those of the cosine
    np.testing.assert_allclose(gain_db, -3.0 * np.log(np.cos(off)) / np.log(np.cos(np.radians(25.0))), rtol=1e-9)


def test_the_floor_holds_behind_and_beside_the_antenna():
    antenna = cosine(40.0, 60.0, floor_db=-25.0)
    behind = compute_gain(antenna, [np.pi, -2.0, 1.6, 0.0], [0.0, 0.4, -0.3, np.pi / 2])
    np.testing.assert_allclose(behind, 10**-2.5, rtol=1e-12)
    everywhere = compute_gain(antenna, RNG.uniform(-np.pi, np.pi, 5000), RNG.uniform(-np.pi / 2, np.pi / 2, 5000))
    assert everywhere.min() == pytest.approx(10**-2.5)
    assert everywhere.max() <= 1.0


def test_a_table_is_interpolated_in_db_and_round_the_back():
    cuts = {"azimuth_db": (-20, -6, 0, -4, -10), "elevation_db": (-9, -3, 0, 0, -1)}
    antenna = Antenna(kind="table", angle_deg=(-150, -30, 0, 30, 150), **cuts)
    degrees = np.array([0, 15, -15, 90, -150, 180, -180, 165, -165.0, 540])
    expected_db = [0, -2, -3, -7, -20, -15, -15, -12.5, -17.5, -15]
    np.testing.assert_allclose(10 * np.log10(compute_gain(antenna, np.radians(degrees), 0.0)), expected_db, atol=1e-9)
    tilted_db = 10 * np.log10(compute_gain(antenna, np.radians([0.0, 15.0]), np.radians([-60.0, -15.0])))
    np.testing.assert_allclose(tilted_db, [-4.5, -3.5], atol=1e-9)  # the cuts add in dB


def test_a_table_over_the_full_circle_has_one_value_at_its_seam():
    cut = (-20, -10, 0, -10, -20)
    antenna = Antenna(kind="table", angle_deg=(-180, -90, 0, 90, 180), azimuth_db=cut, elevation_db=(0,) * 5)
    gain_db = 10 * np.log10(compute_gain(antenna, np.radians([-180, 180, 179.1, -179.1, 45]), 0.0))
    np.testing.assert_allclose(gain_db, [-20, -20, -19.9, -19.9, -5], atol=1e-9)
    with pytest.raises(ConfigError, match="azimuth_db: -20 dB at -180 and -19 dB at 180"):
        Antenna(kind="table", angle_deg=(-180, 0, 180), azimuth_db=(-20, 0, -19), elevation_db=(0, 0, 0))


def test_off_boresight_angles_are_those_of_the_rotated_frame():
    azimuth, elevation = RNG.uniform(-np.pi, np.pi, 300), RNG.uniform(-1.5, 1.5, 300)
    for turn, tilt in RNG.uniform(-1.4, 1.4, (5, 2)) * [2, 1]:
        # up is a turn about -y before the turn about z
        rotation = Rotation.from_euler("z", turn) * Rotation.from_euler("y", -tilt)
        wanted = rotation.inv().apply(vectors(azimuth, elevation))
        found = rotate_to_boresight(azimuth, elevation, turn, tilt)
        np.testing.assert_allclose(vectors(*found), wanted, atol=1e-12)
        ahead = rotate_to_boresight(turn, tilt, turn, tilt)
        np.testing.assert_allclose(ahead, 0.0, atol=1e-7)


def test_an_echo_gets_the_pattern_twice():
    antenna = cosine(70.0, 50.0)
    scatterers = table(np.radians([20.0, 55.0, -15.0]), np.radians([10.0, 10.0, 35.0]), path_gain=0.25)
    seen = apply_antenna(scatterers, antenna, boresight_azimuth_rad=math.radians(20), boresight_tilt_rad=0.0)
    radar = Radar.preset("x4")

    def volts(of):
        return echo_amplitude_v(radar, range_m=of["range"].values, rcs_m2=1.0, path_gain=of["path_gain"].values)[0]

    change_db = 20 * np.log10(volts(seen) / volts(scatterers))
    q_elevation = -0.3 / math.log10(math.cos(math.radians(25.0)))
    low_db = 10 * q_elevation * math.log10(math.cos(math.radians(10.0)))  # one way
    assert change_db[0] == pytest.approx(2 * low_db)
    assert change_db[1] == pytest.approx(2 * (low_db - 3.0))
    assert seen["path_gain"].attrs["units"] == "1"
    assert (scatterers["path_gain"].values == 0.25).all()  # the table given stays as it was


def test_a_pattern_needs_directions_and_an_isotropic_antenna_none():
    scene = Scene([Target(boulic_walk(duration_s=1.0))])
    bare = assemble(scene, np.arange(10) / 100, angles=False)
    with pytest.raises(ConfigError, match=r"antenna.kind = 'cosine' needs .* no azimuth and no elevation; .*angles=Tr"):
        apply_antenna(bare, cosine())
    assert apply_antenna(bare, Antenna()) is bare


CUTS = {"angle_deg": (-90, 0, 90), "azimuth_db": (-9, 0, -9), "elevation_db": (-9, 0, -9)}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "cosine", "hpbw_azimuth_deg": 60}, "needs hpbw_elevation_deg"),
        ({"kind": "cosine", "hpbw_azimuth_deg": 60, "hpbw_elevation_deg": 180}, "less than or equal to 179"),
        ({"hpbw_azimuth_deg": 60}, "'isotropic' has no hpbw_azimuth_deg: remove it, or change the kind"),
        ({"kind": "table", **CUTS, "angle_deg": (-90, 0, 0)}, "must rise"),
        ({"kind": "table", **CUTS, "angle_deg": (-90, 0, 181)}, "within -180 to 180"),
        ({"kind": "table", **CUTS, "azimuth_db": (0, 0)}, "azimuth_db has 2 values, angle_deg 3"),
        ({"kind": "table", **CUTS, "elevation_db": (0, 3, 0)}, "elevation_db reaches from 0 to 3 dB"),
    ],
)
def test_parameters_that_do_not_go_together_are_refused(options, message):
    with pytest.raises(ConfigError, match=message):
        Antenna(**options)


def test_the_antenna_is_part_of_the_radar_and_of_its_json():
    plain = Radar.preset("x4")
    assert plain.antenna == Antenna()
    radar = Radar.preset("x4", antenna={"kind": "cosine", "hpbw_azimuth_deg": 65, "hpbw_elevation_deg": 65})
    assert Radar.model_validate_json(format_canonical_json(radar)) == radar
    older = json.loads(format_canonical_json(plain))
    del older["antenna"]  # as of before antennas
    assert Radar.model_validate(older) == plain

"""Torso, legs and limbs of bodies of a few points."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from doppelgait.core.errors import AnalysisError
from doppelgait.core.frames import Frames
from doppelgait.core.labels import BASEBAND, PART_POWER, SIGNATURE, Signal, make_array, read_axis
from doppelgait.processing import Analysis, Gate, signature
from doppelgait.processing.parts import LEGS_AHEAD, LEGS_BEHIND, locate_parts, measure_parts

WAVELENGTH_M, PRF_HZ, SECONDS = 0.041, 800.0, 3.0
PULSE_M, BIN_M = 0.06, 0.05
SPEED_MPS, STRIDE_HZ = 1.3, 0.9
ANALYSIS = Analysis()
TIME_S = np.arange(int(SECONDS * PRF_HZ)) / PRF_HZ
RANGE_M = np.arange(2.0, 9.0, BIN_M)
CENTRE_M = 7.0 - SPEED_MPS * TIME_S


def echo(*offsets_m, strength=1.0, wavelength_m=WAVELENGTH_M):
    """Baseband of points so far behind the body's centre: Gaussian pulses."""
    values = np.zeros((TIME_S.size, RANGE_M.size), dtype=complex)
    for offset_m in offsets_m:
        way_m = (CENTRE_M + offset_m)[:, None]
        pulse = np.exp(-((RANGE_M[None, :] - way_m) ** 2) / (2 * PULSE_M**2))
        values += strength * pulse * np.exp(-4j * np.pi * way_m / wavelength_m)
    return as_baseband(values)


def as_baseband(values):
    return make_array(BASEBAND, values.astype(np.complex64), {"slow_time": TIME_S, "range": RANGE_M})


def swing(amplitude_mps, phase=0.0):
    """Distance of a limb behind the centre, for its largest speed."""
    angular = 2 * np.pi * STRIDE_HZ
    return -amplitude_mps / angular * np.sin(angular * TIME_S + phase)


TORSO = echo(0.0, 0.03, -0.04)
LEG = echo(swing(1.4), swing(1.4, np.pi), strength=0.6)
GATE = Gate(TIME_S, CENTRE_M, 1.6, None, "truth")


def together(*echoes):
    return as_baseband(sum(one.values for one in echoes))


def view(baseband):
    return signature(baseband, GATE, ANALYSIS, wavelength_m=WAVELENGTH_M)


def locate(baseband):
    return locate_parts(Frames.of(baseband), Signal.of(view(baseband), SIGNATURE), GATE, ANALYSIS)


def energies(mask, baseband):
    power = mask.power_v2(Frames.of(baseband), ANALYSIS, wavelength_m=WAVELENGTH_M).label()
    return power.values.sum(axis=(1, 2), dtype=np.float64)


def test_a_limb_is_a_limb_even_where_it_has_the_velocity_of_the_torso():
    body = together(TORSO, LEG)
    mask, reason = locate(body)
    assert reason == ""
    torso, leg = (energies(replace(mask, floor_v2=0.0), part) for part in (TORSO, LEG))
    assert torso[0] > 0.95 * torso.sum()
    # farthest ahead and behind, 0.25 m from the centre, it is as fast as the torso for a quarter of the time
    assert leg[0] < 0.06 * leg.sum()
    flat = energies(replace(mask, floor_v2=0.0, length_m=np.inf), LEG)
    assert flat[0] > 0.15 * flat.sum()


def test_legs_are_what_moves_by_more_than_arms_reach():
    slow = echo(swing(0.6 * LEGS_BEHIND * SPEED_MPS), strength=0.6)
    mask, _ = locate(together(TORSO, slow))
    assert energies(mask, slow)[1] < 0.02 * energies(mask, slow).sum()
    mask, _ = locate(together(TORSO, LEG))
    fast = energies(mask, LEG)
    # how long a sine of amplitude 1.4 m/s is beyond the limits
    beyond = sum(np.arccos(limit * SPEED_MPS / 1.4) / np.pi for limit in (LEGS_AHEAD, LEGS_BEHIND))
    assert fast[1] / fast.sum() == pytest.approx(beyond, abs=0.06)


def test_the_long_trunk_of_an_animal_stays_whole():
    """Points over 0.5 m that move with the body are no limbs."""
    trunk = echo(-0.25, -0.1, 0.03, 0.14, 0.26)
    mask, _ = locate(together(trunk, LEG))
    assert energies(mask, trunk)[0] > 0.95 * energies(mask, trunk).sum()
    narrow, _ = locate(together(TORSO, LEG))
    assert mask.length_m > 2 * narrow.length_m


def test_parts_add_up_to_the_signature():
    body = together(TORSO, LEG)
    mask, _ = locate(body)
    power = mask.power_v2(Frames.of(body), ANALYSIS, wavelength_m=WAVELENGTH_M).label()
    mu = view(body)
    assert np.allclose(read_axis(power, "time"), read_axis(mu, "time"))
    inside = np.abs(read_axis(mu, "velocity") - SPEED_MPS) < 1.4 * SPEED_MPS
    difference = power.values.sum(axis=0)[:, inside] - mu.values[:, inside]
    assert np.abs(difference).max() < 1e-3 * mu.values.max()


def test_noise_does_not_move_the_shares():
    body = together(TORSO, LEG)
    rng = np.random.default_rng(3)
    peak_v2 = np.median(view(body).values.max(axis=1))
    mu = view(body)
    sd = np.sqrt(peak_v2 / 100 / mu.attrs["window_energy"] / mu.attrs["n_gate_bins"] / 2)
    noise = sd * (rng.standard_normal(body.shape) + 1j * rng.standard_normal(body.shape))
    noisy = as_baseband(body.values + noise)
    clean = energies(locate(body)[0], body)
    heard = energies(locate(noisy)[0], noisy)
    assert heard / heard.sum() == pytest.approx(clean / clean.sum(), abs=0.03)
    drowned = as_baseband(body.values + 10 * noise)
    assert locate(drowned) == (None, "snr_below_5_db")


def test_a_torso_without_radial_speed_has_no_parts():
    standing = as_baseband(
        together(TORSO, LEG).values * np.exp(-4j * np.pi * SPEED_MPS * TIME_S / WAVELENGTH_M)[:, None]
    )
    mask, reason = locate(standing)
    assert mask is None
    assert reason == "torso_slower_than_3_doppler_cells"


def test_labels_and_moments_of_a_table_made_by_hand():
    velocity = np.array([-1.0, 0.0, 1.0, 2.0])
    power = np.zeros((3, 2, 4), dtype=np.float32)
    power[0, 0] = (0, 1, 3, 0)
    power[1, 0] = (0, 0, 0, 4)
    power[2, 1] = (2, 0, 0, -1)
    array = make_array(
        PART_POWER, power,
        {"part": np.arange(3.0), "time": [0.0, 0.1], "doppler": velocity * 50, "velocity": ("doppler", velocity)},
        {"parts": "torso legs limbs"},
    )  # fmt: skip
    found = measure_parts(array)
    assert found["label"].values.tolist() == [[-1, 0, 0, 1], [2, -1, -1, -1]]
    assert found["share"].values == pytest.approx([4 / 9, 4 / 9, 1 / 9])
    assert found["velocity_mps"].values[0] == pytest.approx([0.75, np.nan], nan_ok=True)
    assert found["spread_mps"].values[0, 0] == pytest.approx(np.sqrt(3 / 16))
    with pytest.raises(AnalysisError, match="part_power"):
        measure_parts(xr.DataArray(np.zeros((2, 2)), dims=("time", "doppler")))

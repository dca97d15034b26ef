"""What the X-band study displays and measures, on images whose answer is known."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

PRI_S = 1.68e-3
WAVELENGTH_M = 299_792_458.0 / 9.7e9
N_ROWS, N_COLUMNS, COLUMN_S = 256, 624, 8 * PRI_S
ROW_MPS = 9.2 / 256


@pytest.fixture(scope="module")
def measures() -> ModuleType:
    return import_module("xband_measures")


@pytest.fixture(scope="module")
def sensor() -> ModuleType:
    return import_module("xband_sensor")


def tone(velocity_mps: float) -> np.ndarray:
    """Sweeps of a point that approaches at constant speed."""
    return np.exp(2j * np.pi * (2.0 * velocity_mps / WAVELENGTH_M) * PRI_S * np.arange(5120))


def row_of(velocity_mps: float) -> int:
    """Row 0 is +4.6 m/s, row 128 is 0."""
    return round((4.6 - velocity_mps) / ROW_MPS)


def moving_line() -> np.ndarray:
    """A torso at 1.2 m/s, a limb that swings from 1.2 to 3 m/s twice a second, ground, nothing else."""
    image = np.full((N_ROWS, N_COLUMNS), -30.0)
    image[128] = -12.0
    time_s = COLUMN_S * np.arange(N_COLUMNS)
    for column, speed_mps in enumerate(2.1 - 0.9 * np.cos(2 * np.pi * 2.0 * time_s)):
        image[row_of(speed_mps) : row_of(1.2), column] = -18.0
    image[row_of(1.2)] = -11.0
    return image


def test_display_has_the_size_of_the_figures(measures: ModuleType) -> None:
    assert measures.pixel_power(tone(1.0)).shape == (256, 624)


@pytest.mark.parametrize("velocity_mps", [56 * ROW_MPS, -28 * ROW_MPS, 14 * ROW_MPS])
def test_approaching_is_above_zero(measures: ModuleType, velocity_mps: float) -> None:
    power = measures.pixel_power(tone(velocity_mps))
    assert int(power[:, 300].argmax()) == row_of(velocity_mps)
    assert power.max() == pytest.approx(1.0, abs=0.01)  # the window has sum 1


def test_pixel_is_a_windowed_transform_of_its_sweeps(measures: ModuleType) -> None:
    rng = np.random.default_rng(1)
    signal = rng.standard_normal(5120) + 1j * rng.standard_normal(5120)
    n = np.arange(128)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (n + 1) / 129)
    row, column = 100, 37  # bin 28 of 256
    expected = abs((signal[8 * column + n] * window * np.exp(-2j * np.pi * 28 * n / 256)).sum() / window.sum()) ** 2
    assert measures.pixel_power(signal)[row, column] == pytest.approx(expected)


def test_noise_gain_of_a_hann_window(measures: ModuleType) -> None:
    assert measures.noise_gain() == pytest.approx(1.5 / 129)  # sum w^2 / (sum w)^2 = (3/8) / (1/4) / (N + 1)


def test_bursts_lose_their_mean_and_keep_one_bin(measures: ModuleType) -> None:
    baseband = np.zeros((5200, 3), dtype=complex)
    baseband[:, 1], baseband[:, 2] = tone(1.0)[:1].repeat(5200) * 7.0, np.arange(5200)
    bins = [1] * 10 + [2] * 10
    signal = measures.stitched(baseband, bins)
    assert np.abs(signal[:2560]).max() < 1e-12  # static
    assert signal[2560:2816] == pytest.approx(np.arange(256) - 127.5)
    assert signal[2816:3072] == pytest.approx(np.arange(256) - 127.5)


def test_levels_are_below_the_maximum_and_clipped(measures: ModuleType) -> None:
    shown = measures.displayed_db(np.array([[1.0, 0.5, 1e-2, 1e-9, 0.0]]))
    assert shown[0] == pytest.approx([-10.0, -10.0, -20.0, -30.0, -30.0])


def test_going_away_is_turned_over(measures: ModuleType) -> None:
    away = measures.pixel_power(tone(-56 * ROW_MPS))
    turned = measures.towards(away, direction=-1)
    assert int(turned[:, 9].argmax()) == row_of(56 * ROW_MPS)
    assert np.array_equal(measures.towards(turned, direction=-1), away)
    assert measures.towards(away, direction=1) is away


def test_torso_envelope_and_modulation(measures: ModuleType) -> None:
    image = moving_line()
    assert measures.torso_speed_mps(image) == pytest.approx(1.2, abs=ROW_MPS)
    # the 95th percentile of 2.1 - 0.9 cos is 2.1 + 0.9 cos(0.05 pi)
    assert measures.envelope_mps(image) == pytest.approx(2.1 + 0.9 * np.cos(0.05 * np.pi), abs=2 * ROW_MPS)
    assert measures.modulation_hz(image) == pytest.approx(2.0, abs=0.03)


def test_torso_of_clipped_rows_is_their_middle(measures: ModuleType) -> None:
    image = np.full((N_ROWS, N_COLUMNS), -30.0)
    image[row_of(1.6) : row_of(1.0) + 1] = -10.0
    assert measures.torso_speed_mps(image) == pytest.approx(1.3, abs=ROW_MPS)


@pytest.mark.parametrize("mean_db", [-35.0, -31.0, -28.0])
def test_noise_from_the_share_above_the_floor(measures: ModuleType, mean_db: float) -> None:
    rng = np.random.default_rng(2)
    power = rng.standard_exponential((N_ROWS, N_COLUMNS)) * 10 ** (mean_db / 10)
    image = np.clip(10 * np.log10(power), -30.0, -10.0)
    assert measures.noise_db(image) == pytest.approx(mean_db, abs=0.15)


def test_steps_at_the_joints_of_bursts(measures: ModuleType) -> None:
    """The window of column c covers sweeps 8 c to 8 c + 128: its middle is at sweep 256 m in column 32 m - 8."""
    image = np.full((N_ROWS, N_COLUMNS), -25.0)
    image[:, [32 * m - 8 for m in range(1, 20)]] = -19.0
    assert measures.boundary_step_db(image) == pytest.approx(6.0)


def test_distances_of_a_shifted_image(measures: ModuleType) -> None:
    rng = np.random.default_rng(3)
    image = rng.uniform(-28, -20, size=(N_ROWS, 1)) + rng.uniform(-1, 1, size=(N_ROWS, N_COLUMNS))
    assert measures.histogram_distance_db(image, image + 2.0) == pytest.approx(2.0)
    for ground in (True, False):
        assert measures.profile_distance(image, image + 2.0, ground=ground) == pytest.approx((2.0, 1.0))
    changed = image.copy()
    changed[row_of(0.3) : row_of(-0.3) + 1] += 5.0
    assert measures.profile_distance(image, changed, ground=False)[0] == pytest.approx(0.0)
    assert measures.profile_distance(image, changed, ground=True)[0] > 1.0


def test_ground_sways_as_much_as_stated(sensor: ModuleType) -> None:
    """Gaussian sway of exponentially distributed size: the mean square over points is 2 m^2."""
    motion = sensor.ground(400.0, np.random.default_rng(4))
    along_m = motion.position_m[:, :, 0]
    sway_m = along_m - along_m.mean(axis=0)
    assert np.mean(sway_m**2) == pytest.approx(2 * sensor.SWAY_M**2, rel=0.15)
    speed_mps = np.diff(along_m, axis=0) * motion.rate_hz
    assert np.mean(speed_mps**2) == pytest.approx(2 * (sensor.SWAY_M / sensor.SWAY_S) ** 2, rel=0.15)


def test_velocity_axis_ends_where_the_figures_do(sensor: ModuleType) -> None:
    assert pytest.approx(4.6, abs=0.005) == sensor.RADAR.unambiguous_velocity_mps


def test_missing_data_are_named(sensor: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"decoded_levels\.npz: not there"):
        sensor.real_levels(tmp_path)
    np.savez(tmp_path / "decoded_levels.npz", human__NormalToward=np.zeros((256, 624), dtype=np.uint8))
    with pytest.raises(SystemExit, match="has no human__NormalAway"):
        sensor.real_levels(tmp_path)

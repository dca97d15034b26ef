"""What the X-band study displays and measures, on images whose answer is known."""

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

PRI_S = 1.68e-3
WAVELENGTH_M = 299_792_458.0 / 9.7e9
N_ROWS, N_COLUMNS = 256, 624
ROW_MPS = 9.2 / 256


@pytest.fixture(scope="module")
def measures() -> ModuleType:
    return import_module("xband_measures")


def tone(velocity_mps: float) -> np.ndarray:
    """Sweeps of a point that approaches at constant speed."""
    return np.exp(2j * np.pi * (2.0 * velocity_mps / WAVELENGTH_M) * PRI_S * np.arange(5120))


@pytest.mark.parametrize("velocity_mps", [56 * ROW_MPS, -28 * ROW_MPS, 14 * ROW_MPS])
def test_approaching_is_above_zero(measures: ModuleType, velocity_mps: float) -> None:
    power = measures.pixel_power(tone(velocity_mps))
    assert int(power[:, 300].argmax()) == round((4.6 - velocity_mps) / ROW_MPS)  # row 0 is +4.6 m/s
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


@pytest.mark.parametrize("mean_db", [-35.0, -31.0, -28.0])
def test_noise_from_the_share_above_the_floor(measures: ModuleType, mean_db: float) -> None:
    rng = np.random.default_rng(2)
    power = rng.standard_exponential((N_ROWS, N_COLUMNS)) * 10 ** (mean_db / 10)
    image = np.clip(10 * np.log10(power), -30.0, -10.0)
    assert measures.noise_db(image) == pytest.approx(mean_db, abs=0.15)


def test_ground_sways_as_much_as_stated(images: ModuleType) -> None:
    """Gaussian sway of exponentially distributed size: the mean square over points is 2 m^2."""
    motion = images.ground(400.0, np.random.default_rng(4))
    along_m = motion.position_m[:, :, 0]
    sway_m = along_m - along_m.mean(axis=0)
    assert np.mean(sway_m**2) == pytest.approx(2 * images.SWAY_M**2, rel=0.15)
    speed_mps = np.diff(along_m, axis=0) * motion.rate_hz
    assert np.mean(speed_mps**2) == pytest.approx(2 * (images.SWAY_M / images.SWAY_S) ** 2, rel=0.15)


def test_missing_data_are_named(measures: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "decoded_levels.npz"
    with pytest.raises(SystemExit, match=r"decoded_levels\.npz: not there"):
        measures.read_levels(path)
    np.savez(path, human__NormalToward=np.zeros((256, 624), dtype=np.uint8))
    with pytest.raises(SystemExit, match="has no human__NormalAway"):
        measures.read_levels(path, ["human__NormalToward", "human__NormalAway"])

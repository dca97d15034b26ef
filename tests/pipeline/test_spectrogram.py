"""Foreign spectrograms as signatures: axes, clips, blanking, and gait whose answer is known."""

import json
from typing import Any

import numpy as np
import pytest
import xarray as xr

import doppelgait as dg
from doppelgait import processing
from doppelgait.core.errors import AnalysisError
from doppelgait.motion.models import boulic_walk
from doppelgait.pipeline import analyze, simulate
from doppelgait.pipeline.spectrogram import convert_levels_to_signature, make_level_gate
from doppelgait.pipeline.target import analyze_signature
from doppelgait.processing import Analysis
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target

WAVELENGTH_M = 0.03
PRF_HZ, CPI_PULSES, HOP = 600.0, 120, 6
N_COLUMNS, N_ROWS = 400, 240
TIME_S = 0.1 + HOP / PRF_HZ * np.arange(N_COLUMNS)
DOPPLER_HZ = 2.5 * (np.arange(N_ROWS) - 120)
"""Two rows to a resolution cell of 5 Hz, whose width in velocity is 0.075 m/s."""
TIMING: dict[str, Any] = {
    "wavelength_m": WAVELENGTH_M, "prf_hz": PRF_HZ, "cpi_pulses": CPI_PULSES, "hop": HOP, "range_m": (0.0, 50.0),
}  # fmt: skip
ANALYSIS = Analysis(cpi_s=CPI_PULSES / PRF_HZ)


def signature_of(level_db: np.ndarray, **settings: Any) -> xr.DataArray:
    given = {"time_s": TIME_S, "doppler_hz": DOPPLER_HZ, **TIMING, **settings}
    return convert_levels_to_signature(level_db, **given)


def noise(mean_db: float, seed: int = 1) -> np.ndarray:
    power = np.random.default_rng(seed).standard_exponential((N_COLUMNS, N_ROWS)) * 10 ** (mean_db / 10)
    return 10.0 * np.log10(power)


def walker_db(*, torso_hz: float, step_hz: float) -> np.ndarray:
    """A torso line, and a limb that swings 100 Hz beyond it; lines of a Gaussian window, 0 dB and -8 dB at the top."""
    limb_hz = torso_hz + 50.0 * np.sign(torso_hz) * (1.0 - np.cos(2.0 * np.pi * step_hz * TIME_S))
    torso = 10.0 ** (-0.6 * ((DOPPLER_HZ[None] - torso_hz) / 5.0) ** 2)
    limb = 10.0 ** (-0.8 - 0.6 * ((DOPPLER_HZ[None] - limb_hz[:, None]) / 5.0) ** 2)
    return 10.0 * np.log10(torso + limb + 10 ** (noise(-33.0) / 10))


def test_a_falling_velocity_axis_is_turned_round() -> None:
    level_db = noise(-20.0)
    rising = signature_of(level_db)
    falling = signature_of(level_db[:, ::-1], doppler_hz=None, velocity_mps=DOPPLER_HZ[::-1] * 0.015)
    np.testing.assert_allclose(falling.doppler.values, DOPPLER_HZ, atol=1e-9)
    assert np.array_equal(falling.values, rising.values)


@pytest.mark.parametrize(("torso_hz", "step_hz"), [(82.0, 1.9), (-82.0, 1.9), (60.0, 3.7)])
def test_gait_of_a_clipped_image(torso_hz: float, step_hz: float) -> None:
    level_db = np.clip(walker_db(torso_hz=torso_hz, step_hz=step_hz), -30.0, 0.0)
    mu = signature_of(level_db, floor_db=-30.0, ceiling_db=0.0)
    found = analyze_signature(mu, make_level_gate(mu), ANALYSIS, label=None)
    assert found.gate.source == "given"
    assert found.gait_frequency_hz == pytest.approx(step_hz, rel=0.01)
    assert found.features.torso_velocity_mps == pytest.approx(torso_hz * 0.015, abs=0.02)  # half a row
    assert found.features.step_length_m == pytest.approx(abs(torso_hz) * 0.015 / step_hz, rel=0.02)
    # the limb's reach, and half the widths of both lines, 10^(-0.6 (f / 5 Hz)^2), 15 dB below the torso's
    own_hz = 5.0 * (np.sqrt(1.5 / 0.6) + np.sqrt((1.5 - 0.8) / 0.6))
    assert found.features.doppler_bandwidth_hz == pytest.approx(100.0 + own_hz, abs=5.0)


def test_through_levels_and_back_nothing_changes() -> None:
    """The same recording analysed as always, and from the levels of its signature."""
    radar, settings = Radar.preset("x4-long"), Analysis()
    walk = boulic_walk(speed_mps=1.2, duration_s=3.0)
    scene = Scene([Target(walk, label="human", range_m=6.0, aspect_deg=20.0)], duration_s=2.5)
    recording = simulate(scene, radar, rng=dg.rng(3), snr_db=10.0)
    direct = analyze(recording, gate=(4.0, 8.0), analysis=settings)[0]
    mu = direct.signature
    again = convert_levels_to_signature(
        10.0 * np.log10(mu.values.astype(np.float64)), time_s=mu.time.values, doppler_hz=mu.doppler.values,
        wavelength_m=radar.wavelength_m, prf_hz=radar.prf_hz, cpi_pulses=mu.attrs["cpi_pulses"], hop=mu.attrs["hop"],
        range_m=(4.0, 8.0), n_gate_bins=mu.attrs["n_gate_bins"],
    )  # fmt: skip
    found = analyze_signature(again, make_level_gate(again), settings, label="human")
    np.testing.assert_allclose(found.features.vector(), direct.features.vector(), rtol=1e-4)
    assert found.gait_frequency_hz == pytest.approx(direct.gait_frequency_hz, rel=1e-5)
    assert found.flags == direct.flags


def test_noise_below_the_clip_is_bounded_by_it() -> None:
    """With more than half of the cells at the floor their median is the floor, read as ln 2 of the mean."""
    mu = signature_of(np.maximum(noise(-34.0), -30.0), floor_db=-30.0)
    assert processing.noise_floor_v2(mu) == pytest.approx(1e-3 / np.log(2.0), rel=1e-5)
    assert json.loads(mu.attrs["levels"])["floor_share"] == pytest.approx(1.0 - np.exp(-(10**0.4)), abs=0.005)


def test_slow_rows_are_emptied() -> None:
    level_db = noise(-20.0)
    mu = signature_of(level_db, blank_below_mps=0.39)
    slow = np.abs(DOPPLER_HZ) < 26.0
    assert (mu.values[:, slow] == 0.0).all()
    assert np.array_equal(mu.values[:, ~slow], signature_of(level_db).values[:, ~slow])
    assert processing.noise_floor_v2(mu) == pytest.approx(1e-2, rel=0.03)  # empty rows are no quiet rows


def test_the_printed_duration_is_refused() -> None:
    """Columns of 10 ms that a figure prints as 8.3 ms."""
    with pytest.raises(AnalysisError, match=r"every 8\.333 ms, but hop 6 at prf_hz 600 is 10 ms"):
        signature_of(noise(-20.0), time_s=TIME_S / 1.2)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"doppler_hz": None}, "one of the two"),
        ({"velocity_mps": DOPPLER_HZ}, "one of the two"),
        ({"doppler_hz": DOPPLER_HZ[:-1]}, "time first"),
        ({"doppler_hz": DOPPLER_HZ**3}, "equal steps"),
        ({"time_s": TIME_S[::-1]}, "time_s must rise"),
        ({"time_s": TIME_S[:3]}, r"time_s has shape \(3,\)"),
        ({"wavelength_m": 0.0}, "wavelength_m is 0"),
        ({"prf_hz": -1.0}, "prf_hz is -1"),
        ({"hop": 0}, "hop 0"),
        ({"n_gate_bins": 0.0}, "n_gate_bins is 0"),
        ({"blank_below_mps": -0.1}, "blank_below_mps is -0.1"),
        ({"ceiling_db": -30.0, "floor_db": -10.0}, "must be below ceiling_db"),
        ({"range_m": (5.0, 1.0)}, "two rising ranges"),
    ],
)
def test_faults_are_named(settings: dict[str, Any], told: str) -> None:
    with pytest.raises(AnalysisError, match=told):
        signature_of(noise(-20.0), **settings)


def test_gaps_in_the_levels_are_refused() -> None:
    level_db = noise(-20.0)
    level_db[3, 4] = np.nan
    with pytest.raises(AnalysisError, match="not finite"):
        signature_of(level_db)

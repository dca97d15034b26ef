"""Down-conversion of RF frames against sums written out, the driver's description of the chip and its known figures."""

import numpy as np
import pytest
from scipy.signal import firwin

from doppelgait.core.errors import RecordingError
from doppelgait.radar.xethru.downconvert import CHIP_TAPS, FrameFilter, down_convert_frames

FS = 23.328e9
LOW, HIGH = 7.29e9, 8.748e9
C = 299_792_458.0


def test_the_sum_written_out() -> None:
    frames = np.random.default_rng(1).normal(size=(2, 70))
    values, range_m = down_convert_frames(
        frames, carrier_hz=LOW, sample_rate_hz=FS, range_start_m=0.5, bin_length_m=0.00643004
    )
    taps = firwin(27, FS / 16, window="hamming", fs=FS)
    first = 0.5 / 0.00643004
    for m in range(values.shape[1]):
        n = 8 * m + np.arange(27)
        wanted = (taps * frames[:, n] * np.exp(-2j * np.pi * LOW / FS * (first + n))).sum(axis=1)
        assert np.allclose(values[:, m], wanted, atol=1e-6)
    assert values.shape == (2, (70 - 27) // 8 + 1)
    assert np.allclose(range_m, 0.5 + 0.00643004 * (13 + 8 * np.arange(values.shape[1])))


@pytest.mark.parametrize(("carrier_hz", "band"), [(LOW, "low"), (HIGH, "high")])
def test_the_chip_as_its_driver_describes_it(carrier_hz: float, band: str) -> None:
    """Two real filters, every 8th output, Q negated, and in the low band the sign changing from output to output."""
    frames = np.random.default_rng(2).normal(size=(1, 400))
    values, _ = down_convert_frames(frames, carrier_hz=carrier_hz, sample_rate_hz=FS, filter="chip")
    in_phase, quadrature = (np.array(taps) for taps in CHIP_TAPS[band])
    wanted = []
    for m in range(values.shape[1]):
        part = frames[0, 8 * m : 8 * m + 32]
        sign = (-1) ** m if band == "low" else 1
        wanted.append(sign * ((in_phase * part).sum() - 1j * (quadrature * part).sum()) / np.abs(in_phase).sum())
    ratio = values[0] / np.array(wanted)
    assert np.allclose(np.abs(ratio), 1.0, atol=1e-4)
    assert np.allclose(ratio, ratio[0], atol=1e-4)


def response_db(frequency_hz: float, filter: FrameFilter) -> float:
    n = np.arange(2000)
    frames = np.cos(2 * np.pi * frequency_hz / FS * n)[None]
    values, _ = down_convert_frames(frames, carrier_hz=LOW, sample_rate_hz=FS, filter=filter)
    return float(20 * np.log10(np.sqrt(np.mean(np.abs(values) ** 2))))


def test_the_chips_published_figures() -> None:
    """0.78 of an RF amplitude, -3 dB from 6.78 to 7.87 GHz, -10 dB from 6.36 to 8.27 GHz, noise ratio of its taps."""
    peak_db = response_db(LOW, "chip")
    assert 10 ** (peak_db / 20) == pytest.approx(0.78, abs=0.005)
    for frequency_hz, level_db in ((6.78e9, -3), (7.87e9, -3), (6.36e9, -10), (8.27e9, -10)):
        assert response_db(frequency_hz, "chip") - peak_db == pytest.approx(level_db, abs=0.3)
    assert response_db(LOW, "hamming") == pytest.approx(20 * np.log10(0.5), abs=0.03)


@pytest.mark.parametrize("filter", ["hamming", "chip"])
def test_phase_follows_range_and_approaching_is_positive(filter: FrameFilter) -> None:
    """An echo from R has the phase -4 pi R / lambda, wherever the frame starts."""
    n = np.arange(600)
    range_m = 1.5 - 0.003 * np.arange(5)
    for start_m in (0.0, 0.4):
        time_s = n / FS + 2 * start_m / C
        frames = np.cos(2 * np.pi * LOW * (time_s - 2 * range_m[:, None] / C))
        values, _ = down_convert_frames(frames, carrier_hz=LOW, sample_rate_hz=FS, range_start_m=start_m, filter=filter)
        error = np.angle(values * np.exp(4j * np.pi * range_m * LOW / C)[:, None])
        assert np.abs(error).max() < 0.01
        assert np.all(np.angle(values[1:] / values[:-1]) > 0)


@pytest.mark.parametrize("filter", ["hamming", "chip"])
def test_an_echo_lies_at_its_range(filter: FrameFilter) -> None:
    n = np.arange(800)
    at_m = 2.0
    pulse = np.exp(-0.5 * ((n / FS - 2 * at_m / C) / 0.345e-9) ** 2) * np.cos(2 * np.pi * LOW * n / FS)
    values, range_m = down_convert_frames(pulse[None], carrier_hz=LOW, sample_rate_hz=FS, filter=filter)
    power = np.abs(values[0]) ** 2
    assert (range_m * power).sum() / power.sum() == pytest.approx(at_m, abs=2e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"carrier_hz": 12e9}, "below half the sampling rate"),
        ({"decimation": 0}, "decimation 0"),
        ({"frames": np.zeros((2, 20))}, "shorter than the 27 taps"),
        ({"frames": np.zeros((2, 50), dtype=complex)}, "real matrix"),
        ({"filter": "chip", "carrier_hz": 7e9}, "5/16"),
        ({"bin_length_m": 0.0}, "bin_length_m"),
    ],
)
def test_what_is_refused(changes: dict[str, object], message: str) -> None:
    options = {"frames": np.zeros((2, 50)), "carrier_hz": LOW, "sample_rate_hz": FS, **changes}
    frames = options.pop("frames")
    with pytest.raises(RecordingError, match=message):
        down_convert_frames(frames, **options)  # type: ignore[arg-type]

"""Chirps of Infineon's Radar SDK, made here from a point that approaches."""

import json
from functools import reduce

import numpy as np
import pytest

from beat import approaching, beat
from doppelgait.core.errors import RecordingError
from doppelgait.radar import read_recording
from doppelgait.radar.readers import find_formats

SWEEP = {"carrier_hz": 60.5e9, "bandwidth_hz": 1e9, "sweep_s": 32e-6, "n_samples": 64}
SPACING_M = 299_792_458.0 / 2e9
NEW = {
    "start_frequency_Hz": 60_000_000_000,
    "end_frequency_Hz": 61e9,
    "num_chirps_per_frame": 8,
    "num_samples_per_chirp": 64,
    "chirp_repetition_time_s": 5e-4,
    "frame_repetition_time_s": 4e-3,
    "sample_rate_Hz": 2e6,
}
RENAMED = {"start_": "lower_", "end_": "upper_", "_per_frame": "", "_per_chirp": ""}
OLD = {reduce(lambda name, change: name.replace(*change), RENAMED.items(), key): value for key, value in NEW.items()}


def write(folder, config, *, name="config.json", shape=(50, 2, 8, 64), integers=False):
    rows = beat(*approaching(400, 2000.0, 1.5, 0.8), **SWEEP).real.reshape(50, 8, 64)
    data = 0.5 + 0.1 * np.stack([rows, 2 * rows], axis=1)
    data = data.reshape(shape) if len(shape) == 4 else data[:, 0]
    np.save(folder / "radar.npy", np.round(data * 4096).astype(np.uint16) if integers else data.astype(np.float32))
    (folder / name).write_text(json.dumps(config))
    return folder / "radar.npy"


@pytest.mark.parametrize(
    ("config", "options"),
    [
        ({"device_config": {"fmcw_single_shape": NEW}}, {}),
        ({"sequence": [{"loop": NEW}]}, {"name": "radar.json"}),
        (OLD, {"integers": True}),
        (NEW, {"shape": (50, 8, 64)}),
    ],
)
def test_a_point_has_its_range_and_positive_doppler(tmp_path, config, options):
    path = write(tmp_path, config, **options)
    assert find_formats(path) == ["infineon"]
    recording = read_recording(path)
    assert recording.samples.shape == (400, 32)
    np.testing.assert_allclose(recording.slow_time_s, np.arange(400) / 2000.0)
    np.testing.assert_allclose(recording.range_m, SPACING_M * np.arange(32))
    values = recording.samples.matrix
    assert np.abs(values).sum(axis=0).argmax() == round(1.42 / SPACING_M)
    spectrum = np.abs(np.fft.fft(values[:, round(1.42 / SPACING_M)]))
    assert 2000.0 * spectrum.argmax() / 400 == pytest.approx(2 * 0.8 / 299_792_458.0 * 60.5e9, abs=5.0)


def test_antennas_and_bursts(tmp_path):
    path = write(tmp_path, {**NEW, "frame_repetition_time_s": 0.05})
    first, second, both = (read_recording(path, antenna=one) for one in (0, 1, "sum"))
    np.testing.assert_allclose(second.samples.matrix, 2 * first.samples.matrix, rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(both.samples.matrix, 3 * first.samples.matrix, rtol=1e-3, atol=1e-5)
    assert first.facts["burst_pulses"] == 8
    np.testing.assert_allclose(np.diff(first.slow_time_s)[6:8], [5e-4, 0.05 - 7 * 5e-4])


@pytest.mark.parametrize(
    ("config", "options", "said"),
    [
        ({**NEW, "num_chirps_per_frame": 16}, {}, r"of shape \(50, 2, 8, 64\); by config.json it is .*16 chirps"),
        ({key: value for key, value in NEW.items() if key != "sample_rate_Hz"}, {}, "lacks sample_rate_hz"),
        ([NEW, {**NEW, "end_frequency_Hz": 62e9}], {}, "has several values of end_frequency_hz"),
        ({**NEW, "chirp_repetition_time_s": 5e-3}, {}, "do not fit into a frame of 0.004 s"),
        (NEW, {"antenna": 2}, "antenna = 2 is not allowed; give antenna = 0 to 1 or 'sum'"),
    ],
)
def test_what_does_not_fit_is_named(tmp_path, config, options, said):
    with pytest.raises(RecordingError, match=said):
        read_recording(write(tmp_path, config), **options)

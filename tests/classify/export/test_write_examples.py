"""Windows of a device are analysed as doppelgait analyses a recording."""

import numpy as np
import pytest

from doppelgait.classify.export.device import CSettings, plan_device
from doppelgait.classify.export.write import convert_samples, remove_running_mean, walk_samples
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.processing import Analysis, Gate, patches, signature
from doppelgait.processing.patches import Patch, cut_pictures
from export_models import export_model_of


def device_of(prf_hz=500.0, *, bins=2, still_time_s=None, window_s=None, patch=None, **analysis):
    conditions = {"carrier_hz": (7.29e9, 7.29e9), "prf_hz": (prf_hz, prf_hz), "observation_s": (2.0, 2.0)}
    model = export_model_of("network", conditions=conditions, analysis=analysis)
    settings = CSettings(window_s=window_s, bins=bins, still_time_s=still_time_s)
    return plan_device(model, patch or Patch(), settings)


@pytest.mark.parametrize(
    ("prf_hz", "settings"), [(500.0, {}), (1300.0, {"window_s": 3.9}), (211.0, {"cpi_s": 0.2}), (97.0, {"hop": 2})]
)
def test_levels_are_those_of_a_recording_of_the_window(prf_hz, settings):
    device, rng = device_of(prf_hz, **settings), np.random.default_rng(1)
    samples = walk_samples(rng, device)
    assert samples.shape == (device.window_pulses, 2)
    analysis = Analysis.model_validate({name: value for name, value in settings.items() if name != "window_s"})
    baseband = make_array(
        BASEBAND, samples, {"slow_time": np.arange(len(samples)) / prf_hz, "range": np.array([1.0, 1.1])}, {}
    )
    whole = signature(
        baseband, Gate.fixed(0.9, 1.2, time_s=np.array([0.0, 9.0])), analysis, wavelength_m=device.wavelength_m
    )
    expected = patches.levels(whole, device.patch)
    assert expected.shape == (64, device.n_columns)
    assert np.allclose(convert_samples(samples, device), expected, atol=1e-4)


@pytest.mark.parametrize("window_s", [2.0, 3.0, 3.9, 7.0])
def test_pictures_cover_the_window_as_usual(window_s):
    device = device_of(window_s=window_s)
    whole = np.arange(64 * device.n_columns, dtype=np.float32).reshape(64, -1)
    expected = cut_pictures(whole, device.patch)
    assert np.array_equal([whole[:, start : start + 64] for start in device.picture_starts], expected)


def test_static_echoes_leave_a_mean_over_the_time_constant():
    device = device_of(still_time_s=0.1)
    step = np.r_[np.full(400, 5.0 + 1j), np.full(400, 7.0 + 1j)][:, None]
    moving = remove_running_mean(step, device)[:, 0]
    assert np.abs(moving[:400]).max() < 1e-12
    after = np.arange(400)
    assert np.allclose(moving[400:], 2.0 * np.exp(-(after + 1) / 50.0), atol=1e-9)

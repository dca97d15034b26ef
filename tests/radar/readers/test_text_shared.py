"""Real 24 GHz continuous-wave recordings of people and a dog (the shared test data)."""

import warnings

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.processing import Analysis, burst_signature
from doppelgait.radar.readers import read_recording

pytestmark = pytest.mark.shared

LEAST_MPS = 0.3
"""Slower lines are static echoes and sway."""


@pytest.fixture(scope="module")
def folder(shared):
    return shared / "data" / "radar" / "cw24_kmkim036"


def signature_of(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)  # clipping near the radar, in nearly all of them
        recording = read_recording(path)
    return burst_signature(recording.baseband, None, Analysis(), wavelength_m=recording.radar.wavelength_m)


def torso_mps(mu):
    """Strongest line of every burst, the median over bursts."""
    velocity = mu.velocity.values
    return float(np.median(velocity[np.where(np.abs(velocity) > LEAST_MPS, mu.values, 0.0).argmax(axis=1)]))


def test_all_recordings_are_read(folder):
    paths = sorted(folder.glob("*/*_RE.txt"))
    assert len(paths) == 152
    clipped = 0
    for path in paths:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", DoppelgaitWarning)
            recording = read_recording(path)
        clipped += any("clipped" in str(one.message) for one in told)
        assert not any("burst" in str(one.message) for one in told)  # all hold whole bursts
        assert recording.n_pulses in (1280, 1920, 2560, 2944, 3840, 4224, 4480)
    assert clipped == 146


@pytest.mark.parametrize(("motion", "low_mps", "high_mps"), [("1", -1.20, -0.87), ("2", 0.95, 1.09)])
def test_away_is_negative_and_toward_positive(folder, motion, low_mps, high_mps):
    for path in sorted(folder.glob(f"211118/211118_*_{motion}_[123]_RE.txt")):
        assert low_mps - 0.1 <= torso_mps(signature_of(path)) <= high_mps + 0.1, path.name

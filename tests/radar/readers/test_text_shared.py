"""Real 24 GHz continuous-wave recordings of people and a dog (the shared test data)."""

import re
import warnings

import numpy as np
import pytest

from doppelgait.core.errors import DoppelgaitWarning
from doppelgait.processing import Analysis, burst_signature
from doppelgait.radar.readers import read_recording

pytestmark = pytest.mark.shared

LEAST_MPS = 0.3
"""Slower lines are static echoes and sway."""

TORSO_MPS = {"creep": (0.69, 24), "walk": (0.98, 36), "stride": (1.24, 32), "run": (1.69, 24)}
"""Measured before on the same files by other means (Hamming window): median torso velocity, recordings."""
MOTIONS = {0: "walk", 1: "run", 2: "stride", 3: "creep"}


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


def edge_mps(mu):
    """Speed below which 98 % of the approaching side's energy lies, the median over bursts."""
    velocity = mu.velocity.values
    energy = np.cumsum(mu.values[:, velocity > 0], axis=1)
    return float(np.median(velocity[velocity > 0][(energy < 0.98 * energy[:, -1:]).sum(axis=1)]))


@pytest.fixture(scope="module")
def approaching(folder):
    """Torso velocity and edge of every recording of the sessions that label one motion towards the radar."""
    found = {name: [] for name in TORSO_MPS}
    for path in sorted(folder.glob("22*/*_RE.txt")):
        motion = re.fullmatch(r"22\d{4}_\d_(\d)_\d+_RE\.txt", path.name)
        mu = signature_of(path)
        found[MOTIONS[int(motion[1])]].append((torso_mps(mu), edge_mps(mu)))
    return {name: np.array(values) for name, values in found.items()}


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


def test_the_dog(folder):
    # in these the dog is slower and smaller than the person in the same set-up
    values = [torso_mps(signature_of(folder / "211109" / f"211109_{name}_RE.txt")) for name in ("3_2", "3_3")]
    np.testing.assert_allclose(values, [0.55, 0.47], atol=0.2)

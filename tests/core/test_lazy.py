"""Pulses that are read when they are asked for."""

import pickle

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import RecordingError
from doppelgait.core.frames import Frames
from doppelgait.core.labels import BASEBAND, make_array, replace_array_values
from doppelgait.core.lazy import LONG_PULSES, LateRows, lazy_rows, read_pulses
from doppelgait.processing.clutter import remove_common_phase, remove_static_clutter
from doppelgait.radar.recordings import read_recording

PRF_HZ, N_BINS = 500.0, 40


def basebands(count):
    """The same echoes in memory and on demand: drifting clock, static clutter, noise."""
    rng = np.random.default_rng(3)
    values = rng.normal(size=(count, N_BINS, 2)).astype(np.float32).view(np.complex64)[..., 0] * np.float32(0.01)
    values = (values + 5.0) * np.exp(1j * np.linspace(0, 3, count))[:, None]
    coords = {"slow_time": np.arange(count) / PRF_HZ, "range": 0.1 * np.arange(N_BINS)}
    here = make_array(BASEBAND, values.astype(np.complex64), coords)
    rows = LateRows(here.shape, lambda first, stop: here.values[first:stop], np.complex64)
    return here, replace_array_values(here, lazy_rows(rows))


def test_every_slice_is_that_of_the_values():
    here, there = basebands(1000)
    for key in (np.s_[10:20], np.s_[3], np.s_[::7, 2:5], np.s_[-4:], np.s_[5:5], np.s_[::-1]):
        np.testing.assert_array_equal(there[key].values, here[key].values)


def test_tiles_follow_each_other():
    here, _ = basebands(2 * LONG_PULSES + 5)
    tiles = list(Frames.of(here).read_tiles(100))
    assert len(tiles) == 3
    assert all(first % 100 == 0 for first, _ in tiles)
    np.testing.assert_array_equal(np.concatenate([values for _, values in tiles]), here.values)


def take_off(baseband, kind):
    if kind == "common phase":
        return remove_common_phase(Frames.of(baseband)).label()
    return remove_static_clutter(baseband, kind=kind)


@pytest.mark.parametrize("kind", ["mean", "median", "exponential", "mti", "common phase"])
def test_clutter_of_a_long_recording_is_that_of_the_whole(kind, monkeypatch):
    here, there = basebands(LONG_PULSES + 9000)
    tiled = take_off(there, kind)
    with monkeypatch.context() as whole:
        whole.setattr("doppelgait.core.lazy.LONG_PULSES", 1 << 20)
        expected = take_off(here, kind).values
    assert np.abs(expected - here.values).max() > 1.0  # static echoes or their drift
    np.testing.assert_allclose(tiled.values, expected, atol=2e-5 if kind == "common phase" else 2e-6)
    near = slice(LONG_PULSES - 50, LONG_PULSES + 50)
    np.testing.assert_array_equal(read_pulses(tiled, near.start, near.stop), tiled.values[near])


@pytest.fixture
def recording(tmp_path):
    scene = dg.Scene(targets=[dg.Target(motion=dg.motion.generate("human", duration_s=2.0))])
    return dg.simulate(scene, dg.Radar.preset("x4", prf_hz=500.0), rng=dg.rng(1), path=tmp_path / "a.h5")


def test_a_long_recording_stays_in_its_file(tmp_path, monkeypatch, recording):
    with monkeypatch.context() as small:
        small.setattr("doppelgait.radar.recordings.STORED_BYTES", 0)
        found = read_recording(tmp_path / "a.h5")
    assert not found.samples.in_memory
    np.testing.assert_array_equal(found.baseband.values, recording.baseband.values)
    np.testing.assert_array_equal(found.samples.rows(7, 9), recording.samples.matrix[7:9])
    np.testing.assert_array_equal((found.samples + 1.0).matrix, recording.samples.matrix + np.float32(1.0))
    for name, values in found.truth[0].scatterers.data_vars.items():
        np.testing.assert_array_equal(values.values, recording.truth[0].scatterers[name].values)
    part = found.between(0.5, 1.0)
    assert part.samples.in_memory
    np.testing.assert_array_equal(part.baseband.values, recording.between(0.5, 1.0).baseband.values)
    (tmp_path / "a.h5").write_bytes(b"")
    with pytest.raises(RecordingError, match=r"a\.h5: pulses 0 to 1 cannot be read"):
        found.samples.rows(0, 1)


def test_changes_of_a_long_recording_stay_on_demand(tmp_path, monkeypatch, recording):
    monkeypatch.setattr("doppelgait.radar.recordings.STORED_BYTES", 0)
    monkeypatch.setattr("doppelgait.core.lazy.LONG_PULSES", 300)
    found = read_recording(tmp_path / "a.h5")
    changed = found.with_baseband(found.baseband)
    assert not changed.samples.in_memory
    np.testing.assert_array_equal(changed.baseband.values, recording.baseband.values)
    assert found.between(0.5, 1.0).samples.in_memory
    for frames in (found.between(0.2, 1.9).frames, found.frames.take_bins(slice(3, 9))):
        assert not frames.samples.in_memory
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(frames)).read(5, 400), frames.read(5, 400))

"""Real X4 frames in MATLAB files: axes, noise, a breathing person; the same through our own file and plain arrays."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from doppelgait.radar import read_recording
from doppelgait.radar.readers import find_formats
from doppelgait.radar.readers.matlab import list_variables

pytestmark = pytest.mark.shared

RF_BIN_M = 0.00643004


@pytest.fixture(scope="module")
def folder(shared) -> Path:
    return shared / "data" / "radar" / "x4_rf_giraffe_yin"


@pytest.mark.parametrize(
    ("name", "matrix", "frames", "bins", "first_m", "last_m"),
    [
        ("rf_empty_room_two_radars_20220222_143239.mat", "Data_Matrix_1", 338, 1121, 0.694, 7.90),
        ("rf_empty_room_two_radars_20220222_143239.mat", "Data_Matrix_2", 338, 1121, 0.694, 7.90),
        ("rf_breathing_20220303_131324.mat", None, 3006, 390, 0.495, 3.00),
    ],
)
def test_frames_rate_and_range_are_those_of_the_manifest(folder, name, matrix, frames, bins, first_m, last_m):
    recording = read_recording(folder / name, matrix=matrix)
    range_m = recording.baseband["range"].values
    assert recording.baseband.shape == (frames, (bins - 27) // 8 + 1)
    assert recording.radar.prf_hz == pytest.approx(25.04, abs=0.005)
    assert recording.radar.n_range_bins == range_m.size
    # 27 taps: the first output lies 13 RF bins behind the start, up to 7 + 13 are left at the end
    assert range_m[0] - 13 * RF_BIN_M == pytest.approx(first_m, abs=1e-3)
    assert 13 * RF_BIN_M <= last_m - range_m[-1] <= 22 * RF_BIN_M
    np.testing.assert_allclose(np.diff(range_m), 8 * RF_BIN_M, atol=1e-7)
    assert recording.truth == ()
    assert any("not in the file" in note for note in recording.notes)


def test_every_measured_file_is_taken_by_one_reader(shared):
    radar = shared / "data" / "radar"
    expected = {
        "a121_acconeer/*.h5": "acconeer",
        "cw24_kmkim036/*/*_RE.txt": "cw-text",
        "x4_baseband_iq_novelda/*/*.dat": "xethru",
        "x4_datafloat_marcusm111/*/*.dat": "xethru",
        "x4_rf_giraffe_yin/*.mat": "matlab-rf",
        "licences/*": None,
    }
    for pattern, name in expected.items():
        paths = sorted(radar.glob(pattern))
        assert paths, pattern
        for path in paths:
            assert find_formats(path) == ([] if name is None else [name]), path.name


def test_scipy_reads_the_same_values(folder):
    for path in sorted(folder.glob("*.mat")):
        wanted = loadmat(path)
        for name, variable in list_variables(path, max_bytes=1 << 30).items():
            if variable.is_complex is not None:
                np.testing.assert_array_equal(variable.load(), wanted[name])

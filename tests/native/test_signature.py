"""The compiled kernels against NumPy and closed forms (E-18, E-24)."""

import numpy as np
import pytest

from doppelgait._core import native
from doppelgait.processing.signature import sum_columns

LENGTHS = [48, 64, 80, 96, 128, 160, 192, 256, 320, 384, 512, 640, 768, 1024, 5120]
OTHER_LENGTHS = [1, 3, 16, 32, 49, 101, 112, 200]


def test_native_code_has_passes_for_some_lengths():
    assert all(map(native.has_passes, LENGTHS))
    assert not any(map(native.has_passes, [-48, 0, *OTHER_LENGTHS]))


def run(y, *, first_pulse, hop, window, first_bin, n_gate, k, n_columns):
    planes = np.full((2, y.shape[1], len(y) + 26), 1e9, np.float32)  # pulses beyond the record count as zero
    planes[..., : len(y)] = y.real.T, y.imag.T
    out = np.full((n_columns, k), np.nan, np.float32)
    first_bin = np.broadcast_to(np.asarray(first_bin, np.int64), n_columns).copy()
    sum_columns(
        *planes,
        len(y),
        first_pulse,
        hop,
        np.pad(window, (0, k - window.size)).astype(np.float32),
        first_bin - 0.5,
        first_bin + n_gate - 0.5,
        out,
    )
    return out


def by_numpy(y, *, first_pulse, hop, window, first_bin, n_gate, k, n_columns):
    m = window.size
    first_bin = np.broadcast_to(first_bin, n_columns)
    out = np.zeros((n_columns, k))
    for j in range(n_columns):
        pulses = first_pulse + j * hop + np.arange(m)
        bins = np.arange(first_bin[j], first_bin[j] + n_gate)
        bins = bins[(bins >= 0) & (bins < y.shape[1])]
        frame = np.zeros((m, bins.size), complex)
        inside = (pulses >= 0) & (pulses < y.shape[0])
        frame[inside] = y[pulses[inside]][:, bins]
        spectrum = np.fft.fft(frame * window[:, None], k, axis=0)
        out[j] = np.fft.fftshift((np.abs(spectrum) ** 2).sum(axis=1))
    return out


@pytest.fixture(scope="module")
def random_baseband():
    rng = np.random.default_rng(0)
    return (rng.standard_normal((400, 9)) + 1j * rng.standard_normal((400, 9))).astype(np.complex64)


SHAPES = [(k, 40, 3) for k in (2, 5, 7, 8, 11, 15, 24, 40, 81, 100, 108, 125, 143, 240, *OTHER_LENGTHS, *LENGTHS)]
SHAPES += [(k, n_columns, hop) for k in (40, 48) for n_columns in (1, 2, 15, 16, 17, 31, 32, 33, 100) for hop in (1, 3)]


@pytest.mark.parametrize(("k", "n_columns", "hop"), SHAPES)
def test_transform_of_every_length_equals_numpy_e24(random_baseband, k, n_columns, hop):
    window = np.hanning(min(k, 101) + 2)[1:-1]
    case = {"first_pulse": 0, "hop": hop, "window": window, "first_bin": 2, "n_gate": 4, "k": k, "n_columns": n_columns}
    found, wanted = run(random_baseband, **case), by_numpy(random_baseband, **case)
    assert np.linalg.norm(found - wanted) < 1e-6 * np.linalg.norm(wanted)


@pytest.mark.parametrize("first_pulse", [-20, -17, -1])
@pytest.mark.parametrize("hop", [1, 7])
@pytest.mark.parametrize("k", [48, 50])
def test_pulses_outside_the_record_and_bins_outside_the_frame_are_zero_e22(random_baseband, k, hop, first_pulse):
    n_columns = 60
    case = {
        "first_pulse": first_pulse,
        "hop": hop,
        "window": np.hanning(43)[1:-1],
        "first_bin": np.linspace(-6, 11, n_columns).astype(int),
        "n_gate": 4,
        "k": k,
        "n_columns": n_columns,
    }
    found, wanted = run(random_baseband[:380], **case), by_numpy(random_baseband[:380], **case)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=3e-6 * wanted.max())
    assert not wanted[0].any()
    assert not found[0].any()
    assert not found[-1].any()


@pytest.mark.parametrize(("n_frames", "first_bin", "n_bins"), [(1, 0, 1), (31, 2, 3), (33, 0, 7), (100, 6, 1)])
def test_planes_of_a_data_matrix_are_its_real_and_imaginary_parts(n_frames, first_bin, n_bins):
    rng = np.random.default_rng(2)
    matrix = (rng.standard_normal((n_frames, 7)) + 1j * rng.standard_normal((n_frames, 7))).astype(np.complex64)
    plane_re, plane_im = np.full((2, n_bins, n_frames), np.nan, np.float32)
    native.split_planes(matrix[:, first_bin : first_bin + n_bins], plane_re, plane_im)
    np.testing.assert_array_equal(plane_re, matrix.real.T[first_bin : first_bin + n_bins])
    np.testing.assert_array_equal(plane_im, matrix.imag.T[first_bin : first_bin + n_bins])
    joined = np.empty((n_frames, n_bins), np.complex64)
    native.join_planes(plane_re, plane_im, joined)
    np.testing.assert_array_equal(joined, matrix[:, first_bin : first_bin + n_bins])


@pytest.mark.parametrize("edge", [np.nan, np.inf, -np.inf, 1e300, -1e300])
def test_gates_without_a_place_read_nothing_outside_the_planes(edge):
    out = np.empty((10, 48), np.float32)
    for low, high in ((edge, 3.0), (1.0, edge), (edge, edge)):
        edges = np.full(10, low), np.full(10, high)
        native.gated_signature(*np.ones((2, 4, 60), np.float32), 60, 0, 3, np.ones(48, np.float32), *edges, out)
        assert np.isfinite(out).all()

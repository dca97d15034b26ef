"""The compiled kernels against NumPy and closed forms (E-18, E-24)."""

import numpy as np
import pytest

from doppelgait._core import native
from doppelgait.processing.signature import sum_columns

SUPPORT_SIGMAS = 5.5
WAVELENGTH_M = 299_792_458 / 7.29e9


@pytest.mark.parametrize("k", [48, 64, 80, 96, 128, 160, 192, 256, 320, 384, 512, 640, 768, 1024, 5120])
def test_lengths_with_native_passes(k):
    assert native.has_passes(k)


@pytest.mark.parametrize("k", [-48, 0, 1, 3, 16, 32, 49, 101, 112, 200])
def test_other_lengths_have_no_passes(k):
    assert not native.has_passes(k)


def run(y, *, first_pulse, hop, window, first_bin, n_gate, k, n_columns):
    planes = [np.ascontiguousarray(part.T.astype(np.float32)) for part in (y.real, y.imag)]
    out = np.full((n_columns, k), np.nan, np.float32)
    first_bin = np.broadcast_to(np.asarray(first_bin, np.int64), n_columns).copy()
    sum_columns(
        *planes,
        planes[0].shape[1],
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


@pytest.mark.parametrize(
    "k",
    [
        2,
        3,
        5,
        7,
        8,
        11,
        15,
        16,
        24,
        32,
        40,
        48,
        49,
        64,
        81,
        96,
        100,
        101,
        108,
        125,
        128,
        143,
        160,
        192,
        240,
        256,
        320,
        384,
        512,
        640,
        1024,
    ],
)
def test_transform_of_every_length_equals_numpy_e24(random_baseband, k):
    window = np.hanning(min(k, 101) + 2)[1:-1]
    case = {"first_pulse": 0, "hop": 3, "window": window, "first_bin": 2, "n_gate": 4, "k": k, "n_columns": 40}
    found, wanted = run(random_baseband, **case), by_numpy(random_baseband, **case)
    assert np.linalg.norm(found - wanted) < 1e-6 * np.linalg.norm(wanted)


@pytest.mark.parametrize("n_columns", [1, 2, 15, 16, 17, 31, 32, 33, 100])
@pytest.mark.parametrize("hop", [1, 3])
def test_any_number_of_columns_e24(random_baseband, n_columns, hop):
    case = {"first_pulse": 0, "hop": hop, "window": np.hanning(33), "first_bin": 1, "n_gate": 3, "k": 40}
    found = run(random_baseband, n_columns=n_columns, **case)
    wanted = by_numpy(random_baseband, n_columns=n_columns, **case)
    assert np.linalg.norm(found - wanted) < 1e-6 * np.linalg.norm(wanted)


@pytest.mark.parametrize("first_pulse", [-20, -17, -1])
@pytest.mark.parametrize("hop", [1, 7])
def test_pulses_outside_the_record_and_bins_outside_the_frame_are_zero_e22(random_baseband, hop, first_pulse):
    n_columns = 60
    case = {
        "first_pulse": first_pulse,
        "hop": hop,
        "window": np.hanning(43)[1:-1],
        "first_bin": np.linspace(-6, 11, n_columns).astype(int),
        "n_gate": 4,
        "k": 50,
        "n_columns": n_columns,
    }
    found, wanted = run(random_baseband[:380], **case), by_numpy(random_baseband[:380], **case)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=3e-6 * wanted.max())
    assert not wanted[0].any()
    assert not found[0].any()
    assert not found[-1].any()


def echoes(range_m, amplitude=None, *, n_bins=60, spacing=0.05, sigma=0.0517, phase=0.0, first_m=1.0):
    range_m = np.atleast_2d(np.asarray(range_m, float))
    amplitude = np.ones_like(range_m) if amplitude is None else np.atleast_2d(np.asarray(amplitude, float))
    out = np.full((range_m.shape[0], n_bins), np.nan, np.complex64)
    native.add_echoes(range_m, amplitude, first_m, spacing, sigma, WAVELENGTH_M, phase, out, None)
    return out


@pytest.mark.parametrize(("spacing", "sigma"), [(0.0514, 0.0517), (0.0064, 0.0517), (0.0514, 0.15), (0.2, 0.05)])
def test_echo_envelope_is_gaussian_to_the_cut_and_zero_beyond_e18(spacing, sigma):
    n_bins = int(np.ceil(3.0 / spacing))
    axis = 1.0 + spacing * np.arange(n_bins)
    for place in (2.0, 2.0 + 0.3 * spacing, 2.4999 * spacing + 1.0, 1.0, axis[-1], 0.9, axis[-1] + 0.11):
        y = np.abs(echoes([[place]], n_bins=n_bins, spacing=spacing, sigma=sigma)[0])
        wanted = np.exp(-0.5 * ((axis - place) / sigma) ** 2)
        assert np.abs(y - wanted).max() < 4e-7
        near = np.abs(axis - place) < SUPPORT_SIGMAS * sigma
        np.testing.assert_allclose(y[near], wanted[near], rtol=1e-5)


def test_echo_phase_is_reduced_in_double_precision_e13():
    range_m = 39.0 + np.linspace(0, 0.5, 400)[:, None]
    y = echoes(range_m, n_bins=40, first_m=38.5, phase=0.4).astype(complex)
    strongest = y[np.arange(400), np.abs(y).argmax(axis=1)]
    wanted = np.exp(1j * (0.4 - 4 * np.pi * (range_m[:, 0] % WAVELENGTH_M) / WAVELENGTH_M))
    assert np.abs(np.angle(strongest / wanted)).max() < 2e-7


def test_output_is_overwritten_and_far_scatterers_do_not_reach_it():
    assert not echoes([[50.0, -7.0]]).any()
    ranges = [[2.0, 3.0]]
    np.testing.assert_array_equal(echoes(ranges, [[1.0, 0.0]]), echoes([[2.0]], [[1.0]]))
    assert np.isfinite(echoes([[1e9, 2.0]])).all()


def test_kernels_give_the_same_bytes_every_time(random_baseband):
    ranges = np.random.default_rng(1).uniform(1, 4, (20, 6))
    assert echoes(ranges).tobytes() == echoes(ranges).tobytes()
    case = {"first_pulse": 0, "hop": 3, "window": np.hanning(101), "first_bin": 2, "n_gate": 4, "k": 128}
    first = run(random_baseband, n_columns=40, **case)
    assert first.tobytes() == run(random_baseband, n_columns=40, **case).tobytes()


def test_rows_may_be_longer_than_the_record():
    """Pulses beyond the record count as zero even where the buffers hold an earlier example."""
    rng = np.random.default_rng(1)
    y = (rng.standard_normal((70, 4)) + 1j * rng.standard_normal((70, 4))).astype(np.complex64)
    k, window = 32, np.hanning(27).astype(np.float32)
    wanted = by_numpy(y, first_pulse=-5, hop=2, window=window, first_bin=1, n_gate=2, k=k, n_columns=40)
    planes = np.full((2, 4, 96), 1e9, dtype=np.float32)
    planes[0, :, :70], planes[1, :, :70] = y.real.T, y.imag.T
    out = np.empty((40, k), np.float32)
    low = np.full(40, 0.5)
    padded = np.pad(window, (0, k - window.size))
    sum_columns(*planes, 70, -5, 2, padded, low, low + 2, out)
    np.testing.assert_allclose(out, wanted, rtol=1e-5, atol=1e-5 * wanted.max())


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


@pytest.mark.parametrize(
    ("changed", "error"),
    [
        ({"plane_re": np.zeros((3, 60), np.float32)}, ValueError),
        ({"plane_im": np.zeros((4, 59), np.float32)}, ValueError),
        ({"plane_re": np.zeros((4, 60), np.float32)[:, ::-1]}, ValueError),
        ({"plane_re": np.zeros(60, np.float32)}, TypeError),
        ({"plane_re": None}, TypeError),
        ({"n_pulses": 61}, ValueError),
        ({"n_pulses": -1}, ValueError),
        ({"hop": 0}, ValueError),
        ({"hop": 1 << 60}, ValueError),
        ({"first_pulse": -(1 << 62)}, ValueError),
        ({"window": np.ones(49, np.float32)}, ValueError),
        ({"low": np.zeros(9)}, ValueError),
        ({"high": np.zeros(11)}, ValueError),
        ({"out": np.zeros((10, 50), np.float32)}, ValueError),
        ({"out": np.zeros((10, 48))}, TypeError),
        ({"out": np.zeros((10, 96), np.float32)[:, ::2]}, ValueError),
        ({"out": np.broadcast_to(np.float32(0.0), (10, 48))}, TypeError),
    ],
)
def test_arrays_that_do_not_fit_are_refused_by_the_signature(changed, error):
    planes = np.zeros((2, 4, 60), np.float32)
    fitting = {
        "plane_re": planes[0], "plane_im": planes[1], "n_pulses": 60, "first_pulse": 0, "hop": 1,
        "window": np.ones(48, np.float32), "low": np.zeros(10), "high": np.ones(10),
        "out": np.ones((10, 48), np.float32),
    }  # fmt: skip
    native.gated_signature(**fitting)
    assert not fitting["out"].any()
    with pytest.raises(error):
        native.gated_signature(**{**fitting, **changed})


@pytest.mark.parametrize("edge", [np.nan, np.inf, -np.inf, 1e300, -1e300])
def test_gates_without_a_place_read_nothing_outside_the_planes(edge):
    out = np.empty((10, 48), np.float32)
    for low, high in ((edge, 3.0), (1.0, edge), (edge, edge)):
        edges = np.full(10, low), np.full(10, high)
        native.gated_signature(*np.ones((2, 4, 60), np.float32), 60, 0, 3, np.ones(48, np.float32), *edges, out)
        assert np.isfinite(out).all()

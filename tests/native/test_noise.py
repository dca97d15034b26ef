"""Counter-based receiver noise (E-18): the generator, its transform, blocking and the statistics of the values.

All keys are fixed, so nothing here can flake; limits are at p = 1e-4 or beyond.
"""

import math
import zlib

import numpy as np
import pytest
from scipy import stats

from doppelgait._core import native
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.core.rng import draw_key
from doppelgait.core.samples import WHITE
from doppelgait.radar import add_noise

LANES = native.NOISE_LANES

KEY = 0x0123456789ABCDEF
ROOT_2 = math.sqrt(2.0)
P_LIMIT = 1e-4


def planes(n_bins, n_frames, *, key=KEY, rms=ROOT_2, first_bin=0, first_frame=0, factor=WHITE):
    """Noise alone; with the default rms both parts have variance 1."""
    re, im = np.zeros((2, n_bins, n_frames), dtype=np.float32)
    native.add_noise_block(re, im, 0, n_frames, first_bin, first_frame, key, rms, factor)
    return re, im


# The literal reference: Python integers and float64.


def reference_philox(counter, key):
    (a, b, c, d), (k0, k1) = counter, key
    for _ in range(10):
        first, second = 0xD2511F53 * a, 0xCD9E8D57 * c
        a, b, c, d = second // 2**32 ^ b ^ k0, second % 2**32, first // 2**32 ^ d ^ k1, first % 2**32
        k0, k1 = (k0 + 0x9E3779B9) % 2**32, (k1 + 0xBB67AE85) % 2**32
    return a, b, c, d


def reference_noise(frame, n, key, rms):
    words = reference_philox((frame, n // 2, 0, 0), (key % 2**32, key >> 32))[2 * (n % 2) :]
    angle = (words[1] % 2**30 - (2**30 if words[1] & 2**29 else 0)) * math.pi / 2 / 2**30
    x, y = math.cos(angle), math.sin(angle)
    if words[1] & 2**30:
        x, y = y, x
    sign = -1 if words[1] & 2**31 else 1
    u = float(np.float32(words[0]) + np.float32(0.5)) / 2**32
    return sign * rms * math.sqrt(-math.log(u)) * complex(x, y)


# Philox


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [
        ((0,) * 4, (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_the_reference_gives_the_published_words(counter, key, words):
    assert reference_philox(counter, key) == words


# Transform


@pytest.mark.parametrize("key", [0, 1, KEY, 2**64 - 1])
@pytest.mark.parametrize(("first_bin", "first_frame"), [(5, 2**31 - 20), (2**32 - 7, 2**32 - 50), (2**33 - 13, 0)])
def test_noise_is_the_float64_reference(key, first_bin, first_frame):
    """Up to the last counters: frames and pairs of bins are words of 32 bits, the two upper words are 0."""
    re, im = planes(13, 50, key=key, rms=3e-5, first_bin=first_bin, first_frame=first_frame)
    exact = [[reference_noise(first_frame + i, first_bin + n, key, 3e-5) for i in range(50)] for n in range(13)]
    np.testing.assert_allclose(re + 1j * im, exact, atol=0, rtol=4e-7)


# Addressing


TAPS = {k: (0.7 ** np.arange(k + 1)).astype(np.float32) for k in (0, 1, 3, 6)}


@pytest.mark.parametrize("n_taps", TAPS)
@pytest.mark.parametrize("seed", range(4))
def test_any_blocks_in_any_order_give_the_same_bytes(seed, n_taps):
    n_bins, n_frames, taps = 37, 2 * LANES + 91, TAPS[n_taps]
    whole = planes(n_bins, n_frames, factor=taps)
    rng = np.random.default_rng(seed)
    bins = np.unique([0, n_bins, *rng.integers(0, n_bins, 5)])
    frames = np.unique([0, n_frames, *rng.integers(0, n_frames, 7)])
    blocks = [(n, i) for n in range(bins.size - 1) for i in range(frames.size - 1)]
    rng.shuffle(blocks)
    re, im = np.zeros((2, n_bins, n_frames), dtype=np.float32)
    for n, i in blocks:
        (top, end), (left, right) = bins[n : n + 2], frames[i : i + 2]
        if seed % 2:
            native.add_noise_block(re[top:end], im[top:end], left, right, top, left, KEY, ROOT_2, taps)
        else:  # cut out, no longer contiguous
            cut_re, cut_im = re[top:end, left:right], im[top:end, left:right]
            native.add_noise_block(cut_re, cut_im, 0, right - left, top, left, KEY, ROOT_2, taps)
    assert re.tobytes() == whole[0].tobytes()
    assert im.tobytes() == whole[1].tobytes()


@pytest.mark.parametrize("n_frames", [1, 2, LANES - 1, LANES, LANES + 1, 3 * LANES + 7])
@pytest.mark.parametrize("n_bins", [1, 2, 9])
@pytest.mark.parametrize("n_taps", TAPS)
def test_matrix_and_planes_hold_the_same_noise(n_bins, n_frames, n_taps):
    matrix = np.zeros((n_frames, n_bins), dtype=np.complex64)
    native.add_noise_matrix(matrix, KEY, ROOT_2, TAPS[n_taps])
    re, im = planes(n_bins, n_frames, factor=TAPS[n_taps])
    np.testing.assert_array_equal(matrix.real, re.T)
    np.testing.assert_array_equal(matrix.imag, im.T)


def test_correlated_noise_is_white_noise_filtered_over_bins():
    """Against a plain convolution of the white noise that the same key gives."""
    taps = np.array([0.8, 0.5, -0.3, 0.1], dtype=np.float32)
    white = np.array(planes(40, 300, first_bin=7, first_frame=50)).astype(np.float64)
    expected = sum(tap * white[:, k : k + 30] for k, tap in enumerate(taps.tolist()))
    found = planes(30, 300, first_bin=7, first_frame=50, factor=taps)
    np.testing.assert_allclose(found, expected, atol=2e-6)


def test_only_the_named_columns_change_and_values_are_added():
    re, im = np.full((2, 3, 300), 5.0, dtype=np.float32)
    native.add_noise_block(re, im, 40, 240, 8, 1000, KEY, 1.0, WHITE)
    alone = planes(3, 200, rms=1.0, first_bin=8, first_frame=1000)
    for plane, added in zip((re, im), alone, strict=True):
        assert (plane[:, :40] == 5).all()
        assert (plane[:, 240:] == 5).all()
        np.testing.assert_array_equal(plane[:, 40:240], np.float32(5) + added)


def test_an_empty_block_is_no_work():
    native.add_noise_matrix(np.zeros((0, 5), dtype=np.complex64), KEY, 1.0, WHITE)
    native.add_noise_matrix(np.zeros((5, 0), dtype=np.complex64), KEY, 1.0, WHITE)
    planes(3, 0)


def test_keys_come_from_the_generator_and_give_different_noise():
    assert draw_key(np.random.default_rng(4)) == draw_key(np.random.default_rng(4))
    keys = {int(draw_key(np.random.default_rng(seed))) for seed in range(200)}
    assert len(keys) == 200
    assert max(keys) > 2**63
    assert len({planes(2, 50, key=key)[0].tobytes() for key in keys}) == 200


def test_public_noise_is_the_kernel_and_draws_once():
    quiet = make_array(
        BASEBAND, np.zeros((150, 7), np.complex64), {"slow_time": np.arange(150) / 1e3, "range": np.arange(7) / 20}
    )
    generator = np.random.default_rng(8)
    noisy = add_noise(quiet, noise_power_v2=4.0, rng=generator)
    expected = np.zeros((150, 7), dtype=np.complex64)
    twin = np.random.default_rng(8)
    native.add_noise_matrix(expected, draw_key(twin), 2.0, WHITE)
    assert noisy.values.tobytes() == expected.tobytes()
    assert generator.integers(2**63) == twin.integers(2**63)
    assert not quiet.values.any()


DIGEST = 0x9FF76EFC
"""CRC-32 of the two planes of :func:`checksum`: the bytes of a given key never change."""


def test_bytes_are_those_of_the_first_release():
    re, im = planes(40, 500, key=77, rms=1e-5, first_bin=3, first_frame=1000)
    assert zlib.crc32(re.astype("<f4").tobytes() + im.astype("<f4").tobytes()) == DIGEST


# Statistics


@pytest.fixture(scope="module")
def noise():
    """64 bins of 32768 frames, float64: 4.2 million normal values of variance 1."""
    re, im = planes(64, 32768)
    return re + 1j * im.astype(np.float64)


@pytest.mark.parametrize("what", ["value", "square", "power"])
def test_white_along_frames_and_bins(noise, what):
    """Correlations at 64 lags in slow time, 32 in range and 64 in both, of the noise, of w^2 and of |w|^2."""
    series = {"value": noise, "square": noise**2, "power": np.abs(noise) ** 2 - 2}[what]
    variance = np.mean(np.abs(series) ** 2)
    lags = [(0, i) for i in (*range(1, 49), *(LANES + k for k in range(-4, 5)), 256, 512, 1000, 1024, 2048, 4096, 8192)]
    lags += [(n, 0) for n in range(1, 33)] + [(n, i) for n in range(1, 9) for i in (-7, -3, -2, -1, 1, 2, 3, 7)]
    total = 0.0
    for n, i in lags:
        ahead, behind = series[n:, max(i, 0) :], series[: 64 - n, max(-i, 0) :]
        shared = min(ahead.shape[1], behind.shape[1])
        products = sum(np.vdot(b[:shared], a[:shared]) for a, b in zip(ahead, behind, strict=True))
        z = products / variance / math.sqrt((64 - n) * shared)
        total += abs(z) ** 2 * (1 if what == "power" else 2)
    freedom = len(lags) * (1 if what == "power" else 2)
    assert stats.chi2.sf(total, freedom) > P_LIMIT
    assert stats.chi2.cdf(total, freedom) > P_LIMIT


def test_consecutive_keys_and_frames_pool_to_white_noise():
    """The first frames of many examples, pooled: what a dataset's users see."""
    keys = [int(draw_key(np.random.default_rng(seed))) for seed in range(1000)] + list(range(1000))
    first = np.array([np.concatenate(planes(8, 8, key=key)).ravel() for key in keys], dtype=np.float64)
    assert stats.kstest(first.ravel(), "norm").pvalue > P_LIMIT
    columns = np.corrcoef(first.T)[np.triu_indices(first.shape[1], 1)] * math.sqrt(len(keys))
    assert stats.kstest(columns, "norm").pvalue > P_LIMIT
    rows = np.sum(first[1:] * first[:-1], axis=1) / math.sqrt(first.shape[1])
    assert 2 * stats.norm.sf(abs(rows.sum()) / math.sqrt(rows.size)) > P_LIMIT

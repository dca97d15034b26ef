"""Sum of Gaussian echoes into the complex data matrix (E-18).

The sample of every frame and bin is computed by itself, from the numbers of its own frame only and in the order of the
scatterers: how the frames and bins are cut into tiles changes no bit of it. Thirty-two consecutive frames go side by
side through every inner loop, on contiguous memory, so that the compiler turns it into vector instructions.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

SUPPORT_SIGMAS = 5.5
"""An echo is cut where its envelope is below exp(-5.5^2 / 2) = 2.7e-7 of its peak."""

LANES = 32
"""Frames side by side; the width of a tile of planes is a multiple of it."""

TILE = 9 * LANES
"""Frames that are synthesised before they are transposed."""

BINS_PER_TURN = 64
"""Bins transposed together: 64 bins of 32 frames, real and imaginary, are 16 KiB and stay in the first-level cache."""

PLACE, REST, IN_PHASE, QUADRATURE = 0, LANES, 2 * LANES, 3 * LANES
"""Places of an echo's four numbers in its buffer, each for all lanes."""

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]

# Largest relative error 9e-8 for |x| <= 1/2, exact at 0.
_E1, _E2, _E3 = np.float32(0.6931469775973299), np.float32(0.24022242082677556), np.float32(0.05550733744824973)
_E4, _E5 = np.float32(0.009671512812489076), np.float32(0.0013264727213551826)
# Largest errors 3e-10 and 7e-9 for |v| <= 1/4.
_C1, _C2, _C3 = np.float32(-19.739208547715332), np.float32(64.93934647616803), np.float32(-85.45356475943481)
_C4, _C5 = np.float32(60.14388953533489), np.float32(-24.98143432289362)
_S0, _S1, _S2 = np.float32(6.283185280154403), np.float32(-41.34168061334532), np.float32(81.60247636883796)
_S3, _S4 = np.float32(-76.5811726421402), np.float32(39.75982706857711)
_ZERO, _ONE, _TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)
_ROUNDER = np.float32(1.5 * 2**23)  # a float32 this large has no fraction: adding it rounds
_EXPONENT = np.int32(23)  # position of the exponent in a float32


@kernel(fastmath=("contract",))
def _exp2(x: np.float32) -> np.float32:
    """Compute 2^x for -126 < x <= 0.
    A polynomial gives 2^(x - round(x)); 2^round(x) is added to the exponent's bits.
    """
    rounded = np.float32(x + _ROUNDER)
    f = x - (rounded - _ROUNDER)
    power = np.float32(_ONE + f * (_E1 + f * (_E2 + f * (_E3 + f * (_E4 + f * _E5)))))
    bits = np.int32(power.view(np.int32) + np.int32(rounded.view(np.int32) << _EXPONENT))
    return np.float32(bits.view(np.float32))


@kernel(fastmath=("contract",))
def _describe(range_m, amplitude, extra_turns, geometry, reach, echo):  # type: ignore[no-untyped-def]
    """Compute place, amplitude and bins of one echo in all lanes.
    The place is in bins, the amplitude is complex; first and last bin are those that the echo reaches.
    """
    first_bin_m, bins_per_m, first_turn, turns_per_m = geometry
    first = np.int32(2**30)
    last = np.int32(-(2**30))
    for lane in range(LANES):
        place = (range_m[lane] - first_bin_m) * bins_per_m
        nearest = np.rint(place)
        echo[PLACE + lane] = np.float32(nearest)
        echo[REST + lane] = np.float32(place - nearest)
        within = min(max(place, -1e9), 1e9)  # so that far scatterers fit an int32
        first = min(first, np.int32(np.ceil(within - reach)))
        last = max(last, np.int32(np.floor(within + reach)))
        turns = first_turn - turns_per_m * range_m[lane] + extra_turns[lane]
        turns -= np.rint(turns)
        halves = np.rint(2.0 * turns)
        v = np.float32(turns - 0.5 * halves)
        half = np.float32(halves)
        peak = np.float32(amplitude[lane]) * (_ONE - _TWO * half * half)
        q = v * v
        echo[IN_PHASE + lane] = peak * (_ONE + q * (_C1 + q * (_C2 + q * (_C3 + q * (_C4 + q * _C5)))))
        echo[QUADRATURE + lane] = peak * v * (_S0 + q * (_S1 + q * (_S2 + q * (_S3 + q * _S4))))
    return first, last


@kernel(fastmath=("contract",))
def _add(echo, first, stop, exponent, cut, start, stride, re, im):  # type: ignore[no-untyped-def]
    """Add one echo in all lanes to bins first..stop-1.
    They are in the flat planes from ``start`` on, ``stride`` apart.
    """
    for n in range(first, stop):
        row = start + (n - first) * stride
        for lane in range(LANES):
            # both differences but the last are between whole numbers, hence exact
            x = (np.float32(n) - echo[PLACE + lane]) - echo[REST + lane]
            xx = x * x
            envelope = _exp2(exponent * xx) if xx <= cut else _ZERO
            at = np.uint64(row + lane)  # unsigned: no test for an index from the end, which would stop vectorising
            re[at] += envelope * echo[IN_PHASE + lane]
            im[at] += envelope * echo[QUADRATURE + lane]


@kernel()
def _load(range_m, amplitude, first_frame, ranges, amplitudes, extra_phase_rad, extra):  # type: ignore[no-untyped-def]
    """Transpose one block of frames to (scatterer, lane).
    Frames outside the record are silent.
    """
    n_frames, n_scatterers = range_m.shape
    for lane in range(LANES):
        wanted = first_frame + lane
        frame = min(max(wanted, 0), n_frames - 1)
        for scatterer in range(n_scatterers):
            ranges[scatterer, lane] = range_m[frame, scatterer]
            amplitudes[scatterer, lane] = amplitude[frame, scatterer] if wanted == frame else 0.0
            if extra_phase_rad is not None:
                extra[scatterer, lane] = extra_phase_rad[frame, scatterer] * (0.5 / math.pi)


def echo_planes(
    range_m: Float64Array,
    amplitude: Float64Array,
    first_bin_m: float,
    bin_spacing_m: float,
    pulse_sigma_m: float,
    wavelength_m: float,
    phase_rad: float,
    first_frame: int,
    first_bin: int,
    plane_re: Float32Array,
    plane_im: Float32Array,
    extra_phase_rad: Float64Array | None = None,
) -> tuple[int, int]:
    r"""Write the echoes of all scatterers into a tile of planes.

    Slow time is contiguous.

    .. math:: Y_{i,n} = \sum_l a_{il}\, e^{-(R_n - R_{il})^2 / 2 s^2}\, e^{j(\theta - 4 \pi R_{il} / \lambda)}

    With the place of a scatterer in bins :math:`p = (R_{il} - R_0) / \Delta R` and :math:`\varsigma = s / \Delta R` the
    envelope is :math:`2^{-(n - p)^2 / (2 \varsigma^2 \ln 2)}`, zero for :math:`|n - p| > 5.5 \varsigma`. Place and
    number of turns :math:`\theta / 2\pi - 2 R_{il} / \lambda` are computed in float64 and split there into a whole
    number and a rest; only the rests go on in float32. (All in float32 would leave an error floor of -80 dB.)

    Parameters
    ----------
    range_m, amplitude : ndarray, shape (I, L), float64
        Range and amplitude of every scatterer in every frame, in any memory order.
    first_bin_m, bin_spacing_m : float
        Range of bin 0 and spacing of the bins.
    pulse_sigma_m : float
        Standard deviation of an echo's envelope in range, s = c tau / 2.
    wavelength_m, phase_rad : float
        Wavelength and phase theta of the transmitted pulse.
    first_frame, first_bin : int
        Frame and bin of the tile's first sample. Frames outside 0..I-1 are zero.
    plane_re, plane_im : ndarray, shape (bins, frames), float32, C-contiguous
        The tile, overwritten; the number of frames is a multiple of LANES. Rows of a multiple of 4 KiB (1024 frames)
        fall on the same cache lines and can take three times as long; 992 or 1056 frames do not.
    extra_phase_rad : ndarray, shape (I, L), float64, optional
        Further phase of every scatterer in every frame.

    Returns
    -------
    tuple of int
        Rows of the tile, from and up to, outside of which it is zero.
    """
    if plane_re.shape[1] % LANES or plane_im.shape != plane_re.shape:
        raise ValueError("both planes need the same shape, and a multiple of 32 frames")
    rows = np.empty(2, dtype=np.int64)
    _fill_planes(
        range_m,
        amplitude,
        first_bin_m,
        bin_spacing_m,
        pulse_sigma_m,
        wavelength_m,
        phase_rad,
        first_frame,
        first_bin,
        plane_re.shape[1],
        plane_re.reshape(-1),
        plane_im.reshape(-1),
        extra_phase_rad,
        rows,
    )
    return int(rows[0]), int(rows[1])


@kernel()
def _fill_planes(  # type: ignore[no-untyped-def]
    range_m,
    amplitude,
    first_bin_m,
    bin_spacing_m,
    pulse_sigma_m,
    wavelength_m,
    phase_rad,
    first_frame,
    first_bin,
    n_frames,
    re,
    im,
    extra_phase_rad,
    rows,
):
    """Write the echoes into flat planes of ``n_frames`` a row; see :func:`echo_planes`."""
    n_bins, n_scatterers = re.shape[0] // n_frames, range_m.shape[1]
    sigma = pulse_sigma_m / bin_spacing_m
    cut = np.float32((SUPPORT_SIGMAS * sigma) ** 2)
    reach = SUPPORT_SIGMAS * sigma + 1e-3  # float32 may round a bin at the cut to either side
    geometry = (first_bin_m, 1.0 / bin_spacing_m, phase_rad / (2.0 * math.pi), 2.0 / wavelength_m)
    exponent = np.float32(-0.5 / (math.log(2.0) * sigma * sigma))
    ranges = np.empty((n_scatterers, LANES))
    amplitudes = np.empty((n_scatterers, LANES))
    extra = np.zeros((n_scatterers, LANES))
    echo = np.empty(4 * LANES, dtype=np.float32)
    re[:] = 0.0
    im[:] = 0.0
    lowest = n_bins
    highest = 0
    for column in range(0, n_frames, LANES):
        _load(range_m, amplitude, first_frame + column, ranges, amplitudes, extra_phase_rad, extra)
        for scatterer in range(n_scatterers):
            first, last = _describe(ranges[scatterer], amplitudes[scatterer], extra[scatterer], geometry, reach, echo)
            first = max(first - first_bin, 0)
            stop = min(last + 1 - first_bin, n_bins)
            if first < stop:
                start = first * n_frames + column
                _add(echo, first + first_bin, stop + first_bin, exponent, cut, start, n_frames, re, im)
                lowest = min(lowest, first)
                highest = max(highest, stop)
    rows[0], rows[1] = min(lowest, highest), highest


def join_planes(
    plane_re: Float32Array, plane_im: Float32Array, lowest: int, highest: int, out: npt.NDArray[np.complex64]
) -> None:
    """Transpose planes to a matrix of complex samples.
    This is the reverse of :func:`split_planes`. Shapes: plane_re, plane_im (bins, I or more); out (I, bins).
    """
    pairs = out.view(np.float32)
    pairs[:, : 2 * lowest] = 0.0
    pairs[:, 2 * highest :] = 0.0
    _join(plane_re.reshape(-1), plane_im.reshape(-1), plane_re.shape[1], lowest, highest, pairs)


@kernel()
def _join(re, im, width, lowest, highest, pairs):  # type: ignore[no-untyped-def]
    for begin in range(lowest, highest, BINS_PER_TURN):
        end = min(begin + BINS_PER_TURN, highest)
        for frame in range(pairs.shape[0]):
            for n in range(begin, end):
                pairs[np.uint64(frame), np.uint64(2 * n)] = re[np.uint64(n * width + frame)]
                pairs[np.uint64(frame), np.uint64(2 * n + 1)] = im[np.uint64(n * width + frame)]


def add_echoes(
    range_m: Float64Array,
    amplitude: Float64Array,
    first_bin_m: float,
    bin_spacing_m: float,
    pulse_sigma_m: float,
    wavelength_m: float,
    phase_rad: float,
    out: npt.NDArray[np.complex64],
    extra_phase_rad: Float64Array | None = None,
) -> None:
    """Write the echoes of all scatterers into the data matrix.
    Shapes: out (I, N).
    """
    planes = np.empty((2, out.shape[1], TILE), dtype=np.float32)  # a tile stays in the second-level cache
    for frame in range(0, out.shape[0], TILE):
        rows = echo_planes(
            range_m,
            amplitude,
            first_bin_m,
            bin_spacing_m,
            pulse_sigma_m,
            wavelength_m,
            phase_rad,
            frame,
            0,
            planes[0],
            planes[1],
            extra_phase_rad,
        )
        join_planes(planes[0], planes[1], *rows, out[frame : frame + TILE])


@kernel()
def split_planes(
    matrix: npt.NDArray[np.complex64], first_bin: int, plane_re: Float32Array, plane_im: Float32Array
) -> None:
    """Copy range bins of a data matrix to real and imaginary planes.
    Slow time is contiguous. Shapes: matrix (I, N); plane_re, plane_im (bins, I).
    """
    for begin in range(0, plane_re.shape[1], LANES):  # a block of frames stays in the cache for all bins
        end = min(begin + LANES, plane_re.shape[1])
        for n in range(plane_re.shape[0]):
            for frame in range(begin, end):
                value = matrix[frame, first_bin + n]
                plane_re[n, frame] = value.real
                plane_im[n, frame] = value.imag

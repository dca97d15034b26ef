"""Native functions: the same bytes at every level of processor, and arguments that do not fit are refused."""

import math
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from importlib import import_module

import numpy as np
import pytest

from doppelgait._core import native
from doppelgait.radar.waveforms import pulses, sweep


@dataclass
class Case:
    """Call of a native function with arguments that fit."""

    name: str
    arguments: list
    outputs: tuple[int, ...] = ()
    """Places of the arrays that are written."""
    free: tuple[tuple[int, int], ...] = ()
    """Array and axis whose length nothing else determines."""
    rows: tuple[int, ...] = ()
    """Places of read arrays whose rows are contiguous."""
    pack: Callable[[list], list] = list
    """What makes lists of arrays of the arguments."""

    def call(self, arguments, module=native):
        return getattr(module, self.name)(*self.pack(arguments))

    def run(self, module=native):
        """Return the result and the arrays that were written."""
        arguments = [value.copy() if isinstance(value, np.ndarray) else value for value in self.arguments]
        result = self.call(arguments, module)
        written = [arguments[n] for n in self.outputs]
        return written if result is None else [np.array(result), *written]


def make_spline_cases(rng, n_points):
    step, times = 0.013, np.sort(rng.uniform(0.0, 0.013 * 39, 77))
    values = np.cumsum(rng.standard_normal((40, 3 * n_points)), axis=0)
    moments = np.full_like(values, np.nan)
    native.spline_moments(values, step, moments)
    spline, origin = [values, moments, step, times], np.array([1.0, -2.0, 0.5])
    both, each = np.zeros((77, 3 * n_points)), np.zeros((77, n_points))
    knots = np.sort(rng.uniform(size=(2, 7))), np.array([7, 5])
    return [
        Case("spline_moments", [values, step, np.zeros_like(values)], (2,)),
        Case("positions_and_velocities", [*spline, both, both], (4, 5)),
        Case("values_between", [*spline, both], (4,)),
        Case("ranges_and_velocities", [*spline, origin, each, each], (5, 6)),
        Case("angles_of_sight", [*spline, origin, each, each, 40.0, each], (5, 6, 8)),
        Case("angles_of_sight", [*spline, origin, each, each, 40.0, None], (5, 6)),
        Case(
            "turn_and_move", [values.reshape(-1, 3), 0.8, 0.6, 1.0, 2.0, 3.0, 4.0, np.zeros((40 * n_points, 3))], (7,)
        ),
        Case("evaluate_harmonics", [rng.normal(size=(6, 8)), both[:3] + 0.3, both[:6]], (2,), free=((0, 1), (1, 0))),
        Case("evaluate_cubics", [*knots, rng.normal(size=(4, 12)), 1, both[:4] + 0.1, both[:4]], (5,)),
    ]


def make_signature_cases(rng, n):
    planes, low = rng.standard_normal((2, n, 400)).astype(np.float32), np.linspace(-2.0, n - 0.7, 50)
    signature = [
        *planes,
        390,
        -20,
        3,
        np.hanning(128).astype(np.float32),
        low,
        low + 2.4,
        np.zeros((50, 128), np.float32),
    ]
    others = (48, 64, 80, 160, 192, 256, 512, 640)  # every first pass, and middle passes
    return [
        Case("gated_signature", signature, (8,), rows=(0, 1)),
        *(
            Case(
                "gated_signature",
                [*signature[:4], 1, np.hanning(k).astype(np.float32), *signature[6:8], np.zeros((50, k), np.float32)],
                (8,),
                rows=(0, 1),
            )
            for k in others
        ),
    ]


def make_noise_cases(rng, n):
    planes, taps = np.zeros((2, n, 300), np.float32), np.array([0.8, 0.5, 0.2], np.float32)
    matrix = np.zeros((300, n), np.complex64)
    return [
        Case("add_noise_block", [*planes, 3, 290, 3, 1000, 77, 1e-5, taps], (0, 1), free=((8, 0),)),
        Case("add_noise_matrix", [matrix, 78, 1e-5, taps], (0,), free=((0, 0), (0, 1), (3, 0))),
    ]


def make_image_cases(rng, n):
    paths = rng.uniform(0.2, 4.0, (10, 50, n))
    reflection, table = rng.standard_normal((2, 50, n)), np.ones((6, 50, 3 * n + 1))
    heights, moments = rng.standard_normal((2, 20, n))
    spline = [heights, moments, 0.1, rng.uniform(0.0, 1.9, 50)]
    return [
        Case(
            "fill_images",
            [*paths, *reflection, 0.5, n + 1, *table],
            (14, 15, 16, 17, 18, 19),
            pack=lambda a: [a[:5], a[5:10], *a[10:14], a[14:]],
        ),
        Case("image_ranges", [*spline, 1, 0.9, n + 1, 2 * n + 1, *table[:2]], (8, 9)),
    ]


def make_fit_cases(rng, n):
    size = 13 * n
    t = np.linspace(-1.0, 1.0, size)
    basis, values = np.stack([np.ones(size), t, t * t]), rng.standard_normal(size)
    prior, divisor = rng.uniform(0.5, 1.0, (2, size))
    low, high = values - rng.uniform(1.0, 2.0, size), values + rng.uniform(1.0, 2.0, size)
    low[3] = np.nan
    cells, quiet = rng.uniform(size=(30, size)), rng.uniform(size=size) < 0.5
    cadence_hz, power = np.arange(0.0, 8.0, 0.05), rng.uniform(size=(160, size))
    return [
        Case("quantile", [values, 0.3], free=((0, 0),)),
        Case(
            "robust_fit",
            [basis, values, prior, divisor, 0.01, 2.4, 5, np.zeros(size), np.zeros(3)],
            (7, 8),
            free=((0, 1),),
        ),
        Case("variance_of_rows", [cells, quiet, 4], free=((0, 0),)),
        Case("variance_of_rows", [cells.astype(np.float32), quiet, 4], free=((0, 0),)),
        Case("edge_statistics", [low, high, values, -1.0, 0.05, 0.95, np.zeros(12)], (6,)),
        Case("oscillating_power", [cadence_hz, power, 1.9, 0.06, 0.25, np.zeros(2)], (5,), free=((1, 1),)),
    ]


def make_echo_cases(rng, n):
    range_m, amplitude, extra_rad = rng.uniform(0.3, 3.0, (3, 77, n))
    radar = [0.4, 0.05, 0.052, 0.041, 0.3]
    planes = np.zeros((2, 40, 90), np.float32)
    return [
        Case("echo_planes", [range_m, amplitude, *radar, *planes, extra_rad], (7, 8), rows=(0, 1, 9)),
    ]


def make_plane_cases(rng, n):
    re, im = rng.standard_normal((2, n, 77)).astype(np.float32)
    matrix = (re + 1j * im).T.astype(np.complex64)
    zeros, factors = np.zeros_like(re), rng.standard_normal((2, n, 77)).astype(np.float32)
    turns, phases, weights = rng.uniform(-9, 9, 77), rng.uniform(-9, 9, (3, 77)), rng.standard_normal((n, 3))
    return [
        Case("strongest_power", [re, im, np.zeros(77, np.float32)], (2,), free=((2, 0),), rows=(0, 1)),
        Case("turn_planes", [re, im, *factors], (0, 1)),
        Case("quantise_parts", [re, 77, 0.1, -9.0, 9.0, 1.5, zeros], (6,), rows=(0,)),
        Case("find_largest_part", [re, 77], free=((0, 0),), rows=(0,)),
        Case("rotate_parts", [re, im, turns, phases, weights, zeros, zeros], (5, 6), rows=(0, 1)),
        Case("join_planes", [re, im, np.zeros((77, n), np.complex64)], (2,), free=((2, 0),), rows=(0, 1)),
        Case("split_planes", [np.ascontiguousarray(matrix), zeros, zeros], (1, 2), free=((0, 0),), rows=(0,)),
    ]


def make_body_cases(rng, n):
    centre, along, across = rng.standard_normal((3, 20, n, 3))
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    across = np.cross(along, across)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    body = [centre, along, across, rng.uniform(0.2, 1.0, (n, 3))]
    radar, points = np.array([4.0, 0.5, 0.2]), rng.standard_normal((20, n + 2, 3))
    passes = rng.uniform(size=(n + 2, n)) < 0.1
    return [
        Case("see_ellipsoids", [*body, radar, np.zeros((20, 3, n)), np.zeros((20, n))], (5, 6)),
        Case("sight_amplitudes", [points, *body, passes, radar, 0.1, np.zeros((20, n + 2))], (8,)),
    ]


def make_cadence_cases(rng, n):
    rows, weights, taps = rng.standard_normal((31, n)), rng.uniform(0.0, 1.0, 31), rng.standard_normal((2, 18))
    lines = np.fft.rfft(rng.standard_normal((n, 60)))
    return [
        Case("smear", [rows, weights, taps.ravel(), 2, np.zeros((40, n))], (4,), free=((2, 0), (4, 0))),
        Case("project", [rows, rng.standard_normal((31, 7)), np.zeros((7, n))], (2,)),
        Case("lay_circular", [rows, weights, n // 2, np.zeros((n - n // 2, 31))], (3,), free=((3, 0),)),
        Case(
            "fine_magnitudes",
            [lines, taps, 2, np.zeros((50, n + 2))],
            (3,),
            free=((0, 0), (0, 1), (1, 0), (1, 1), (3, 0)),
        ),
    ]


def make_column_cases(rng, n, dtype=np.float64):
    values = (rng.standard_normal((9, n + 2)) ** 2).astype(dtype)
    level, each, sums = values.mean(axis=1), np.zeros(9), np.zeros(5)
    cells, lines = np.zeros(values.shape), np.linspace(0.4, n + 0.3, 9)
    bins, edges, reaches = rng.integers(0, n + 2, 9), np.array([1, 4, 9]), np.array([0.6, 2.7, 1.5])
    wide = (rng.standard_normal((9, 2 * n + 1)) ** 2).astype(dtype)
    return [
        Case("sum_excess", [values, 0.3, each, each], (2, 3), free=((0, 1),)),
        Case("scale_excess", [values, 0.3, lines, cells], (3,)),
        Case("column_peaks", [values, np.zeros(9, dtype), each], (1, 2), free=((0, 1),)),
        Case("row_means", [values, np.zeros(n + 2)], (1,), free=((0, 0),)),
        Case("count_above", [values, level, edges, np.zeros((2, n + 2))], (3,)),
        Case("shift_columns", [values, 1.7 * lines - 4.0, cells], (2,)),
        Case("copy_rows", [values, bins[:5], np.zeros((9, 5), dtype)], (2,), free=((0, 1),)),
        Case("power_quantiles", [values, 0.3, 0.2, 0.01, 0.99, each, each], (5, 6), free=((0, 1),)),
        Case("positive_sums", [values - values.mean(), 3, np.zeros(3)], (2,), free=((0, 1),)),
        Case("powers_about_line", [values, 0.3, lines, reaches, lines, sums, each, each], (5, 6, 7), free=((0, 1),)),
        Case("follow_ridge", [wide, 0.1, lines, n, 2.0, np.zeros(9, np.int64)], (5,)),
        Case("refine_path", [values, 0.1, bins - 1, each], (3,), free=((0, 1),)),
        Case("strongest_near", [values, bins - 1, 1, np.zeros(9, dtype)], (3,), free=((0, 1),)),
    ]


def make_single_column_cases(rng, n):
    return make_column_cases(rng, n, np.float32)


def make_row_cases(rng, n):
    moved, noise = rng.standard_normal((8, 3 * n)) ** 2, rng.uniform(0.0, 0.5, 8)
    starts, stops = 3 * np.arange(n), 3 * np.arange(1, n + 1)
    return [
        Case("limb_amplitudes", [moved, noise, 0.1, 0.2, starts, stops, np.zeros((8, n))], (6,)),
        Case("widths_above", [moved, 0.7, np.zeros(8)], (2,), free=((0, 1),)),
        Case("sum_groups", [moved, 2, 3, np.zeros((4, n))], (3,)),
        Case("sum_groups", [moved, 2, 1, np.zeros((4, 3 * n))], (3,)),
        Case("smooth", [moved.ravel(), 1.7, True, np.zeros(24 * n)], (3,)),
        Case("smooth", [moved.ravel(), 9.3, False, np.zeros(24 * n)], (3,)),
    ]


def make_rhythm_cases(rng, n):
    rows, basis = rng.standard_normal((40, n)), np.linalg.qr(rng.standard_normal((40, 3)))[0]
    stops, starts = np.array([n // 2, n]), np.array([0, 7, 21])
    pairs, until, powers = np.full((64, n + 1), np.nan), np.zeros((4, 41)), np.zeros((4, 33), complex)
    share, place = rng.uniform(size=80), rng.uniform(1.0, 30.0, 9 * n)
    lines = rng.standard_normal((64, 2 * n))
    return [
        Case("remove_trend", [rows, basis], (0,), free=((0, 1), (1, 1))),
        Case("square_difference", [rows, 3, np.zeros(37)], (2,), free=((0, 1), (2, 0))),
        Case("period_harmonics", [rows, starts, 19, 0.1, np.zeros((15, n))], (4,)),
        Case("weigh_rows", [rows, stops, 0.7, 1e-3, pairs, np.zeros(n), until], (4, 5, 6), free=((4, 0), (4, 1))),
        Case("powers_of_pairs", [lines, stops, rng.uniform(size=n), 0.7, powers], (4,), free=((0, 0),)),
        Case("sum_harmonics", [share, place, 3, np.zeros(9 * n)], (3,), free=((0, 0),)),
        Case(
            "rhythm_evidence",
            [np.tanh(rng.standard_normal((2, 90))), 40.0, lines[:2] ** 2, 0.05, place / 4.0, np.zeros((18, 9 * n))],
            (5,),
            free=((0, 1), (2, 1)),
        ),
    ]


def make_path_cases(rng, n):
    x, y = np.cumsum(rng.uniform(0.5, 1.0, (2, 30 * n)), axis=1)
    return [Case("longest_stretch", [x, y, np.hypot(x, y), 1.0, 0.5, 0.9, 2.0, 0.1, 3])]


def make_amplitude_cases(rng, n):
    table = rng.uniform(0.1, 2.0, (4, 30, n))
    return [Case("integrate_echoes", [*table, 3e-4, 0.2, 1.3, np.zeros((30, n))], (7,), rows=(0, 1, 2, 3))]


def make_waveform_cases(rng, n):
    amplitude, turns, delay = rng.uniform(0.0, 1.0, (3, 37, n))
    slopes, doppler, out = 1e-3 * delay, rng.uniform(-1e-5, 1e-5, (37, n)), np.zeros((37, 96), np.complex64)
    delay[3:5] += 1.2
    echoes, table = [amplitude, turns, delay, doppler], pulses.tabulate(96, 0.009, 50.0)
    turn = rng.standard_normal((2, 96)).astype(np.float32)
    facts = np.array([6.7e-9, 0.1, 6e10, 7.5e12, 1.5e9, 1.0, 6e6, 2.4e5, 2.0, 128.0, 0.5])
    tables = sweep.tabulate_taps(), sweep.tabulate_half_bin_responses("hann", 128, 96)
    return [
        Case("add_tones", [amplitude, turns, delay, slopes, out], (4,), free=((4, 1),)),
        Case("add_responses", [*echoes, 0.1, 0.009, 50.0, 1e-5, out, None], (8,), free=((8, 1),)),
        Case("add_responses", [*echoes, 0.1, 0.009, 50.0, 1e-5, out, table], (8,), free=((8, 1),)),
        Case(
            "add_sweep_responses",
            [*(8.0 * table for table in echoes[:3]), turns, facts, *tables, turn, out],
            (8,),
            free=((8, 1),),
        ),
    ]


def make_pattern_cases(rng, n):
    azimuth, elevation, gain = rng.uniform(-1.5, 1.5, (3, 37, n))
    normal, times = rng.standard_normal((40, 2 * n)), rng.uniform(0.0, 2.0, 37)
    return [
        Case("apply_cosine_pattern", [azimuth, elevation, 0.1, 0.2, 2.0, 3.0, 1e-3, gain, np.zeros_like(gain)], (8,)),
        Case("smoothed_chi_square", [normal, times, 0.3, 9, np.zeros_like(gain)], (4,), free=((0, 0),)),
    ]


def make_cases():
    rng = np.random.default_rng(5)
    makers = [value for name, value in globals().items() if name.startswith("make_") and value is not make_cases]
    return [case for n in (1, 2, 3, 5, 41) for make in makers for case in make(rng, n)]


CASES = make_cases()
LEVELS = [import_module(f"doppelgait._core._level{n}") for n in range(1, native.find_processor_level() + 1)]


def identify(case):
    return case.name


@pytest.mark.parametrize("case", CASES, ids=identify)
def test_levels_2_and_3_make_the_same_bytes_and_level_1_differs_by_rounding(case):
    first, second, third = (case.run(LEVELS[min(n, len(LEVELS) - 1)]) for n in range(3))
    for one, two, three in zip(first, second, third, strict=True):
        assert two.tobytes() == three.tobytes()
        limit = (1e-9 if two.real.dtype.itemsize >= 8 else 1e-5) * np.nanmax(np.abs(two), initial=0.0)
        np.testing.assert_allclose(one, two, rtol=0, atol=limit)


DISTINCT = list({case.name: case for case in CASES}.values())


@pytest.mark.parametrize("case", DISTINCT, ids=identify)
def test_written_arrays_are_never_copied(case):
    for n in case.outputs:
        given = case.arguments[n]
        others = [np.zeros(given.shape, np.float16), np.zeros((2 * given.size, 2))[::2, 0]]
        others += [np.zeros(given.shape[::-1]).T] if given.ndim > 1 and min(given.shape) > 1 else []
        others += [
            np.broadcast_to(np.zeros(1, given.dtype), given.shape),
            np.frombuffer(bytes(given.nbytes), given.dtype).reshape(given.shape),
        ]
        for other in others:
            arguments = [*case.arguments[:n], other, *case.arguments[n + 1 :]]
            with pytest.raises((TypeError, ValueError)):
                case.call(arguments)
            assert not other.any()


@pytest.mark.parametrize("case", DISTINCT, ids=identify)
def test_lengths_that_disagree_are_refused(case):
    for n, value in enumerate(case.arguments):
        for axis in range(np.ndim(value)):
            if (n, axis) in case.free:
                continue
            arguments = [part.copy() if isinstance(part, np.ndarray) else part for part in case.arguments]
            arguments[n] = np.ascontiguousarray(np.delete(value, -1, axis))
            with pytest.raises(ValueError, match=r"\w"):
                case.call(arguments)
            for k in case.outputs:
                assert k == n or arguments[k].tobytes() == case.arguments[k].tobytes()


@pytest.mark.parametrize("case", DISTINCT, ids=identify)
def test_read_arrays_may_have_any_layout_and_type(case):
    strided = replace(case, arguments=list(case.arguments))
    for n, value in enumerate(case.arguments):
        if isinstance(value, np.ndarray) and n not in (*case.outputs, *case.rows):
            strided.arguments[n] = np.repeat(value, 2, axis=-1)[..., ::2]
    for one, other in zip(case.run(), strided.run(), strict=True):
        assert one.tobytes() == other.tobytes()
    for n in case.rows:
        arguments = [*case.arguments[:n], np.repeat(case.arguments[n], 2, axis=-1)[..., ::2], *case.arguments[n + 1 :]]
        with pytest.raises(ValueError, match=r"\w"):
            case.call(arguments)


@pytest.mark.parametrize("time", [math.nan, math.inf, -math.inf, -5.0, 1e300])
def test_times_outside_a_spline_read_its_first_or_last_frames(time):
    values, out = np.ones((4, 3)), np.zeros((1, 3))
    native.values_between(values, 0.0 * values, 0.1, np.array([time]), out)
    assert np.isnan(out).all() or out == pytest.approx(1.0)


@pytest.mark.parametrize("place", [math.nan, math.inf, -1e300, 1e17, -3.0])
def test_lines_anywhere_read_no_cell_outside_the_axis(place):
    values, path = np.ones((4, 5)), np.zeros(4, np.int64)
    line = np.array([2.0, place, 2.0, place])
    native.follow_ridge(values, 0.1, line, 2, 2.0, path)
    assert path[0] in range(5)
    sums, square, moment = np.zeros(5), np.zeros(4), np.zeros(4)
    native.powers_about_line(values, 0.1, line, np.ones(3), np.ones(4), sums, square, moment)
    assert square[0] == pytest.approx(3 * 0.9**2)


PLANES = [*np.zeros((2, 4, 64), np.float32)]
GATE = [np.zeros(10), np.ones(10), np.ones((10, 48), np.float32)]
TAP, WINDOW = np.ones(1, np.float32), np.ones(48, np.float32)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        *(
            ("gated_signature", [*PLANES, *numbers, WINDOW, *GATE])
            for numbers in ((65, 0, 1), (-1, 0, 1), (64, 0, 0), (64, 0, 1 << 60), (64, -(1 << 62), 1))
        ),
        ("gated_signature", [*PLANES, 64, 0, 1, np.ones(49, np.float32), *GATE[:2], np.ones((10, 49), np.float32)]),
        ("add_noise_block", [*PLANES, 0, 65, 0, 0, 1, 1.0, TAP]),
        ("add_noise_block", [*PLANES, -1, 64, 0, 0, 1, 1.0, TAP]),
        ("add_noise_block", [*PLANES, 0, 64, 0, 0, 1, 1.0, TAP[:0]]),
        *(
            ("smoothed_chi_square", [np.ones((37, 4)), np.array([1.0, time]), 0.3, 9, np.zeros((2, 2))])
            for time in (-0.2, 2.9, math.nan, math.inf, 1e300)
        ),
        ("smooth", [np.ones(4), 0.0, True, np.ones(4)]),
        ("smooth", [np.ones(4), 1e300, True, np.ones(4)]),
        ("smooth", [np.ones(0), 1.0, True, np.ones(0)]),
        ("follow_ridge", [np.ones((4, 5)), 0.1, np.ones(4), 3, 2.0, np.zeros(4, np.int64)]),
        ("follow_ridge", [np.ones((4, 5)), 0.1, np.ones(4), -1, 2.0, np.zeros(4, np.int64)]),
        ("strongest_near", [np.ones((4, 5)), np.zeros(4, np.int64), 5, np.ones(4)]),
        ("copy_rows", [np.ones((4, 5)), np.array([0, 5]), np.ones((4, 2))]),
        ("copy_rows", [np.ones((4, 5)), np.array([0, -1]), np.ones((4, 2))]),
        ("count_above", [np.ones((4, 5)), np.ones(4), np.array([0, 5]), np.ones((1, 5))]),
        ("count_above", [np.ones((4, 5)), np.ones(4), np.array([-1, 4]), np.ones((1, 5))]),
        ("limb_amplitudes", [np.ones((4, 5)), np.ones(4), 0.0, 0.0, np.array([-1]), np.array([2]), np.ones((4, 1))]),
        ("limb_amplitudes", [np.ones((4, 5)), np.ones(4), 0.0, 0.0, np.array([1]), np.array([6]), np.ones((4, 1))]),
        ("sum_groups", [np.ones((4, 5)), 0, 1, np.ones((4, 5))]),
        ("positive_sums", [np.ones((4, 5)), 0, np.ones(4)]),
        ("smear", [np.ones((4, 5)), np.ones(4), np.ones(3), 0, np.ones((4, 5))]),
        ("smear", [np.ones((4, 5)), np.ones(4), np.ones(3), 1 << 60, np.ones((4, 5))]),
        ("lay_circular", [np.ones((4, 5)), np.ones(4), -1, np.ones((2, 9))]),
        ("lay_circular", [np.ones((4, 5)), np.ones(4), 4, np.ones((2, 9))]),
        ("fine_magnitudes", [np.ones((2, 9), complex), np.ones((2, 6)), 1, np.ones((7, 2))]),
        ("fine_magnitudes", [np.ones((2, 9), complex), np.ones((0, 6)), 0, np.ones((7, 2))]),
        ("row_means", [np.ones((0, 3)), np.ones(3)]),
        ("column_peaks", [np.ones((4, 2)), np.ones(4), np.ones(4)]),
    ],
)
def test_numbers_that_do_not_fit_are_refused_before_anything_is_written(name, arguments):
    before = deepcopy(arguments)
    with pytest.raises(ValueError, match=r"\w"):
        getattr(native, name)(*arguments)
    for now, then in zip(arguments, before, strict=True):
        np.testing.assert_array_equal(now, then)


ODD = np.array([math.nan, math.inf, -math.inf, 1e30, -1e30, 0.0])


@pytest.mark.parametrize("case", DISTINCT, ids=identify)
def test_any_values_are_safe(case):
    """A sanitizer finds what this test reads or writes outside its arrays."""
    rng = np.random.default_rng(9)
    for _ in range(12):
        arguments = [value.copy() if isinstance(value, np.ndarray) else value for value in case.arguments]
        for n, value in enumerate(arguments):
            if isinstance(value, np.ndarray) and value.dtype.kind in "fc":
                value[rng.uniform(size=value.shape) < rng.choice([0.01, 0.3, 1.0])] = rng.choice(ODD)
            elif isinstance(value, np.ndarray) and value.dtype.kind == "i":
                value[rng.integers(value.size)] = rng.choice([-1, 0, 10**6, -(2**62), 2**62])
            elif isinstance(value, float) and rng.uniform() < 0.3:
                arguments[n] = float(rng.choice(ODD))
            elif isinstance(value, int) and rng.uniform() < 0.3:
                arguments[n] = int(rng.integers(-5, 50))
        try:
            case.call(arguments)
        except (ValueError, TypeError):
            continue

"""Link budget: echo amplitude, receiver noise, derived quantities."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.errors import ConfigError
from doppelgait.core.labels import AnyTable, ScattererTable, maps_table
from doppelgait.core.samples import borrow_memory
from doppelgait.core.units import (
    NOISE_DENSITY_W_PER_HZ,
    REFERENCE_IMPEDANCE_OHM,
    FloatArray,
    db_to_amplitude,
    db_to_power,
    dbm_to_watt,
    power_to_db,
    watt_to_volt,
)
from doppelgait.radar.parameters import Radar

MIN_RANGE_M = 0.2
"""Minimum range, m, in the radar equation, which is a far-field law; smaller ranges are replaced by it (E-14)."""
CPI_S = 0.1
"""Coherent processing interval, s, of the derived velocity resolution."""
RANGE_M = 5.0
"""Range, m, of the derived power and SNR of 1 m^2."""


def received_power_w(radar: Radar, *, range_m: npt.ArrayLike, rcs_m2: npt.ArrayLike) -> Any:
    """Return an echo's peak power at the antenna by the radar equation (E-14).

    Parameters
    ----------
    radar : Radar
    range_m : array_like
        Range R; values below 0.2 m are replaced by 0.2 m.
    rcs_m2 : array_like
        Radar cross section sigma, broadcast against ``range_m``.

    Returns
    -------
    ndarray
        P_t G_t G_r lambda^2 sigma / ((4 pi)^3 R^4), W.

    Examples
    --------
    >>> import doppelgait as dg
    >>> radar = dg.Radar.preset("x4")
    >>> near, far = dg.radar.received_power_w(radar, range_m=[1.0, 2.0], rcs_m2=1.0)
    >>> near_v, far_v = dg.radar.echo_amplitude_v(radar, range_m=[1.0, 2.0], rcs_m2=1.0)
    >>> round(float(near / far), 2), round(float(near_v / far_v), 2)
    (16.0, 4.0)
    """
    distance = np.maximum(np.asarray(range_m, dtype=float), MIN_RANGE_M)
    gain = db_to_power(radar.tx_gain_dbi + radar.rx_gain_dbi)
    constant = dbm_to_watt(radar.tx_power_dbm) * gain * radar.wavelength_m**2 / (4.0 * np.pi) ** 3
    square = distance * distance
    return constant * np.asarray(rcs_m2, dtype=float) / (square * square)  # ten times as fast as a power of 4


def echo_amplitude_v(
    radar: Radar, *, range_m: npt.ArrayLike, rcs_m2: npt.ArrayLike, path_gain: npt.ArrayLike = 1.0
) -> Any:
    """Return the echo amplitude at the receiver output, V (E-14).

    It is a = sqrt(2 Z0 P_r) 10^(G_rx/20) into 50 ohm, with P_r of :func:`received_power_w` (see its
    example); ``path_gain`` is an additional two-way power ratio (walls, antenna pattern).
    """
    one_metre_w = received_power_w(radar, range_m=1.0, rcs_m2=np.asarray(rcs_m2) * np.asarray(path_gain))
    square = np.maximum(np.asarray(range_m, dtype=float), MIN_RANGE_M)
    square *= square
    one_metre_v = watt_to_volt(one_metre_w) * db_to_amplitude(radar.receiver_gain_db)
    fits = np.broadcast_shapes(np.shape(one_metre_v), square.shape) == square.shape
    return np.divide(one_metre_v, square, out=square if fits and square.ndim else None)


def comparator_noise_v(radar: Radar) -> float:
    """Return one pulse's rms noise at the comparator, V, s^2 = Z0 k T0 F G_rx f_s / 2 (E-18b)."""
    density_w = NOISE_DENSITY_W_PER_HZ * db_to_power(radar.noise_figure_db + radar.receiver_gain_db)
    return math.sqrt(REFERENCE_IMPEDANCE_OHM * density_w * radar.sample_rate_hz / 2.0)


def compute_counter_noise_ratio(radar: Radar) -> float:
    """Return the noise power ratio of a swept-threshold counter to averaging (E-18b)."""
    if radar.threshold_step_v is None:
        return 1.0
    return radar.threshold_step_v / (math.sqrt(math.pi) * comparator_noise_v(radar))


def find_noise_slope(radar: Radar) -> float:
    """Return dB of noise per dB of gain: 1, or 1/2 for a swept-threshold counter (E-18b)."""
    return 1.0 if radar.threshold_step_v is None else 0.5


def sample_noise_v2(radar: Radar) -> float:
    """Return the mean square noise of one receiver sample, V^2 (E-18, E-18b)."""
    density_w = NOISE_DENSITY_W_PER_HZ * db_to_power(radar.noise_figure_db + radar.receiver_gain_db)
    single_v2 = 2.0 * REFERENCE_IMPEDANCE_OHM * density_w * radar.receiver_bandwidth_hz
    return float(single_v2 / radar.averages_per_frame * compute_counter_noise_ratio(radar))


def noise_power_v2(radar: Radar) -> float:
    """Return the mean square noise of one range bin, V^2, after compression (E-18)."""
    return sample_noise_v2(radar) * radar.waveform.noise_gain(radar)


FACTOR_ROWS = 2000
"""Maximum number of iteration steps; the error is then 2.5e-4 for a spectrum that reaches 0, otherwise 1e-12."""


def make_noise_taps(radar: Radar) -> npt.NDArray[np.float32]:
    """Return the taps that correlate white noise over range bins (E-18c)."""
    return np.array(_factorise(radar.noise_correlation), dtype=np.float32)


@lru_cache(maxsize=64)
def _factorise(correlation: tuple[float, ...]) -> tuple[float, ...]:
    """Factorise a correlation by Bauer's method."""
    # the rows of the Cholesky factor of its Toeplitz matrix converge to the taps (Arch. Elektr. Uebertragung 9, 1955);
    # plain arithmetic makes the result independent of the processor and of libraries
    rho, last = (1.0, *correlation), len(correlation)
    rows = [(1.0,) + (0.0,) * last]  # each row is the diagonal element and the elements before it
    for step in range(FACTOR_ROWS):
        row = [0.0] * (last + 1)
        for lag in range(min(last, len(rows)), 0, -1):
            before = rows[-lag]
            row[lag] = (rho[lag] - sum(row[m] * before[m - lag] for m in range(lag + 1, last + 1))) / before[0]
        row[0] = math.sqrt(1.0 - sum(tap * tap for tap in row))
        rows = [*rows[-last:], tuple(row)]
        if step >= last and max(abs(new - old) for new, old in zip(rows[-1], rows[0], strict=True)) < 1e-13:
            break
    return rows[-1]


def compute_scatterer_arrays(scatterers: AnyTable, radar: Radar) -> tuple[Any, Any]:
    """Return ranges (m) and echo amplitudes (V) of scatterers.

    Both are contiguous float64 arrays (slow_time, scatterer). The amplitude is that of a frame:
    E-14 with the integration loss (E-13b), negative beyond a null.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2})], duration_s=3.0)
    >>> table, radar = dg.scene.assemble(scene, [0.0, 0.1, 0.2]), dg.Radar.preset("x4")
    >>> range_m, amplitude_v = dg.radar.compute_scatterer_arrays(table, radar)
    >>> range_m.mean(axis=1).round(2)  # mean range at the three times
    array([6.8 , 6.73, 6.63])
    >>> round(float(dg.radar.radial_velocity_mps(table).mean()), 1)  # approaching, m/s
    0.9
    >>> dg.radar.lowest_prf_hz(table, radar, cpi_s=0.1)
    294.0
    >>> delayed = table.assign(path_phase=-0.1 * table["range"] / table["range"])
    >>> dg.radar.path_phase_rad(delayed)[0, :3]
    array([-0.1, -0.1, -0.1])
    """
    range_m, amplitude_v, _ = compute_echoes(scatterers, radar)
    return np.ascontiguousarray(range_m), amplitude_v


def compute_echoes(scatterers: AnyTable, radar: Radar) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Return ranges, amplitudes and extra phases of scatterers, in contiguous rows."""
    table = ScattererTable.of(scatterers)
    range_m, rcs_m2, path_gain = (read_rows(table[name]) for name in ("range", "rcs", "path_gain"))
    turns_per_mps = 2.0 / radar.wavelength_m * radar.integration_share / radar.prf_hz
    speeds = range_m if radar.integration_share == 0.0 else read_rows(radial_velocity_mps(table))
    one_metre_v = float(echo_amplitude_v(radar, range_m=1.0, rcs_m2=1.0))
    amplitude_v = borrow_memory(range_m.shape, np.float64)
    native.integrate_echoes(range_m, speeds, rcs_m2, path_gain, one_metre_v, MIN_RANGE_M, turns_per_mps, amplitude_v)
    return range_m, amplitude_v, read_rows(table["path_phase"]) if "path_phase" in table else None


def read_rows(values: npt.ArrayLike) -> FloatArray:
    """Return values of which every row is contiguous, as a view if possible."""
    rows = np.asarray(values, dtype=np.float64)
    return rows if rows.strides[-1] == rows.itemsize else np.ascontiguousarray(rows)


@maps_table
def fold_scatterers(scatterers: ScattererTable, radar: Radar) -> ScattererTable:
    """Place echoes of earlier pulses k at R - k c / (2 pulse rate) (E-10b)."""
    range_m, waveform = scatterers["range"], radar.waveform
    if not radar.folds_pulses or range_m.size == 0:
        return scatterers
    pulse_m, reach_m = waveform.unambiguous_range_m(radar), waveform.reach_m(radar)
    first_m = waveform.first_bin_m(radar) - reach_m
    last_m = radar.range_stop_m + reach_m
    if range_m.min() >= last_m - pulse_m and range_m.max() <= first_m + pulse_m:
        return scatterers
    fewest, most = np.ceil((range_m - last_m) / pulse_m), np.floor((range_m - first_m) / pulse_m)
    images = []
    for further in range(max(int((most - fewest).max()), 0) + 1):
        pulses = fewest + further
        shown = (pulses <= most) | (further == 0)  # the first range may be outside the frame
        columns = np.flatnonzero(shown.any(axis=0))
        part = scatterers.take(columns)
        true_m, lag_m = range_m[:, columns], pulses[:, columns] * pulse_m
        nearer = np.square(np.maximum(true_m - lag_m, MIN_RANGE_M) / np.maximum(true_m, MIN_RANGE_M))
        phase_rad = path_phase_rad(part)
        turn_rad = -4.0 * np.pi / radar.wavelength_m * lag_m
        values = {
            "range": true_m - lag_m,
            "path_gain": np.where(shown[:, columns], part["path_gain"] * np.square(nearer), 0.0),
            "path_phase": turn_rad if phase_rad is None else phase_rad + turn_rad,
        }
        images.append(part.replace(**values))
    return replace(
        scatterers,
        values={name: np.concatenate([part[name] for part in images], axis=1) for name in images[0].values},
        columns={name: np.concatenate([part[name] for part in images]) for name in scatterers.columns},
    )


def path_phase_rad(scatterers: AnyTable) -> FloatArray | None:
    """Return the extra phase of every echo, (slow_time, scatterer), C-contiguous, or None."""
    if "path_phase" not in scatterers:
        return None
    return np.ascontiguousarray(ScattererTable.of(scatterers)["path_phase"], dtype=np.float64)


def radial_velocity_mps(scatterers: AnyTable) -> FloatArray:
    """Return the radial velocity of scatterers, m/s, (slow_time, scatterer)."""
    if "radial_velocity" not in scatterers:
        raise ConfigError(
            "the scatterer table has no radial_velocity, which waveforms with a sweep and radars with an "
            "integration_share need; add it"
        )
    return np.asarray(ScattererTable.of(scatterers)["radial_velocity"], dtype=np.float64)


def list_derived_quantities(radar: Radar) -> dict[str, float]:
    """Return derived quantities of a radar by name, which ends in the unit.

    Quantities that do not apply to the waveform are omitted. Power and SNR are those of 1 m^2 at
    5 m in a single frame, in the middle of its bin (E-14, E-18).

    Examples
    --------
    >>> import doppelgait as dg
    >>> radar = dg.Radar.preset("x4")
    >>> wavelength_m = dg.radar.list_derived_quantities(radar)["wavelength_m"]
    >>> f"{wavelength_m:.4f} m, {dg.radar.noise_power_v2(radar):.2g} V^2"
    '0.0411 m, 4.4e-11 V^2'
    """
    noise_v2 = noise_power_v2(radar)
    power_w = received_power_w(radar, range_m=RANGE_M, rcs_m2=1.0)
    echo_v = echo_amplitude_v(radar, range_m=RANGE_M, rcs_m2=1.0)
    values = {
        "wavelength_m": radar.wavelength_m,
        **radar.waveform.figures(radar),
        "range_resolution_m": radar.range_resolution_m,
        "bin_spacing_m": radar.bin_spacing_m,
        "n_range_bins": radar.n_range_bins,
        "range_stop_m": radar.range_stop_m,
        "unambiguous_range_m": radar.waveform.unambiguous_range_m(radar),
        "unambiguous_velocity_mps": radar.unambiguous_velocity_mps,
        "velocity_resolution_100ms_mps": radar.wavelength_m / (2.0 * CPI_S),
        "averages_per_frame": radar.averages_per_frame,
        "noise_power_v2": noise_v2,
        "noise_level_dbv": float(power_to_db(noise_v2)),
        "received_power_1m2_5m_dbm": float(power_to_db(power_w / 1e-3)),
        "snr_1m2_5m_db": float(power_to_db(echo_v**2 / noise_v2)),
    }
    if not radar.waveform.ranged:
        del values["range_resolution_m"], values["bin_spacing_m"]
    return {name: value for name, value in values.items() if math.isfinite(value)}


RECEIVER_ERRORS = {
    "I/Q and clipping": ("iq_imbalance", "adc", "x4_counts"),
    "DC": ("dc_leak", "leakage"),
    "phase noise and jitter": ("phase_noise", "frame_jitter"),
}
"""Impairments that model an effect without a radar parameter, by the name of the effect."""


def describe_effects(radar: Radar, impairments: Collection[str] = ()) -> dict[str, str]:
    """Describe noise, integration, folding and receiver errors by name."""
    waveform = radar.waveform
    noise = "one sample" if radar.pulse_rate_hz is None else f"mean of {radar.averages_per_frame}"
    if radar.threshold_step_v is not None:
        noise = f"counter, {1e3 * radar.threshold_step_v:.3g} mV a step"
    correlation = ", ".join(f"{share:.2f}" for share in radar.noise_correlation)
    integration, folding = f"{radar.integration_share:g} of the frame", "none"
    if radar.integration_share == 0:
        integration = "none" if waveform.samples_are_bins else "motion in the sweep"
    if radar.fold_echoes or not waveform.samples_are_bins:
        folding = f"at {waveform.unambiguous_range_m(radar):.4g} m"
    window = "none" if waveform.samples_are_bins else f"of the window ({radar.range_window})"
    return {
        "noise law": noise,
        "noise correlation": correlation or window,
        "frame integration": integration,
        "folding": folding if waveform.ranged else "no range",
        **{
            effect: ", ".join(kind for kind in kinds if kind in impairments) or "none"
            for effect, kinds in RECEIVER_ERRORS.items()
        },
    }

"""The equations of docs/theory.md as literal float64 loops: slow, plain, and free of the package's own code.

Nothing here may import doppelgait.
"""

import numpy as np

C_MPS = 299_792_458.0


def relative_l2(found, wanted):
    """Norm of the error over the norm of what is wanted."""
    return np.linalg.norm(found - wanted) / np.linalg.norm(wanted)


def pulse(time_s, sigma_s):
    """E-11."""
    return np.exp(-(time_s**2) / (2 * sigma_s**2))


def baseband(range_m, amplitude_v, axis_m, *, sigma_s, wavelength_m, theta_rad=0.0):
    """E-18, one scatterer and one frame after the other; shape (I, N) complex128."""
    n_frames, n_scatterers = range_m.shape
    y = np.zeros((n_frames, len(axis_m)), dtype=np.complex128)
    for i in range(n_frames):
        for s in range(n_scatterers):
            r = range_m[i, s]
            phase = theta_rad - 4 * np.pi * (r % wavelength_m) / wavelength_m
            y[i] += amplitude_v[i, s] * pulse(2 * (axis_m - r) / C_MPS, sigma_s) * np.exp(1j * phase)
    return y


def rf_baseband(range_m, amplitude_v, axis_m, *, sigma_s, carrier_hz, sample_rate_hz, decimation, theta_rad=0.0):
    """E-16 and E-17: real RF samples, complex mixing, 65-tap Kaiser low-pass (beta 7, 2.5 GHz), every D-th sample."""
    half = 32
    n_full = (len(axis_m) - 1) * decimation + 1
    time_s = 2 * axis_m[0] / C_MPS + np.arange(-half, n_full + half) / sample_rate_hz
    tap = np.arange(-half, half + 1)
    low_pass = np.sinc(2 * 2.5e9 / sample_rate_hz * tap) * np.kaiser(2 * half + 1, 7.0)
    low_pass /= low_pass.sum()
    wavelength_m = C_MPS / carrier_hz
    y = np.zeros((range_m.shape[0], len(axis_m)), dtype=np.complex128)
    for i in range(range_m.shape[0]):
        rf = np.zeros(time_s.size)
        for s in range(range_m.shape[1]):
            r = range_m[i, s]
            phase = theta_rad - 4 * np.pi * (r % wavelength_m) / wavelength_m
            rf += (
                amplitude_v[i, s]
                * pulse(time_s - 2 * r / C_MPS, sigma_s)
                * np.cos(2 * np.pi * carrier_hz * time_s + phase)
            )
        mixed = 2 * rf * np.exp(-2j * np.pi * carrier_hz * time_s)
        y[i] = np.convolve(mixed, low_pass, mode="valid")[::decimation]
    return y


def window(n_pulses, steepness):
    """E-23."""
    h = (n_pulses - 1) / 2
    return np.array([np.exp(-0.5 * ((m - h) / (steepness * h)) ** 2) for m in range(n_pulses)])


def doppler_axis_hz(n_bins, prf_hz):
    """E-25."""
    return np.array([prf_hz * (k - n_bins // 2) / n_bins for k in range(n_bins)])


def range_doppler_cells(y, centre, k, n, w, n_bins):
    """E-24 with E-22 at one Doppler bin and the range bins n; k counts from the lowest Doppler.

    Pulses outside the record are zero.
    """
    h = (len(w) - 1) // 2
    turn = -2j * np.pi * (k - n_bins // 2) / n_bins
    m = np.array([m for m in range(len(w)) if 0 <= centre + m - h < y.shape[0]])
    return abs(np.sum((w[m] * np.exp(turn * m))[:, np.newaxis] * y[np.ix_(centre + m - h, n)], axis=0)) ** 2


def signature(y, centres, first_bin, n_gate, w, n_bins):
    """E-27: (J, K) sum of the cells over the gate's range bins; bins outside the frame do not count."""
    y = np.asarray(y, dtype=np.complex128)
    mu = np.zeros((len(centres), n_bins))
    for j, centre in enumerate(centres):
        gate = [n for n in range(first_bin[j], first_bin[j] + n_gate) if 0 <= n < y.shape[1]]
        for k in range(n_bins):
            mu[j, k] = np.sum(range_doppler_cells(y, centre, k, gate, w, n_bins))
    return mu


def normalised_by_sum(mu, floor):
    """E-28, steps 2 and 3."""
    result = np.zeros(mu.shape)
    for j in range(mu.shape[0]):
        excess = [max(float(value) - floor, 0.0) for value in mu[j]]
        total = sum(excess)
        if total > 0:
            result[j] = np.array(excess) / total
    return result


def detrended(rows, order):
    """E-31: every Doppler row minus its least-squares polynomial (monomials, solved by normal equations)."""
    n_columns, n_bins = rows.shape
    t = np.linspace(-1, 1, n_columns)
    basis = np.array([t**r for r in range(order + 1)])
    gram = basis @ basis.T
    result = np.zeros(rows.shape)
    for k in range(n_bins):
        result[:, k] = rows[:, k] - np.linalg.solve(gram, basis @ rows[:, k]) @ basis
    return result


def cadence_map(rows, weights, n_fft, n_kept):
    """E-30: D[q, k]."""
    j = np.arange(rows.shape[0])
    d = np.zeros((n_kept, rows.shape[1]))
    for q in range(n_kept):
        for k in range(rows.shape[1]):
            d[q, k] = abs(np.sum(weights * rows[:, k] * np.exp(-2j * np.pi * q * j / n_fft))) / np.sum(weights)
    return d

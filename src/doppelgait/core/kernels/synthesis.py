"""Sum of Gaussian echoes into the complex data matrix (E-18)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

SUPPORT_SIGMAS = 5.5
"""An echo is cut where its envelope is below exp(-5.5^2 / 2) = 2.7e-7 of its peak."""


@njit(cache=True, nogil=True, error_model="numpy")
def add_echoes(
    range_m: npt.NDArray[np.float64],
    amplitude: npt.NDArray[np.float64],
    first_bin_m: float,
    bin_spacing_m: float,
    pulse_sigma_m: float,
    wavelength_m: float,
    phase_rad: float,
    out: npt.NDArray[np.complex64],
) -> None:
    r"""Write the echoes of all scatterers into the data matrix.

    .. math:: Y_{i,n} = \sum_l a_{il}\, e^{-(R_n - R_{il})^2 / 2 s^2}\, e^{j(\theta - 4 \pi R_{il} / \lambda)}

    With the bin next to the scatterer, :math:`n_0`, and the rest :math:`x = (R_{il} - R_{n_0}) / \Delta R`, the
    envelope at :math:`n_0 + j` is :math:`e^{-x^2/2\varsigma^2} (e^{x/\varsigma^2})^j e^{-j^2/2\varsigma^2}`,
    :math:`\varsigma = s / \Delta R`: one table for all scatterers and one running product, no exponential per bin.
    The number of turns 2R/lambda is reduced in float64; float32 would leave an error floor of -80 dB.

    Parameters
    ----------
    range_m, amplitude : ndarray, shape (I, L), float64
        Range and amplitude of every scatterer in every frame.
    first_bin_m, bin_spacing_m : float
        Range of bin 0 and spacing of the bins.
    pulse_sigma_m : float
        Standard deviation of an echo's envelope in range, s = c tau / 2.
    wavelength_m, phase_rad : float
        Wavelength and phase theta of the transmitted pulse.
    out : ndarray, shape (I, N), complex64
        Overwritten.
    """
    n_frames, n_scatterers = range_m.shape
    n_bins = out.shape[1]
    sigma = pulse_sigma_m / bin_spacing_m
    reach = math.ceil(SUPPORT_SIGMAS * sigma) + 1
    table = np.empty(reach + 1)
    for j in range(reach + 1):
        table[j] = math.exp(-0.5 * (j / sigma) ** 2)
    margin = 2 * reach + 1  # an echo centred just outside the frame still writes inside the buffer
    real = np.empty(n_bins + 2 * margin)
    imag = np.empty(n_bins + 2 * margin)
    for i in range(n_frames):
        real[:] = 0.0
        imag[:] = 0.0
        for scatterer in range(n_scatterers):
            place = (range_m[i, scatterer] - first_bin_m) / bin_spacing_m
            if place < -reach or place > n_bins - 1 + reach:
                continue
            nearest = math.floor(place + 0.5)
            rest = place - nearest
            turns = 2.0 * range_m[i, scatterer] / wavelength_m
            angle = phase_rad - 2.0 * math.pi * (turns - math.floor(turns))
            peak = amplitude[i, scatterer] * math.exp(-0.5 * (rest / sigma) ** 2)
            in_phase = peak * math.cos(angle)
            quadrature = peak * math.sin(angle)
            step_up = math.exp(rest / sigma**2)
            step_down = 1.0 / step_up
            centre = margin + nearest
            real[centre] += in_phase
            imag[centre] += quadrature
            up = step_up
            down = step_down
            for j in range(1, reach + 1):
                above = up * table[j]
                below = down * table[j]
                real[centre + j] += in_phase * above
                imag[centre + j] += quadrature * above
                real[centre - j] += in_phase * below
                imag[centre - j] += quadrature * below
                up *= step_up
                down *= step_down
        for n in range(n_bins):
            out[i, n] = complex(real[margin + n], imag[margin + n])

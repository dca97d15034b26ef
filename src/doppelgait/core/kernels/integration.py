"""Amplitudes of echoes that a frame integrates (E-13b, E-14)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

Float64Array = npt.NDArray[np.float64]

# sin(pi r) / r as a polynomial in r^2 for |r| <= 1/2: Taylor's, whose next term is below 2e-11
_S0, _S1, _S2, _S3, _S4, _S5, _S6, _S7 = (
    (-1.0) ** k * math.pi ** (2 * k + 1) / math.factorial(2 * k + 1) for k in range(8)
)


@kernel(fastmath=("contract",))
def integrate_echoes(
    range_m: Float64Array,
    velocity_mps: Float64Array,
    rcs_m2: Float64Array,
    path_gain: Float64Array,
    one_metre: float,
    nearest_m: float,
    turns_per_mps: float,
    out: Float64Array,
) -> None:
    r"""Compute the amplitude of every echo in every frame.
    Shapes: range_m, velocity_mps (I, L); rcs_m2, path_gain (I, L); out (I, L).
    """
    n_frames, n_scatterers = out.shape
    for frame in range(n_frames):
        of_rcs, of_gain = frame if rcs_m2.shape[0] > 1 else 0, frame if path_gain.shape[0] > 1 else 0
        for scatterer in range(n_scatterers):
            distance = max(range_m[frame, scatterer], nearest_m)
            x = turns_per_mps * velocity_mps[frame, scatterer]
            whole = np.rint(x)
            r = x - whole
            q = r * r
            half = _S0 + q * (_S1 + q * (_S2 + q * (_S3 + q * (_S4 + q * (_S5 + q * (_S6 + q * _S7))))))
            odd = whole - 2.0 * np.floor(0.5 * whole)
            loss = half * (1.0 / math.pi) if whole == 0.0 else half * r * (1.0 - 2.0 * odd) / (math.pi * x)
            level = one_metre * math.sqrt(rcs_m2[of_rcs, scatterer] * path_gain[of_gain, scatterer])
            out[frame, scatterer] = level * loss / (distance * distance)

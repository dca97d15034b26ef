"""Two-way gain of a cosine antenna pattern for many directions."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

Float64Array = npt.NDArray[np.float64]


@kernel()
def apply_cosine_pattern(
    azimuth_rad: Float64Array,
    elevation_rad: Float64Array,
    boresight_azimuth_rad: float,
    boresight_tilt_rad: float,
    azimuth_exponent: float,
    elevation_exponent: float,
    floor: float,
    path_gain: Float64Array,
    out: Float64Array,
) -> None:
    """Multiply path gains by the square of a cosine pattern.
    The pattern is max(cos^p(azimuth) cos^q(elevation), floor).
    """
    cos_tilt, sin_tilt = math.cos(boresight_tilt_rad), math.sin(boresight_tilt_rad)
    for i in range(azimuth_rad.shape[0]):
        for n in range(azimuth_rad.shape[1]):
            turn = azimuth_rad[i, n] - boresight_azimuth_rad
            up, level = math.sin(elevation_rad[i, n]), math.cos(elevation_rad[i, n])
            ahead, left = level * math.cos(turn), level * math.sin(turn)
            forward = ahead * cos_tilt + up * sin_tilt
            above = up * cos_tilt - ahead * sin_tilt
            gain = floor
            across2, level2 = forward * forward + left * left, 1.0 - above * above
            if forward > 0.0 and level2 > 0.0:
                half_log = azimuth_exponent * math.log(forward * forward / across2)
                half_log += elevation_exponent * math.log(level2)
                gain = max(math.exp(0.5 * half_log), floor)
            out[i, n] = path_gain[i, n] * gain * gain

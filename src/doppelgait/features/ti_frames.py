"""Four features per frame, as in the classifier of TI's xWRL6432.

The motion and presence detection of this sensor describes each frame of a track by two velocities,
a power and an entropy, and is trained on windows of frames. With the same features from simulated
and recorded signatures you can train a classifier for the sensor. The exact forms are specific to
doppelgait; the sensor computes the features from its Doppler spectrum of the track's range bins.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.labels import SIGNATURE, Signal, measures_signal
from doppelgait.core.lazy import xr
from doppelgait.core.units import decimal_logarithm, logarithm

NUMBERS = ("lower_velocity_mps", "upper_velocity_mps", "power_v2", "spectral_entropy")
"""Columns of :func:`measure_columns`."""
LOWER, UPPER = 0.125, 0.875  # shares of the power of a frame below the two velocities


@measures_signal(SIGNATURE)
def measure_columns(signature: Signal, *, noise_floor_v2: float = 0.0) -> xr.DataArray:
    """Measure four numbers of every column of a signature.

    Let ``p[k] = max(mu[t, k] - nu, 0)`` and ``q[k] = p[k] / sum(p)``, with ascending velocities.
    The lower and upper velocities are those of the first rows at which the cumulative power reaches
    12.5 % and 87.5 %. The power is the sum of p from the lower to the upper row, both included. The
    entropy is ``-sum(q ln q) / ln K``, from 0 (one row) to 1 (K equal rows).

    Parameters
    ----------
    signature : DataArray (time, doppler)
        V^2, clutter removed.
    noise_floor_v2 : float
        Mean noise power nu of a cell (E-28), which is subtracted.

    Returns
    -------
    DataArray (time, number)
        float32: lower and upper velocity in m/s (positive when approaching), power in V^2, entropy.
        Velocities and entropy are NaN in columns with no power above the noise.

    Raises
    ------
    AnalysisError
        If the array is no signature.

    See Also
    --------
    measure_windows : mean and standard deviation over windows.

    Examples
    --------
    >>> import doppelgait as dg
    >>> from doppelgait.features import measure_columns
    >>> walk = dg.Target(dg.motion.human_gait(speed_mps=1.2, duration_s=3.0), range_m=4.0)
    >>> recording = dg.simulate(dg.Scene(targets=[walk]), dg.Radar.preset("ti-60-burst"))
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> numbers = measure_columns(result.signature, noise_floor_v2=result.quality["noise_floor_v2"])
    >>> numbers.mean("time").values[:2].round(1)  # edges of the signature, m/s
    array([0.8, 1.5], dtype=float32)
    """
    power = np.maximum(signature.values.astype(np.float64) - noise_floor_v2, 0.0)
    velocity_mps = signature.axis("velocity")
    if velocity_mps[0] > velocity_mps[-1]:
        power, velocity_mps = power[:, ::-1], velocity_mps[::-1]
    total = power.sum(axis=1)
    below = np.cumsum(power, axis=1)
    some = total > 0
    share = power / np.where(some, total, 1.0)[:, None]
    # rounding may make the last sum smaller than the total
    lower, upper = (
        (below < part * total[:, None]).sum(axis=1).clip(max=velocity_mps.size - 1) for part in (LOWER, UPPER)
    )
    rows = np.arange(velocity_mps.size)
    between = (rows >= lower[:, None]) & (rows <= upper[:, None])
    logarithms = logarithm(np.where(share > 0, share, 1.0))
    values = np.stack(
        [
            np.where(some, velocity_mps[lower], np.nan),
            np.where(some, velocity_mps[upper], np.nan),
            (power * between).sum(axis=1),
            np.where(some, -(share * logarithms).sum(axis=1) / math.log(velocity_mps.size), np.nan),
        ],
        axis=1,
    )
    coords = {"time": signature.axis("time"), "number": list(NUMBERS)}
    return xr.DataArray(values.astype(np.float32), dims=("time", "number"), coords=coords, name="ti_frames")


def measure_windows(numbers: npt.ArrayLike, *, frames: int | None = None) -> npt.NDArray[np.float64]:
    """Measure mean and standard deviation of frames in windows.

    Parameters
    ----------
    numbers : array_like, shape (T, 4)
        Result of :func:`measure_columns`; the power is converted to dB.
    frames : int, optional
        Frames per window. Windows do not overlap, and remaining frames are left out. By default one
        window of all frames.

    Returns
    -------
    ndarray, shape (windows, 8)
        Four means and four standard deviations over the frames with power; NaN in a window without such frames.

    See Also
    --------
    measure_columns : measure the columns.

    Examples
    --------
    >>> import numpy as np
    >>> from doppelgait.features import measure_windows
    >>> columns = np.tile([-0.4, 1.6, 1e-12, 0.7], (20, 1))  # 20 equal columns: power -120 dB
    >>> measure_windows(columns, frames=10)[0].round(1)
    array([  -0.4,    1.6, -120. ,    0.7,    0. ,    0. ,    0. ,    0. ])
    """
    values = np.array(numbers, dtype=np.float64)
    dark = ~(values[:, 2] > 0)
    values[dark] = np.nan
    values[~dark, 2] = 10.0 * decimal_logarithm(values[~dark, 2])
    length = frames or len(values)
    found = np.full((len(values) // max(length, 1), 2 * values.shape[1]), np.nan)
    for number in range(len(found)):
        part = values[number * length : (number + 1) * length]
        part = part[~np.isnan(part[:, 2])]
        if len(part):
            found[number] = np.concatenate([part.mean(axis=0), part.std(axis=0)])
    return found

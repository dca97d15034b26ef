"""What to do with a signature whose gate reaches beyond the recorded frame."""

from __future__ import annotations

import numpy as np
import xarray as xr

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import SIGNATURE, axis, check_signal

MIN_SHARE = 0.5
"""A column counts while at least this part of its gate lies inside the frame."""
MIN_COLUMNS = 8


def within_frame(signature: xr.DataArray) -> tuple[xr.DataArray, float]:
    """Signature without the time in which its gate is mostly outside the frame.

    Parameters
    ----------
    signature : DataArray (time, doppler)
        With coordinate ``gate_share``.

    Returns
    -------
    signature : DataArray (time, doppler)
        The longest run of columns with half of the gate or more inside; a column whose gate is cut is divided by the
        part inside, so that its noise has the level of a whole gate.
    share : float
        Mean part of the gate that was inside over the whole recording; 1 when nothing was cut.

    Raises
    ------
    AnalysisError
        If fewer than 8 columns remain.
    """
    check_signal(signature, SIGNATURE)
    share = axis(signature, "gate_share")
    if share.size < MIN_COLUMNS:
        raise AnalysisError(
            f"the signature has {share.size} column{'s' * (share.size > 1)}, at least {MIN_COLUMNS} are needed; "
            "record longer, or lower hop where it is coarser than the lossless one"
        )
    if share.min() >= 1.0:
        return signature, 1.0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], share >= MIN_SHARE, [0]]).astype(int)))
    runs = edges.reshape(-1, 2)
    first, stop = max(runs, key=lambda run: run[1] - run[0]) if runs.size else (0, 0)
    if stop - first < MIN_COLUMNS:
        raise AnalysisError(
            f"the gate lies outside the recorded frame for all but {stop - first} of {share.size} columns; move the "
            "gate, or record with another range_start_m and range_stop_m"
        )
    kept = signature.isel(time=slice(first, stop))
    scaled = kept.values / axis(kept, "gate_share")[:, None].astype(np.float32)
    return kept.copy(data=scaled), float(share.mean())

"""Radars described by what a file says, where no preset is meant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, RecordingError
from doppelgait.radar.parameters import Radar

CW_FRAME_M = (0.0, 10.0)
"""Ranges that the one bin of a continuous-wave recording stands for; it measures no range."""


def radar_of_facts(path: Path, **facts: Any) -> Radar:
    """Radar with these parameters; one that is not allowed is a :class:`RecordingError` that names the file."""
    try:
        return validate(Radar, facts, where="radar")
    except ConfigError as error:
        raise RecordingError(f"{path}: {error}") from None


def cw_radar(path: Path, *, name: str, carrier_hz: float, prf_hz: float, **facts: Any) -> Radar:
    """Continuous-wave radar: one sample per pulse, one range bin for the whole frame.

    Parameters
    ----------
    path : Path
        For messages.
    name : str
    carrier_hz, prf_hz : float
        Carrier; complex samples per second.
    **facts
        Further parameters of :class:`~doppelgait.radar.parameters.Radar`.
    """
    start_m, stop_m = CW_FRAME_M
    return radar_of_facts(
        path,
        name=name,
        waveform="cw",
        carrier_hz=carrier_hz,
        prf_hz=prf_hz,
        sample_rate_hz=prf_hz,
        range_start_m=start_m,
        range_stop_m=stop_m,
        **facts,
    )

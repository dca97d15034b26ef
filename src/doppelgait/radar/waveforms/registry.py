"""Waveforms by name."""

from __future__ import annotations

from doppelgait.core.registry import Registry
from doppelgait.radar.config import Radar
from doppelgait.radar.waveforms.cw import CW
from doppelgait.radar.waveforms.impulse import IMPULSE
from doppelgait.radar.waveforms.matched import LFM, RECTANGULAR
from doppelgait.radar.waveforms.protocol import Waveform
from doppelgait.radar.waveforms.sweep import FMCW, STEPPED

WAVEFORMS: Registry[Waveform] = Registry("doppelgait.waveforms", "waveform")
"""Waveforms; those of other packages come by the entry-point group ``doppelgait.waveforms``."""

WAVEFORMS.add("impulse", IMPULSE)
WAVEFORMS.add("rectangular", RECTANGULAR)
WAVEFORMS.add("lfm", LFM)
WAVEFORMS.add("fmcw", FMCW)
WAVEFORMS.add("stepped", STEPPED)
WAVEFORMS.add("cw", CW)


def waveform_of(radar: Radar) -> Waveform:
    """The waveform that a radar transmits."""
    return WAVEFORMS[radar.waveform]

"""Waveforms behind one protocol: how a radar turns scatterers into receiver samples, and those into range bins."""

from doppelgait.radar.waveforms.protocol import Waveform, check_given
from doppelgait.radar.waveforms.registry import WAVEFORMS, waveform_of

__all__ = ["WAVEFORMS", "Waveform", "check_given", "waveform_of"]

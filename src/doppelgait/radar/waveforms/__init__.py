"""Waveforms: how a radar turns scatterers into receiver samples, and those into range bins."""

from doppelgait.radar.parameters import WAVEFORMS, Waveform

__all__ = ["WAVEFORMS", "Waveform"]

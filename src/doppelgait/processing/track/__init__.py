"""Following bodies in range and radial velocity through the detections of a recording."""

from doppelgait.processing.track.live import Track, Tracker
from doppelgait.processing.track.tracker import track

__all__ = ["Track", "Tracker", "track"]

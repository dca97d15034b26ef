"""Detection of bodies: thresholds, clusters, scans."""

from doppelgait.processing.detect.cfar import ca_factor, os_factor, os_pfa
from doppelgait.processing.detect.config import Detector
from doppelgait.processing.detect.maps import noise_factor, noise_map
from doppelgait.processing.detect.scans import find_scans

__all__ = ["Detector", "ca_factor", "find_scans", "noise_factor", "noise_map", "os_factor", "os_pfa"]

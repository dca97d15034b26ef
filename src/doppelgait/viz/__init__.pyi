"""What type checkers and editors know of ``doppelgait.viz``: the names that are imported on first use."""

from doppelgait.viz.motion import doppler_lines as doppler_lines
from doppelgait.viz.motion import range_lines as range_lines
from doppelgait.viz.motion import scatterer_doppler as scatterer_doppler
from doppelgait.viz.motion import stick_frames as stick_frames
from doppelgait.viz.objects import overview as overview
from doppelgait.viz.ranges import range_doppler_map as range_doppler_map
from doppelgait.viz.ranges import range_time as range_time
from doppelgait.viz.ranges import signature as signature
from doppelgait.viz.spectra import cadence_map as cadence_map
from doppelgait.viz.spectra import cadence_spectrum as cadence_spectrum
from doppelgait.viz.spectra import mean_doppler_spectrum as mean_doppler_spectrum
from doppelgait.viz.style import save_figure as save_figure
from doppelgait.viz.tables import contact_sheet as contact_sheet
from doppelgait.viz.tables import feature_matrix as feature_matrix
from doppelgait.viz.tables import feature_scatter as feature_scatter
from doppelgait.viz.tables import signature_normalisation as signature_normalisation

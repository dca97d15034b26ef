"""What the impairments must know of the waveform: noise in a sample, ranges of the samples, energy of an echo."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError
from doppelgait.radar.impairments.registry import Samples
from doppelgait.radar.parameters import Radar


def noise_gain(radar: Radar) -> float:
    """Power of white noise in a range bin over that in a receiver sample."""
    return radar.waveform.noise_gain(radar)


def check_width(samples: Samples, radar: Radar) -> None:
    """Refuse samples that this radar does not take (:class:`AnalysisError`)."""
    wanted = radar.waveform.n_samples(radar)
    if samples.shape[1] != wanted:
        raise AnalysisError(
            f"a pulse of the radar {radar.name!r} has {wanted} samples, these have {samples.shape[1]}; take the radar "
            "that they were made with"
        )


def sample_range_m(radar: Radar) -> npt.NDArray[np.float64]:
    """Range of every sample, m; of waveforms whose samples mix all ranges only one, the middle of the frame."""
    if radar.waveform.samples_are_bins:
        return radar.range_axis_m()
    return np.array([(radar.range_start_m + radar.range_stop_m) / 2.0])


def echo_energy_m(radar: Radar) -> float:
    """Integral over range of the power of an echo of peak 1 after compression, m; measured on one in mid-frame."""
    from doppelgait.radar.impairments.levels import static_samples

    bin_m = radar.bin_spacing_m
    n_places = int(np.clip(math.ceil(4.0 * bin_m / radar.range_resolution_m), 8, 512))
    middle_m = radar.range_start_m + (radar.n_range_bins // 2) * bin_m
    range_m = middle_m + bin_m * (np.arange(n_places) + 0.5)[:, None] / n_places
    response = radar.waveform.compress(static_samples(range_m, np.ones_like(range_m), radar), radar)
    return bin_m * float((np.abs(response).astype(np.float64) ** 2).sum()) / n_places

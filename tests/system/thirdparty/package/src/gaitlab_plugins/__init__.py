"""Plug-ins of another laboratory: all that doppelgait needs to know is this module's name."""

from typing import Literal

import numpy as np
from pydantic import Field

import doppelgait as dg
from doppelgait.core.config import FrozenModel
from doppelgait.radar import Waveform, compute_scatterer_arrays, path_phase_rad
from doppelgait.scene.rcs import scatterer_rcs_m2


class Hum(FrozenModel):
    """Mains hum on the receiver.

    Parameters
    ----------
    level_v : float
        Amplitude, V.
    frequency_hz : float
    """

    kind: Literal["hum"] = "hum"
    level_v: float = Field(default=1e-6, ge=0)
    frequency_hz: float = Field(default=50.0, gt=0)


@dg.plugin("impairment", parameters=Hum, version="2")
def add_hum(samples, parameters, radar, rng):
    """Add a sine of random phase to every pulse."""
    turn_rad = 2 * np.pi * parameters.frequency_hz * np.arange(samples.shape[0]) / radar.prf_hz
    hum_v = parameters.level_v * np.cos(turn_rad + rng.uniform(0, 2 * np.pi))
    return samples + hum_v[:, None].astype(np.float32)


@dg.plugin("waveform")
class Barker(Waveform):
    """Phase-coded pulse behind its matched filter, by the autocorrelation of its code."""

    needs = ("sweep_s",)

    kind: Literal["gaitlab_barker"] = "gaitlab_barker"
    chips: Literal[7, 11, 13] = 13

    def synthesise(self, scatterers, radar):
        """Sum of the responses of all scatterers, V."""
        range_m, amplitude_v = compute_scatterer_arrays(scatterers, radar)
        phase_rad = radar.transmit_phase_rad - 4 * np.pi * np.mod(range_m / radar.wavelength_m, 1)
        extra_rad = path_phase_rad(scatterers)
        echo = amplitude_v * np.exp(1j * (phase_rad if extra_rad is None else phase_rad + extra_rad))
        lags = np.arange(self.chips + 1)
        code = np.where(lags == 0, self.chips, np.where(lags % 2 == 0, 1 if self.chips == 13 else -1, 0)) / self.chips
        code[-1] = 0
        axis_m = radar.range_axis_m()
        samples = np.zeros((len(range_m), axis_m.size), np.complex64)
        for column in range(range_m.shape[1]):
            chips_off = np.abs(axis_m - range_m[:, column, None]) / self.chip_m(radar)
            samples += echo[:, column, None] * np.interp(chips_off, lags, code)
        return samples

    def chip_m(self, radar):
        """Length of one chip in range."""
        return 299_792_458.0 * radar.sweep_s / (2 * self.chips)

    def resolution_m(self, radar):
        """Half-power width of the main lobe: that of a triangle."""
        return (2 - 2**0.5) * self.chip_m(radar)

    def noise_bandwidth_hz(self, radar):
        """Noise bandwidth of the matched filter."""
        return 1 / radar.sweep_s


class Backpack(dg.scene.RcsSpec):
    """A body by its parts, with a reflector on the torso.

    Parameters
    ----------
    reflector_gain : float
        Radar cross section of the reflector over that of the whole body, 1.
    """

    kind: Literal["gaitlab_backpack"] = "gaitlab_backpack"
    reflector_gain: float = Field(default=1.0, ge=0, le=100)


@dg.plugin("rcs", parameters=Backpack, version="3")
def scatter_backpack(view, parameters):
    """Share the body's total by its parts and add the reflector to the torso."""
    torso = np.isin(view.motion.parts, ["torso", "trunk"])
    body_m2 = scatterer_rcs_m2(dg.scene.RcsSpec(total_m2=parameters.total_m2), view.motion.parts, 80.0)
    return view.motion, body_m2 + parameters.reflector_gain * body_m2.sum() * torso / torso.sum()


@dg.plugin("classifier", "gaitlab-centroid", features="six")
def train_centroid(train, held, *, n_classes, seed):
    """Nearest centroid of the features that are known, as a linear model."""
    from doppelgait.classify.learned import Linear

    values = train.values
    with np.errstate(invalid="ignore"):
        known = ~np.isnan(values).all(axis=0)
        median = np.where(known, np.nanmedian(np.where(known, values, 0.0), axis=0), 0.0)
    filled = np.where(np.isnan(values), median, values)
    mean, scale = filled.mean(axis=0), np.maximum(filled.std(axis=0), 1e-9)
    places = np.array([((filled[train.labels == n] - mean) / scale).mean(axis=0) for n in range(n_classes)])
    bias = -0.5 * (places**2).sum(axis=1)
    return Linear(median, np.zeros(0, dtype=np.int64), mean, scale, places, bias)


@dg.plugin("feature", "gaitlab_peak_share", unit="1", source="gaitlab: share of the strongest cell")
def peak_share(observed):
    """Share of the signature's power in its strongest cell."""
    return float(observed.power_v2.max() / observed.power_v2.sum())


def sniff_steps(path, head):
    """Whether a file starts with the word STEPS."""
    return head.startswith(b"STEPS")


@dg.plugin("motion_reader", "steps", sniff=sniff_steps, suffixes=(".steps",))
def read_steps(path, *, rate_hz: float | None = None):
    """Points of a STEPS file: rate and names in two lines, then x, y and z of every point in metres, a line a frame."""
    lines = path.read_text().splitlines()
    names = lines[1].split()
    values = np.loadtxt(lines[2:]).reshape(-1, len(names), 3)
    rate = float(lines[0].split()[1]) if rate_hz is None else rate_hz
    facts = {"source": path.name, "kind": "recording", "subject": path.stem, "species": "human"}
    return dg.motion.make_motion(values, rate_hz=rate, markers=names, parts=names, facts=facts)

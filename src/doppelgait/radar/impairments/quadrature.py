"""Unequal quadrature channels, and a constant that leaks into them."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import Field

from doppelgait.core.config import FrozenModel
from doppelgait.core.units import db_to_amplitude
from doppelgait.radar.impairments.levels import level_to_volt
from doppelgait.radar.impairments.registry import IMPAIRMENTS, Impairment, Samples
from doppelgait.radar.parameters import Radar


class IqImbalance(FrozenModel):
    r"""Quadrature channel of other gain, and not quite 90 degrees from the in-phase one.

    .. math:: y' = \mathrm{Re}\,y + j g\,\mathrm{Im}(y e^{j \varphi}) = \alpha y + \beta y^*, \qquad
        \alpha = \frac{1 + g e^{j \varphi}}{2}, \quad \beta = \frac{1 - g e^{-j \varphi}}{2}

    The second term is an image at the opposite Doppler. The defaults are those of a usual analogue mixer (image at
    -28 dB, assumed); a 24 GHz CW sensor showed about -11 dB, and the X4 mixes digitally (-55 dB or less).

    Parameters
    ----------
    gain_db : float
        Gain g of the quadrature channel over the in-phase channel.
    phase_deg : float
        Error phi of the angle between them.
    """

    kind: Literal["iq_imbalance"] = "iq_imbalance"
    gain_db: float = Field(default=0.5, ge=-40, le=40)
    phase_deg: float = Field(default=3.0, ge=-90, le=90)


def image_weights(spec: IqImbalance) -> tuple[complex, complex]:
    """Weights alpha of the signal and beta of its image."""
    g, phi = float(db_to_amplitude(spec.gain_db)), math.radians(spec.phase_deg)
    turn = complex(math.cos(phi), math.sin(phi))
    return (1.0 + g * turn) / 2.0, (1.0 - g * turn.conjugate()) / 2.0


def image_ratio_db(spec: IqImbalance) -> float:
    """Power of the image over that of the signal: 10 log10 (1 + g^2 - 2 g cos phi) / (1 + g^2 + 2 g cos phi)."""
    signal, image = image_weights(spec)
    return 20.0 * math.log10(abs(image) / abs(signal)) if image else -math.inf


def unbalance(samples: Samples, spec: IqImbalance, /, *, radar: Radar, rng: np.random.Generator) -> Samples:
    """Samples with their image."""
    del radar, rng
    signal, image = image_weights(spec)
    unbalanced: Samples = samples * np.complex64(signal)
    unbalanced += np.conj(samples) * np.complex64(image)
    return unbalanced


class DcLeak(FrozenModel):
    """Constant in every sample, as a mixer makes of its own oscillator, with a slow random walk.

    Parameters
    ----------
    level_db : float
        Modulus of the constant, dB re 1 V.
    in_units : bool
        ``level_db`` is re one unit of the sensor's own files (``radar.volts_per_unit``).
    phase_deg : float, optional
        Its phase; drawn by default.
    walk_per_sqrt_min : float
        Change after one minute (root mean square of a complex random walk) over the constant.
    """

    kind: Literal["dc_leak"] = "dc_leak"
    level_db: float = Field(default=-80.0, ge=-400, le=100)
    in_units: bool = False
    phase_deg: float | None = Field(default=None, ge=-360, le=360)
    walk_per_sqrt_min: float = Field(default=0.01, ge=0, le=100)


def add_dc(samples: Samples, spec: DcLeak, /, *, radar: Radar, rng: np.random.Generator) -> Samples:
    """Samples with the constant of their pulse added."""
    level_v = level_to_volt(spec.level_db, radar, in_units=spec.in_units, wanted_by="dc_leak: level_db")
    drawn_rad = rng.uniform(0.0, 2.0 * math.pi)
    phase_rad = drawn_rad if spec.phase_deg is None else math.radians(spec.phase_deg)
    parts = rng.standard_normal((2, samples.shape[0]))
    steps = (parts[0] + 1j * parts[1]) * spec.walk_per_sqrt_min / math.sqrt(2.0 * 60.0 * radar.prf_hz)
    walk = np.cumsum(steps) - steps[:1]
    constant_v = level_v * complex(math.cos(phase_rad), math.sin(phase_rad)) * (1.0 + walk)
    return np.asarray(samples + constant_v.astype(np.complex64)[:, None])


IMPAIRMENTS.add("iq_imbalance", Impairment(IqImbalance, unbalance))
IMPAIRMENTS.add("dc_leak", Impairment(DcLeak, add_dc))

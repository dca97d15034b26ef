"""Conditions of a recording: receiver noise, environment and impairments."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from doppelgait.core.config import FrozenModel
from doppelgait.radar.impairments import Impairments
from doppelgait.scene.environment import Environment


class Noise(FrozenModel):
    """Receiver noise, added before all impairments.

    Parameters
    ----------
    kind : {"thermal", "snr", "none"}
        ``thermal``: from the radar's noise figure and bandwidth (equation E-18 of docs/theory.md), unless the list
        of impairments has an entry ``thermal_noise``. ``snr``: the level at which the SNR is ``snr_db``.
    snr_db : float
        SNR_frame to set: time mean of the strongest bin's power over the noise power.

    Examples
    --------
    >>> from doppelgait.pipeline import Noise
    >>> Noise(kind="snr", snr_db=10.0).snr_db
    10.0
    """

    kind: Literal["thermal", "snr", "none"] = "thermal"
    snr_db: float = Field(default=20.0, ge=-100, le=200)


class Conditions(FrozenModel):
    """Receiver noise, environment and impairments of a recording.

    Parameters
    ----------
    noise : Noise
        Receiver noise; thermal by default.
    environment : sequence of models or tables
        Effects such as walls and ground reflections (:mod:`doppelgait.scene.environment`), reflections first.
    impairments : sequence of models or tables
        Impairments of the receiver (:mod:`doppelgait.radar.impairments`), in the order of application.

    Raises
    ------
    ConfigError
        If a kind or a parameter is not allowed.

    Examples
    --------
    >>> import doppelgait as dg
    >>> conditions = dg.Conditions(noise={"kind": "snr", "snr_db": 10.0})
    >>> conditions.noise.snr_db
    10.0
    """

    noise: Noise = Noise()
    environment: Environment = ()
    impairments: Impairments = ()

    def has_impairment(self, kind: str) -> bool:
        """Return True if this impairment is present."""
        return any(getattr(spec, "kind", "") == kind for spec in self.impairments)

"""Conditions of a recording: receiver noise, environment and impairments."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.radar.impairments import Impairments
from doppelgait.scene.environment import Environment


class Noise(FrozenModel):
    """Receiver noise, added before all impairments.

    Parameters
    ----------
    kind : {"thermal", "snr", "none"}
        ``thermal``: from the radar's noise figure and bandwidth (equation E-18 of docs/theory.md), unless the list
        of impairments has an entry ``thermal_noise``. ``snr``: the level for ``snr_db``.
    snr_db : float
        SNR_frame to set: time mean of the strongest bin's power over the noise power; not with ``thermal``.

    Raises
    ------
    ConfigError
        If a parameter is not allowed, or ``snr_db`` is set with ``thermal``.
    """

    kind: Literal["thermal", "snr", "none"] = "thermal"
    snr_db: float = Field(default=20.0, ge=-100, le=200)

    @model_validator(mode="after")
    def _has_one_level(self) -> Self:
        if self.kind == "thermal" and "snr_db" in self.model_fields_set:
            raise ValueError(
                f"kind = 'thermal' and snr_db = {self.snr_db:g} both set the noise level: leave snr_db out, or use "
                "kind = 'snr'"
            )
        return self

    @model_serializer(mode="wrap")
    def _serialise(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {name: value for name, value in plain(self).items() if name != "snr_db" or self.kind != "thermal"}


class Conditions(FrozenModel):
    """Receiver noise, environment and impairments of a recording.

    Parameters
    ----------
    noise : Noise
        Receiver noise; thermal by default.
    environment : sequence of models or tables
        Effects such as walls and ground reflections (:mod:`doppelgait.scene.environment`), reflections first.
    impairments : sequence of models or tables
        Impairments of the receiver (:mod:`doppelgait.radar.impairments`), in their order.

    Raises
    ------
    ConfigError
        If a kind or a parameter is not allowed.

    Examples
    --------
    >>> import doppelgait as dg
    >>> conditions = dg.Conditions(noise=dg.Noise(kind="snr", snr_db=10.0))
    >>> conditions.noise.snr_db
    10.0
    """

    noise: Noise = Noise()
    environment: Environment = ()
    impairments: Impairments = ()

    def has_impairment(self, kind: str) -> bool:
        """Return True if this impairment is present."""
        return any(getattr(spec, "kind", "") == kind for spec in self.impairments)

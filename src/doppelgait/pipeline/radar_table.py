"""Radar of a run (a preset or file, and changes), and conditions of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from doppelgait.core.config import FrozenModel, format_line_note, validate
from doppelgait.core.draws import CYCLE, DISTRIBUTIONS, resolve
from doppelgait.core.errors import ConfigError, list_choices
from doppelgait.radar.impairments import Impairments
from doppelgait.radar.parameters import Radar
from doppelgait.radar.presets import change_preset, read_preset
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


AUTO_PRF_START_HZ = 1000.0
FITTED_KEYS = ("environment", "impairments")


class RadarFile(NamedTuple):
    """Name and table of a radar file that was read before."""

    file: str
    values: Mapping[str, Any]


class FixedRadar(dict[str, Any]):
    """Parsed radar whose preset draws nothing: it serves every example."""


def parse_radar(
    table: Any, *, where: str = "radar", text: str = "", folder: Path | None = None, seed: int = 0, example: int = 0
) -> dict[str, Any]:
    """Parse the ``[radar]`` table of a run.

    Returns ``radar``, ``auto_prf`` and the lists of a calibrated preset. Distributions in a preset's file are sampled
    here. Each has a random stream that is derived from seed, example and key.
    """
    if isinstance(table, FixedRadar):
        return table
    if isinstance(table, str):
        table = {"preset": table}
    if not isinstance(table, Mapping):
        raise ConfigError(f"{where}: radar must be a preset's name or a table, not {table!r}")
    values = dict(table)
    preset: Any = values.pop("preset", None)
    auto_prf = values.get("prf_hz") == "auto"
    if auto_prf:
        del values["prf_hz"]
        values |= {} if preset is not None else {"prf_hz": AUTO_PRF_START_HZ}
    found: dict[str, Any] = {}
    stated: Mapping[str, Any] = found
    if preset is not None:
        try:
            if isinstance(preset, RadarFile):
                preset, source, stated = preset.file, preset.file, preset.values
            else:
                source = str(preset)
                if source.endswith(".toml"):  # the path starts from the folder of the scene file
                    source = str((folder or Path()) / source)
                stated = read_preset(source)
            found = resolve(stated, seed=seed, example=example, key="preset")
            own = sorted({*Radar.model_fields, *FITTED_KEYS})
            for key, value in found.items():
                if key not in own:
                    raise ConfigError(f"{key}: unknown key; allowed are {list_choices(own, key)}")
                if isinstance(value, Mapping) and key not in ("waveform", "antenna"):
                    laws = ", ".join((*DISTRIBUTIONS, CYCLE))
                    raise ConfigError(f"{key} = {value}: needs a number, or a table with one of {laws}")
            values = change_preset(source, values, sampled=found)
        except ConfigError as error:
            place = f"{where + ': ' if where else ''}radar.preset {preset}{format_line_note(text, ['radar', 'preset'])}"
            raise ConfigError(f"{place}: {str(error).removeprefix('preset.')}") from None
    radar = validate(Radar, values, where=where, text=text, section=("radar",))
    lists = {key: value for key, value in found.items() if key in FITTED_KEYS}
    return (FixedRadar if found == stated else dict)(radar=radar, auto_prf=auto_prf, **lists)


def read_radar(radar: str | Path, *, seed: int = 0, example: int = 0) -> tuple[Radar, Conditions]:
    """Read a radar preset or file, and its conditions."""
    found = parse_radar(str(radar), where="", seed=seed, example=example)
    return found["radar"], Conditions(**{key: found[key] for key in FITTED_KEYS if key in found})

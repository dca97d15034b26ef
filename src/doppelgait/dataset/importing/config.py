"""How recordings are imported."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError
from doppelgait.dataset.config import SPLITS, FieldSpec
from doppelgait.pipeline import Tracking
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.gate import GateChoice

Split = Literal["train", "validation", "test"]

FIELDS_OF_RECORDINGS = ("signature", "cadence_map", "baseband")


def parse_gate(value: Any, *, where: str = "") -> GateChoice:
    """Parse the gate of measured recordings: ``"track"``, ``"1.2:2.8"`` or two ranges in m; a ConfigError if none."""
    return Gate.parse(value, names=("track",), lowest_m=0.0, where=where)


class ImportConfig(FrozenModel):
    """How labelled recordings become a dataset.

    Parameters
    ----------
    gate : "track" or (float, float)
        Where the target is, for recordings whose line does not say: found and followed, or between two ranges in m.
        A recording without range (a continuous-wave radar) needs two ranges; any that its frame holds will do.
    window_s, hop_s : float, optional
        Cut recordings into windows of this length, one every ``hop_s`` (by default one after the other). A rest that
        is shorter than a window is left out. By default a recording, or its part from ``start_s`` to ``stop_s``, is
        one example.
    fields : list
        Arrays to keep beside the features: ``signature``, ``cadence_map``, ``baseband``.
    split : "train", "validation", "test" or table
        Where everything goes, or shares of the subjects of every class. By default the column ``split`` of the
        labels, and ``test`` without one.
    seed : int
        Of the draw of subjects where shares are given.
    shard_size : int
        Recordings in one shard file.
    analysis : Analysis
    tracking : Tracking
    """

    gate: GateChoice = "track"
    window_s: float | None = Field(default=None, gt=0, le=86_400)
    hop_s: float | None = Field(default=None, gt=0, le=86_400)
    fields: tuple[FieldSpec, ...] = (FieldSpec(name="signature"),)
    split: Split | dict[Split, float] | None = None
    seed: int = Field(default=2018, ge=0)
    shard_size: int = Field(default=50, ge=1, le=100_000)
    analysis: Analysis = Analysis()
    tracking: Tracking = Tracking()

    @field_validator("gate", mode="before")
    @classmethod
    def _is_a_gate(cls, gate: Any) -> GateChoice:
        try:
            return parse_gate(gate)
        except ConfigError as error:
            raise ValueError(str(error)) from None

    @field_validator("fields", mode="before")
    @classmethod
    def _by_name(cls, fields: Any) -> Any:
        if not isinstance(fields, list | tuple):
            return fields
        specs = [{"name": one} if isinstance(one, str) else one for one in fields]
        names = [one.get("name") if isinstance(one, dict) else one.name for one in specs]
        if len(set(names)) < len(names):
            raise ValueError("names a field twice")
        if unknown := [name for name in names if name not in FIELDS_OF_RECORDINGS]:
            raise ValueError(f"{unknown[0]!r} is none of {', '.join(FIELDS_OF_RECORDINGS)}, which a recording can give")
        return specs

    @field_validator("split", mode="before")
    @classmethod
    def _is_a_split(cls, split: Any) -> Any:
        if split is None or split in SPLITS if not isinstance(split, dict) else False:
            return split
        shares = split.values() if isinstance(split, dict) and set(split) <= set(SPLITS) else ()
        if not shares or not all(isinstance(share, int | float) and share >= 0 for share in shares):
            raise ValueError(f"must be one of {', '.join(SPLITS)}, or shares of 0 or more for these")
        if abs(sum(shares) - 1.0) > 1e-9:
            raise ValueError(f"shares must sum to 1, not {sum(shares):g}")
        return split

    @model_validator(mode="after")
    def _hop_needs_a_window(self) -> Self:
        if self.hop_s is not None and self.window_s is None:
            raise ValueError("hop_s: is the step from window to window; give window_s, too")
        return self

    @property
    def step_s(self) -> float | None:
        """Step from window to window."""
        return self.hop_s or self.window_s

"""Which run a request speaks about, and the last few of them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

from doppelgait.core.errors import ConfigError
from doppelgait.viewer.query import Gate, Pairs, gate_of, single
from doppelgait.viewer.run import Run
from doppelgait.viewer.settings import Clutter
from doppelgait.viewer.source import Opened

MOST_RUNS = 4


@dataclass(frozen=True)
class Reference:
    """A run, its gate, and the parameters that are left.

    Parameters
    ----------
    key : tuple
        Names the run: ``()`` is the opened one.
    gate : str, (float, float) or None
        None: whatever the run shows first.
    further : dict
        Parameters of the endpoint itself.
    clutter : {"kept", "removed"}, optional
        None: as the run has it.
    piece : (int, int), optional
        Number of a target and of its piece to show.
    """

    key: tuple[str | tuple[str, str], ...]
    gate: Gate | None
    further: dict[str, str]
    clutter: Clutter | None = None
    piece: tuple[int, int] | None = None


def parse_reference(query: Pairs, names: Sequence[str] = ()) -> Reference:
    """Reference to a run: nothing for what was opened, ``example=ID``, or ``try=1`` with the controls' values.

    Parameters
    ----------
    query : sequence of (str, str)
    names : sequence of str
        Parameters of the endpoint itself.

    Raises
    ------
    ConfigError
        If a parameter is unknown, comes twice, or the run is named in two ways.
    """
    trying = any(key == "try" for key, _ in query)
    own = _control_names() if trying else []
    found = single(query, ["example", "try", "gate", *names, *own])
    if trying and (found["try"] != "1" or "example" in found):
        raise ConfigError("try: must be 1, and does not go together with example")
    gate = gate_of(found["gate"]) if "gate" in found else None
    further = {key: value for key, value in found.items() if key in names}
    key: tuple[str | tuple[str, str], ...] = ("example", found["example"]) if "example" in found else ()
    if trying:
        key = ("try", *sorted((name, value) for name, value in found.items() if name in own))
    return Reference(key, gate, further, clutter=_clutter_of(further), piece=_piece_of(further))


def _clutter_of(further: dict[str, str]) -> Clutter | None:
    text = further.pop("clutter", None)
    for known in get_args(Clutter):
        if text == known:
            chosen: Clutter = known
            return chosen
    if text is None:
        return None
    raise ConfigError(f"clutter: {text!r} is not allowed; it must be {' or '.join(get_args(Clutter))}")


def _piece_of(further: dict[str, str]) -> tuple[int, int] | None:
    """Target and piece of ``piece=T:K``."""
    text = further.pop("piece", None)
    if text is None:
        return None
    target, colon, piece = text.partition(":")
    if not colon or not all(part.isascii() and part.isdigit() and len(part) <= 6 for part in (target, piece)):
        raise ConfigError(f"piece: {text!r} is not allowed; it must be TARGET:PIECE, for example 0:2")
    return int(target), int(piece)


def _control_names() -> list[str]:
    from doppelgait.viewer.try_it import controls

    return [str(control["name"]) for control in controls()]


class Shelf:
    """The opened run and the last few others; for one thread at a time.

    Parameters
    ----------
    opened : Opened or None
    """

    def __init__(self, opened: Opened | None) -> None:
        self.opened = opened
        self._runs: OrderedDict[tuple[str | tuple[str, str], ...], Run] = OrderedDict()

    def run(self, reference: Reference) -> Run:
        """The run that is meant.

        Raises
        ------
        DoppelgaitError
            If there is none, or it cannot be made.
        """
        if not reference.key:
            return self._opened_run()
        if reference.key not in self._runs:
            self._runs[reference.key] = self._made(reference)
            while len(self._runs) > MOST_RUNS:
                self._runs.popitem(last=False)
        self._runs.move_to_end(reference.key)
        return self._runs[reference.key]

    def _opened_run(self) -> Run:
        if self.opened is None or self.opened.run is None:
            raise ConfigError("no recording is open; name a run with example=ID (of an open dataset) or try=1")
        return self.opened.run

    def _made(self, reference: Reference) -> Run:
        kind, *rest = reference.key
        if kind == "try":
            from doppelgait.viewer.try_it import run_of

            return run_of(dict(item for item in rest if isinstance(item, tuple)))
        if self.opened is None or self.opened.browser is None:
            raise ConfigError("example: no dataset is open; start the viewer with the folder of one")
        return self.opened.browser.run(str(rest[0]))

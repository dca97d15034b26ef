"""Shipped models, trained on synthetic recordings alone.

``tools/train_models.py`` trains the models. The card of each model is stored next to it.
"""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait.classify.model import Model, mark_outside
from doppelgait.classify.model_file import load_model
from doppelgait.core.errors import ConfigError
from doppelgait.radar import Radar

FOLDER = Path(str(resources.files("doppelgait.classify") / "models"))


def read_model_cards() -> dict[str, dict[str, Any]]:
    """Read the cards of the shipped models, by name.

    Returns
    -------
    dict
        By name of the model: what it was trained on, its classes, ``conditions`` (lowest and highest carrier, pulse
        rate and observation time), scores on synthetic test data, size and times.

    Examples
    --------
    >>> from doppelgait.classify import read_model_cards
    >>> read_model_cards()["x4"]["classes"]
    ['human', 'animal']
    """
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(FOLDER.glob("*.json"))}


@cache
def load_shipped_model(name: str) -> Model:
    """Load a model that comes with the package."""
    if name not in read_model_cards():
        raise ConfigError(
            f"model {name!r} is not shipped with doppelgait; shipped models are {', '.join(read_model_cards())}"
        )
    return load_model(FOLDER / f"{name}.npz")


def load_model_for_radar(radar: Radar) -> Model:
    """Load the shipped model that fits a radar."""
    return load_shipped_model(find_shipped_model(radar.carrier_hz, radar.prf_hz))


def open_model(name: str | Path) -> Model:
    """Load a model by shipped name or from a file.

    Raises
    ------
    DatasetError
        As :func:`doppelgait.classify.load_model`.

    See Also
    --------
    find_shipped_model : find the included model for a radar.

    Examples
    --------
    >>> from doppelgait.classify import open_model
    >>> open_model("x4").facts.alarm
    'human'
    """
    return load_shipped_model(str(name)) if str(name) in read_model_cards() else load_model(name)


def find_shipped_model(carrier_hz: float, prf_hz: float) -> str:
    """Return the name of the shipped model for a radar.

    Parameters
    ----------
    carrier_hz, prf_hz : float
        Of the radar; within 10 % of those that a model was trained on.

    Raises
    ------
    ConfigError
        If none fits.

    See Also
    --------
    load_shipped_model : load the model by its name.

    Examples
    --------
    >>> from doppelgait.classify import find_shipped_model
    >>> find_shipped_model(carrier_hz=7.29e9, prf_hz=1000)
    'x4'
    """
    asked, cards = {"carrier_hz": carrier_hz, "prf_hz": prf_hz}, read_model_cards()
    for name, card in cards.items():
        if not any(mark_outside(np.array([value]), key, card["conditions"])[0] for key, value in asked.items()):
            return name
    said = []
    for name, card in cards.items():
        low, high = (value / 1e9 for value in card["conditions"]["carrier_hz"])
        rates = card["conditions"]["prf_hz"]
        said.append(f"{name} ({(low + high) / 2:.4g} GHz, {rates[0]:g} to {rates[1]:g} Hz)")
    raise ConfigError(
        f"no shipped model is for a carrier of {carrier_hz / 1e9:.4g} GHz and {prf_hz:g} pulses a "
        f"second; there are {', '.join(said)}. Train one on a plan of your radar "
        "(doppelgait evaluate DATASET -o REPORT --save model.npz) and name it (--model)"
    )

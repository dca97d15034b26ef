"""Put a simulator through the suite."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Literal, TypeVar

import numpy as np

from doppelgait.core.errors import ConfigError
from doppelgait.radar.parameters import Radar
from doppelgait.testing.conformance import own
from doppelgait.testing.conformance.bench import Bench, Noise, Quantise, Simulator, Sweep, TwoRay, Wall
from doppelgait.testing.conformance.check import Check
from doppelgait.testing.conformance.radars import check_waveform, suite_radars
from doppelgait.testing.conformance.rules import RULES, Rule

Auto = Literal["auto"]
T = TypeVar("T")


def run_conformance(
    simulator: Simulator = own.simulate_bins,
    *,
    radars: Mapping[str, Radar] | None = None,
    only: Iterable[str] | None = None,
    sweep: Sweep | Auto | None = "auto",
    noise: Noise | Auto | None = "auto",
    quantise: Quantise | Auto | None = "auto",
    wall: Wall | Auto | None = "auto",
    two_ray: TwoRay | Auto | None = "auto",
) -> list[Check]:
    """Measure a simulator against closed forms.

    Parameters
    ----------
    simulator : callable
        ``(scatterers, radar) -> baseband``, noise-free; this package's by default.
    radars : mapping of str to Radar, optional
        Radars to measure it with, by the name that the checks get; by default :func:`suite_radars`, one of every
        waveform. The equivalence of waveforms is measured with radars of a small band and the same waveforms.
    only : iterable of str, optional
        Checks to make: ``"noise_power"`` (of every radar) or ``"noise_power[fmcw]"``.
    sweep, noise, quantise, wall, two_ray : callable, "auto" or None
        Further parts of the simulator, in the form of the protocols in :mod:`.bench`; None where it has none: its
        checks are "not applicable" then. ``"auto"``: this package's own beside its own simulator, else None, so that
        no part passes that is not the simulator's.

    Returns
    -------
    list of Check
        A simulator that raises an error fails the check; the error's text is the note.

    Raises
    ------
    ConfigError
        If ``only`` names no check, or there is no theory for a radar's waveform.
    """
    ours = simulator is own.simulate_bins
    bench = Bench(
        simulator=simulator,
        sweep=_part(sweep, own.sweep_samples, ours=ours),
        noise=_part(noise, own.receiver_noise, ours=ours),
        quantise=_part(quantise, own.quantised, ours=ours),
        wall=_part(wall, own.behind_wall, ours=ours),
        two_ray=_part(two_ray, own.over_floor, ours=ours),
    )
    chosen = dict(suite_radars() if radars is None else radars)
    if not chosen:
        raise ConfigError("conformance: radars is empty; give one radar or more, or leave it out")
    for radar in chosen.values():
        check_waveform(radar.waveform.kind)
    return [_measure(rule, bench, radar, name) for name, rule, radar in _cases(chosen, only)]


def _part(given: T | Auto | None, default: T, *, ours: bool) -> T | None:
    if isinstance(given, str):
        return default if ours else None
    return given


def _cases(radars: Mapping[str, Radar], only: Iterable[str] | None) -> list[tuple[str, Rule, Radar]]:
    first = next(iter(radars.values()))
    cases = []
    for rule in RULES:
        if not rule.waveforms:
            cases.append((rule.name, rule, first))
        cases += [
            (f"{rule.name}[{key}]", rule, one) for key, one in radars.items() if one.waveform.kind in rule.waveforms
        ]
    if only is None:
        return cases
    wanted = [only] if isinstance(only, str) else list(only)
    known = {name for name, _, _ in cases} | {rule.name for rule in RULES}
    unknown = [name for name in wanted if name not in known]
    if unknown:
        raise ConfigError(
            f"conformance: there is no check {unknown[0]!r}; known are {', '.join(rule.name for rule in RULES)}, each "
            f"also for one radar as in {cases[0][0]!r}"
        )
    return [case for case in cases if case[0] in wanted or case[1].name in wanted]


def _measure(rule: Rule, bench: Bench, radar: Radar, name: str) -> Check:
    if getattr(bench, rule.needs) is None:
        note = f"the simulator has no {rule.needs}"
        return Check(name, rule.what, math.nan, rule.limit, rule.unit, None, rule.source, note)
    try:
        with np.errstate(divide="ignore", invalid="ignore"):  # silence gives inf or NaN, which fail
            figure, note = float(rule.measure(bench, radar)), ""
    except Exception as error:  # whatever a foreign simulator raises is its failure, not the suite's
        figure, note = math.nan, f"{type(error).__name__}: {error}"
    return Check(name, rule.what, figure, rule.limit, rule.unit, figure <= rule.limit, rule.source, note)

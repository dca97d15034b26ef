"""All checks with quantity, limit and needs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from doppelgait import ConfigError
from doppelgait.radar import Radar
from doppelgait_conformance import bench, echo, equivalence, receiver, theory
from doppelgait_conformance.bench import Bench, Noise, Quantise, Simulator, Sweep, TwoRay, Wall
from doppelgait_conformance.check import Check
from doppelgait_conformance.radars import check_waveform, list_suite_radars

Measure = Callable[[Bench, Radar], float]

RANGED = tuple(name for name in theory.WAVEFORMS if name != "cw")
PULSED = ("impulse", "rectangular", "lfm")
CHIRPED = ("lfm", "fmcw", "stepped")


@dataclass(frozen=True)
class Rule:
    """Available check.

    Parameters
    ----------
    name, what, limit, unit, source
        As in :class:`doppelgait_conformance.Check`.
    measure : callable
        ``measure(bench, radar) -> figure``.
    waveforms : tuple of str
        Waveforms of the radars that it is made with; empty: made once, with the first radar's carrier.
    needs : str
        Part of the bench that it needs in addition to the simulator.
    """

    name: str
    what: str
    limit: float
    unit: str
    source: str
    measure: Measure
    waveforms: tuple[str, ...] = theory.WAVEFORMS
    needs: str = "simulator"


def _name_rule(
    measure: Measure,
    what: str,
    limit: float,
    unit: str,
    source: str,
    waveforms: tuple[str, ...] = theory.WAVEFORMS,
    needs: str = "simulator",
) -> Rule:
    """Make the rule with the name of its function."""
    return Rule(measure.__name__, what, limit, unit, source, measure, waveforms, needs)


RULES = (
    _name_rule(echo.radar_equation, "level of an echo", 0.01, "dB", "radar equation, E-14"),
    _name_rule(echo.phase_linearity, "phase per metre of range", 1e-3, "rad", "-4 pi / lambda, E-13"),
    _name_rule(echo.absolute_phase, "phase of an echo on a bin", 1e-3, "rad", "theta - 4 pi R / lambda, E-18"),
    _name_rule(echo.path_phase, "turn of an echo by path_phase", 1e-3, "rad", "exp(j phi)"),
    _name_rule(echo.doppler_sign, "Doppler shift, both signs", 0.1, "%", "+2 v / lambda, E-05"),
    _name_rule(echo.superposition, "echoes together and one by one", 1e-5, "1", "linearity, E-18"),
    _name_rule(echo.range_migration, "strongest bin of a crossing target", 0.52, "bins", "E-15, E-18", RANGED),
    _name_rule(echo.range_profile, "profile within 2 cells", 0.1, "dB", "transform of the spectrum", RANGED),
    _name_rule(echo.range_doppler_coupling, "range shift of a target", 2.0, "%", "-f_c v T / B", CHIRPED),
    _name_rule(echo.beat_frequency, "beat of a point target", 0.1, "%", "S 2 R / c - 2 v f_c / c", ("fmcw",), "sweep"),
    _name_rule(echo.frame_integration, "loss of a moving echo", 0.1, "dB", "sinc(f_d T_i), E-13b", (*PULSED, "cw")),
    _name_rule(echo.folding, "echoes beyond the next pulse", 1e-4, "1", "R - k c / (2 pulse rate), E-10b", PULSED),
    _name_rule(receiver.noise_power, "noise in a bin", 0.1, "dB", "2 Z0 k T0 F B G / N, E-18", needs="noise"),
    _name_rule(
        receiver.counter_noise, "noise of a threshold sweep", 0.1, "dB", "0.564 s d / n, E-18b", ("impulse",), "noise"
    ),
    _name_rule(
        receiver.noise_correlation, "noise of bins 1 to 4 apart", 0.02, "1", "the radar's own, E-18c", PULSED, "noise"
    ),
    _name_rule(receiver.noise_whiteness, "correlation, circularity", 0.02, "1", "0", needs="noise"),
    _name_rule(receiver.matched_snr, "SNR after matched processing", 0.3, "dB", "E / N0", needs="noise"),
    _name_rule(equivalence.same_signature, "signature of a walk: 1 - correlation", 0.01, "1", "sum of phasors"),
    _name_rule(equivalence.same_gait, "speed and step frequency of a walk", 1.0, "%", "sum of phasors"),
    _name_rule(
        receiver.quantisation_snr, "SNR of a tone, 8 to 12 bit", 0.5, "dB", "6.02 b + 1.76 - back-off", (), "quantise"
    ),
    _name_rule(
        receiver.quantisation_bias,
        "mean error with noise of 0.5 steps",
        0.02,
        "steps",
        "exp(-2 pi^2 s^2) / pi",
        (),
        "quantise",
    ),
    _name_rule(
        receiver.wall_loss, "two-way loss, 3 walls, 3 angles", 0.1, "dB", "characteristic matrix of a slab", (), "wall"
    ),
    _name_rule(receiver.wall_delay, "further range", 0.1, "mm", "(sqrt(eps' - sin^2) - cos) d", (), "wall"),
    _name_rule(receiver.wall_phase, "turn of the echo", 0.01, "rad", "characteristic matrix of a slab", (), "wall"),
    _name_rule(
        receiver.two_ray_pattern,
        "field over a floor",
        0.1,
        "dB",
        "(exp(-jkR) / R + Gamma exp(-jkg) / g)^2",
        (),
        "two_ray",
    ),
)


Auto = Literal["auto"]
T = TypeVar("T")


def run_conformance(
    simulator: Simulator = bench.simulate_bins,
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
        Radars to measure it with, by the name that the checks get; by default :func:`list_suite_radars`, one of every
        waveform. The equivalence of waveforms is measured with radars of a small band and the same waveforms.
    only : iterable of str, optional
        Checks to make: ``"noise_power"`` (of every radar) or ``"noise_power[fmcw]"``.
    sweep, noise, quantise, wall, two_ray : callable, "auto" or None
        Further parts of the simulator, in the form of the protocols in :mod:`.bench`; None where it has none: its
        checks are "not applicable" then. ``"auto"``: this package's own with its own simulator, else None, so that
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
    ours = simulator is bench.simulate_bins
    tested = Bench(
        simulator=simulator,
        sweep=_take_part(sweep, bench.simulate_sweep, ours=ours),
        noise=_take_part(noise, bench.sample_receiver_noise, ours=ours),
        quantise=_take_part(quantise, bench.quantise_samples, ours=ours),
        wall=_take_part(wall, bench.apply_wall, ours=ours),
        two_ray=_take_part(two_ray, bench.apply_floor, ours=ours),
    )
    chosen = dict(list_suite_radars() if radars is None else radars)
    if not chosen:
        raise ConfigError("conformance: radars is empty; name one radar or more, or leave it out")
    for radar in chosen.values():
        check_waveform(radar.waveform.kind)
    first = next(iter(chosen.values()))
    cases = []
    for rule in RULES:
        if not rule.waveforms:
            cases.append((rule.name, rule, first))
        for key, one in chosen.items():
            if one.waveform.kind in rule.waveforms:
                cases.append((f"{rule.name}[{key}]", rule, one))
    if only is not None:
        wanted = [only] if isinstance(only, str) else list(only)
        known = {name for name, _, _ in cases} | {rule.name for rule in RULES}
        unknown = [name for name in wanted if name not in known]
        if unknown:
            raise ConfigError(
                f"conformance: there is no check {unknown[0]!r}; known are {', '.join(rule.name for rule in RULES)}, "
                f"each also for one radar as in {cases[0][0]!r}"
            )
        cases = [case for case in cases if case[0] in wanted or case[1].name in wanted]
    return [_measure(rule, tested, radar, name) for name, rule, radar in cases]


def _take_part(choice: T | Auto | None, default: T, *, ours: bool) -> T | None:
    if isinstance(choice, str):
        return default if ours else None
    return choice


def _measure(rule: Rule, bench: Bench, radar: Radar, name: str) -> Check:
    if getattr(bench, rule.needs) is None:
        note = f"the simulator has no {rule.needs}"
        return Check(name, rule.what, math.nan, rule.limit, rule.unit, None, rule.source, note)
    try:
        with np.errstate(divide="ignore", invalid="ignore"):  # zero output gives inf or NaN, which fail
            figure, note = float(rule.measure(bench, radar)), ""
    except Exception as error:  # every exception of the tested simulator is a failed check, not an error of the suite
        figure, note = math.nan, f"{type(error).__name__}: {error}"
    return Check(name, rule.what, figure, rule.limit, rule.unit, figure <= rule.limit, rule.source, note)

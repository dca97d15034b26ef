"""All checks: what each compares, its limit, and what it needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from doppelgait.radar.parameters import Radar
from doppelgait.testing.conformance import echo, equivalence, receiver, surroundings, sweep, theory
from doppelgait.testing.conformance.bench import Bench

Measure = Callable[[Bench, Radar], float]

RANGED = tuple(name for name in theory.WAVEFORMS if name != "cw")
CHIRPED = ("lfm", "fmcw", "stepped")


@dataclass(frozen=True)
class Rule:
    """A check that can be made.

    Parameters
    ----------
    name, what, limit, unit, source
        As in :class:`doppelgait.testing.conformance.Check`.
    measure : callable
        ``measure(bench, radar) -> figure``.
    waveforms : tuple of str
        Waveforms of the radars that it is made with; empty: made once, with the first radar's carrier.
    needs : str
        Part of the bench that it cannot do without, beside the simulator.
    """

    name: str
    what: str
    limit: float
    unit: str
    source: str
    measure: Measure
    waveforms: tuple[str, ...] = theory.WAVEFORMS
    needs: str = "simulator"


RULES = (
    Rule("radar_equation", "level of an echo", 0.01, "dB", "radar equation, E-14", echo.radar_equation),
    Rule("phase_linearity", "phase per metre of range", 1e-3, "rad", "-4 pi / lambda, E-13", echo.phase_linearity),
    Rule("absolute_phase", "phase of an echo on a bin", 1e-3, "rad", "theta - 4 pi R / lambda, E-18",
         echo.absolute_phase),
    Rule("path_phase", "turn of an echo by path_phase", 1e-3, "rad", "exp(j phi)", echo.path_phase),
    Rule("doppler_sign", "Doppler shift, both signs", 0.1, "%", "+2 v / lambda, E-05", echo.doppler_sign),
    Rule("superposition", "echoes together and one by one", 1e-5, "1", "linearity, E-18", echo.superposition),
    Rule("range_migration", "strongest bin of a crossing target", 0.52, "bins", "E-15, E-18", echo.range_migration,
         RANGED),
    Rule("range_profile", "profile within 2 cells", 0.1, "dB", "transform of the spectrum", sweep.range_profile,
         RANGED),
    Rule("range_doppler_coupling", "range shift of a mover", 2.0, "%", "-f_c v T / B", sweep.range_doppler_coupling,
         CHIRPED),
    Rule("beat_frequency", "beat of a point target", 0.1, "%", "S 2 R / c - 2 v f_c / c", sweep.beat_frequency,
         ("fmcw",), "sweep"),
    Rule("noise_power", "noise in a bin", 0.1, "dB", "2 Z0 k T0 F B G / N, E-18", receiver.noise_power, needs="noise"),
    Rule("noise_whiteness", "correlation, circularity", 0.02, "1", "0", receiver.noise_whiteness, needs="noise"),
    Rule("matched_snr", "SNR after matched processing", 0.3, "dB", "E / N0", receiver.matched_snr, needs="noise"),
    Rule("same_signature", "signature of a walk: 1 - correlation", 0.01, "1", "sum of phasors",
         equivalence.same_signature),
    Rule("same_gait", "speed and step frequency of a walk", 1.0, "%", "sum of phasors", equivalence.same_gait),
    Rule("quantisation_snr", "SNR of a tone, 8 to 12 bit", 0.5, "dB", "6.02 b + 1.76 - back-off",
         receiver.quantisation_snr, (), "quantise"),
    Rule("quantisation_bias", "mean error with noise of 0.5 steps", 0.02, "steps", "exp(-2 pi^2 s^2) / pi",
         receiver.quantisation_bias, (), "quantise"),
    Rule("wall_loss", "two-way loss, 3 walls, 3 angles", 0.1, "dB", "characteristic matrix of a slab",
         surroundings.wall_loss, (), "wall"),
    Rule("wall_delay", "further range", 0.1, "mm", "(sqrt(eps' - sin^2) - cos) d", surroundings.wall_delay, (), "wall"),
    Rule("wall_phase", "turn of the echo", 0.01, "rad", "characteristic matrix of a slab", surroundings.wall_phase, (),
         "wall"),
    Rule("two_ray_pattern", "field over a floor", 0.1, "dB", "(exp(-jkR) / R + Gamma exp(-jkg) / g)^2",
         surroundings.two_ray_pattern, (), "two_ray"),
)  # fmt: skip

"""Conformance suite: any simulator of radar echoes against closed forms.

A simulator is a callable ``(scatterers, radar) -> baseband``. It gets a scatterer table, as
:func:`doppelgait.radar.synthesise` does, and a :class:`doppelgait.radar.Radar`, and returns a DataArray (slow_time,
range) or a complex array (I, N) on the radar's range axis, in volts. A literal loop for the impulse radar (E-18):

>>> import numpy as np
>>> from doppelgait_conformance import format_report, run_conformance, list_suite_radars
>>> def mine(scatterers, radar):
...     wavelength_m, spread_m = 299_792_458.0 / radar.carrier_hz, 299_792_458.0 * radar.sigma_s / 2
...     pulse_m = 299_792_458.0 / (2 * (radar.pulse_rate_hz or radar.prf_hz))
...     level_db = radar.tx_power_dbm + radar.tx_gain_dbi + radar.rx_gain_dbi + radar.receiver_gain_db
...     one_v = np.sqrt(0.1 * 10 ** (level_db / 10) / (4 * np.pi) ** 3) * wavelength_m  # 2 x 50 ohm x 1 mW
...     bins = np.zeros((scatterers.sizes["slow_time"], radar.n_range_bins), complex)
...     for n in range(scatterers.sizes["scatterer"]):
...         row = {name: values.values[:, [n]] for name, values in scatterers.items()}
...         echo_v = one_v * np.sqrt(row["rcs"] * row["path_gain"]) / row["range"] ** 2
...         phase = radar.transmit_phase_rad + row.get("path_phase", 0) - 4 * np.pi * row["range"] / wavelength_m
...         loss = np.sinc(2 * row["radial_velocity"] / wavelength_m * radar.integration_share / radar.prf_hz)
...         for k in range(4) if radar.fold_echoes else (0,):  # echoes of this and of earlier pulses
...             offset_m = radar.range_axis_m() + k * pulse_m - row["range"]
...             bins += loss * echo_v * np.exp(1j * phase - offset_m**2 / (2 * spread_m**2))
...     return bins
>>> checks = run_conformance(mine, radars=list_suite_radars("impulse"))
>>> sorted({check.passed for check in checks}, key=str)  # it has no noise, no converter, no wall and no floor
[None, True]
>>> print(format_report(checks[:1]).splitlines()[-1])
1 checks: 1 passed, 0 failed, 0 not applicable

``python -m doppelgait_conformance`` measures this package's own simulator.
"""

from doppelgait_conformance.bench import Bench, Noise, Quantise, Simulator, Sweep, TwoRay, Wall
from doppelgait_conformance.check import Check, format_report
from doppelgait_conformance.radars import list_suite_radars
from doppelgait_conformance.run import RULES, Rule, run_conformance

__all__ = [
    "RULES",
    "Bench",
    "Check",
    "Noise",
    "Quantise",
    "Rule",
    "Simulator",
    "Sweep",
    "TwoRay",
    "Wall",
    "format_report",
    "list_suite_radars",
    "run_conformance",
]

"""A fitted twin in words: flags, rows of a table, a dictionary for JSON."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from doppelgait.radar.fit.estimate import Estimate

if TYPE_CHECKING:
    from doppelgait.radar.fit.twin import TwinFit

BUSY_SHARE = 1.0 / 3.0
"""Share of bins with movers from which the median no longer gives the noise."""
PLAUSIBLE_NOISE_FIGURE_DB = (0.0, 30.0)
SHORT_S = 10.0


def flags_of(fit: TwinFit) -> tuple[str, ...]:
    """What to know before the numbers are used; empty when nothing is odd."""
    flags = []
    if fit.movers:
        where = ", ".join(f"{m.start_m:.2f} to {m.stop_m:.2f} m ({m.excess_db:.0f} dB)" for m in fit.movers)
        flags.append(f"the room was not empty: slow-time variance over the noise at {where}; those bins were left out")
        if sum(m.stop_m - m.start_m for m in fit.movers) > BUSY_SHARE * (fit.range_m[-1] - fit.range_m[0]):
            flags.append("movers in more than a third of the frame: noise, phase and clutter cannot be trusted")
    if not fit.noise.flat:
        flags.append(f"the noise is not flat in range: {fit.noise.slope_db_per_m.value:+.2f} dB/m")
    low_db, high_db = PLAUSIBLE_NOISE_FIGURE_DB
    if not low_db <= fit.noise_figure_db.value <= high_db:
        flags.append(
            f"a noise figure of {fit.noise_figure_db.value:.1f} dB would be needed: the twin changes the receiver gain "
            "instead, that is the scale of the file against volts"
        )
    if fit.radar.volts_per_unit is None:
        flags.append("the radar does not say how many volts a unit of the file is; levels count the values as volts")
    if fit.phase is None:
        flags.append("static echoes are too weak to show phase and gain of a frame; these are left out")
    if fit.faults.dropped.any() or fit.faults.lost:
        flags.append(f"{int(fit.faults.dropped.sum())} frames repeated or blank, {fit.faults.lost} missing in time")
    if fit.bursts.frames.any():
        flags.append(f"interference in {int(fit.bursts.frames.sum())} frames, left out")
    if fit.duration_s < SHORT_S:
        flags.append(f"only {fit.duration_s:.1f} s: drift and random walk are poorly known; a minute or more is better")
    return tuple(flags)


def estimate_rows(fit: TwinFit) -> list[tuple[str, Estimate, str]]:
    """Name, estimate and unit of every scalar that was fitted, in the order to print."""
    rows = [
        ("noise level", fit.noise_level_db, "dB re 1 V"),
        *_in_units("noise level", fit.noise_level_db, fit),
        ("noise slope over range", fit.noise.slope_db_per_m, "dB/m"),
        ("equivalent noise figure", fit.noise_figure_db, "dB"),
        ("or receiver gain", fit.receiver_gain_db, "dB"),
    ]
    if not math.isnan(fit.leakage.range_m):
        rows.append((f"strongest echo within 1 m, at {fit.leakage.range_m:.2f} m", fit.leakage.level_db, "dB re 1 V"))
    rows.append(("constant over range", fit.leakage.constant_v, "V"))
    if fit.phase is not None and fit.gain is not None:
        minute = 60.0
        rows += [
            ("phase drift", fit.phase.drift_per_s.scaled(minute), "rad/min"),
            ("phase random walk", fit.phase.walk_per_root_s.scaled(math.sqrt(minute)), "rad/sqrt(min)"),
            ("phase jitter, white", fit.phase.white, "rad"),
            ("as clock jitter", fit.phase.white.scaled(1e12 / (2 * math.pi * fit.radar.carrier_hz)), "ps"),
            ("gain drift", fit.gain.drift_per_s.scaled(minute), "dB/min"),
            ("gain jitter, white", fit.gain.white, "dB"),
        ]
    rows.append(("dropped frames", fit.faults.probability.scaled(100.0), "%"))
    return rows


def _in_units(name: str, estimate: Estimate, fit: TwinFit) -> list[tuple[str, Estimate, str]]:
    unit_db = fit.level_of_unit_db
    if unit_db is None:
        return []
    return [(f"{name}, sensor's unit", Estimate(estimate.value - unit_db, estimate.sd), "dB re 1 unit")]


def twin_as_dict(fit: TwinFit) -> dict[str, Any]:
    """All of a fit as plain values for JSON; what is unknown is None."""
    unit_db = fit.level_of_unit_db
    return {
        "source": fit.source,
        "radar": fit.radar.model_dump(mode="json"),
        "frames": fit.n_frames,
        "frames_used": fit.n_used,
        "duration_s": fit.duration_s,
        "estimates": [
            {"name": name, "value": _finite(e.value), "sd": _finite(e.sd), "unit": unit}
            for name, e, unit in estimate_rows(fit)
        ],
        "noise_is_flat": fit.noise.flat,
        "noise_independent_bins": fit.noise.independent_bins,
        "clutter": [
            {
                "range_m": r,
                "level_db": level,
                "sd_db": sd,
                "level_re_unit_db": None if unit_db is None else level - unit_db,
            }
            for r, level, sd in zip(*(x.tolist() for x in _columns(fit)), strict=True)
        ],
        "interference_frames": fit.bursts.frames.nonzero()[0].tolist(),
        "movers": [{"start_m": m.start_m, "stop_m": m.stop_m, "excess_db": m.excess_db} for m in fit.movers],
        "flags": list(fit.flags),
    }


def _columns(fit: TwinFit) -> tuple[Any, Any, Any]:
    return fit.clutter.range_m, fit.clutter.level_db, fit.clutter.sd_db


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None

"""Write a fitted sensor model as a calibrated preset.

Radar parameters come first, then the impairments that were fitted with them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from typing import Any

from doppelgait.core.config import validate
from doppelgait.radar.fit.gain import rescale_radar
from doppelgait.radar.fit.model import PLAUSIBLE_NOISE_FIGURE_DB, SensorFit
from doppelgait.radar.fit.static import DB_PER_NEPER, Estimate
from doppelgait.radar.parameters import Radar, find_possible_correlation

SIGNIFICANT = 3.0
"""Minimum distance from 0, in standard deviations, of a drift, a walk or a constant in the preset."""


def calibrate_radar(fit: SensorFit, radar: Radar | None = None) -> Radar:
    """Return the radar with fitted noise and measured axes.

    Frame rate and range axis are those of the recording.

    The noise figure is changed if the result is plausible (0 to 30 dB), otherwise the receiver gain.

    Parameters
    ----------
    fit : SensorFit
    radar : Radar, optional
        Source of the other parameters; by default the radar of the recording.
    """
    base = fit.radar if radar is None else radar
    start_m = max(float(fit.range_m[0]), 0.0)
    stop_m = start_m + (fit.range_m.size - 0.5) * base.bin_spacing_m
    changes: dict[str, Any] = {
        "name": f"{base.name}, calibrated",
        "prf_hz": fit.radar.prf_hz,
        "range_start_m": start_m,
        "range_stop_m": stop_m,
    }
    same = base.model_copy(update={"prf_hz": fit.radar.prf_hz})
    noise = _choose_noise_change(fit, same)
    if base.waveform.samples_are_bins and "noise_correlation" in base.waveform.takes:
        correlation = [float(rho.real) for rho in fit.noise.correlation[1:]]
        while correlation and correlation[-1] == 0.0:  # not significant
            correlation.pop()
        changes["noise_correlation"] = find_possible_correlation(correlation)
    where = f"the radar fitted to {fit.source or 'a recording'}; its values should be in V"
    return validate(Radar, {**base.model_dump(), **changes, **noise}, where=where)


def _choose_noise_change(fit: SensorFit, radar: Radar) -> dict[str, Any]:
    """Return a plausible noise figure, or a scale."""
    from doppelgait.radar.link import find_noise_slope, noise_power_v2

    excess_db = fit.noise_level_db.value - DB_PER_NEPER * math.log(noise_power_v2(radar))
    figure_db = radar.noise_figure_db + excess_db / find_noise_slope(radar)
    low_db, high_db = PLAUSIBLE_NOISE_FIGURE_DB
    if low_db <= figure_db <= high_db:
        return {"noise_figure_db": figure_db}
    scaled = rescale_radar(radar, excess_db)
    return {key: getattr(scaled, key) for key in ("receiver_gain_db", "threshold_step_v")}


def format_calibrated_preset(fit: SensorFit, radar: Radar | None = None) -> str:
    """Return the text of a calibrated preset.

    ``Radar.preset("FILE.toml")`` loads it; its ``[[impairments]]`` are for a scene.

    Every value has a comment with its source.

    Parameters
    ----------
    fit : SensorFit
    radar : Radar, optional
        Source of the parameters that a recording does not state; by default the radar of the recording.

    Raises
    ------
    ConfigError
        If the fitted values do not make a radar or an impairment.
    """
    from doppelgait.radar.impairments import make_impairment
    from doppelgait.radar.link import find_noise_slope

    calibrated = calibrate_radar(fit, radar)
    tables = list(_iterate_impairments(fit))
    for table, _ in tables:
        make_impairment(table)
    lines = [
        f"# {clean_comment(f'Sensor model fitted from {_format_origin(fit)}.')}",
        "# A number after +- is one standard deviation. Levels are dB re 1 V at the receiver output.",
        "# Receiver noise is in the radar's own parameters: do not add thermal_noise.",
    ]
    if fit.gain is not None and _is_significant(fit.gain.white):
        lines.append(f"# Not modelled: gain jitter of {fit.gain.white.value:.2g} dB from frame to frame.")
    lines += [*(f"# Note: {clean_comment(flag)}." for flag in fit.flags), ""]
    base = fit.radar if radar is None else radar
    noise = _choose_noise_change(fit, base.model_copy(update={"prf_hz": fit.radar.prf_hz}))
    axes = f"axis of {fit.source or 'the recording'}"
    origins = dict.fromkeys(("prf_hz", "range_start_m", "range_stop_m"), axes)
    origins["noise_correlation"] = f"fitted from {_format_origin(fit)}: between bins 1, 2, ... apart"
    if "noise_figure_db" in noise:
        noise_sd_db = fit.noise_level_db.sd / find_noise_slope(base)
        origins["noise_figure_db"] = (
            _format_fitted(fit, noise_sd_db, "dB") + "; gives the measured noise per bin and frame"
        )
    else:
        origins["receiver_gain_db"] = (
            _format_fitted(fit, fit.noise_level_db.sd, "dB")
            + "; gives the measured noise: no noise figure of a receiver does"
        )
        origins["threshold_step_v"] = "scaled with the gain, so that the SNR is that of the preset"
    values = calibrated.model_dump(mode="json", exclude_none=True)
    nested = {name: value for name, value in values.items() if isinstance(value, dict)}
    default = f"as {base.name}"
    lines += [format_setting(k, v, origins.get(k, default)) for k, v in values.items() if k not in nested]
    for name, table in nested.items():
        lines += ["", f"[{name}]", *(format_setting(k, v, default) for k, v in table.items())]
    for table, comments in tables:
        lines += [
            "",
            "[[impairments]]",
            *(format_setting(key, value, comments.get(key, "")) for key, value in table.items()),
        ]
    return "\n".join(lines) + "\n"


def _format_origin(fit: SensorFit) -> str:
    return f"{fit.source or 'a recording'}, {fit.n_used} of {fit.n_frames} frames, {fit.duration_s:.1f} s"


def _format_fitted(fit: SensorFit, sd: float, unit: str) -> str:
    return f"fitted from {_format_origin(fit)}, +-{sd:.2g} {unit}"


def _iterate_impairments(fit: SensorFit) -> Iterable[tuple[dict[str, Any], dict[str, str]]]:
    """Yield impairment tables with comments in their order.
    The order is: echoes of the room, their phase, then faults of the recorder.
    """
    knots = [[round(r, 4), round(level, 2)] for r, level in zip(fit.clutter.range_m, fit.clutter.level_db, strict=True)]
    sd_db = float(fit.clutter.sd_db.max())
    yield (
        {"kind": "static_clutter", "levels": knots},
        {"levels": _format_fitted(fit, sd_db, "dB a knot") + "; holds the direct path too"},
    )
    constant = fit.leakage.constant_v
    if constant.value > SIGNIFICANT * constant.sd:
        level_db = 2.0 * DB_PER_NEPER * math.log(constant.value)
        sd = 2.0 * DB_PER_NEPER * constant.sd / constant.value
        yield {"kind": "dc_leak", "level_db": round(level_db, 2)}, {"level_db": _format_fitted(fit, sd, "dB")}
    if fit.phase is not None:
        drift = fit.phase.drift_per_s.scale(60.0)
        walk = fit.phase.walk_per_root_s.scale(math.sqrt(60.0))
        rows = {
            "white_rad": (fit.phase.white, "rad"),
            "drift_rad_per_min": (drift, "rad/min"),
            "walk_rad_per_sqrt_min": (walk, "rad/sqrt(min)"),
        }
        table = {
            name: _round_digits(estimate.value) if _is_significant(estimate) else 0.0
            for name, (estimate, _) in rows.items()
        }
        comments = {
            name: _format_fitted(fit, estimate.sd, unit)
            + ("" if _is_significant(estimate) else f"; {estimate.value:.2g} is not distinguished from 0")
            for name, (estimate, unit) in rows.items()
        }
        yield {"kind": "phase_noise", **table}, comments
    if fit.bursts.frames.any():
        yield _make_interference_table(fit)
    if fit.faults.probability.value > 0:
        repeated = int(fit.faults.dropped.sum()) - fit.faults.blank
        length = max(fit.faults.mean_length, 1.0)
        share = min(fit.faults.probability.value, length / (1.0 + length))
        faults = {
            "kind": "dropped_frames",
            "probability": _round_digits(share),
            "mean_length": _round_digits(length),
            "fill": "zero" if fit.faults.blank > repeated else "repeat",
        }
        comments = {
            "probability": _format_fitted(fit, fit.faults.probability.sd, "of all frames"),
            "mean_length": "fitted: mean length of the runs",
            "fill": f"fitted: {repeated} frames repeated, {fit.faults.blank} zero",
        }
        yield faults, comments


def _make_interference_table(fit: SensorFit) -> tuple[dict[str, Any], dict[str, str]]:
    count = float(fit.bursts.frames.sum())
    runs = count / fit.bursts.mean_length
    table = {
        "kind": "interference",
        "rate_hz": _round_digits(runs / fit.duration_s),
        "duration_s": _round_digits(max(fit.bursts.mean_length - 1.0, 1e-3) / fit.radar.prf_hz),
        "level_db": round(fit.bursts.level_db, 1),
        "hit_share": _round_digits(fit.bursts.share),
    }
    comments = {
        "rate_hz": _format_fitted(fit, math.sqrt(runs) / fit.duration_s, "Hz"),
        "duration_s": f"fitted: {fit.bursts.mean_length:.2g} frames in a row, less one for a burst across two frames",
        "level_db": "fitted: rms of the cells found; those below the threshold are not counted",
        "hit_share": "fitted: share of the bins found in a frame hit",
    }
    return table, comments


def _is_significant(estimate: Estimate) -> bool:
    return abs(estimate.value) > SIGNIFICANT * estimate.sd


def _round_digits(value: float) -> float:
    return float(f"{value:.4g}")


def format_setting(key: str, value: Any, comment: str) -> str:
    """Return a line of TOML with a comment."""
    text = f"{key} = {_format_toml(value)}"
    return f"{text:<40}  # {clean_comment(comment)}" if comment else text


def clean_comment(comment: str) -> str:
    """Remove line breaks and control characters from a comment.
    They would end the comment, or are not allowed in TOML.
    """
    return " ".join("".join(c if c.isprintable() else " " for c in comment).split())


def _format_toml(value: Any) -> str:
    """Return a value in TOML.
    For strings, numbers, booleans and lists of them, the JSON text is valid TOML.
    """
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{name} = {_format_toml(inner)}" for name, inner in value.items()) + " }"
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n" + "".join(f"    [{', '.join(_format_toml(cell) for cell in row)}],\n" for row in value) + "]"
    return json.dumps(value, ensure_ascii=False)

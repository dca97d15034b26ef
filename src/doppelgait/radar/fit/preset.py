"""Write fitted sensor models as presets: of one sensor, or of a kind of sensors with distributions.

Radar parameters come first, then the impairments that were fitted with them.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from doppelgait.core.config import validate
from doppelgait.radar.fit.measure import SLOW_CELLS
from doppelgait.radar.fit.model import SensorFit, choose_noise_change
from doppelgait.radar.fit.pool import (
    MATTERS,
    SHAPE_DB,
    PooledQuantity,
    SensorKind,
    find_mains_harmonic,
    is_noise_separate,
)
from doppelgait.radar.fit.room import DB_PER_NEPER, Estimate
from doppelgait.radar.parameters import Radar, find_possible_correlation

Table = tuple[dict[str, Any], dict[str, str]]
"""Impairment and the comments of its keys."""


UNITS = {
    "noise_level_db": "dB re 1 V",
    "noise_figure_db": "dB",
    "gain_db": "dB",
    "direct_path_db": "dB re 1 V",
    "white_rad": "rad",
    "walk_rad_per_sqrt_min": "rad/sqrt(min)",
    "drift_rad_per_min": "rad/min",
    "iq_gain_db": "dB",
    "iq_phase_deg": "deg",
    "noise_iq_gain_db": "dB",
    "noise_iq_phase_deg": "deg",
    "dc_level_db": "dB re 1 V",
    "dc_i_v": "V",
    "dc_q_v": "V",
    "drop_probability": "of all frames",
}
"""Unit of each fitted quantity by its name, which is a group and the key of an impairment."""
GROUPS = re.compile("^(noise|iq|dc|drop)_")
DIGITS = {"level_db": 2, "phase_deg": 3}
"""Digits behind the point, by key; 4 for others."""
MAX_KNOTS = 16


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
    changes: dict[str, Any] = {
        "name": f"{base.name}, calibrated",
        "prf_hz": fit.radar.prf_hz,
        "range_start_m": start_m,
        "range_stop_m": start_m + (fit.range_m.size - 0.5) * base.bin_spacing_m,
    }
    if base.waveform.samples_are_bins and "noise_correlation" in base.waveform.takes:
        correlation = [float(rho.real) for rho in fit.noise.correlation[1:]]
        while correlation and correlation[-1] == 0.0:  # not significant
            correlation.pop()
        changes["noise_correlation"] = find_possible_correlation(correlation)
    where = f"the radar fitted to {fit.source or 'a recording'}; its values should be in V"
    return validate(Radar, {**base.model_dump(), **changes, **choose_noise_change(fit, base)}, where=where)


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
    from doppelgait.radar.link import find_noise_slope

    base = fit.radar if radar is None else radar
    values = calibrate_radar(fit, radar).model_dump(mode="json", exclude_none=True)
    lines = [
        f"# {clean_comment(f'Sensor model fitted from {_format_origin(fit)}.')}",
        "# A number after +- is one standard deviation. Levels are dB re 1 V at the receiver output.",
        "# Receiver noise is in the radar's own parameters: do not add thermal_noise.",
    ]
    if fit.gain is not None and _is_significant(fit.gain.white):
        lines.append(f"# Not modelled: gain jitter of {fit.gain.white.value:.2g} dB from frame to frame.")
    lines += [f"# Note: {clean_comment(flag)}." for flag in fit.flags]
    comments = dict.fromkeys(("prf_hz", "range_start_m", "range_stop_m"), f"axis of {fit.source or 'the recording'}")
    comments["noise_correlation"] = f"fitted from {_format_origin(fit)}: between bins 1, 2, ... apart"
    level_sd = fit.noise_level_db.sd
    if "noise_figure_db" in choose_noise_change(fit, base):
        noise = _format_fitted(fit, level_sd / find_noise_slope(base), "dB")
        comments["noise_figure_db"] = f"{noise}; gives the measured noise per bin and frame"
    else:
        noise = _format_fitted(fit, level_sd, "dB")
        comments["receiver_gain_db"] = f"{noise}; gives the measured noise: no noise figure of a receiver does"
        comments["threshold_step_v"] = "scaled with the gain, so that the SNR is that of the preset"
    return _format_preset(lines, values, comments, f"as {base.name}", list(_iterate_impairments(fit)))


def _format_preset(
    lines: Sequence[str], values: Mapping[str, Any], comments: Mapping[str, str], default: str, tables: Sequence[Table]
) -> str:
    """Return the text of a radar and of its impairments, which are checked."""
    from doppelgait.core.draws import replace_by_middle
    from doppelgait.radar.impairments import make_impairment

    for table, _ in tables:
        make_impairment(replace_by_middle(table))
    nested = sorted(name for name, value in values.items() if isinstance(value, dict) and name not in comments)
    lines = [*lines, ""]
    lines += [format_setting(k, v, comments.get(k, default)) for k, v in values.items() if k not in nested]
    for name in nested:
        lines += ["", f"[{name}]", *(format_setting(k, v, default) for k, v in values[name].items())]
    for table, why in tables:
        lines += ["", "[[impairments]]", *(format_setting(k, v, why.get(k, "")) for k, v in table.items())]
    return "\n".join(lines) + "\n"


def _format_origin(fit: SensorFit) -> str:
    return f"{fit.source or 'a recording'}, {fit.n_used} of {fit.n_frames} frames, {fit.duration_s:.1f} s"


def _format_fitted(fit: SensorFit, sd: float, unit: str) -> str:
    return f"fitted from {_format_origin(fit)}, +-{sd:.2g} {unit}"


def _iterate_impairments(fit: SensorFit) -> Iterator[Table]:
    """Yield impairment tables with comments: echoes, their phase, then faults of the recorder."""
    knots = [[round(r, 4), round(level, 2)] for r, level in zip(fit.clutter.range_m, fit.clutter.level_db, strict=True)]
    why = _format_fitted(fit, float(fit.clutter.sd_db.max()), "dB a knot") + "; holds the direct path too"
    yield {"kind": "static_clutter", "levels": knots}, {"levels": why}
    constant = fit.leakage.constant_v
    if _is_significant(constant):
        level = constant.to_db(20.0)
        yield {"kind": "dc_leak", "level_db": round(level.value, 2)}, {"level_db": _format_fitted(fit, level.sd, "dB")}
    if fit.phase is not None:
        table: dict[str, Any] = {"kind": "phase_noise"}
        comments, minutely = {}, fit.phase.per_minute()
        for name in ("white_rad", "drift_rad_per_min", "walk_rad_per_sqrt_min"):
            estimate = minutely[name]
            table[name] = _round_digits(estimate.value) if _is_significant(estimate) else 0.0
            comments[name] = _format_fitted(fit, estimate.sd, UNITS[name])
            if not _is_significant(estimate):
                comments[name] += f"; {estimate.value:.2g} is not distinguished from 0"
        yield table, comments
    if fit.bursts.frames.any():
        bursts = fit.bursts
        runs = float(bursts.frames.sum()) / bursts.mean_length
        table = {
            "kind": "interference",
            "rate_hz": _round_digits(runs / fit.duration_s),
            "duration_s": _round_digits(max(bursts.mean_length - 1.0, 1e-3) / fit.radar.prf_hz),
            "level_db": round(bursts.level_db, 1),
            "hit_share": _round_digits(bursts.share),
        }
        comments = {
            "rate_hz": _format_fitted(fit, math.sqrt(runs) / fit.duration_s, "Hz"),
            "duration_s": f"fitted: {bursts.mean_length:.2g} frames in a row, less one for a burst across two frames",
            "level_db": "fitted: rms of the cells found; those below the threshold are not counted",
            "hit_share": "fitted: share of the bins found in a frame hit",
        }
        yield table, comments
    if fit.faults.probability.value > 0:
        repeated = int(fit.faults.dropped.sum()) - fit.faults.blank
        length = max(fit.faults.mean_length, 1.0)
        table = {
            "kind": "dropped_frames",
            "probability": _round_digits(min(fit.faults.probability.value, length / (1.0 + length))),
            "mean_length": _round_digits(length),
            "fill": "zero" if fit.faults.blank > repeated else "repeat",
        }
        comments = {
            "probability": _format_fitted(fit, fit.faults.probability.sd, UNITS["drop_probability"]),
            "mean_length": "fitted: mean length of the runs",
            "fill": f"fitted: {repeated} frames repeated, {fit.faults.blank} zero",
        }
        yield table, comments


def _is_significant(estimate: Estimate) -> bool:
    return abs(estimate.value) > MATTERS * estimate.sd


def _round_digits(value: float) -> float:
    return float(f"{value:.4g}")


def format_setting(key: str, value: Any, comment: str) -> str:
    """Return a line of TOML with a comment."""
    text = f"{key} = {_format_toml(value)}"
    return f"{text:<40}  # {clean_comment(comment)}" if comment else text


def clean_comment(comment: str) -> str:
    """Remove line breaks and control characters, which would end a comment."""
    return " ".join("".join(c if c.isprintable() else " " for c in comment).split())


def _format_toml(value: Any) -> str:
    """Return a value in TOML; strings, numbers, booleans and lists are written as in JSON."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{name} = {_format_toml(inner)}" for name, inner in value.items()) + " }"
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n" + "".join(f"    [{', '.join(_format_toml(cell) for cell in row)}],\n" for row in value) + "]"
    return json.dumps(value, ensure_ascii=False)


def kind_rows(kind: SensorKind) -> list[dict[str, str]]:
    """Return pooled quantities as rows to print."""
    named = {**kind.pooled, **{f"clutter at {range_m:.2f} m": level for range_m, level in kind.clutter}}
    named |= {_name_line(kind, n): line.level_db for n, line in enumerate(kind.lines)}
    return [
        {
            "quantity": name,
            "mean": f"{p.mean.value:.4g}",
            "+-": f"{p.mean.sd:.2g}",
            "spread": "-" if math.isnan(p.spread) else f"{p.spread:.2g}",
            "95 %": "-" if math.isnan(p.spread) else f"{p.low:.2g} to {p.high:.2g}",
            "unit": UNITS.get(name, "dB re 1 V"),
            "from": str(p.count),
        }
        for name, p in named.items()
    ]


def _name_line(kind: SensorKind, number: int) -> str:
    line = kind.lines[number]
    mains = find_mains_harmonic(line.frequency_hz, kind.radar.prf_hz, max(line.half_width_hz, 0.5))
    return f"line at {line.frequency_hz:+.4g} Hz" + (f" ({mains}?)" if mains else "")


def format_kind_preset(kind: SensorKind) -> str:
    """Return the text of a preset with distributions.

    A plan draws each distribution once per example.

    Every value has a comment with its source; quantities that the recordings do not show are listed at the top.

    Raises
    ------
    ConfigError
        If the fitted values do not make a radar or an impairment.
    """
    names = ", ".join(m.recording.source or "a recording" for m in kind.recordings[:5])
    more = len(kind.recordings) - 5
    separate, pooled = is_noise_separate(kind.pooled), kind.pooled
    lines = [
        f"# {clean_comment(f'Sensors of a kind, fitted from {len(kind.recordings)} recordings')}: "
        f"{clean_comment(names)}{f' and {more} more' if more > 0 else ''}.",
        "# A number after +- is one standard deviation. A distribution is the spread between recordings without",
        "# the measurement error; a plan draws from it for every example, otherwise its centre is used.",
        "# Levels are dB re 1 V at the receiver output.",
        "# Receiver noise arises behind the mixer: the thermal_noise below replaces the noise of the radar."
        if separate
        else "# Receiver noise is in the radar: do not add thermal_noise.",
        *(f"# Refused: {clean_comment(name)}: {clean_comment(why)}." for name, why in kind.refused.items()),
        *(f"# Left out: {clean_comment(why)}." for why in kind.left_out),
    ]
    values = kind.radar.model_dump(mode="json", exclude_none=True)
    values["name"] = f"{kind.radar.name}, fitted"
    comments: dict[str, str] = {}
    if (figure := pooled.get("noise_figure_db")) is not None:
        below_0 = (
            figure.spread_is_known and figure.mean.value < MATTERS * figure.spread
        )  # a normal draw would fall there
        values["noise_figure_db"] = _draw(figure, kind.radar.noise_figure_db, lowest=0.0 if below_0 else None)
        use = "not used: thermal_noise below" if separate else "gives the measured noise"
        comments["noise_figure_db"] = f"{_format_comment(figure, 'dB')}; {use}"
    if (gain := pooled.get("gain_db")) is not None:
        values["receiver_gain_db"] = _draw(gain, kind.radar.receiver_gain_db)
        comments["receiver_gain_db"] = _format_comment(gain, "dB") + "; the spread is that of the direct path"
    if kind.correlation and "noise_correlation" in kind.radar.waveform.takes:
        values["noise_correlation"] = list(find_possible_correlation(kind.correlation))
        comments["noise_correlation"] = "fitted: between bins 1, 2, ... apart"
    tables = list(_iterate_kind_impairments(kind))
    return _format_preset(lines, values, comments, f"as {kind.radar.name}", tables)


def _draw(pooled: PooledQuantity, middle: float, *, digits: int = 4, lowest: float | None = None) -> Any:
    """Return a number, or its distribution: normal, or uniform if it has a ``lowest`` value."""
    value = round(middle, digits) if lowest is None else _round_digits(middle)
    if not pooled.spread_is_known:
        return value
    if lowest is None:
        return {"normal": [value, float(f"{pooled.spread:.3g}")]}
    half = math.sqrt(3.0) * pooled.spread
    return {"uniform": [_round_digits(max(middle - half, lowest)), _round_digits(middle + half)]}


def _format_comment(pooled: PooledQuantity, unit: str) -> str:
    text = f"fitted from {pooled.count} recordings, mean +-{pooled.mean.sd:.2g} {unit}"
    if math.isnan(pooled.spread):
        return f"{text}; too few for a spread"
    spread = "spread" if pooled.spread_is_known else "no spread beyond the uncertainty: 95 %"
    return f"{text}; {spread} {pooled.low:.2g} to {pooled.high:.2g}"


def _make_table(
    kind: str, pooled: Mapping[str, PooledQuantity], middles: Mapping[str, float | None], *, lowest: float | None = None
) -> Table:
    """Return an impairment of quantities around their middles, by default means."""
    table: dict[str, Any] = {"kind": kind}
    comments = {}
    for name, middle in middles.items():
        key, quantity = GROUPS.sub("", name), pooled[name]
        middle = quantity.mean.value if middle is None else middle
        table[key] = _draw(quantity, middle, digits=DIGITS.get(key, 4), lowest=lowest)
        comments[key] = _format_comment(quantity, UNITS[name].removesuffix(" re 1 V"))
    return table, comments


def _iterate_kind_impairments(kind: SensorKind) -> Iterator[Table]:
    """Yield impairments in order, with comments."""
    pooled = kind.pooled
    apart = is_noise_separate(pooled)
    if not apart:
        yield from _iterate_noise(kind)
    if kind.clutter:
        levels = [[round(r, 3), _draw(level, level.mean.value, digits=2)] for r, level in kind.clutter]
        worst = max(level.mean.sd for _, level in kind.clutter)
        text = f"fitted from up to {max(level.count for _, level in kind.clutter)} recordings, +-{worst:.2g} dB a knot"
        yield {"kind": "static_clutter", "levels": levels}, {"levels": text + "; holds the direct path too"}
    if "white_rad" in pooled:
        names = ("white_rad", "walk_rad_per_sqrt_min")
        yield _make_table(
            "phase_noise", pooled, {name: max(pooled[name].mean.value, 0.0) for name in names}, lowest=0.0
        )
    image = ("iq_gain_db", "iq_phase_deg")
    if apart:
        # echoes pass both, the noise behind the mixer passes the second only: I is unchanged, and
        # both together give the Q of the echoes
        g, phi, own_g, own_phi = (
            10.0 ** (pooled[name].mean.value / 20.0) if name.endswith("_db") else math.radians(pooled[name].mean.value)
            for name in (*image, "noise_iq_gain_db", "noise_iq_phase_deg")
        )
        kept = g * math.cos(phi) / (own_g * math.cos(own_phi))
        mixed = (g * math.sin(phi) - own_g * math.sin(own_phi)) / (own_g * math.cos(own_phi))
        joint = (20.0 * math.log10(math.hypot(kept, mixed)), math.degrees(math.atan2(mixed, kept)))
        gain, phase = (pooled[name].mean.value for name in image)
        why = f"; with the next one {gain:.2f} dB and {phase:.1f} deg"
        table, comments = _make_table("iq_imbalance", pooled, dict(zip(image, joint, strict=True)))
        yield table, {**comments, "gain_db": comments["gain_db"] + why}
        level_db = pooled["noise_level_db"].mean.value - DB_PER_NEPER * math.log((1.0 + own_g**2) / 2.0)
        table, comments = _make_table("thermal_noise", pooled, {"noise_level_db": level_db})
        yield table, {"level_db": comments["level_db"] + "; replaces the radar's own: it arises behind the mixer"}
        yield from _iterate_noise(kind)
        second = {"gain_db": round(20.0 * math.log10(own_g), 3), "phase_deg": round(math.degrees(own_phi), 2)}
        why = _format_comment(pooled["noise_iq_gain_db"], "dB") + "; of the noise"
        yield {"kind": "iq_imbalance", **second}, {"gain_db": why}
    elif "iq_gain_db" in pooled and any(pooled[n].spread_is_known or _is_significant(pooled[n].mean) for n in image):
        yield _make_table("iq_imbalance", pooled, dict.fromkeys(image))
    if (constant := _find_constant(kind)) is not None:
        yield constant
    share = pooled.get("drop_probability")
    if share is not None and share.mean.value > 0.0:
        most = 0.9 * kind.run_length / (1.0 + kind.run_length)
        middles = {"drop_probability": min(share.mean.value, most)}
        table, comments = _make_table("dropped_frames", pooled, middles, lowest=0.0)
        yield {**table, "mean_length": round(max(kind.run_length, 1.0), 3)}, comments
    if kind.bits:
        why = "reached" if math.isfinite(kind.full_scale_v) and kind.clipped else "never reached: assumed"
        table = {"kind": "adc", "bits": kind.bits, "full_scale_v": float(f"{kind.full_scale_v:.6g}")}
        why += f"; {100 * kind.clipped:.2g} % clipped"
        yield table, {"bits": "from the steps of the values", "full_scale_v": why}


def _iterate_noise(kind: SensorKind) -> Iterator[Table]:
    """Yield the impairments that add to the samples, except white noise."""
    noise_db = kind.pooled["noise_level_db"].mean.value if "noise_level_db" in kind.pooled else math.nan
    table: dict[str, Any] = {"kind": "coloured_noise"}
    if math.isfinite(noise_db) and sum(e.value > max(SHAPE_DB, MATTERS * e.sd) for _, e in kind.doppler) >= 2:
        # power above the white floor
        levels = _subtract_level(_make_doppler_knots(kind), noise_db, 0.0)
        text = "fitted: noise over the white floor, by Doppler; constant outside, 20 dB below the floor where refused"
        yield {**table, "levels": levels}, {"levels": text}
    if math.isfinite(noise_db) and kind.range_db:
        lowest_db = min(level_db for _, level_db in kind.range_db)
        shape = {"levels": [[0.0, round(noise_db, 2)]], "range_db": _subtract_level(kind.range_db, 0.0, lowest_db)}
        yield table | shape, {"range_db": "fitted: noise over its lowest level, by range"}
    for number, line in enumerate(kind.lines):
        level = _draw(line.level_db, line.level_db.mean.value, digits=2)
        table = {"kind": "spur", "frequency_hz": round(line.frequency_hz, 3), "level_db": level}
        yield table, {"frequency_hz": _name_line(kind, number), "level_db": _format_comment(line.level_db, "dB")}


def _make_doppler_knots(kind: SensorKind) -> list[tuple[float, float]]:
    """Return knots of noise over the floor, by Doppler.
    At refused frequencies it is that floor, 0 dB; an impairment extends its outer knots to both sides.
    """
    step_hz, runs = kind.doppler_step_hz, [[kind.doppler[0]]]
    for before, here in pairwise(kind.doppler):
        if here[0] - before[0] > 1.5 * step_hz:
            runs.append([])
        runs[-1].append(here)
    thin = math.ceil(len(kind.doppler) / MAX_KNOTS)
    knots: list[tuple[float, float]] = []
    for run in runs:
        if run[0][0] > (SLOW_CELLS + 1.5) * step_hz:
            knots.append((run[0][0] - step_hz, 0.0))
        knots += [(f, e.value) for f, e in [*run[:-1:thin], run[-1]]]
        if run[-1][0] < kind.radar.prf_hz / 2.0 - 1.5 * step_hz:
            knots.append((run[-1][0] + step_hz, 0.0))
    return knots


def _subtract_level(knots: Sequence[tuple[float, float]], reference_db: float, lowest_db: float) -> list[list[float]]:
    """Return knots of the power over a lowest level, in dB to a reference, at least -20 dB."""
    excess = [(x, max(10.0 ** (level_db / 10.0) - 10.0 ** (lowest_db / 10.0), 0.01)) for x, level_db in knots]
    return [[round(x, 4), round(reference_db + DB_PER_NEPER * math.log(power), 2)] for x, power in excess]


def _find_constant(kind: SensorKind) -> Table | None:
    """Return the constant of all bins, if significant."""
    found, half = kind.pooled, len(kind.recordings) / 2
    if "dc_level_db" in found and found["dc_level_db"].count > half:
        return _make_table("dc_leak", found, {"dc_level_db": None})
    if "dc_i_v" not in found or found["dc_i_v"].count < half:
        return None
    in_phase, quadrature = found["dc_i_v"], found["dc_q_v"]
    size_v = math.hypot(in_phase.mean.value, quadrature.mean.value)
    spread_v = math.hypot(*(0.0 if math.isnan(p.spread) else p.spread for p in (in_phase, quadrature)))
    if size_v < MATTERS * math.hypot(in_phase.mean.sd, quadrature.mean.sd) and spread_v == 0.0:
        return None
    why = f"fitted: I {in_phase.mean.value:.3g}, Q {quadrature.mean.value:.3g} V, each with the spread {spread_v:.2g} V"
    if size_v < 2.0 * spread_v:  # without a common phase it is static echoes of the room rather than a constant
        level_db = 20.0 * math.log10(math.hypot(size_v, spread_v))
        return {"kind": "dc_leak", "level_db": round(level_db, 2)}, {"level_db": why}
    size: Any = round(20.0 * math.log10(size_v), 2)
    phase: Any = round(math.degrees(math.atan2(quadrature.mean.value, in_phase.mean.value)), 2)
    if in_phase.spread_is_known or quadrature.spread_is_known:
        share = spread_v / math.sqrt(2.0) / size_v
        size = {"normal": [size, round(2.0 * DB_PER_NEPER * share, 3)]}
        phase = {"normal": [phase, round(math.degrees(share), 2)]}
    return {"kind": "dc_leak", "level_db": size, "phase_deg": phase}, {"level_db": why}

"""Write a fitted sensor as plain values, and as a preset of the radar and its impairments."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from doppelgait.core.draws import replace_by_middle
from doppelgait.radar.fit.measure import SLOW_CELLS
from doppelgait.radar.fit.pool import (
    MATTERS,
    SHAPE_DB,
    PooledQuantity,
    SensorKind,
    find_mains_harmonic,
    is_noise_separate,
)
from doppelgait.radar.fit.room import DB_PER_NEPER, FACTS, VOLT_DB, Estimate, Fact
from doppelgait.radar.impairments import make_impairment
from doppelgait.radar.parameters import find_possible_correlation

Table = tuple[dict[str, Any], dict[str, str]]
"""Impairment and the comments of its keys."""

MAX_KNOTS = 16


def describe_sensor(kind: SensorKind) -> dict[str, Any]:
    """Return a fitted sensor as plain values for JSON.

    Returns
    -------
    dict
        ``quantities`` has one row for every quantity, with its name, mean, standard deviation, spread between
        recordings and unit; levels are also re one unit of the files if the radar states its volts. ``recordings``
        lists the use of every recording. ``refused``, ``notes`` and ``left_out`` have the reasons. Unknown is None.
    """
    rows = [(name, FACTS[name].label, FACTS[name].unit, pooled) for name, pooled in kind.pooled.items()]
    rows += [(f"clutter_at_{r:.2f}_m", f"clutter at {r:.2f} m", VOLT_DB, level) for r, level in kind.clutter]
    rows += [
        (f"line_at_{line.frequency_hz:.4g}_hz", _name_line(kind, number), VOLT_DB, line.level_db)
        for number, line in enumerate(kind.lines)
    ]
    volts = kind.radar.volts_per_unit
    quantities = []
    for name, label, unit, p in rows:
        values = {"value": p.mean.value, "sd": p.mean.sd, "spread": p.spread, "low": p.low, "high": p.high}
        if unit == VOLT_DB and volts is not None:
            values["value_re_unit_db"] = p.mean.value - 20.0 * math.log10(volts)
        known = {key: value if math.isfinite(value) else None for key, value in values.items()}
        quantities.append({"name": name, "quantity": label, **known, "unit": unit, "recordings": p.count})
    recordings: list[dict[str, Any]] = []
    for m in kind.recordings:
        recordings.append({"recording": m.recording.source, "used_for": m.uses, "frames": m.recording.n_pulses})
        if m.room is not None:
            recordings[-1] |= {
                "frames_used": m.room.time_s.size,
                "interference_frames": m.room.bursts.frames.nonzero()[0].tolist(),
                "movers": [dataclasses.asdict(interval) for interval in m.room.moving],
            }
    return {
        "radar": kind.radar.model_dump(mode="json"),
        "quantities": quantities,
        "recordings": recordings,
        "refused": kind.refused,
        "notes": kind.notes,
        "left_out": list(kind.left_out),
    }


def _name_line(kind: SensorKind, number: int) -> str:
    line = kind.lines[number]
    mains = find_mains_harmonic(line.frequency_hz, kind.radar.prf_hz, max(line.half_width_hz, 0.5))
    return f"line at {line.frequency_hz:+.4g} Hz" + (f" ({mains}?)" if mains else "")


def format_preset(kind: SensorKind) -> str:
    """Return the text of a preset of a fitted sensor.

    ``Radar.preset("FILE.toml")`` loads it; its ``[[impairments]]`` are for a scene. A plan draws each distribution once
    per example. Every value has a comment with its source; quantities that the recordings do not show are on top.

    Raises
    ------
    ConfigError
        If the fitted values do not make a radar or an impairment.
    """
    names = ", ".join(m.recording.source or "a recording" for m in kind.recordings[:5])
    more = len(kind.recordings) - 5
    separate, pooled = is_noise_separate(kind.pooled), kind.pooled
    lines = [
        f"# {clean_comment(f'Sensor fitted to {names}')}{f' and {more} more' if more > 0 else ''}.",
        "# A number after +- is one standard deviation. A distribution is the spread between recordings without",
        "# the measurement error; a plan draws from it for every example, otherwise its centre is used.",
        "# Levels are dB re 1 V at the receiver output.",
        "# Receiver noise arises behind the mixer: the thermal_noise below replaces the noise of the radar."
        if separate
        else "# Receiver noise is in the radar: do not add thermal_noise.",
        *(f"# Note: {clean_comment(note)}." for note in kind.notes.values()),
        *(f"# Refused: {clean_comment(name)}: {clean_comment(why)}." for name, why in kind.refused.items()),
        *(f"# Left out: {clean_comment(why)}." for why in kind.left_out),
    ]
    jitter = pooled.get("gain_white_db")
    if jitter is not None and _is_significant(jitter.mean):
        lines.append(f"# Not modelled: gain jitter of {jitter.mean.value:.2g} dB from frame to frame.")
    values = kind.radar.model_dump(mode="json", exclude_none=True)
    values["name"] = f"{kind.radar.name}, fitted"
    comments = dict.fromkeys(("prf_hz", "range_start_m", "range_stop_m"), "axis of the recordings")
    if (figure := pooled.get("noise_figure_db")) is not None:
        # a normal draw would fall below 0
        below_0 = figure.spread_is_known and figure.mean.value < MATTERS * figure.spread
        fact = dataclasses.replace(FACTS["noise_figure_db"], lowest=0.0 if below_0 else None)
        values["noise_figure_db"] = _draw(figure, kind.radar.noise_figure_db, fact)
        use = "not used: thermal_noise below" if separate else "gives the measured noise per bin and frame"
        comments["noise_figure_db"] = f"{_format_comment(figure, 'dB')}; {use}"
        if "noise figure" in kind.notes and not separate:
            comments["noise_figure_db"] = "as without the fit: the gain changes instead"
            comments["receiver_gain_db"] = f"{_format_comment(figure, 'dB')}; gives the measured noise"
            comments["threshold_step_v"] = "scaled with the gain, so that the SNR is that of the preset"
    if (gain := pooled.get("gain_db")) is not None:
        values["receiver_gain_db"] = _draw(gain, kind.radar.receiver_gain_db, FACTS["gain_db"])
        comments["receiver_gain_db"] = _format_comment(gain, "dB") + "; the spread is that of the direct path"
    if kind.correlation is not None and "noise_correlation" in kind.radar.waveform.takes:
        values["noise_correlation"] = list(find_possible_correlation(kind.correlation))
        comments["noise_correlation"] = "fitted: between bins 1, 2, ... apart"
    tables = list(_iterate_impairments(kind))
    for table, _ in tables:
        make_impairment(replace_by_middle(table))
    nested = sorted(name for name, value in values.items() if isinstance(value, dict) and name not in comments)
    default = f"as {kind.radar.name}"
    lines += ["", *(format_setting(k, v, comments.get(k, default)) for k, v in values.items() if k not in nested)]
    for name in nested:
        lines += ["", f"[{name}]", *(format_setting(k, v, default) for k, v in values[name].items())]
    for table, why in tables:
        lines += ["", "[[impairments]]", *(format_setting(k, v, why.get(k, "")) for k, v in table.items())]
    return "\n".join(lines) + "\n"


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


def _draw(pooled: PooledQuantity, middle: float, fact: Fact) -> Any:
    """Return a number, or its distribution: normal, or uniform if it has a lowest value."""
    value = _round_digits(middle) if fact.digits is None else round(middle, fact.digits)
    if not pooled.spread_is_known:
        return value
    if fact.lowest is None:
        return {"normal": [value, float(f"{pooled.spread:.3g}")]}
    half = math.sqrt(3.0) * pooled.spread
    return {
        "uniform": [_round_digits(max(middle - half, fact.lowest)), _round_digits(min(middle + half, fact.highest))]
    }


def _format_comment(pooled: PooledQuantity, unit: str) -> str:
    if pooled.count == 1:
        return f"fitted, +-{pooled.mean.sd:.2g} {unit}"
    text = f"fitted from {pooled.count} recordings, mean +-{pooled.mean.sd:.2g} {unit}"
    if math.isnan(pooled.spread):
        return f"{text}; too few for a spread"
    spread = "spread" if pooled.spread_is_known else "no spread beyond the uncertainty: 95 %"
    return f"{text}; {spread} {pooled.low:.2g} to {pooled.high:.2g}"


def _make_table(kind: SensorKind, impairment: str, middles: Mapping[str, float] | None = None) -> Table:
    """Return an impairment of its facts, around means or other middles."""
    table: dict[str, Any] = {"kind": impairment}
    comments = {}
    for name, fact in FACTS.items():
        sets, _, key = fact.sets.partition(".")
        if sets != impairment or name not in kind.pooled:
            continue
        pooled = kind.pooled[name]
        middle = (middles or {}).get(name, pooled.mean.value)
        comments[key] = _format_comment(pooled, fact.unit.removesuffix(" re 1 V"))
        if fact.significant and not pooled.spread_is_known and not _is_significant(pooled.mean):
            comments[key] += f"; {middle:.2g} is not distinguished from 0"
            middle = 0.0
        table[key] = _draw(pooled, middle if fact.lowest is None else max(middle, fact.lowest), fact)
    return table, comments


def _iterate_impairments(kind: SensorKind) -> Iterator[Table]:
    """Yield impairments in the order of the signal, with comments."""
    pooled = kind.pooled
    apart = is_noise_separate(pooled)
    if not apart:
        yield from _iterate_noise(kind)
    if kind.clutter:
        knot = Fact("", "dB", digits=2)
        levels = [[round(r, 4), _draw(level, level.mean.value, knot)] for r, level in kind.clutter]
        worst = max((level for _, level in kind.clutter), key=lambda level: level.mean.sd)
        why = _format_comment(worst, "dB a knot") + "; holds the direct path too"
        yield {"kind": "static_clutter", "levels": levels}, {"levels": why}
    if "white_rad" in pooled:
        yield _make_table(kind, "phase_noise")
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
        table, comments = _make_table(kind, "iq_imbalance", dict(zip(image, joint, strict=True)))
        comments["gain_db"] += f"; with the next one {gain:.2f} dB and {phase:.1f} deg"
        yield table, comments
        level_db = pooled["noise_level_db"].mean.value - DB_PER_NEPER * math.log((1.0 + own_g**2) / 2.0)
        table, comments = _make_table(kind, "thermal_noise", {"noise_level_db": level_db})
        comments["level_db"] += "; replaces the radar's own: it arises behind the mixer"
        yield table, comments
        yield from _iterate_noise(kind)
        second = {"gain_db": round(20.0 * math.log10(own_g), 3), "phase_deg": round(math.degrees(own_phi), 2)}
        why = _format_comment(pooled["noise_iq_gain_db"], "dB") + "; of the noise"
        yield {"kind": "iq_imbalance", **second}, {"gain_db": why}
    elif "iq_gain_db" in pooled and any(pooled[n].spread_is_known or _is_significant(pooled[n].mean) for n in image):
        yield _make_table(kind, "iq_imbalance")
    if (constant := _find_constant(kind)) is not None:
        yield constant
    half = len(kind.recordings) / 2
    if "burst_level_db" in pooled and pooled["burst_level_db"].count >= half:
        yield _make_table(kind, "interference")
    if "drop_probability" in pooled and pooled["drop_probability"].mean.value > 0.0:
        length = kind.run_length
        largest = math.nextafter(length / (1.0 + length), 0.0)
        middles = {"drop_probability": min(pooled["drop_probability"].mean.value, largest)}
        table, comments = _make_table(kind, "dropped_frames", middles)
        faults = [m.room.faults for m in kind.recordings if m.room is not None]
        blank, repeated = sum(f.blank for f in faults), sum(int(f.dropped.sum()) - f.blank for f in faults)
        table |= {"mean_length": _round_digits(length), "fill": "zero" if blank > repeated else "repeat"}
        comments |= {"mean_length": "fitted: mean length of the runs"}
        yield table, comments | {"fill": f"fitted: {repeated} frames repeated, {blank} zero"}
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
        level = _draw(line.level_db, line.level_db.mean.value, FACTS["noise_level_db"])
        table = {"kind": "spur", "frequency_hz": round(line.frequency_hz, 3), "level_db": level}
        yield table, {"frequency_hz": _name_line(kind, number), "level_db": _format_comment(line.level_db, "dB")}


def _make_doppler_knots(kind: SensorKind) -> list[tuple[float, float]]:
    """Return knots of noise over the floor, by Doppler; 0 dB at refused frequencies."""
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
        return _make_table(kind, "dc_leak")
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

"""Requirements of the gait features against rows of the acceptance study."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pandas as pd

FAILURE = 0.1
FEW_PERIODS = 3.0
REPORT_S = (1.0, 1.5, 2.0, 3.0, 5.0)
REPORT_FAILURES = {
    ("liland2018", 60.0): (35, 21, 14, 2, 0),
    ("standard", 60.0): (7, 0, 0, 0, 0),
    ("liland2018", 20.0): (35, 21, 15, 5, 39),
    ("standard", 20.0): (7, 0, 0, 0, 0),
    ("liland2018", 10.0): (52, 58, 69, 82, 96),
    ("standard", 10.0): (8, 0, 0, 0, 0),
    ("liland2018", 5.0): (66, 72, 78, 95, 100),
    ("standard", 5.0): (10, 1, 0, 0, 0),
    ("standard", 0.0): (28, 14, 8, 7, 1),
}
"""Failures in % at those T_o in the reference measurements, with other models, by method and SNR_mu in dB."""
CLOSE_POINTS, CLOSE_UP_TO_S, CLOSE_FROM_DB = 20.0, 2.0, 20.0
VELOCITY_MPS = {"human walk": 0.04}
OTHER_VELOCITY_MPS = 0.08
FREQUENCY_RMS = {20.0: 1.0, 5.0: 2.0}
GROUND_RMS = {3.0: 7.0, 5.0: 2.0}
LEAST_CORRELATION = 0.85
LEAST_CORRELATED = 5
"""Fewer targets say nothing of a correlation."""
RATIO_LIMITS = (
    ("K 128 -> 512", ("standard", 60.0), ("K 512", 60.0), 2.0),
    ("SNR_mu 60 -> 5 dB", ("standard", 60.0), ("standard", 5.0), 10.0),
)
NAMES = ("item", "condition", "demand", "reached", "n", "as recorded", "met?")

Row = tuple[Any, ...]


def markdown(table: pd.DataFrame) -> str:
    """Format a Markdown table of all columns."""
    head = [[str(name) for name in table.columns], ["---"] * len(table.columns)]
    lines = [*head, *([str(value) for value in line] for line in table.to_numpy(dtype=object).tolist())]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def failed(rows: pd.DataFrame) -> pd.Series:
    """Mark rows in which f_mu is missing or 10 % wrong."""
    return ~((rows["found_hz"].astype(float) / rows["truth_hz"] - 1.0).abs() <= FAILURE)


def report_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate failures in % at psi 0 by method, SNR_mu and time.

    Ours, in brackets the reference's, and n.
    """
    cells = (
        failed(rows)
        .groupby([rows["snr_mu_db"], rows["method"], rows["seconds"]])
        .agg(["mean", "size"])
        .to_dict("index")
    )
    found = []
    for level_db in sorted(set(rows["snr_mu_db"]), reverse=True):
        for method in sorted(set(rows["method"])):
            row = {"SNR_mu dB": f"{level_db:g}", "method": method}
            known = dict(zip(REPORT_S, REPORT_FAILURES.get((method, level_db), ()), strict=False))
            for seconds in sorted(set(rows["seconds"])):
                share, n = cells[level_db, method, seconds].values()
                bracket = f" ({known[seconds]})" if seconds in known else ""
                row[f"{seconds:g} s"] = f"{100 * share:.0f}{bracket}, n {n:.0f}"
            found.append(row)
    return pd.DataFrame(found)


def report_demands(rows: pd.DataFrame) -> pd.DataFrame:
    """Check the requirements on the report's method.

    Worse than ours in every cell; within 20 points of the reference at 20 dB and more, up to 2 s.
    """
    share = 100.0 * failed(rows).groupby([rows["method"], rows["snr_mu_db"], rows["seconds"]]).mean()
    report, ours = share["liland2018"], share["standard"]
    worse, same = int((report > ours).sum()), int((report == ours).sum())
    counts = f"{worse} cells worse, {same} the same, of {len(report)}"
    apart = max(apart_points(report))
    n = int(rows.groupby(["method", "snr_mu_db", "seconds"]).size().min())
    item, near = "source-compatible mode", f"apart from table 2.2 at >= {CLOSE_FROM_DB:g} dB, <= {CLOSE_UP_TO_S:g} s"
    found = [
        (item, "fails more often than ours", "every cell", counts, n, 0, _met(worse == len(report))),
        (item, near, f"<= {CLOSE_POINTS:g} points", f"{apart:.1f}", n, 0, _met(apart <= CLOSE_POINTS)),
    ]
    return pd.DataFrame(found, columns=NAMES)


def apart_points(report: pd.Series) -> list[float]:
    """Return the differences of failures from the reference, in points.

    By SNR_mu and time, where a requirement exists.
    """
    known = {
        (level_db, seconds): share
        for (method, level_db), shares in REPORT_FAILURES.items()
        for seconds, share in zip(REPORT_S, shares, strict=True)
        if method == "liland2018" and level_db >= CLOSE_FROM_DB and seconds <= CLOSE_UP_TO_S
    }
    return [abs(float(report[cell]) - share) for cell, share in known.items() if cell in report.index]


def acceptance(rows: pd.DataFrame) -> pd.DataFrame:
    """Check every requirement that the rows allow."""
    marked = rows.assign(failed=failed(rows), recorded=rows["source"] == "recorded")
    makers: tuple[Callable[[pd.DataFrame], Iterator[Row]], ...] = (
        _failure_demands, _side_demands, _frequency_demands, _velocity_demands, _ground_demands, _flag_demands,
        _bandwidth_demands, _ratio_demands, _label_demands,
    )  # fmt: skip
    return pd.DataFrame([row for make in makers for row in make(marked)], columns=NAMES)


def _met(met: bool) -> str:
    return "met" if met else "not met"


def _at_most(
    item: str, condition: str, limit: float, reached: float, cell: pd.DataFrame, *, unit: str = " %"
) -> Iterator[Row]:
    """Return the row of a requirement "at most"; none without trials."""
    if len(cell) and math.isfinite(reached):
        counts = (len(cell), int(cell["recorded"].sum()), _met(reached <= limit))
        yield item, condition, f"<= {limit:g}{unit}", f"{reached:.3g}{unit}", *counts


def _our_rows(rows: pd.DataFrame) -> pd.DataFrame:
    return rows[(rows["method"] == "standard") & rows["part"].isin(["models", "mocap"])]


def _failure_demands(rows: pd.DataFrame) -> Iterator[Row]:
    own = _our_rows(rows)
    psi, snr, seconds, periods = own["psi_deg"], own["snr_mu_db"], own["seconds"], own["periods"]
    front, points = psi <= 30, ~own["occluded"].astype(bool)
    demands = (
        ("psi <= 30, SNR_mu >= 10 dB, T_o >= 2 s", front & (snr >= 10) & (seconds >= 2), 1.0),
        ("psi <= 30, SNR_mu >= 10 dB, >= 3 periods", front & (snr >= 10) & (periods >= FEW_PERIODS), 0.5),
        ("psi 45, 20 dB, T_o >= 3 s", (psi == 45) & (snr == 20) & (seconds >= 3) & points, 3.0),
        ("psi 45, 20 dB, T_o >= 3 s, limbs hide each other", (psi == 45) & (seconds >= 3) & ~points, 5.0),
        ("psi <= 30, SNR_mu 5 dB, T_o >= 2 s", front & (snr == 5) & (seconds >= 2), 3.0),
    )
    for condition, chosen, limit in demands:
        for name, cell, allowed in _by_periods(own[chosen], limit):
            yield from _at_most("f_mu off by > 10 %", condition + name, allowed, 100 * cell["failed"].mean(), cell)


def _by_periods(cell: pd.DataFrame, limit: float) -> Iterator[tuple[str, pd.DataFrame, float]]:
    """Separate recorded targets seen for fewer than three periods.

    They have twice the limit.
    """
    few = (cell["periods"] < FEW_PERIODS) & (cell["part"] == "mocap")
    yield "", cell[~few], limit
    yield ", below 3 periods", cell[few], 2.0 * limit


def _side_demands(rows: pd.DataFrame) -> Iterator[Row]:
    own = _our_rows(rows)
    cell = own[own["psi_deg"].between(60, 75) & own["gait"].str.startswith("human") & (own["seconds"] >= 3)]
    found_hz = cell["found_hz"].astype(float)
    right = (
        ~failed(cell) | ~failed(cell.assign(found_hz=2.0 * found_hz)) | ~failed(cell.assign(found_hz=found_hz / 2.0))
    )
    condition = "psi 60-75, people, T_o >= 3 s, 20 dB"
    yield from _at_most("neither it nor its double or half", condition, 10.0, 100 * (~right).mean(), cell)
    yield from _at_most("f_mu off by > 10 %", condition, 15.0, 100 * cell["failed"].mean(), cell)


def _frequency_demands(rows: pd.DataFrame) -> Iterator[Row]:
    own = _our_rows(rows)
    for level_db, limit in FREQUENCY_RMS.items():
        cell = own[(own["psi_deg"] == 0) & (own["seconds"] == 3) & (own["snr_mu_db"] == level_db) & ~own["failed"]]
        off = 100 * _rms(cell["found_hz"].astype(float) / cell["truth_hz"] - 1.0)
        yield from _at_most("f_mu rms of successes", f"T_o 3 s, psi 0, {level_db:g} dB", limit, off, cell)


def _rms(values: Any) -> float:
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    return float(np.sqrt(np.mean(known**2))) if known.size else math.nan


def _velocity_demands(rows: pd.DataFrame) -> Iterator[Row]:
    own = _our_rows(rows)
    cell = own[(own["psi_deg"] == 0) & (own["seconds"] == 3) & (own["snr_mu_db"] >= 5)]
    for gait, part in cell.groupby("gait"):
        limit = VELOCITY_MPS.get(str(gait), OTHER_VELOCITY_MPS)
        off = _rms(part["v_mps"].astype(float) - part["true_mps"])
        yield from _at_most("v_m rms", f"{gait}, 3 s, psi 0, >= 5 dB", limit, off, part, unit=" m/s")


def _ground_demands(rows: pd.DataFrame) -> Iterator[Row]:
    own = rows[(rows["part"] == "tracked") & rows["gait"].str.startswith("human")]
    for seconds, limit in GROUND_RMS.items():
        for name, widest_deg in (("0-90", 90.0), ("0-75 only", 75.0)):
            asked = own[(own["seconds"] == seconds) & (own["psi_deg"] <= widest_deg)]
            cell = asked[asked["speed_mps"].notna()]
            off = 100 * _rms(cell["speed_mps"].astype(float) / cell["ground_mps"] - 1.0)
            missing = f"none for {len(asked) - len(cell)} of {len(asked)}"
            condition = f"people, {seconds:g} s, psi {name}, 15 dB, tracked; {missing}"
            yield from _at_most("v_g rms", condition, limit, off, cell)


def _flag_demands(rows: pd.DataFrame) -> Iterator[Row]:
    sets = (("truth gate, 20 dB", _our_rows(rows)), ("tracked, 15 dB", rows[rows["part"] == "tracked"]))
    for name, own in sets:
        cell = own[(own["psi_deg"] >= 60) & (own["seconds"] >= 3) & own["found_hz"].notna()]
        missed = 100 * (1.0 - cell["flagged"].astype(float).mean())
        yield from _at_most("not flagged low_confidence", f"psi >= 60, T_o >= 3 s, {name}", 5.0, missed, cell)


def _bandwidth_demands(rows: pd.DataFrame) -> Iterator[Row]:
    own = rows[(rows["method"] == "standard") & rows["part"].isin(["models", "mocap", "wide"])]
    front = own[(own["psi_deg"] == 0) & (own["seconds"] == 3) & (own["snr_mu_db"] == 20) & own["b_hz"].notna()]
    for (part, gait), cell in front.groupby(["part", "gait"]):
        if len(cell) < LEAST_CORRELATED:
            continue
        condition = f"{gait}, 3 s, psi 0, 20 dB, f_p {2000 if part == 'wide' else 1000} Hz"
        reached = float(np.corrcoef(cell["b_hz"].astype(float), cell["span_hz"])[0, 1])
        counts = (len(cell), int(cell["recorded"].sum()), _met(reached >= LEAST_CORRELATION))
        yield "B_mu correlation with true span", condition, f">= {LEAST_CORRELATION:g}", f"{reached:.3f}", *counts


def _ratio_demands(rows: pd.DataFrame) -> Iterator[Row]:
    cell = rows[rows["part"].isin(["models", "mocap"]) & (rows["psi_deg"] == 0) & (rows["seconds"] == 3)]
    wide = cell.pivot_table(index=["gait", "number", "recorded"], columns=["method", "snr_mu_db"], values="rho")
    for name, before, after, limit in RATIO_LIMITS:
        if not {before, after} <= set(wide.columns):
            continue
        for gait, part in wide.groupby("gait"):
            both = part[[before, after]].dropna().reset_index()
            change = (both[after] / both[before] - 1.0).abs()
            mean = 100 * abs(both[after].mean() / both[before].mean() - 1.0)
            single = f"median {100 * change.median():.2g} %, {100 * (change <= limit / 100).mean():.0f} % within"
            condition = f"{gait}, {name}; single trials: {single}"
            yield from _at_most("rho, change of the mean", condition, limit, mean, both)


def _label_demands(rows: pd.DataFrame) -> Iterator[Row]:
    cell = rows[rows["part"] == "labels"]
    if len(cell):
        differ = 100 * (~cell["same_bits"].astype(bool)).mean()
        yield from _at_most("features differ in a bit", "same motion, other class tag", 0.0, differ, cell)


def by_cell(rows: pd.DataFrame) -> pd.DataFrame:
    """Tabulate failures of f_mu in % by gait, aspect and SNR_mu.

    From 2 s on, by our method; n in brackets.
    """
    own = _our_rows(rows).assign(failed=failed(_our_rows(rows)))
    own = own[own["seconds"] >= 2]
    found = own.groupby(["psi_deg", "occluded", "snr_mu_db", "gait"])["failed"].agg(["mean", "size"])
    text = found.apply(lambda cell: f"{100 * cell['mean']:.1f} ({cell['size']:.0f})", axis=1)
    return text.unstack("gait").fillna("").reset_index()

"""Printed tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from clock import Timing

WIDTH = 56


def print_title(text: str) -> None:
    print(f"\n{text}\n{'-' * len(text)}")


def print_timings(rows: Mapping[str, Timing], *, unit: str = "", factor: float = 1.0, digits: int = 2) -> None:
    """Two columns, from minima and from medians."""
    print(f"{'':{WIDTH}s} {f'min {unit}'.strip():>12s} {f'median {unit}'.strip():>12s}")
    for name, row in rows.items():
        print(f"{name:{WIDTH}s} {factor * row['min']:12.{digits}f} {factor * row['median']:12.{digits}f}")


def print_ratios(rows: Mapping[str, Timing], *, digits: int = 1) -> None:
    print(f"{'':{WIDTH}s} {'of minima':>12s} {'of medians':>12s}")
    for name, row in rows.items():
        print(f"{name:{WIDTH}s} {row['min']:11.{digits}f}x {row['median']:11.{digits}f}x")


def print_values(rows: Mapping[str, float], form: str, unit: str = "") -> None:
    for name, value in rows.items():
        print(f"{name:{WIDTH + 16}s} {value:{form}} {unit}".rstrip())


def print_growth(rows: Sequence[Mapping[str, Any]]) -> None:
    """One line a case: least and median ms of every stage and, in brackets, the least per unit of what varies."""
    stages = list(dict.fromkeys(row["stage"] for row in rows))
    cases = list(dict.fromkeys((row["axis"], row["size"]) for row in rows))
    print(f"{'':18s}" + "".join(f"{stage:>30s}" for stage in stages))
    for axis, size in cases:
        cells = {row["stage"]: row for row in rows if (row["axis"], row["size"]) == (axis, size)}
        line = f"{axis:11s} {size:6g}" + "".join(f"{growth_cell(cells[stage]):>30s}" for stage in stages)
        print(line.rstrip())


def growth_cell(row: Mapping[str, Any]) -> str:
    least, median = row["seconds"]["min"], row["seconds"]["median"]
    per_unit = f"({1e3 * row['per_unit']['min']:.4f})" if row["per_unit"] else ""
    return f"{1e3 * least:.2f} {1e3 * median:8.2f} {per_unit:>10s}"


def print_workers(rows: Sequence[Mapping[str, Any]]) -> None:
    """One line for every number of workers and hop."""
    print(f"{'workers':9s}{'hop':14s}{'examples/s, best, median':>26s}{'x obvious NumPy':>18s}{'peak MB each':>14s}")
    for row in rows:
        rate = f"{row['per_second']['min']:.0f}, {row['per_second']['median']:.0f}"
        times = f"{row['ratio']['min']:.0f}, {row['ratio']['median']:.0f}"
        print(f"{row['workers']:<9d}{row['hop']:14s}{rate:>26s}{times:>18s}{row['peak_mb']:14.0f}")


def print_asked(rows: Sequence[Mapping[str, Any]]) -> None:
    """Asked and measured; the verdict is that of the medians, and of the minima where that differs."""
    print(f"{'':{WIDTH}s} {'asked':>13s} {'aim':>7s} {'of minima':>11s} {'of medians':>11s}")
    for row in rows:
        asked = f"{'>=' if row['at_least'] else '<='} {row['asked']:g} {row['unit']}"
        low, middle = f"{row['measured']['min']:.3g}", f"{row['measured']['median']:.3g}"
        print(f"{row['name']:{WIDTH}s} {asked:>13s} {row['aim']:>7g} {low:>11s} {middle:>11s}  {row['verdict']}")

"""Text of motion files: lines, tables of numbers, and the frames of points with a time axis."""

from __future__ import annotations

import inspect
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from doppelgait.core.documents import CELL_BYTES, check_cost, read_document, stat_regular
from doppelgait.core.errors import MotionError, warn_caller
from doppelgait.core.plugins import plugin
from doppelgait.core.units import FloatArray
from doppelgait.motion.motion import Motion, make_motion
from doppelgait.motion.readers.points import (
    MAX_RATE_HZ,
    MIN_FRAMES,
    MIN_RATE_HZ,
    check_amount,
    check_rate,
    choose_up_axis,
    convert_unit_to_metres,
    find_skeleton_unit,
    find_unit,
    has_rest_pose,
    pick_joints,
    pick_markers,
    remove_implausible,
    take_subject,
    turn_z_up,
)


def read_text(path: Path) -> str:
    """Read a UTF-8 or Latin-1 text file."""
    return "\n".join(read_lines(path))


def parse_rows(
    path: Path, text: str, at: int, *, n_columns: int, n_rows: int | None = None, separator: str = " "
) -> FloatArray:
    """Parse a table of numbers up to the end. Shapes: returns (T, n_columns)."""
    lines = [text[at:]] if separator == " " else [line for line in text[at:].split("\n") if line.strip()]
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # raised for values that are no numbers
        try:
            values = np.fromstring(separator.join(lines), sep=separator)
        except (DeprecationWarning, ValueError):
            values = np.empty(0)
    whole = values.size == (values.size // n_columns if n_rows is None else n_rows) * n_columns
    whole &= separator == " " or all(line.count(separator) == n_columns - 1 for line in lines)
    if whole and values.size and np.isfinite(values).all():
        return values.reshape(-1, n_columns)
    row = 0
    for number, line in enumerate(text[at:].split("\n"), start=text.count("\n", 0, at) + 1):
        words = line.split(None if separator == " " else separator)
        if not line.strip():
            continue
        row += 1
        where = f"{path}, line {number}: frame {row}"
        bad = next((word for word in words if not is_finite(word)), None)
        if bad is not None:
            raise MotionError(f"{where} holds {bad[:30]!r}, which is not a finite number")
        if len(words) != n_columns:
            raise MotionError(
                f"{where} holds {len(words)} values, but {n_columns} are needed; the file is truncated or damaged"
            )
    if n_rows is None or row == 0:
        raise MotionError(f"{path}: holds no frames")
    raise MotionError(
        f"{path}: declares {n_rows} frames but holds {row}; it is truncated, or its number of frames is wrong"
    )


def is_finite(word: str) -> bool:
    """Return True if a word is a finite number."""
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False


Row = tuple[int, list[str]]  # line number, from 1, and cells of the line

MAX_BYTES = 2**30
HEAD_ROWS = 20
BLANK = {"", "na", "n/a", "null", "none", "-"}


def decode(raw: bytes) -> str:
    """Decode a table's text as UTF-8 or, if that fails, as Latin-1."""
    # a byte-order mark is removed
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def check_size(path: Path) -> None:
    """Refuse a file that is too large to be read whole."""
    size = stat_regular(path).st_size
    if size > MAX_BYTES:
        raise MotionError(f"{path}: has {size} bytes; files of up to {MAX_BYTES} bytes are read")


def read_lines(path: Path) -> list[str]:
    """Read the lines of a text file."""
    raw = read_document(path, MAX_BYTES, MotionError)
    check_cost(path, CELL_BYTES * (raw.count(b"\n") + raw.count(b"\r")), MotionError)
    return decode(raw).replace("\r\n", "\n").replace("\r", "\n").split("\n")


HEADER_BYTES = 2**20
"""Bytes read for the column names: those of many points exceed the head that sniffers get."""


def list_head_lines(path: Path, head: bytes, n_lines: int) -> list[str]:
    """Return the first lines of a text file, at least as many as asked for."""
    if head.count(b"\n") < n_lines:
        with path.open("rb") as file:
            head = file.read(HEADER_BYTES)
    return [*decode(head).splitlines(), *[""] * n_lines]


def trim_cells(cells: Sequence[str]) -> list[str]:
    """Return the cells without blank cells at the end."""
    return list(cells[: max((n for n, cell in enumerate(cells, start=1) if cell), default=0)])


def to_numbers(path: Path, rows: Sequence[Row], columns: Sequence[int], titles: Sequence[str]) -> FloatArray:
    """Convert cells to numbers, shape (rows, columns)."""
    # blank cells, na, n/a, null, none and - become NaN
    values = np.empty((len(rows), len(columns)))
    # numbers of the first rows have decimal commas, and none a point
    first = [cell for _, row in rows[:HEAD_ROWS] for cell in row]
    decimal_comma = any(is_finite(cell.replace(",", ".")) for cell in first if "," in cell)
    decimal_comma = decimal_comma and not any(is_finite(cell) for cell in first if "." in cell)
    for k, (line, cells) in enumerate(rows):
        wanted = [cells[i] for i in columns]
        if decimal_comma:
            wanted = [cell.replace(",", ".") for cell in wanted]
        try:
            values[k] = list(map(float, wanted))
        except ValueError:
            for n, (title, cell) in enumerate(zip(titles, wanted, strict=True)):
                word = cell.strip()
                try:
                    values[k, n] = np.nan if word.lower() in BLANK else float(word)
                except ValueError:
                    raise MotionError(
                        f"{path}: line {line}, column {title!r}: {word[:40]!r} is not a number. Correct it, or leave "
                        "the cell blank where the point was not seen."
                    ) from None
    values[~np.isfinite(values)] = np.nan
    return values


MAX_DIGITS = 18  # maximum number of digits of a number of frames or markers that is parsed


def note_frames(path: Path, declared: str, n_frames: int) -> list[str]:
    """Return a note, and warn, if a header declares another number of frames."""
    if not is_other(declared, n_frames):
        return []
    note = f"declares {declared[:MAX_DIGITS]} frames but holds {n_frames}"
    warn_caller(f"{path}: {note}; it may be truncated. The existing frames are read.")
    return [note]


def is_other(declared: str, count: int) -> bool:
    """Return True if a header states another number. Numbers may have thousands of digits."""
    return declared.isdecimal() and (len(declared) > MAX_DIGITS or int(declared) != count)


JITTER = 0.01  # maximum time error of a frame, in frames; a larger one causes a false velocity
COARSEST = 0.4  # maximum rounding of a printed time, in frames; a missing frame appears as 0.5
MAX_STEP = 2.5
"""Maximum step of irregular times to interpolate over, in median steps. A longer one is a gap."""
INSTEAD = "or give rate_hz= if the frames are evenly spaced nevertheless"


@dataclass(frozen=True)
class Times:
    """Times of the frames, their lines, and the units of their last digits. Shapes: time_s (T,)."""

    time_s: FloatArray
    lines: Sequence[int]
    printed_s: float
    significant_s: float


def read_times(path: Path, rows: Sequence[Row], column: int, title: str, *, factor: float = 1.0) -> Times:
    """Read a column of times."""
    rows = [(line, cells[column : column + 1] or [""]) for line, cells in rows]
    time_s = to_numbers(path, rows, [0], [title])[:, 0] * factor
    printed = [cell.strip().replace(",", ".").partition(".")[2] for _, (cell,) in rows]
    decimals = [digits for digits in printed if "e" not in digits.lower()] or ["0" * 14 + "1"]
    # large numbers printed to nine significant digits have fewer decimals
    least_s = 1e-8 * float(np.abs(np.nan_to_num(time_s)).max())
    # some programs print times that are rounded to the millisecond with six decimals
    digits = (max(map(len, decimals)), max(len(word.rstrip("0")) for word in decimals))
    printed_s, significant_s = (max(10.0**-n * factor, least_s) for n in digits)
    return Times(time_s, [line for line, _ in rows], printed_s, significant_s)


def find_frame_rate(path: Path, times: Times, declared_hz: float | None = None) -> tuple[float, int]:
    """Determine the frame rate and how many frames have it: all, or all but the last."""
    # it is the declared rate if the times agree with it
    time_s, lines = times.time_s, times.lines
    step = np.diff(time_s)
    if np.isnan(time_s).any():
        raise MotionError(f"{path}: line {lines[int(np.isnan(time_s).argmax())]} has no time. Add it, {INSTEAD}.")
    if not (step > 0).all():
        k = int((step <= 0).argmax())
        raise MotionError(
            f"{path}: line {lines[k + 1]}: the time does not increase ({time_s[k]:g} s, then {time_s[k + 1]:g} s). "
            f"Correct it, interpolate over the increasing times: resample_hz=..., {INSTEAD}."
        )
    fit = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    if not MIN_RATE_HZ <= fit <= MAX_RATE_HZ:
        raise MotionError(
            f"{path}: its times step by {1 / fit:.6g} s, {fit:.4g} frames a second; allowed are {MIN_RATE_HZ:g} to "
            f"{MAX_RATE_HZ:g}. If they are not in seconds, give the rate: rate_hz=..."
        )
    for n in (len(time_s), len(time_s) - 1):
        rate = _fit_rate(time_s[:n], times, declared_hz) if n >= MIN_FRAMES else np.nan
        if rate == rate:
            return rate, n
    odd = int(np.abs(step - np.median(step)).argmax())
    raise MotionError(
        f"{path}: line {lines[odd + 1]}: the time steps by {step[odd]:.6g} s, but most frames are "
        f"{np.median(step):.6g} s apart. Frames must be evenly spaced: interpolate over the times: resample_hz=..., "
        f"add missing frames with blank cells, {INSTEAD}."
    )


def _fit_rate(time_s: FloatArray, times: Times, declared_hz: float | None) -> float:
    """Return the frame rate of even times, NaN if they are uneven."""
    fit = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    candidates = [declared_hz or 0.0, *(round(fit, decimals) for decimals in range(7))]
    rate = next((hz for hz in candidates if hz > 0 and _offset_s(time_s, hz) <= _rounding_s(times, hz)), fit)
    return rate if _offset_s(time_s, rate) <= max(_rounding_s(times, rate), JITTER / rate) else float("nan")


def _offset_s(time_s: FloatArray, rate_hz: float) -> float:
    """Return the largest deviation from even times."""
    # the even times are fitted for the smallest maximum deviation
    return float(np.ptp(time_s - np.arange(len(time_s)) / rate_hz)) / 2.0


def _rounding_s(times: Times, rate_hz: float) -> float:
    """Return the largest deviation that rounding explains."""
    # if a whole number of digits is a period, rounding to them moves all frames alike
    digits = min(1.0 / max(rate_hz * times.significant_s, 1e-15), 1e15)
    digit_s = times.printed_s if abs(digits - round(digits)) < 1e-6 * digits else times.significant_s
    return min(0.5 * digit_s * (1.0 + 1e-6), COARSEST / rate_hz)


def resample(path: Path, position: FloatArray, time_s: FloatArray, rate_hz: float) -> FloatArray:
    """Interpolate positions over uneven times by cubic splines. Shapes: position (T, P, 3)."""
    from scipy.interpolate import CubicSpline

    # frames whose time does not increase repeat an earlier one
    kept = time_s > np.fmax.accumulate(np.concatenate([[-np.inf], time_s[:-1]]))
    check_amount(path, int(kept.sum()))
    time_s, position = time_s[kept], position[kept]
    n_frames = int(min((time_s[-1] - time_s[0]) * rate_hz * (1.0 + 1e-12), 1e15)) + 1
    check_cost(path, 8.0 * position[0].size * n_frames, MotionError)
    even_s, longest_s = time_s[0] + np.arange(n_frames) / rate_hz, MAX_STEP * float(np.median(np.diff(time_s)))
    result = np.full((n_frames, *position.shape[1:]), np.nan)
    for p in range(position.shape[1]):
        seen = np.isfinite(position[:, p]).all(axis=1)
        if seen.sum() < 2:
            continue
        seen_s = time_s[seen]
        after = np.clip(np.searchsorted(seen_s, even_s, side="right"), 1, len(seen_s) - 1)
        near = (np.diff(seen_s)[after - 1] <= longest_s) & (even_s >= seen_s[0]) & (even_s <= seen_s[-1])
        result[near, p] = CubicSpline(seen_s, position[seen, p])(even_s[near])
    return result


@dataclass(frozen=True)
class Points:
    """Points of a file, with what it states about rate and unit. Shapes: position (T, P, 3).

    An empty unit is guessed; None must be given, except of a skeleton, which has ``parents``. ``each`` are the units
    of points or of their coordinates, and ``device`` is the one whose usual rate is assumed.
    """

    labels: Sequence[str]
    position: FloatArray
    unit: str | float | None = None
    unit_from: str = ""
    each: Sequence[Sequence[str]] | None = None
    rate_hz: float | str | None = None
    rate_from: str = ""
    device: str = ""
    times: Times | None = None
    declared_up: str = ""
    usual_up: str = "z"
    subject: str = ""
    texts: Mapping[str, Sequence[str]] = field(default_factory=dict)
    parts: Mapping[str, str] = field(default_factory=dict)
    report: Mapping[str, str] = field(default_factory=dict)
    notes: Sequence[str] = ()
    parents: Sequence[int] | None = None
    root_turns: FloatArray | None = None


def make_timed_motion(
    path: Path,
    points: Points,
    file_format: str,
    *,
    subject: str | int | None = None,
    units: str | None = None,
    up_axis: str | None = None,
    rate_hz: float | None = None,
    resample_hz: float | None = None,
) -> Motion:
    """Make the motion of one body over a time axis, not cleaned: the last step of every reader."""
    stated, missing = units or points.unit, []
    if rate_hz is None and points.times is None and points.rate_hz is None:
        missing.append("frame rate: rate_hz=...")
    if stated is None and points.each is None and points.parents is None:
        missing.append("length unit: units='mm', 'cm' or 'm'")
    if missing:
        raise MotionError(
            f"{path}: states no {' and no '.join(name.split(':')[0] for name in missing)}; give the "
            f"{', and the '.join(missing)}"
        )
    notes, rate_from, unit_from, each = list(points.notes), "", "", None
    if points.root_turns is not None and has_rest_pose(points.root_turns, points.position):
        points = replace(points, position=points.position[1:])
        notes.append("frame 0 is a rest pose put in front of the recording; left out")
    position, rate = _space_evenly(path, points, notes, rate_hz, resample_hz)
    if points.parents is not None:
        body = pick_joints(path, points.labels, points.parents, position)
        unit_from = "option" if units else points.unit_from
        unit, metres, unit_from = find_skeleton_unit(path, body, points.parents, position, stated, unit_from)
        rate_from = points.rate_from if rate_hz is None else "option"
    else:
        wanted = None if subject is None else str(subject)
        texts, parts = points.texts, points.parts
        body = pick_markers(path, points.labels, position, notes, subject=wanted, texts=texts, known_parts=parts)
        if points.each is not None and units is None:
            names = [points.each[i] for i in body.kept]
            each = np.array([[convert_unit_to_metres(path, name) for name in point] for point in names])
            flat = [name for point in names for name in point]
            stated = max(dict.fromkeys(flat), key=flat.count)
        unit = find_unit(path, str(stated or ""), position[:, body.kept])
        metres = convert_unit_to_metres(path, unit)
    check_amount(path, len(position))
    position_m = position[:, body.kept] * (metres if each is None else each)
    chosen, body = take_subject(path, position_m, body)
    position_m = position_m[:, chosen]
    notes += remove_implausible(path, position_m)
    position_m[np.isnan(position_m).any(axis=2)] = np.nan
    declared, usual = points.declared_up, points.usual_up
    axis_facts = choose_up_axis(path, position_m, body, up_axis=up_axis, declared=declared, usual=usual)
    # skeletons face along z, which becomes x, as in the C3D files of the same recordings
    faces_z = body.is_skeleton and axis_facts["up_axis"] == "y"
    owner = body.subject or points.subject
    dropped: dict[str, list[str]] = {}
    for i in sorted(body.reasons):
        dropped.setdefault(body.reasons[i], []).append(body.labels[i] or f"point_{i + 1}")
    return make_motion(
        position_m[..., [2, 0, 1]] if faces_z else turn_z_up(position_m, axis_facts["up_axis"]),
        rate_hz=rate,
        markers=body.names,
        parts=body.parts,
        facts={"source": path.name, "kind": "recording", "subject": owner, "species": body.species},
        report={
            "format": file_format,
            "frame_rate_hz": rate,
            **({"frame_rate_from": rate_from} if rate_from else {}),
            "n_frames": len(position),
            "points_in_file": len(body.labels),
            **({} if body.measured is None else {"points_measured": body.measured}),
            "length_unit": unit,
            "metres_per_unit": metres,
            **({"length_unit_from": unit_from} if unit_from else {}),
            **axis_facts,
            **points.report,
            "dropped": dropped,
            "notes": notes,
        },
    )


def _space_evenly(
    path: Path, points: Points, notes: list[str], rate_hz: float | None, resample_hz: float | None
) -> tuple[FloatArray, float]:
    """Return evenly spaced positions and their rate, of options, times or header."""
    times, position = points.times, points.position
    if resample_hz is not None:
        rate = check_rate(path, resample_hz, said="resample_hz is")
        if rate_hz is not None or times is None:
            step_s = 1.0 / check_rate(path, points.rate_hz if rate_hz is None else rate_hz, said="the frames have")
            even = resample(path, position, np.asarray(np.arange(len(position)) * step_s), rate)
        else:
            even = resample(path, position, times.time_s, rate)
        notes.append(f"resampled from {len(position)} frames to {rate:g} Hz by cubic splines over their times")
        return even, rate
    if rate_hz is not None:
        return position, check_rate(path, rate_hz, said="was given")
    if points.device:
        notes.append(f"the format states no frame rate; {points.rate_hz} Hz, that of {points.device}, is assumed")
        warn_caller(f"{path}: {notes[-1]}. If that is wrong, give the rate: rate_hz=...")
    if times is None:
        return position, check_rate(path, points.rate_hz, said="declares")
    stated = str(points.rate_hz or 0.0)
    declared = max(float(stated), 0.0) if is_finite(stated) else 0.0
    rate, n = find_frame_rate(path, times, declared or None)
    if n < len(position):
        step_s = float(times.time_s[-1] - times.time_s[-2])
        notes.append(f"the last frame, {step_s:.4g} s after the one before at {rate:g} Hz, was left out")
    if points.rate_hz is not None and rate != declared:
        notes.append(f"the header states {points.rate_hz or 'no rate'} Hz, the times {rate:g} Hz; the times were used")
        warn_caller(f"{path}: {notes[-1]}. If that is wrong, give the rate: rate_hz=...")
    return position[:n], rate


def starts_with(head: bytes, pattern: bytes) -> bool:
    """Match the first bytes without byte-order mark and blanks."""
    return re.match(pattern, head.removeprefix(b"\xef\xbb\xbf").lstrip()) is not None


def point_format(
    name: str, opening: bytes | Callable[[Path, bytes], bool], suffixes: Sequence[str], *, skeleton: bool = False
) -> Callable[[Callable[..., Points]], Callable[..., Points]]:
    """Register a parser of points as a motion reader."""
    # opening: a pattern of the first bytes, or a sniffer. The parser gets the options that it
    # names, the last step those of every format; units belong to one of both
    no_options = {"subject", "resample_hz"} if skeleton else set()

    def register(parse: Callable[..., Points]) -> Callable[..., Points]:
        own, last = (
            {p.name: p for p in inspect.signature(run, eval_str=True).parameters.values() if p.kind is p.KEYWORD_ONLY}
            for run in (parse, make_timed_motion)
        )
        last = {option: p for option, p in last.items() if option not in no_options}
        steps = {**{option: p for option, p in own.items() if option not in last}, **last}

        def read(path: Path, **options: Any) -> Motion:
            points = parse(path, **{option: options[option] for option in own if option in options})
            left = {option: value for option, value in options.items() if option in last}
            if "units" in own:
                left.pop("units", None)
            return make_timed_motion(path, points, name, **left)

        taken = inspect.Parameter("path", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=Path)
        read.__doc__ = parse.__doc__
        read.__signature__ = inspect.Signature([taken, *steps.values()])  # type: ignore[attr-defined]
        sniff = (lambda _, head: starts_with(head, opening)) if isinstance(opening, bytes) else opening
        plugin("motion_reader", name, sniff=sniff, suffixes=tuple(suffixes))(read)
        return parse

    return register

"""Plain samples of one-bin radars, and of several with options: sound files, interleaved numbers, tables of text.

None of these formats states a carrier, and some no rate: options or a TOML file of the same stem do.
"""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.documents import CELL_BYTES, check_cost
from doppelgait.core.errors import RecordingError, warn_caller
from doppelgait.core.readers import Limits
from doppelgait.radar.measured import choose_number, split_rows
from doppelgait.radar.readers.arrays import NAMES, Parsed, array_reader, read_facts

AUDIO_HZ = 4000.0
"""Rate above which a note names ``decimate``: the Doppler of a runner at 24 GHz is below 1500 Hz."""
DATATYPE = re.compile(r"([cr])([isuf])(8|16|32|64)(_le|_be)?")
SUFFIXES = {suffix: kind for kind, suffixes in NAMES["raw"].items() for suffix in suffixes}
"""Data types by suffix; those below leave it open."""
OPEN_SUFFIXES = (".iq", ".bin", ".raw", ".dat")
HEADER_LINES = 64
MIN_PLAIN_HZ = 10.0
"""Slowest rate of times without a unit: slower ones are taken for ms."""
CLOCK = r"\d{1,2}:\d\d:\d\d(\.\d+)?"
DAY_S = 86_400.0
UNITS_S = NAMES["units_s"]
WORDS = {kind: set(words) for kind, words in NAMES["columns"].items()}


def scale_integers(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return integers as shares of full scale, unsigned ones about their middle; other numbers unchanged."""
    if values.dtype.kind not in "iu":
        return values
    largest = 2.0 ** (8 * values.dtype.itemsize - 1)
    return np.asarray(values / largest - (values.dtype.kind == "u"))


@array_reader(
    "wav",
    sniff=lambda path, head: head[:4] in (b"RIFF", b"RIFX", b"RF64") and head[8:12] == b"WAVE",
    suffixes=(".wav",),
)
def parse_wav(path: Path, *, channel: int | None = None, decimate: int = 1) -> Parsed:
    """Read a sound file: two channels are I and Q, one is the one output of a module, which has no direction."""
    from scipy.io import wavfile

    check_cost(path, 8 * path.stat().st_size, RecordingError)
    try:
        with warnings.catch_warnings(record=True) as cautions:
            warnings.simplefilter("always")
            rate_hz, values = wavfile.read(path)
    except Exception as error:  # the library raises nearly anything at damaged bytes
        raise RecordingError(f"{path}: is a damaged or unusual WAV file ({error}); save it again as PCM") from None
    if any("reached" in str(caution.message).lower() for caution in cautions):
        warn_caller(f"{path}: ends before the samples that its header states; the file is cut off")
    if not values.size:
        raise RecordingError(f"{path}: has a header and no samples; the file is cut off")
    channels = values.reshape(len(values), -1)
    if channel is not None or channels.shape[1] > 2:
        values = channels[:, choose_number(path, "channel", channel, channels.shape[1])]
    values = scale_integers(values)
    if not 1 <= decimate <= max(len(values) // 2, 1):
        raise RecordingError(f"{path}: decimate = {decimate} is not allowed; it must be 1 to half of the samples")
    notes = [f"{rate_hz} samples/s, {'I and Q are the two channels' if values.ndim == 2 else 'one channel'}"]
    if decimate > 1:
        from scipy.signal import resample_poly

        values = resample_poly(values, 1, decimate, axis=0)
        notes.append(f"low-pass filtered and decimated by {decimate}")
    elif rate_hz > AUDIO_HZ:
        notes.append(f"slow time has the rate of the sound; decimate={int(rate_hz // AUDIO_HZ) + 1} makes it faster")
    return Parsed(values, {}, {"prf_hz": rate_hz / decimate, "scale_v": 1.0}, notes)


def parse_datatype(text: str) -> tuple[bool, np.dtype[Any]] | None:
    """Return whether samples are complex, and their numbers' type; None for an unknown name."""
    match = DATATYPE.fullmatch(text)
    if match is None or (match[2] == "f") > (int(match[3]) >= 32):
        return None
    kind = "i" if match[2] == "s" else match[2]
    return match[1] == "c", np.dtype((">" if match[4] == "_be" else "<") + f"{kind}{int(match[3]) // 8}")


PulseSamples = Annotated[int, Limits(0)]


def decode_samples(path: Path, content: bytes, number: np.dtype[Any], *, n_parts: int) -> npt.NDArray[Any]:
    """Return the numbers of interleaved samples, shape (samples, parts)."""
    n_samples, rest = divmod(len(content), n_parts * number.itemsize)
    if rest:
        warn_caller(f"{path}: its last sample is not whole and is left out; the file is cut off, or its type is wrong")
    return np.frombuffer(content, number, count=n_samples * n_parts).reshape(n_samples, n_parts)


@array_reader(
    "raw",
    sniff=lambda path, head: False,
    suffixes=(*SUFFIXES, *OPEN_SUFFIXES),
    by_name=(*SUFFIXES, *OPEN_SUFFIXES),
)
def parse_raw(path: Path, *, dtype: str | None = None, samples_per_pulse: PulseSamples = 1) -> Parsed:
    """Read interleaved I and Q without a header; suffix or ``dtype`` names the type of the numbers."""
    name = SUFFIXES.get(path.suffix.lower()) if dtype is None else dtype
    if name is None:
        raise RecordingError(
            f"{path}: holds samples without a header; give dtype (cs16, cu8, cf32, ...; rs16 for one real output), "
            "prf_hz and carrier_hz. Samples of a DCA1000 need their radar settings: config=FILE"
        )
    known_type = parse_datatype(name)
    if known_type is None:
        raise RecordingError(
            f"{path}: dtype = {name!r} is not allowed; it must be c (I and Q) or r (one real output), then i or s "
            "(signed), u or f, and the bits of a number, as in cs16, cu8, cf32, rs16, ci16_be"
        )
    is_complex, number = known_type
    check_cost(path, 2 * path.stat().st_size, RecordingError)
    numbers = decode_samples(path, path.read_bytes(), number, n_parts=1 + is_complex)
    values = split_rows(path, scale_integers(numbers), samples_per_pulse, "pulse")
    return Parsed(values, {}, {}, [f"samples are taken as {name}; integers are shares of full scale"])


def split_name(name: str) -> list[str]:
    """Return the words of a column's name, without case, brackets and signs."""
    plain = name.lower().replace("μ", "µ").replace("in-phase", "inphase").replace("_phase", "phase")
    return re.findall(r"[a-zµ]+", plain)


def find_columns(names: list[str]) -> dict[str, int]:
    """Return the columns of time, I and Q by their names, or of time and the one real output, as I."""
    words = [set(split_name(name)) for name in names]
    first = next((n for n, some in enumerate(words) if WORDS["time"] & some), None)
    times = {} if first is None else {"time": first}
    columns = dict(times)
    for key in ("i", "q"):
        matches = [n for n, some in enumerate(words) if WORDS[key] & some and n not in columns.values()]
        columns |= {key: matches[0]} if len(matches) == 1 else {}
    if "i" in columns and "q" in columns:
        return columns
    others = [n for n, some in enumerate(words) if n not in times.values() and not WORDS["counter"] & some]
    return {"i": others[0], **times} if len(others) == 1 and not WORDS["no_phase"] & words[others[0]] else {}


def _find_header(text: str) -> tuple[int, str, list[str]] | None:
    """Return the number of the first row of numbers, its delimiter and the names in the row above it."""
    header = ""
    for number, line in enumerate(text.splitlines()[:HEADER_LINES]):
        stripped = line.strip().strip("#%").strip()
        if not stripped:
            continue
        delimiter = next((mark for mark in (";", "\t", ",", " ") if mark in stripped), ",")
        if all(re.match(r"[-+]?[\d.,]", cell) for cell in _split_cells(stripped, delimiter)):
            return number, delimiter, _split_cells(header, delimiter) if header else []
        header = stripped
    return None


def _split_cells(line: str, delimiter: str) -> list[str]:
    return [cell.strip().strip('"') for cell in line.split(delimiter) if cell.strip() or delimiter != " "]


def sniff_csv(path: Path, head: bytes) -> bool:
    """Return whether a text has columns that are named I and Q, or real and imaginary part."""
    header = None if b"\0" in head else _find_header(head.decode("utf-8-sig", "replace"))
    return header is not None and "q" in find_columns(header[2])


@array_reader("csv", sniff=sniff_csv, suffixes=(".csv", ".tsv", ".txt"), by_name=(".csv", ".tsv"))
def parse_csv(path: Path, *, columns: str | None = None, prf_hz: float | None = None) -> Parsed:
    """Read columns by name: I and Q, or one output; times, or a counter with gaps."""
    import pandas as pd

    check_cost(path, CELL_BYTES * path.stat().st_size / 4, RecordingError)
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    header = _find_header(text)
    if header is None:
        raise RecordingError(f"{path}: holds no row of numbers in its first {HEADER_LINES} lines")
    number, delimiter, names = header
    names = names if columns is None else [name.strip() for name in columns.split(",")]
    body = text.splitlines()[number:]
    is_comma = delimiter != "," and any("," in line for line in body[:HEADER_LINES])
    if not names:
        raise RecordingError(f"{path}: has no names of columns; give them in order, for example columns='time_ms,i,q'")
    try:
        table = pd.read_csv(
            path,
            sep=r"\s+" if delimiter == " " else delimiter,
            decimal="," if is_comma else ".",
            skiprows=number,
            names=names,
            index_col=False,
            encoding="utf-8-sig",
            encoding_errors="replace",
            comment="#",
        )
    except ValueError as error:
        raise RecordingError(f"{path}: is no table of {', '.join(names)}: {error}") from None
    return _pick_columns(path, table, names, prf_hz)


def _pick_columns(path: Path, table: Any, names: list[str], prf_hz: float | None) -> Parsed:
    picked = find_columns(names)
    if "i" not in picked:
        raise RecordingError(
            f"{path}: has the columns {', '.join(names)}; it needs one of I and one of Q (or re and im), or one "
            "real output. Name them in order: columns='time_ms,i,q'"
        )
    parts = [_read_numbers(path, table.iloc[:, picked[key]], names[picked[key]]) for key in ("i", "q") if key in picked]
    values = parts[0] if len(parts) == 1 else np.stack(parts, axis=-1)
    axes: dict[str, Any] = {}
    if "time" in picked:
        axes["slow_time_s"] = _read_times(path, table.iloc[:, picked["time"]], names[picked["time"]])
    words = [set(split_name(name)) for name in names]
    counters = [n for n, some in enumerate(words) if WORDS["counter"] & some and n not in picked.values()]
    rows = [_number_rows(table.iloc[:, n]) for n in counters] if "time" not in picked else []
    if (row := next((row for row in rows if row is not None), None)) is not None:
        if (prf_hz := prf_hz or read_facts(path, {}).prf_hz) is None:
            warn_caller(f"{path}: a counter has gaps: rows are lost; give prf_hz, so that the others keep their times")
        else:
            axes["slow_time_s"] = row / prf_hz
    notes = [f"columns: {', '.join(names[n] for n in picked.values())}"]
    return Parsed(values, axes, {}, notes, is_timed="time" not in picked)


def _number_rows(column: Any) -> npt.NDArray[np.float64] | None:
    """Return the numbers of the rows by a counter, which may wrap; None if no row is lost, or it counts none."""
    if column.dtype.kind not in "iu" or len(column) < 2:
        return None
    steps: npt.NDArray[Any] = np.diff(np.asarray(column, dtype=np.int64))
    usual = int(np.median(steps))
    steps = np.where(steps < 0, steps + int(column.max()) - int(column.min()) + usual, steps)
    if usual < 1 or (steps < 1).any() or (steps % usual).any() or not 0.5 < (steps == usual).mean() < 1.0:
        return None
    return np.concatenate([[0.0], np.cumsum(steps / usual)])


def _read_numbers(path: Path, column: Any, name: str) -> npt.NDArray[Any]:
    if column.dtype.kind in "iuf":
        return np.asarray(column)
    try:
        return np.asarray([complex(str(text).strip().replace("i", "j").replace(" ", "")) for text in column])
    except ValueError:
        raise RecordingError(
            f"{path}: column {name!r} holds cells that are no numbers; correct or remove them"
        ) from None


def _read_times(path: Path, column: Any, name: str) -> npt.NDArray[np.float64]:
    """Return the stamps in s, by the unit in the column's name or as dates."""
    if column.dtype.kind not in "iuf":
        import pandas as pd

        texts = column.astype(str).str.strip().str.replace(",", ".")
        if texts.str.fullmatch(CLOCK).all():
            time_s = pd.to_timedelta(texts).dt.total_seconds().to_numpy()
            return np.asarray(time_s + DAY_S * np.cumsum(np.diff(time_s, prepend=time_s[0]) < -DAY_S / 2))
        try:
            dates = pd.to_datetime(column, format="ISO8601")
        except ValueError:
            raise RecordingError(
                f"{path}: column {name!r} holds neither numbers nor ISO dates nor hh:mm:ss; correct them"
            ) from None
        return np.asarray((dates - dates.iloc[0]).dt.total_seconds(), dtype=np.float64)
    stamps = np.asarray(column, dtype=np.float64)
    unit = next((UNITS_S[word] for word in split_name(name) if word in UNITS_S), None)
    step = float(np.median(np.diff(stamps))) if stamps.size > 1 else 0.0
    if unit is None and step * MIN_PLAIN_HZ > 1.0:
        raise RecordingError(
            f"{path}: column {name!r} steps by {step:g} and states no unit; name it in columns, as time_s or time_ms"
        )
    return stamps * (unit or 1.0)

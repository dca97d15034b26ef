"""SigMF 1.x: samples in NAME.sigmf-data, their description in NAME.sigmf-meta (JSON)."""

from __future__ import annotations

import hashlib
import io
import json
import math
import re
import tarfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from doppelgait import __version__
from doppelgait.core.documents import check_cost, parse_json, read_document
from doppelgait.core.errors import RecordingError, warn_caller
from doppelgait.core.files import open_atomically
from doppelgait.core.plugins import plugin, read_head
from doppelgait.core.units import FloatArray
from doppelgait.radar.measured import choose_number, split_rows
from doppelgait.radar.readers.arrays import Parsed, array_reader, list_facts
from doppelgait.radar.readers.samples import PulseSamples, decode_samples, parse_datatype
from doppelgait.radar.recording import Recording, list_further_facts

META = ".sigmf-meta"
DATA = ".sigmf-data"
ARCHIVE = ".sigmf"
MAX_META_BYTES = 2**28
MAX_NOTE_LABELS = 20
MAX_PRF_HZ = 1e6


@dataclass(frozen=True)
class Metadata:
    """Metadata of a recording."""

    data_path: Path
    common: dict[str, Any]
    captures: list[dict[str, Any]]
    annotations: list[dict[str, Any]]
    number: np.dtype[Any]
    n_channels: int
    sample_rate_hz: float | None
    is_complex: bool
    packed: bytes | None = None


def find_sigmf_pair(path: Path) -> tuple[Path, Path]:
    """Return the paths of metadata and samples from either."""
    stem = path.name.removesuffix(META).removesuffix(DATA)
    return path.with_name(stem + META), path.with_name(stem + DATA)


def read_archive(path: Path) -> tuple[bytes, str, bytes]:
    """Return metadata, name of the samples and samples of an archive's regular members."""
    try:
        with tarfile.open(path, "r:") as archive:
            members = [member for member in archive.getmembers() if member.isfile()]
            metas = [member for member in members if member.name.endswith(META)]
            if len(metas) != 1:
                listed = ", ".join(member.name for member in metas[:20]) or "none"
                raise RecordingError(f"{path}: holds the recordings {listed}; unpack it and give one .sigmf-meta")
            name = metas[0].name.removesuffix(META) + DATA
            pair = [metas[0], *(member for member in members if member.name == name)]
            check_cost(path, 2 * sum(member.size for member in pair), RecordingError)
            contents = [(archive.extractfile(member) or io.BytesIO()).read() for member in pair]
    except (tarfile.TarError, OSError, EOFError, ValueError) as error:
        raise RecordingError(f"{path}: is damaged or no SigMF archive: {error}") from None
    if len(contents) < 2:
        raise RecordingError(f"{path}: holds no {name}, the samples of {metas[0].name}")
    return contents[0], name, contents[1]


def read_metadata(path: Path) -> Metadata:
    """Read the metadata of a recording, from either file or from an archive."""
    meta_path, data_path = find_sigmf_pair(path)
    packed = None
    if path.name.endswith(ARCHIVE):
        text, name, packed = read_archive(path)
        meta_path, data_path = path, path / name
    elif meta_path.is_file():
        text = read_document(meta_path, MAX_META_BYTES, RecordingError)
    else:
        raise RecordingError(f"{meta_path}: no such file; a SigMF recording is a pair NAME{META} and NAME{DATA}")
    try:
        content = parse_json(text)
        common, captures, annotations = (content[key] for key in ("global", "captures", "annotations"))
        common = dict(common)
        for values in (captures, annotations):
            if not isinstance(values, list) or not all(isinstance(value, dict) for value in values):
                raise ValueError("captures and annotations must be lists of objects")
        version = str(common["core:version"]).removeprefix("v")
        if not version.startswith("1."):
            raise RecordingError(f"{meta_path}: is SigMF {version}; only 1.x is read")
        # the samples may be in a file with another name, which must be in the folder of the metadata
        name = str(common.get("core:dataset", data_path.name))
        if not name or Path(name).name != name or "\\" in name or "\0" in name:
            raise RecordingError(
                f"{meta_path}: core:dataset is {name!r}; it must be the name of a file in the same folder"
            )
        n_channels, rate_hz = common.get("core:num_channels", 1), common.get("core:sample_rate")
        if isinstance(n_channels, bool) or not isinstance(n_channels, int) or not 1 <= n_channels <= 10_000:
            raise ValueError(f"core:num_channels is {n_channels!r}, must be 1 or more")
        if rate_hz is not None and (isinstance(rate_hz, bool) or not 0 < float(rate_hz) < math.inf):
            raise ValueError(f"core:sample_rate is {rate_hz!r}, must be above 0")
        datatype = str(common["core:datatype"])
        if (parsed := parse_datatype(datatype)) is None:
            raise ValueError(f"core:datatype is {datatype!r}, which is not a SigMF type")
    except (ValueError, LookupError, TypeError) as error:
        raise RecordingError(f"{meta_path}: is damaged or no SigMF metadata: {error}") from None
    is_complex, number = parsed
    if packed is None:
        data_path = meta_path.with_name(name)
    rate_hz = None if rate_hz is None else float(rate_hz)
    return Metadata(data_path, common, captures, annotations, number, n_channels, rate_hz, is_complex, packed)


def read_samples(
    path: Path, meta: Metadata, *, channel: int | None, channels: str | None, ignore_checksum: bool
) -> npt.NDArray[Any]:
    """Read the numbers of one channel, or of I and Q, shape (samples, parts). Unsigned ones have their zero moved."""
    is_pair, can_pair = channels is not None, not meta.is_complex and meta.n_channels == 2
    if is_pair and not (can_pair and channel is None):
        raise RecordingError(f"{path}: channels = 'iq' is for two real channels, without channel; leave it out")
    further = "; or channels='iq' if they are I and Q" if can_pair else ""
    chosen = 0 if is_pair else choose_number(path, "channel", channel, meta.n_channels, further)
    if meta.packed is None and not meta.data_path.is_file():
        raise RecordingError(f"{meta.data_path}: no such file; it holds the samples of {path.name}")
    content = meta.data_path.read_bytes() if meta.packed is None else meta.packed
    stored = meta.common.get("core:sha512")
    if stored and not ignore_checksum and hashlib.sha512(content).hexdigest() != str(stored).lower():
        raise RecordingError(
            f"{meta.data_path}: its samples do not have the checksum that {path.name} states (core:sha512): the file "
            "was truncated or changed. Set ignore_checksum=True to read it anyway"
        )
    n_parts = 1 + meta.is_complex
    content = _strip_headers(path, meta, content, n_parts * meta.number.itemsize * meta.n_channels)
    numbers = decode_samples(meta.data_path, content, meta.number, n_parts=n_parts * meta.n_channels)
    values = numbers if is_pair else numbers[:, chosen * n_parts : (chosen + 1) * n_parts]
    return values - 2.0 ** (8 * meta.number.itemsize - 1) if meta.number.kind == "u" else values


def _strip_headers(path: Path, meta: Metadata, content: bytes, frame_bytes: int) -> bytes:
    """Remove foreign bytes before each capture and at the end."""
    try:
        headers = [int(capture.get("core:header_bytes", 0)) for capture in meta.captures]
        trailing = int(meta.common.get("core:trailing_bytes", 0))
        if not any(headers) and not trailing:
            return content
        firsts = [int(capture["core:sample_start"]) for capture in meta.captures]
        if min(*headers, trailing) < 0 or sorted(firsts) != firsts or firsts[:1] != [0]:
            raise ValueError("captures must begin at sample 0 and rise, bytes must be 0 or more")
    except (TypeError, ValueError, LookupError) as error:
        raise RecordingError(f"{path}: its core:header_bytes or core:trailing_bytes are damaged: {error}") from None
    content, parts, at = content[: len(content) - trailing], [], 0
    for header, first, following in zip(headers, firsts, [*firsts[1:], len(content)], strict=True):
        at += header
        parts.append(content[at : at + (following - first) * frame_bytes])
        at += len(parts[-1])
    return b"".join(parts)


def _find_capture_times(path: Path, meta: Metadata, n_pulses: int, n_bins: int, prf_hz: float) -> FloatArray | None:
    """Return the times of the pulses if there are gaps: a capture begins where its index or its date says."""
    captures = [capture for capture in meta.captures if "core:global_index" in capture and meta.sample_rate_hz]
    is_counted = len(captures) == len(meta.captures)
    if not is_counted:  # samples of a capture without a date follow those before them
        captures = [capture for capture in meta.captures if capture.get("core:datetime")]
    if len(captures) < 2:
        return None
    try:
        firsts = np.array([int(capture["core:sample_start"]) for capture in captures])
        if is_counted:
            stated_s = np.array([int(capture["core:global_index"]) for capture in captures]) / meta.sample_rate_hz
            step_s = 0.0
        else:
            import pandas as pd

            texts = [str(capture["core:datetime"]).strip() for capture in captures]
            dates = pd.to_datetime(texts, format="ISO8601", utc=True).to_numpy("M8[ns]")
            stated_s = (dates - dates[0]) / np.timedelta64(1, "s")
            digits = min(len(re.sub(r"^[^.]*\.?|\D.*$", "", text)) for text in texts)
            step_s = 10.0**-digits  # a date without a fraction is true to a second
    except (KeyError, IndexError, ValueError, TypeError, OverflowError):
        return None
    rows = -(-firsts // n_bins)
    late_s = stated_s - stated_s[0] - (rows - rows[0]) / prf_hz
    steps_s = np.diff(late_s)
    if (steps_s < -max(step_s, 1.0 / prf_hz)).any() or (np.diff(rows) < 0).any():
        warn_caller(f"{path}: the times of its captures go back; samples are taken as without gaps")
    elif (steps_s > step_s).any():
        late_s = np.concatenate([[0.0], np.cumsum(np.where(steps_s > step_s, steps_s, 0.0))])
        row = np.arange(n_pulses)
        return np.asarray(row / prf_hz + late_s[np.searchsorted(rows[1:], row, side="right")], dtype=np.float64)
    return None


def sniff_sigmf(path: Path, head: bytes) -> bool:
    """Return whether a path is one of a SigMF pair, by the start of its metadata."""
    meta = find_sigmf_pair(path)[0]
    if head and path.name.endswith(ARCHIVE):
        return META.encode() in head or head[257:262] == b"ustar"
    if not head or not meta.is_file():
        return False
    head = head if meta == path else read_head(meta)
    return head.lstrip()[:1] == b"{" and (b'"core:' in head or meta.name.endswith(META))


@array_reader("sigmf", sniff=sniff_sigmf, suffixes=(META, DATA, ARCHIVE))
def parse_sigmf(
    path: Path,
    *,
    samples_per_pulse: PulseSamples | None = None,
    prf_hz: float | None = None,
    channel: int | None = None,
    channels: Literal["iq"] | None = None,
    ignore_checksum: bool = False,
) -> Parsed:
    """Read a SigMF recording, a pair of files or an archive."""
    meta = read_metadata(path)
    samples = read_samples(path, meta, channel=channel, channels=channels, ignore_checksum=ignore_checksum)
    labels = dict.fromkeys(str(note["core:label"])[:80] for note in meta.annotations if "core:label" in note)
    notes = [f"annotated: {', '.join([*labels][:MAX_NOTE_LABELS])}"] if labels else []
    # volts of one unit: as stated, otherwise 1 V is the largest integer, or 1
    largest = 2.0 ** (8 * meta.number.itemsize - 1) if meta.number.kind in "iu" else 1.0
    stated = {"scale_v": meta.common.get("doppelgait:scale_v", 1.0 / largest)}
    if "doppelgait:radar" in meta.common:
        options = {"samples_per_pulse": samples_per_pulse, "prf_hz": prf_hz}
        if refused := [name for name, value in options.items() if value is not None]:
            raise RecordingError(f"{path}: states its own axes; leave out {', '.join(refused)}")
        return _parse_own(path, meta, samples, stated, notes)
    values = split_rows(path, samples, samples_per_pulse or 1, "pulse")
    hints = {"bin_spacing_m": "SigMF states no range axis"}
    frequencies: list[Any] = [capture.get("core:frequency") for capture in meta.captures]
    carriers_hz = sorted({float(value) for value in frequencies if type(value) in (int, float)})
    if len(carriers_hz) == 1:
        stated["carrier_hz"] = carriers_hz[0]
    elif carriers_hz:
        hints["carrier_hz"] = f"it has several carriers ({', '.join(f'{carrier:g}' for carrier in carriers_hz)} Hz)"
    rate_hz = prf_hz or (meta.sample_rate_hz or 0.0) / (samples_per_pulse or 1)
    if not rate_hz:
        hints["prf_hz"] = "no core:sample_rate"
    elif rate_hz > MAX_PRF_HZ and prf_hz is None:
        hints["prf_hz"] = (
            f"its {rate_hz:g} samples/s are more than a slow-time rate can be (1 MHz): these are samples within pulses"
            ". Give samples_per_pulse and bin_spacing_m, or decimate it first"
        )
    else:
        stated["prf_hz"] = rate_hz
    if samples_per_pulse is not None:
        stated["range_start_m"] = 0.0
    notes.append(f"levels: one unit of the samples is {stated['scale_v']!s} V where no scale_v is given")
    notes += [f"hardware: {str(meta.common['core:hw'])[:200]}"] if "core:hw" in meta.common else []
    times_s = None
    if "prf_hz" in stated and 0.0 < rate_hz <= MAX_PRF_HZ:
        times_s = _find_capture_times(path, meta, len(values), samples_per_pulse or 1, rate_hz)
    axes = {} if times_s is None else {"slow_time_s": times_s}
    return Parsed(values, axes, stated, notes, hints, is_timed=times_s is not None)


def _parse_own(
    path: Path, meta: Metadata, samples: npt.NDArray[Any], stated: dict[str, Any], notes: list[str]
) -> Parsed:
    """Return the content of a recording with doppelgait's keys, of which the others are those of a TOML file."""
    own = {key.removeprefix("doppelgait:"): value for key, value in meta.common.items() if "doppelgait:" in key}
    try:
        range_m = np.asarray(own["range_m"], dtype=np.float64)
        values = split_rows(path, samples, range_m.size, "pulse", least=1)
        # each capture starts at ``doppelgait:time_s``, and its rows have the rate ``doppelgait:prf_hz``
        prf_hz, row, own_notes = float(own["prf_hz"]), np.arange(len(values)), [*own.get("notes", ()), *notes]
        firsts = [int(capture["core:sample_start"]) for capture in meta.captures]
        starts_s = np.array([float(capture["doppelgait:time_s"]) for capture in meta.captures])
        first_rows = np.array(firsts) // range_m.size
        is_whole = not firsts[0] and not any(first % range_m.size for first in firsts)
        if not is_whole or not prf_hz > 0 or (np.diff(first_rows) <= 0).any():
            raise ValueError("captures must begin at whole pulses, the first at 0, and prf_hz be above 0")
        segment = np.searchsorted(first_rows, row, side="right") - 1
        slow_time_s = starts_s[segment] + (row - first_rows[segment]) / prf_hz
        if not np.isfinite(slow_time_s).all() or (np.diff(slow_time_s) <= 0).any():
            raise ValueError("times of its pulses do not rise; doppelgait:time_s or doppelgait:prf_hz is wrong")
        # files of earlier versions have one attribute, without a table
        attributes = own.get("attributes", {"burst_pulses": int(own["burst_pulses"])} if "burst_pulses" in own else {})
    except (LookupError, ValueError, TypeError, OverflowError, ZeroDivisionError) as error:
        raise RecordingError(f"{path}: its doppelgait keys are damaged: {error}") from None
    if any("doppelgait:target" in note for note in meta.annotations):
        own_notes.append("simulated; SigMF holds the labels of its targets, the further truth about them is not stored")
    stated |= {key: own[key] for key in ("radar", "noise_power_v2", "snr_frame_db", "seed") if key in own}
    stated |= {"notes": own_notes, "conjugate": False, "attributes": attributes}
    return Parsed(values, {"slow_time_s": slow_time_s, "range_m": range_m}, stated)


SPECIFICATION = "1.2.0"
EXTENSION = {"name": "doppelgait", "version": "1.0.0", "optional": True}
UNEVEN = 1e-6
"""Minimum relative deviation of a slow-time step that starts a new capture."""
INT16_MAX = 32767


@plugin("radar_writer", "sigmf", suffix=".sigmf-meta")
def write_sigmf(recording: Recording, path: str | Path, *, datatype: Literal["cf32_le", "ci16_le"] = "cf32_le") -> None:
    """Write a recording as a SigMF pair.

    Samples are stored pulse by pulse, and within a pulse in the order of the range bins. ``core:sample_rate`` is pulses
    per second times range bins, so that durations are correct; with one range bin it is the slow-time rate. Every
    segment of evenly spaced pulses is a capture. Keys with the prefix ``doppelgait:`` hold the pulse rate, range axis
    and radar. The truth about targets is not stored, except their labels, as annotations.

    Parameters
    ----------
    recording : Recording
    path : path-like
        ``NAME``, ``NAME.sigmf-meta`` or ``NAME.sigmf-data``; both files are written.
    datatype : {"cf32_le", "ci16_le"}
        Single precision (exact), or 16-bit integers with the maximum component at 32767 (half the size).

    Raises
    ------
    RecordingError
        If the data type is not one of these.
    OutputError
        If a file cannot be written.
    """
    if datatype not in ("cf32_le", "ci16_le"):
        raise RecordingError(f"{path}: datatype = {datatype!r} is not allowed; it must be 'cf32_le' or 'ci16_le'")
    meta_path, data_path = find_sigmf_pair(Path(path))
    pairs = np.ascontiguousarray(recording.baseband.values, dtype="<c8").view("<f4")
    content, scale_v = pairs.tobytes(), 1.0  # volts of one unit
    if datatype == "ci16_le":
        largest = float(np.abs(pairs).max(initial=0.0))
        scale_v = largest / INT16_MAX if largest > 0 else 1.0
        content = np.round(pairs.astype(np.float64) / scale_v).astype("<i2").tobytes()
    checksum = hashlib.sha512(content).hexdigest()
    slow_time_s, range_m = recording.slow_time_s, recording.range_m
    firsts, prf_hz = _find_even_segments(slow_time_s, recording.radar.prf_hz)
    common = {
        "core:datatype": datatype,
        "core:version": SPECIFICATION,
        "core:sample_rate": prf_hz * range_m.size,
        "core:sha512": checksum,
        "core:recorder": f"doppelgait {__version__}",
        "core:hw": recording.radar.name,
        "core:description": "Radar baseband, pulse by pulse, range bins in order; volts after doppelgait:scale_v",
        "core:extensions": [EXTENSION],
        "doppelgait:prf_hz": prf_hz,
        "doppelgait:range_m": [float(value) for value in range_m],
        "doppelgait:radar": recording.radar.model_dump(mode="json"),
        "doppelgait:scale_v": scale_v,
        "doppelgait:source": recording.source,
        "doppelgait:attributes": _keep_finite(list_further_facts(recording)),
    }
    common |= {f"doppelgait:{name}": value for name, value in _keep_finite(list_facts(recording)).items()}
    captures = [
        {
            "core:sample_start": int(first) * range_m.size,
            "core:frequency": recording.radar.carrier_hz,
            "doppelgait:time_s": float(slow_time_s[first]),
        }
        for first in firsts
    ]
    meta = {
        "global": common,
        "captures": captures,
        "annotations": [
            {
                "core:sample_start": 0,
                "core:sample_count": recording.baseband.size,
                "core:label": truth.label or "target",
                "core:comment": "; ".join(text for text in (truth.gait, truth.subject, truth.motion) if text),
                "doppelgait:target": number,
            }
            for number, truth in enumerate(recording.truth)
        ],
    }
    with open_atomically(data_path) as partial:
        partial.write_bytes(content)
    with open_atomically(meta_path) as partial:
        partial.write_text(json.dumps(meta, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _keep_finite(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts that JSON has values for."""
    return {name: value for name, value in facts.items() if not isinstance(value, float) or math.isfinite(value)}


def _find_even_segments(
    slow_time_s: npt.NDArray[np.float64], radar_prf_hz: float
) -> tuple[npt.NDArray[np.int64], float]:
    """Return the first pulses of evenly spaced segments, and the rate of the longest one."""
    steps_s = np.diff(slow_time_s)
    usual_s = float(np.median(steps_s)) if steps_s.size else 1.0 / radar_prf_hz
    firsts = np.concatenate(([0], np.flatnonzero(np.abs(steps_s - usual_s) > UNEVEN * usual_s) + 1))
    lengths = np.diff([*firsts, slow_time_s.size])
    first, n_steps = firsts[lengths.argmax()], lengths.max() - 1
    return firsts, float(n_steps / (slow_time_s[first + n_steps] - slow_time_s[first])) if n_steps else 1.0 / usual_s

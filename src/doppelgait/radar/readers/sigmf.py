"""Recordings as SigMF (specification 1.x).

Samples are in NAME.sigmf-data, their description in NAME.sigmf-meta (JSON).
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import tarfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from doppelgait import __version__
from doppelgait.core.config import validate
from doppelgait.core.documents import check_cost, parse_json
from doppelgait.core.errors import ConfigError, RecordingError, warn_caller
from doppelgait.core.files import open_atomically
from doppelgait.core.plugins import plugin, read_head
from doppelgait.core.units import SPEED_OF_LIGHT_MPS, FloatArray
from doppelgait.radar.measured import CW_FRAME_M, check_number, label_measured, make_cw_radar, make_radar
from doppelgait.radar.parameters import Radar
from doppelgait.radar.recording import Recording

META = ".sigmf-meta"
DATA = ".sigmf-data"
ARCHIVE = ".sigmf"
MAX_META_BYTES = 2**28
DATATYPES = {
    "f32": "f4",
    "f64": "f8",
    "i32": "i4",
    "i16": "i2",
    "i8": "i1",
    "u32": "u4",
    "u16": "u2",
    "u8": "u1",
}
"""NumPy types by SigMF number type."""
MAX_NOTE_LABELS = 20


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
    is_real: bool
    packed: bytes | None = None

    @property
    def own(self) -> dict[str, Any] | None:
        """Keys of doppelgait; None in a file of other software."""
        found = {key: value for key, value in self.common.items() if key.startswith("doppelgait:")}
        return found if "doppelgait:radar" in found else None

    @property
    def scale_v(self) -> Any:
        """Volts of one unit: as stated, otherwise 1 V is the largest integer, or 1."""
        largest = float(2 ** (8 * self.number.itemsize - 1)) if self.number.kind in "iu" else 1.0
        return self.common.get("doppelgait:scale_v", 1.0 / largest)

    def notes(self) -> list[str]:
        """Return the labels of the annotations as a note."""
        labels = [str(one["core:label"])[:80] for one in self.annotations if "core:label" in one]
        shown = list(dict.fromkeys(labels))[:MAX_NOTE_LABELS]
        return [f"annotated: {', '.join(shown)}"] if shown else []


def find_sigmf_pair(path: Path) -> tuple[Path, Path]:
    """Return the paths of metadata and samples from either."""
    stem = path.name.removesuffix(META).removesuffix(DATA)
    return path.with_name(stem + META), path.with_name(stem + DATA)


def read_archive(path: Path) -> tuple[bytes, str, bytes]:
    """Return metadata, name of the samples and samples of an archive: only regular members are read."""
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
    if path.name.endswith(ARCHIVE):
        text, name, samples = read_archive(path)
        try:
            return replace(_parse_metadata(path, path / name, parse_json(text)), packed=samples)
        except (ValueError, LookupError, TypeError) as error:
            raise RecordingError(f"{path}: is damaged or no SigMF metadata: {error}") from None
    meta_path, data_path = find_sigmf_pair(path)
    if not meta_path.is_file():
        raise RecordingError(f"{meta_path}: no such file; a SigMF recording is a pair NAME{META} and NAME{DATA}")
    if meta_path.stat().st_size > MAX_META_BYTES:
        raise RecordingError(
            f"{meta_path}: has {meta_path.stat().st_size:,} bytes, at most {MAX_META_BYTES:,} are read"
        )
    try:
        return _parse_metadata(meta_path, data_path, parse_json(meta_path.read_text(encoding="utf-8")))
    except OSError as error:
        raise RecordingError(f"{meta_path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, LookupError, TypeError) as error:
        raise RecordingError(f"{meta_path}: is damaged or no SigMF metadata: {error}") from None


def _parse_metadata(meta_path: Path, data_path: Path, content: Any) -> Metadata:
    common, captures, annotations = (content[key] for key in ("global", "captures", "annotations"))
    common = dict(common)
    for values in (captures, annotations):
        if not isinstance(values, list) or not all(isinstance(value, dict) for value in values):
            raise ValueError("captures and annotations must be lists of objects")
    version = str(common["core:version"]).removeprefix("v")
    if not version.startswith("1."):
        raise RecordingError(f"{meta_path}: is SigMF {version}; only 1.x is read")
    if "core:dataset" in common:
        # the samples are in a file with another name, which must be in the folder of the metadata
        name = str(common["core:dataset"])
        if not name or Path(name).name != name or "\\" in name or "\0" in name:
            raise RecordingError(
                f"{meta_path}: core:dataset is {name!r}; it must be the name of a file in the same folder"
            )
        data_path = meta_path.with_name(name)
    channels = common.get("core:num_channels", 1)
    if isinstance(channels, bool) or not isinstance(channels, int) or not 1 <= channels <= 10_000:
        raise ValueError(f"core:num_channels is {channels!r}, must be 1 or more")
    rate = common.get("core:sample_rate")
    if rate is not None and (isinstance(rate, bool) or not 0 < float(rate) < math.inf):
        raise ValueError(f"core:sample_rate is {rate!r}, must be above 0")
    datatype = str(common["core:datatype"])
    kind, body = datatype[:1], datatype[1:]
    base, _, order = body.partition("_")
    if kind not in ("c", "r") or base not in DATATYPES or order not in ("", "le", "be"):
        raise ValueError(f"core:datatype is {datatype!r}, which is not a SigMF type")
    number = np.dtype((">" if order == "be" else "<") + DATATYPES[base])
    rate_hz = None if rate is None else float(rate)
    return Metadata(data_path, common, captures, annotations, number, channels, rate_hz, kind == "r")


def read_samples(
    path: Path, meta: Metadata, *, channel: int | None, channels: str | None, ignore_checksum: bool
) -> npt.NDArray[np.complex64]:
    """Read the complex samples of one channel, shape (samples,). They are in units of the file."""
    is_pair = channels is not None
    if is_pair and not (meta.is_real and meta.n_channels == 2 and channel is None):
        raise RecordingError(f"{path}: channels = 'iq' is for two real channels, without channel; leave it out")
    chosen = 0 if channel is None and (meta.n_channels == 1 or is_pair) else channel
    if chosen is None or not 0 <= chosen < meta.n_channels:
        said = f"holds {meta.n_channels} channels" if channel is None else f"channel = {channel!r} is not allowed"
        pair = "; or channels='iq' if they are I and Q" if meta.is_real and meta.n_channels == 2 else ""
        raise RecordingError(f"{path}: {said}; give channel = 0 to {meta.n_channels - 1}{pair}")
    if meta.packed is None and not meta.data_path.is_file():
        raise RecordingError(f"{meta.data_path}: no such file; it holds the samples of {path.name}")
    try:
        content = meta.data_path.read_bytes() if meta.packed is None else meta.packed
    except OSError as error:
        raise RecordingError(f"{meta.data_path}: cannot be read: {error.strerror or error}") from None
    stored = meta.common.get("core:sha512")
    if stored and not ignore_checksum and hashlib.sha512(content).hexdigest() != str(stored).lower():
        raise RecordingError(
            f"{meta.data_path}: its samples do not have the checksum that {path.name} states (core:sha512): the file "
            "was truncated or changed. Set ignore_checksum=True to read it anyway"
        )
    n_parts = 1 if meta.is_real else 2
    frame_bytes = n_parts * meta.number.itemsize * meta.n_channels
    content = _strip_headers(path, meta, content, frame_bytes)
    if len(content) < 2 * frame_bytes:
        raise RecordingError(f"{meta.data_path}: holds {len(content)} bytes, less than two samples of {frame_bytes}")
    if len(content) % frame_bytes:
        text = f"{meta.data_path}: its last sample is not whole and is left out; the file is cut off"
        warn_caller(text)
    values = np.frombuffer(
        content, dtype=meta.number, count=len(content) // frame_bytes * frame_bytes // meta.number.itemsize
    )
    # I and Q as complex numbers; unsigned ones have their zero in the middle
    frames = values.reshape(-1, meta.n_channels, n_parts)
    pairs = frames[:, :, 0] if is_pair else frames[:, chosen]
    zero = 2.0 ** (8 * pairs.dtype.itemsize - 1) if pairs.dtype.kind == "u" else 0.0
    out = np.zeros(pairs.shape[0], dtype=np.complex64)
    with np.errstate(over="ignore", invalid="ignore"):  # beyond single precision: found and refused afterwards
        out.real = pairs[:, 0] - zero if zero else pairs[:, 0]
        if pairs.shape[1] == 2:
            out.imag = pairs[:, 1] - zero if zero else pairs[:, 1]
    return out


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


def _find_capture_times(path: Path, meta: Metadata, n_pulses: int, n_bins: int, prf_hz: float) -> FloatArray:
    """Return the times of the pulses: a capture begins where its index or its date says."""
    times_s = np.arange(n_pulses) / prf_hz
    captures = meta.captures
    try:
        firsts = np.array([int(capture["core:sample_start"]) for capture in captures])
        if all("core:global_index" in capture for capture in captures) and meta.sample_rate_hz:
            stated_s = np.array([int(capture["core:global_index"]) for capture in captures]) / meta.sample_rate_hz
            step_s = 0.0
        else:
            texts = [str(capture["core:datetime"]) for capture in captures]
            dates = np.array([text.strip().removesuffix("Z").removesuffix("+00:00") for text in texts], "M8[ns]")
            stated_s = (dates - dates[0]) / np.timedelta64(1, "s")
            digits = min(len(text.removesuffix("Z").partition(".")[2]) for text in texts)
            step_s = 10.0**-digits  # a date without a fraction is true to a second
    except (KeyError, IndexError, ValueError, TypeError, OverflowError):
        return times_s
    rows = -(-firsts // n_bins)
    late_s = stated_s - stated_s[0] - rows / prf_hz
    for row, before_s, after_s in zip(rows[1:], late_s[:-1], late_s[1:], strict=True):
        if after_s - before_s < -max(step_s, 1.0 / prf_hz):
            warn_caller(f"{path}: the times of its captures go back; samples are taken as without gaps")
            return np.arange(n_pulses) / prf_hz
        if after_s - before_s > step_s and row < n_pulses:
            times_s[row:] += after_s - before_s
    return times_s


MAX_ROWS = 100_000_000


def sniff_sigmf(path: Path, head: bytes) -> bool:
    """Return whether a path is one of a SigMF pair, by the start of its metadata."""
    meta = find_sigmf_pair(path)[0]
    if head and path.name.endswith(ARCHIVE):
        return META.encode() in head or head[257:262] == b"ustar"
    if not head or not meta.is_file():
        return False
    head = head if meta == path else read_head(meta)
    return head.lstrip()[:1] == b"{" and (b'"core:' in head or meta.name.endswith(META))


@plugin("radar_reader", "sigmf", sniff=sniff_sigmf, suffixes=(".sigmf-meta", ".sigmf-data", ".sigmf"))
def read_sigmf(
    path: str | Path,
    *,
    carrier_hz: float | None = None,
    samples_per_pulse: int | None = None,
    prf_hz: float | None = None,
    range_start_m: float | None = None,
    bin_spacing_m: float | None = None,
    scale_v: float | None = None,
    channel: int | None = None,
    channels: Literal["iq"] | None = None,
    conjugate: bool = False,
    ignore_checksum: bool = False,
) -> Recording:
    """Read a SigMF recording, a pair of files or an archive.
    Two real channels can be I and Q (``channels="iq"``); a single one is the one output of a module.
    """
    file = Path(path)
    meta = read_metadata(file)
    samples = read_samples(file, meta, channel=channel, channels=channels, ignore_checksum=ignore_checksum)
    scale = check_number(file, "scale_v", meta.scale_v if scale_v is None else scale_v, above=0, most=1e30)
    with np.errstate(over="ignore", invalid="ignore"):  # NaN and infinity raise an error with their position
        samples = (samples.conj() if conjugate else samples) * np.float32(scale)
    notes = [*meta.notes(), *(["the samples are conjugated"] if conjugate else [])]
    if meta.own is not None:
        options = {"samples_per_pulse": samples_per_pulse, "prf_hz": prf_hz, "range_start_m": range_start_m}
        refused = [name for name, value in {**options, "bin_spacing_m": bin_spacing_m}.items() if value is not None]
        if refused:
            raise RecordingError(f"{file}: states its own axes; leave out {', '.join(refused)}")
        return _read_own(file, meta, samples, carrier_hz, notes)
    if carrier_hz is None:
        found = sorted({float(c["core:frequency"]) for c in meta.captures if _is_number(c.get("core:frequency"))})
        if len(found) != 1:
            said = f"has several carriers ({', '.join(f'{one:g}' for one in found)} Hz)" if found else "has no carrier"
            raise RecordingError(f"{file}: {said}; give carrier_hz")
        carrier_hz = found[0]
    carrier = check_number(file, "carrier_hz", carrier_hz, above=0)
    n_samples = samples.size
    n_bins = 1 if samples_per_pulse is None else samples_per_pulse
    if isinstance(n_bins, bool) or not isinstance(n_bins, int) or not 1 <= n_bins <= max(n_samples // 2, 1):
        raise RecordingError(
            f"{file}: samples_per_pulse = {n_bins!r} is not allowed; it must be 1 to {max(n_samples // 2, 1)}, half of "
            "the samples there are"
        )
    if n_samples % n_bins:
        warn_caller(
            f"{file}: {n_samples} samples are not whole pulses of {n_bins}; the last {n_samples % n_bins} are left out"
        )
    shape = n_samples // n_bins, n_bins
    if prf_hz is None:
        if meta.sample_rate_hz is None:
            raise RecordingError(f"{file}: states no core:sample_rate; give prf_hz")
        prf_hz = meta.sample_rate_hz / n_bins
        if prf_hz > 1e6:
            raise RecordingError(
                f"{file}: its {prf_hz:g} samples/s are more than a slow-time rate can be (1 MHz): these are samples "
                "within pulses. Give samples_per_pulse and bin_spacing_m, or decimate it first"
            )
    rate_hz = check_number(file, "prf_hz", prf_hz, above=0)
    notes.append(f"levels: one unit of the samples is taken as {scale:.4g} V")
    rows = samples[: shape[0] * shape[1]].reshape(shape)
    radar, range_m = _make_foreign_radar(file, meta, carrier, rate_hz, shape[1], range_start_m, bin_spacing_m, notes)
    slow_time_s = _find_capture_times(file, meta, shape[0], shape[1], rate_hz)
    attrs = {"one_output": True} if meta.is_real and channels is None else {}
    return label_measured(file, rows, radar=radar, slow_time_s=slow_time_s, range_m=range_m, notes=notes, attrs=attrs)


def _read_own(
    path: Path, meta: Metadata, samples: npt.NDArray[np.complex64], carrier_hz: float | None, notes: list[str]
) -> Recording:
    """Read a recording with the axes of doppelgait's keys."""
    own = meta.own or {}
    try:
        range_m = np.asarray(own["doppelgait:range_m"], dtype=np.float64)
        if range_m.ndim != 1 or not range_m.size:
            raise ValueError("doppelgait:range_m must be a list of one range or more")
        rows = samples.size // max(range_m.size, 1)
        # times of the rows: each capture starts at ``doppelgait:time_s``, and its rows have the
        # rate ``doppelgait:prf_hz``
        n_bins = range_m.size
        if not 0 < rows <= MAX_ROWS:
            raise ValueError(f"there are {rows} pulses of {n_bins} range bins")
        prf_hz = float(own["doppelgait:prf_hz"])
        firsts = [int(capture["core:sample_start"]) for capture in meta.captures]
        starts_s = np.array([float(capture["doppelgait:time_s"]) for capture in meta.captures])
        if not firsts or firsts[0] != 0 or any(first % n_bins for first in firsts) or not prf_hz > 0:
            raise ValueError("captures must begin at whole pulses, the first at 0, and prf_hz be above 0")
        first_rows = np.array(firsts) // n_bins
        if (np.diff(first_rows) <= 0).any():
            raise ValueError("captures must follow one another")
        row = np.arange(rows)
        segment = np.searchsorted(first_rows, row, side="right") - 1
        slow_time_s = np.asarray(starts_s[segment] + (row - first_rows[segment]) / prf_hz, dtype=np.float64)
        radar = validate(Radar, dict(own["doppelgait:radar"]), where="doppelgait:radar")
        attrs = {"burst_pulses": int(own["doppelgait:burst_pulses"])} if "doppelgait:burst_pulses" in own else {}
    except (LookupError, ValueError, TypeError, OverflowError, ConfigError) as error:
        raise RecordingError(f"{path}: its doppelgait keys are damaged: {error}") from None
    if not np.isfinite(range_m).all() or (np.diff(range_m) <= 0).any():
        raise RecordingError(f"{path}: doppelgait:range_m must be rising numbers")
    if not np.isfinite(slow_time_s).all() or (np.diff(slow_time_s) <= 0).any():
        raise RecordingError(
            f"{path}: times of its pulses do not rise; doppelgait:time_s or doppelgait:prf_hz is wrong"
        )
    if samples.size % range_m.size:
        warn_caller(f"{path}: its last pulse is not whole and is left out; the file is cut off")
    if carrier_hz is not None:
        radar = make_radar(path, **{**radar.model_dump(), "carrier_hz": carrier_hz})
    values = samples[: rows * range_m.size].reshape(rows, range_m.size)
    stored = meta.common.get("doppelgait:notes")
    own_notes = [note for note in stored if isinstance(note, str)] if isinstance(stored, list) else []
    if any("doppelgait:target" in one for one in meta.annotations):
        own_notes.append("simulated; SigMF holds the labels of its targets, the further truth about them is not stored")
    recording = label_measured(
        path,
        values,
        radar=radar,
        slow_time_s=slow_time_s,
        range_m=range_m,
        notes=[*own_notes, *notes],
        attrs=attrs,
    )
    # noise power, signal-to-noise ratio and seed, if they are stored and valid
    levels = {name: own.get(f"doppelgait:{name}") for name in ("noise_power_v2", "snr_frame_db")}
    facts: dict[str, Any] = {
        name: float(value) for name, value in levels.items() if _is_number(value) and value is not None
    }
    seed = own.get("doppelgait:seed")
    return replace(
        recording, **({**facts, "seed": seed} if isinstance(seed, int) and not isinstance(seed, bool) else facts)
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _make_foreign_radar(
    path: Path,
    meta: Metadata,
    carrier_hz: float,
    prf_hz: float,
    n_bins: int,
    range_start_m: float | None,
    bin_spacing_m: float | None,
    notes: list[str],
) -> tuple[Radar, FloatArray]:
    """Return radar and range axis of a foreign file; assumptions are added to ``notes``."""
    name = str(meta.common.get("core:hw", "SigMF recording"))[:200]
    if n_bins == 1:
        radar = make_cw_radar(path, name=name, carrier_hz=carrier_hz, prf_hz=prf_hz)
        start_m, stop_m = CW_FRAME_M
        notes.append(f"taken as continuous wave: the one range bin stands for {start_m:g} to {stop_m:g} m")
        return radar, np.array([(start_m + stop_m) / 2])
    if bin_spacing_m is None:
        raise RecordingError(f"{path}: SigMF states no range axis; give bin_spacing_m (and range_start_m if not 0)")
    spacing_m = check_number(path, "bin_spacing_m", bin_spacing_m, above=0, most=1e4)
    start_m = check_number(path, "range_start_m", range_start_m or 0.0, above=-1e-9, most=1e6)
    notes.append("the pulse is not stated: its range resolution is taken as one range bin")
    radar = make_radar(
        path,
        name=name,
        carrier_hz=carrier_hz,
        prf_hz=prf_hz,
        sample_rate_hz=SPEED_OF_LIGHT_MPS / (2 * spacing_m),
        range_start_m=max(start_m, 0.0),
        range_stop_m=max(start_m, 0.0) + n_bins * spacing_m,
        pulse_sigma_s=spacing_m / (SPEED_OF_LIGHT_MPS * math.sqrt(math.log(2))),
    )
    return radar, np.asarray(start_m + spacing_m * np.arange(n_bins), dtype=np.float64)


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

    See Also
    --------
    read_recording : read the file again.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> dg.radar.write_sigmf(recording, "walk.sigmf-data")
    >>> dg.radar.read_recording("walk.sigmf-data").n_pulses
    1920
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
        "doppelgait:notes": list(recording.notes),
    }
    facts = {"noise_power_v2": recording.noise_power_v2, "snr_frame_db": recording.snr_frame_db}
    common |= {f"doppelgait:{name}": value for name, value in facts.items() if math.isfinite(value)}
    common |= {"doppelgait:seed": recording.seed} if recording.seed is not None else {}
    burst_pulses = recording.baseband.attrs.get("burst_pulses")
    common |= {"doppelgait:burst_pulses": int(burst_pulses)} if burst_pulses is not None else {}
    captures = [
        {
            "core:sample_start": int(first) * range_m.size,
            "core:frequency": recording.radar.carrier_hz,
            "doppelgait:time_s": float(slow_time_s[first]),
        }
        for first in firsts
    ]
    count = recording.baseband.size
    meta = {
        "global": common,
        "captures": captures,
        "annotations": [
            {
                "core:sample_start": 0,
                "core:sample_count": count,
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


def _find_even_segments(
    slow_time_s: npt.NDArray[np.float64], radar_prf_hz: float
) -> tuple[npt.NDArray[np.int64], float]:
    """Return the first pulses of evenly spaced segments, and the rate of the longest one."""
    if slow_time_s.size < 2:
        return np.zeros(1, dtype=np.int64), radar_prf_hz
    steps_s = np.diff(slow_time_s)
    usual_s = float(np.median(steps_s))
    firsts = np.concatenate(([0], np.flatnonzero(np.abs(steps_s - usual_s) > UNEVEN * usual_s) + 1))
    lengths = np.diff([*firsts, slow_time_s.size])
    longest = int(lengths.argmax())
    if lengths[longest] < 2:
        return firsts, 1.0 / usual_s
    first, last = firsts[longest], firsts[longest] + lengths[longest] - 1
    return firsts, float((last - first) / (slow_time_s[last] - slow_time_s[first]))

"""Samples that a DCA1000 board captured from a TI sensor, and the settings of the sensor.

The file contains only 16-bit numbers. Their order follows TI's application report SWRA581B, "Mmwave Radar
Device ADC Raw Data Capture": xWR12xx and xWR14xx send the four receivers in parallel, one lane each (I of
all, then Q of all; an inactive receiver sends zeros); the other devices send one receiver after the other
over two lanes, two samples at a time (I, I, Q, Q). The settings are a TOML or JSON file with doppelgait's
keys, or TI's ``.cfg`` text with the commands of the "mmWave SDK User's Guide".
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Self, get_args

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel, read_toml, validate
from doppelgait.core.documents import parse_json, read_document
from doppelgait.core.errors import ConfigError, RecordingError, warn_caller
from doppelgait.core.plugins import plugin
from doppelgait.radar.measured import choose_number, label_sweeps
from doppelgait.radar.recording import Recording

MAX_CONFIG_BYTES = 1 << 20
Device = Literal["xwr12xx", "xwr14xx", "xwr16xx", "xwr18xx", "xwr2243", "xwr64xx", "xwr68xx"]
DEVICES = get_args(Device)
FOUR_LANES = ("xwr12xx", "xwr14xx")
"""Devices with one lane per receiver; the others send all receivers over two lanes."""
OUTPUTS = ("real", "complex1x", "complex2x")
"""Outputs of the converter, in the order of TI's format numbers."""


class ChirpConfig(FrozenModel):
    """Settings that are needed to read a file of samples.

    device: Device family; it determines the order of the samples.
    output: Output of the converter: all frequencies of complex1x are above 0, and half of those of
        the others.
    q_first: True if the imaginary part is first (TI's sample swap).
    receivers: Active receivers, counted from 0.
    n_samples: Samples of a chirp; an even number.
    sample_rate_hz: Samples per second within a chirp.
    start_hz: Frequency at the start of a chirp.
    slope_hz_per_s: Rise of the frequency per second.
    idle_s: Idle time before a chirp.
    adc_start_s: Time from the start of a chirp to its first sample.
    ramp_s: Time from the start of a chirp to its end.
    chirps_per_loop: Chirps of a loop, one per transmitter in turn.
    loops: Loops of a frame.
    frames: Number of frames; 0 for all that the file holds.
    frame_period_s: Time from the start of one frame to the start of the next.
    """

    device: Device
    output: Literal["real", "complex1x", "complex2x"] = "complex1x"
    q_first: bool = False
    receivers: tuple[int, ...] = Field(default=(0, 1, 2, 3), min_length=1, max_length=4)
    n_samples: int = Field(ge=2, le=65_536)
    sample_rate_hz: float = Field(gt=0, le=1e9)
    start_hz: float = Field(gt=1e9, lt=1e12)
    slope_hz_per_s: float = Field(gt=0, le=1e15)
    idle_s: float = Field(ge=0, le=1)
    adc_start_s: float = Field(default=0.0, ge=0, le=1)
    ramp_s: float = Field(gt=0, le=1)
    chirps_per_loop: int = Field(default=1, ge=1, le=512)
    loops: int = Field(ge=1, le=65_536)
    frames: int = Field(default=0, ge=0, le=10_000_000)
    frame_period_s: float = Field(gt=0, le=60)

    @model_validator(mode="after")
    def _check_consistency(self) -> Self:
        if any(not 0 <= one <= 3 for one in self.receivers) or list(self.receivers) != sorted(set(self.receivers)):
            raise ValueError(f"receivers: {self.receivers} is not allowed; they must be among 0 to 3, rising")
        if self.n_samples % 2:
            raise ValueError(f"n_samples: {self.n_samples} is not allowed; it must be even")
        if self.adc_start_s + self.sweep_s > self.ramp_s * (1 + 1e-9):
            raise ValueError(
                f"ramp_s: {self.ramp_s:g} is shorter than adc_start_s and {self.n_samples} samples at "
                f"{self.sample_rate_hz:g} Hz, {self.adc_start_s + self.sweep_s:.6g} s"
            )
        if self.frame_period_s < self.loops * self.loop_s * (1 - 1e-9):
            raise ValueError(
                f"frame_period_s: {self.frame_period_s:g} is shorter than {self.loops} loops of "
                f"{self.chirps_per_loop} chirps, {self.loops * self.loop_s:.6g} s"
            )
        return self

    @property
    def sweep_s(self) -> float:
        """Sampling time of a chirp."""
        return self.n_samples / self.sample_rate_hz

    @property
    def loop_s(self) -> float:
        """Time between equal chirps of successive loops."""
        return self.chirps_per_loop * (self.idle_s + self.ramp_s)


def find_config(path: Path) -> Path | None:
    """Return settings next to a sample file: .toml, .json, .cfg of its stem, or the only ones of TI's programs."""
    for suffix in (".toml", ".json", ".cfg", STUDIO):
        if (own := path.with_suffix(suffix)).is_file():
            return own
    for pattern in (f"*{STUDIO}", "*.cfg"):
        only = sorted(path.parent.glob(pattern)) if path.parent.is_dir() else []
        if len(only) == 1 and only[0].is_file():
            return only[0]
    return None


def read_config(path: Path, *, device: str | None = None) -> ChirpConfig:
    """Read the settings of a file of samples."""
    if not path.is_file():
        raise RecordingError(f"{path}: no such file of radar settings")
    text = read_document(path, MAX_CONFIG_BYTES, RecordingError).decode("utf-8", "replace")
    suffix = path.suffix.lower()
    try:
        table: Any = read_toml(path)[0] if suffix == ".toml" else {}
        if suffix == ".json":
            table = parse_json(text)
            if not isinstance(table, dict):
                raise RecordingError(f"{path}: holds no JSON object with the keys of the radar settings")
            table = _parse_studio(path, table) if "mmWaveDevices" in table else table
        elif suffix != ".toml":
            table = _parse_commands(path, text)
        table = table if device is None else {**table, "device": device}
        if "device" not in table:
            raise RecordingError(
                f"{path}: does not state the device; give the option device, one of {', '.join(DEVICES)}"
            )
        return validate(ChirpConfig, table, where=f"{path}: radar settings", text=text if suffix == ".toml" else "")
    except ConfigError as error:
        raise RecordingError(str(error)) from None
    except ValueError as error:
        raise RecordingError(f"{path}: is no JSON: {error}") from None


STUDIO = ".mmwave.json"
"""Suffix of the settings that mmWave Studio saves, with the names of TI's mmWaveLink interface."""
TI = read_toml(Path(__file__).with_name("names.toml"))[0]["ti"]
FIELDS: dict[str, list[str]] = TI["commands"]
Commands = dict[str, list[tuple[int, Mapping[str, float]]]]
"""Line number and values by name of each command."""


def _parse_studio(path: Path, document: Mapping[str, Any]) -> dict[str, Any]:
    try:
        (device,) = document["mmWaveDevices"]
        rf, data = device["rfConfig"], device.get("rawDataCaptureConfig", {}).get("rlDevDataFmtCfg_t", {})
        rows = {
            "channelCfg": [{"rxChannelEn": int(str(rf["rlChanCfg_t"]["rxChannelEn"]), 0)}],
            "adcCfg": [rf["rlAdcOutCfg_t"]["fmt"]],
            "profileCfg": [row["rlProfileCfg_t"] for row in rf["rlProfiles"]],
            "chirpCfg": [dict.fromkeys(FIELDS["chirpCfg"], 0) | row["rlChirpCfg_t"] for row in rf["rlChirps"]],
            "frameCfg": [rf["rlFrameCfg_t"]],
        }
        keys = {name: [field for field in fields if field != "-"] for name, fields in FIELDS.items()}
        commands: Commands = {
            name: [(number, {key: float(row[key]) for key in keys[name]}) for number, row in enumerate(cells)]
            for name, cells in rows.items()
        }
        table = _translate(path, commands)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise RecordingError(f"{path}: lacks settings of mmWave Studio, or has several devices: {error!r}") from None
    setup = path.with_name(path.name.removesuffix(STUDIO) + ".setup.json")
    text = setup.read_text(encoding="utf-8", errors="replace")[:MAX_CONFIG_BYTES] if setup.is_file() else ""
    named = re.search(r"[xai]wr_?(\d{4})", text, re.IGNORECASE)
    if named is not None:
        table["device"] = next((one for one in DEVICES if one in (f"xwr{named[1]}", f"xwr{named[1][:2]}xx")), "")
    return {**table, "q_first": data.get("iqSwapSel", 0) == 1}


def _parse_commands(path: Path, text: str) -> dict[str, Any]:
    if re.search(r"^\s*chirpComnCfg\b", text, re.MULTILINE):
        raise RecordingError(
            f"{path}: settings of xWRL parts (chirpComnCfg, chirpTimingCfg) are not read: their port may reorder the "
            "bits of samples. Write the settings as .toml with the keys of this reader and device = 'xwr64xx'"
        )
    commands: Commands = {}
    platform = re.search(r"platform\s*+:?+\s*+(xwr\d\dxx)", text, re.IGNORECASE)
    facts: dict[str, Any] = {"device": platform[1].lower()} if platform else {}
    for number, line in enumerate(text.splitlines(), start=1):
        name, *words = line.split("%")[0].split() or [""]
        if name not in (*FIELDS, "adcbufCfg"):
            continue
        try:
            values = [float(word) for word in words]
        except ValueError:
            raise RecordingError(f"{path}: line {number}, {name}: holds a word that is no number") from None
        fields = FIELDS[name] if name in FIELDS else ["-"] * len(values)
        if len(values) != len(fields) or not all(abs(value) < 1e12 for value in values):
            raise RecordingError(
                f"{path}: line {number}, {name}: has {len(values)} numbers; it must have {len(fields)}, below 1e12"
            )
        if name in FIELDS:
            commands.setdefault(name, []).append((number, dict(zip(fields, values, strict=True))))
        elif "q_first" not in facts:
            facts["q_first"] = _is_swapped(path, values, facts.get("device", ""))
    if missing := [name for name in FIELDS if name not in commands]:
        raise RecordingError(f"{path}: lacks the command {', '.join(missing)}")
    return facts | _translate(path, commands)


def _is_swapped(path: Path, numbers: list[float], device: str) -> bool:
    """Return whether Q comes before I by adcbufCfg; newer lines begin with a subframe."""
    if len(numbers) not in (4, 5):
        raise RecordingError(f"{path}: adcbufCfg has {len(numbers)} numbers; 5 are read, or 4 without the subframe")
    _, swap, interleave, _ = numbers[-4:]
    if interleave == 0 and device and device not in FOUR_LANES:
        raise RecordingError(
            f"{path}: adcbufCfg: receivers that alternate are not allowed for {device}; its samples come receiver by "
            "receiver (1)"
        )
    return swap == 1


def _translate(path: Path, commands: Commands) -> dict[str, Any]:
    """Return the settings that commands state, of the common profile of the chirps of a frame."""
    for name in ("frameCfg", "channelCfg", "adcCfg"):
        if len(commands[name]) > 1:
            lines = ", ".join(str(number) for number, _ in commands[name])
            raise RecordingError(f"{path}: has {name} in lines {lines}; one is read")
    frame, output = commands["frameCfg"][0][1], commands["adcCfg"][0][1]["b2AdcOutFmt"]
    if output not in (0, 1, 2):
        raise RecordingError(f"{path}: adcCfg: output format {output:g} is not allowed; 0 (real), 1 or 2 (complex)")
    chirps: dict[int, tuple[int, Mapping[str, float]]] = {}
    for number, values in (*commands["chirpCfg"], (-1, frame)):
        first, last = int(values["chirpStartIdx"]), int(values["chirpEndIdx"])
        if not 0 <= first <= last <= 511:
            where = "frameCfg" if values is frame else f"line {number}, chirpCfg"
            raise RecordingError(f"{path}: {where}: chirps must be 0 to 511, rising; {first} to {last} are not allowed")
        if values is not frame:
            chirps |= dict.fromkeys(range(first, last + 1), (number, values))
    used = [chirps[number] for number in range(first, last + 1) if number in chirps]
    profiles = {int(values["profileId"]) for _, values in used}
    if len(used) != last - first + 1 or len(profiles) != 1:
        raise RecordingError(
            f"{path}: frameCfg: takes chirps {first} to {last}, of which each needs a chirpCfg and all the same profile"
        )
    for number, values in used:
        if changed := [text for key, text in TI["changes"].items() if values[key]]:
            raise RecordingError(
                f"{path}: line {number}, chirpCfg: changes {', '.join(changed)} of the profile; only equal "
                "chirps are read"
            )
    matches = [values for _, values in commands["profileCfg"] if int(values["profileId"]) in profiles]
    if len(matches) != 1:
        raise RecordingError(f"{path}: has {len(matches)} profileCfg of number {profiles.pop()}; one is needed")
    stated, mask = {**matches[0], **frame}, int(commands["channelCfg"][0][1]["rxChannelEn"])
    return {
        **{key: stated[name] * factor for key, (name, factor) in TI["settings"].items()},
        "output": OUTPUTS[int(output)],
        "receivers": [bit for bit in range(4) if mask >> bit & 1],
        "chirps_per_loop": last - first + 1,
    }


VOLTS_PER_CODE = 1.0 / 2**15
MAX_VALUES = 500_000_000  # maximum number of samples of one receiver
BLOCK = 1 << 24


def sniff_dca1000(path: Path, head: bytes) -> bool:
    """Return whether radar settings lie next to a .bin file."""
    if path.suffix.lower() != ".bin" or not head:
        return False
    config = find_config(path)
    if config is None or config.stat().st_size > MAX_CONFIG_BYTES:
        return False
    content = config.read_bytes()
    return any(word in content for word in (b"profileCfg", b"slope_hz_per_s", b"rlProfileCfg_t", b"chirpComnCfg"))


@plugin("radar_reader", "dca1000", sniff=sniff_dca1000, suffixes=(".bin",), by_name=(".bin",))
def read_dca1000(
    path: Path,
    *,
    config: str | None = None,
    device: Device | None = None,
    rx: int | Literal["sum"] | None = None,
    chirp: int = 0,
    conjugate: bool = True,
    range_stop_m: float | None = None,
) -> Recording:
    """Read the samples of one receiver, or of their sum.
    Every chirp becomes a row of range bins by a windowed (Hann) transform.
    """
    settings = find_config(path) if config is None else Path(config)
    if settings is None:
        raise RecordingError(
            f"{path}: has no radar settings next to it; give config=FILE, or put them into {path.stem}.toml, .json or "
            ".cfg in its folder"
        )
    if not settings.is_file():
        settings = path.parent / settings
    chirps = read_config(settings, device=device)
    receivers = list(chirps.receivers)
    if rx not in (None, "sum", *receivers):
        listed = ", ".join(map(str, receivers))
        raise RecordingError(f"{path}: rx = {rx!r} is not allowed; on are {listed}, and sum is all of them")
    choose_number(path, "chirp", chirp, chirps.chirps_per_loop, " of a loop")
    chosen = receivers if rx == "sum" else [receivers[0] if rx is None else int(rx)]
    n_frames = _count_frames(path, settings, chirps)
    samples = _read_samples(path, chirps, n_frames, chosen, chirp)
    warn_of_zeros(path, samples)
    warn_of_jumps(path, samples, chirps.loops)
    notes = [
        f"{'sum of receivers' if rx == 'sum' else 'receiver'} {', '.join(map(str, chosen))}; chirp {chirp} of "
        f"{chirps.chirps_per_loop}; {n_frames} frames of {chirps.loops}",
        f"levels: one step of the converter is taken as {VOLTS_PER_CODE:.4g} V",
        "packets that the board lost are noticed only where complex samples of strong echoes break inside a chirp",
    ]
    return label_sweeps(
        path,
        samples,
        name=f"TI {chirps.device} by DCA1000",
        carrier_hz=chirps.start_hz + chirps.slope_hz_per_s * (chirps.adc_start_s + chirps.sweep_s / 2.0),
        bandwidth_hz=chirps.slope_hz_per_s * chirps.sweep_s,
        n_ranges=chirps.n_samples if chirps.output == "complex1x" else chirps.n_samples // 2,
        range_stop_m=range_stop_m,
        frames=(n_frames, chirps.loops, chirps.frame_period_s, 1.0 / chirps.loop_s),
        sweep_s=chirps.sweep_s,
        volts_per_unit=VOLTS_PER_CODE,
        conjugate=conjugate,
        notes=notes,
    )


JUMP_ROWS, JUMP_ORDER, JUMP_RATIO = 64, 4, 6.0
"""Least number of chirps whose prediction errors are averaged, order of the prediction, and ratio that shows a jump."""


ZERO_RUN = 32
"""Number of successive samples of 0 that show a packet that was filled with zeros."""


def warn_of_zeros(file: Path, samples: npt.NDArray[Any]) -> None:
    """Warn of chirps of which a part is exactly 0, as some programs fill lost packets."""
    counts = np.cumsum(np.pad(samples == 0, ((0, 0), (1, 0))), axis=1, dtype=np.int32)
    runs = (counts[:, ZERO_RUN:] - counts[:, :-ZERO_RUN] == ZERO_RUN).any(axis=1)
    partly = np.flatnonzero(runs & (counts[:, -1] < samples.shape[1]))
    if partly.size:
        warn_caller(
            f"{file}: a part of {partly.size} of {len(samples)} chirps is exactly 0, first of chirp {partly[0]}: "
            "packets are lost and filled with zeros; features of these times are wrong"
        )


def warn_of_jumps(file: Path, samples: npt.NDArray[Any], loops: int) -> None:
    """Warn if chirps break inside: a lost packet shifts all samples that follow."""
    # Within a chirp a sample follows from those before (linear prediction of a few beats); across
    # the border of two chirps it does not. A border that wanders into the rows raises the error at
    # its place above that of the first frames.
    n_frames = -(-JUMP_ROWS // loops)
    rows, width = n_frames * loops, samples.shape[1]
    order = min(JUMP_ORDER, width // 4)
    if not np.iscomplexobj(samples):  # the prediction of real beats is too rough for it: 7 of 60 were false alarms
        return
    profiles = []
    for first in range(0, len(samples) - rows + 1, rows):
        block = samples[first : first + rows].astype(np.complex128)
        past = np.stack([block[:, order - 1 - k : width - 1 - k].ravel() for k in range(order)])
        now = block[:, order:].ravel()
        gram = past.conj() @ past.T
        weights = np.linalg.lstsq(gram + 1e-9 * np.trace(gram) * np.eye(order), past.conj() @ now, rcond=None)[0]
        error = (np.abs(now - weights @ past) ** 2).reshape(rows, -1).mean(axis=0)
        profiles.append(error / max(float(np.median(error)), 1e-30))
    if len(profiles) < 2:
        return
    ratios = np.array(profiles) / np.maximum(profiles[0], 1.0)
    largest = ratios.max(axis=1)
    # a border touches as many errors as the order; the beat of two strong echoes is wider
    narrow = (ratios > largest[:, np.newaxis] / 2.0).sum(axis=1) <= 2 * order
    marked, at = (largest > JUMP_RATIO) & narrow, ratios.argmax(axis=1)
    stays = marked[1:] & marked[:-1] & (np.abs(np.diff(at)) <= order)  # the border stays until the next loss
    jumps = np.flatnonzero(np.append(stays, False) | np.append(False, stays))
    if jumps.size:
        warn_caller(
            f"{file}: chirps break inside in {jumps.size * n_frames} of {len(profiles) * n_frames} frames, first seen "
            f"in frame {jumps[0] * n_frames}: packets are lost, and times and ranges after that are wrong; record again"
        )


def _count_channels(chirps: ChirpConfig) -> int:
    """Count the receivers in the file, including disabled ones."""
    return 4 if chirps.device in FOUR_LANES else len(chirps.receivers)


def _count_frames(file: Path, settings: Path, chirps: ChirpConfig) -> int:
    parts = 1 if chirps.output == "real" else 2
    frame_bytes = 2 * parts * _count_channels(chirps) * chirps.n_samples * chirps.chirps_per_loop * chirps.loops
    size = file.stat().st_size
    count, rest = divmod(size, frame_bytes)
    frame = (
        f"{chirps.loops} loops of {chirps.chirps_per_loop} chirps, {_count_channels(chirps)} receivers and "
        f"{chirps.n_samples} {'real' if parts == 1 else 'complex'} samples, {frame_bytes:,} bytes"
    )
    if not count or (rest and count >= chirps.frames) or 0 < chirps.frames < count:
        raise RecordingError(
            f"{file}: has {size:,} bytes, which is {count} frames and {rest:,} bytes more; by {settings.name} it has "
            f"{chirps.frames or 'any number of'} frames, each of {frame}. The settings are of another recording, or "
            f"the file is truncated: shorten it to {count * frame_bytes:,} bytes, and set the number of frames to 0 to "
            "read all frames of the file"
        )
    if count < chirps.frames:
        warn_caller(
            f"{file}: holds {count} of the {chirps.frames} frames of {settings.name}: it was stopped early, or packets "
            "are lost"
        )
    if count * chirps.loops * chirps.n_samples > MAX_VALUES:
        raise RecordingError(f"{file}: has {count} frames; at most {MAX_VALUES:,} samples of a receiver are read")
    return count


def _read_samples(
    file: Path, chirps: ChirpConfig, n_frames: int, chosen: list[int], chirp: int
) -> npt.NDArray[np.complex64] | npt.NDArray[np.float32]:
    """Return the sorted samples of a file, shape (pulses, samples), V."""
    size, n_parts, four = chirps.n_samples, 1 if chirps.output == "real" else 2, chirps.device in FOUR_LANES
    width = n_parts * _count_channels(chirps) * size
    out: npt.NDArray[Any] = np.zeros((n_frames * chirps.loops, size), np.float32 if n_parts == 1 else np.complex64)
    step = max(1, BLOCK // width)
    for begin in range(0, len(out), step):
        rows, offset = min(step, len(out) - begin), 2 * begin * chirps.chirps_per_loop * width
        numbers = np.fromfile(file, "<i2", rows * chirps.chirps_per_loop * width, offset=offset)
        if numbers.size < rows * chirps.chirps_per_loop * width:
            raise RecordingError(f"{file}: was truncated while it was read")
        block = numbers.reshape(rows, chirps.chirps_per_loop, width)[:, chirp].astype(np.float32)
        for receiver in chosen:
            if four:
                parts = block.reshape(rows, size, n_parts, 4)[..., receiver]
            else:  # two samples at a time
                pairs = block.reshape(rows, -1, size // 2, n_parts, 2)[:, chirps.receivers.index(receiver)]
                parts = pairs.swapaxes(2, 3).reshape(rows, size, n_parts)
            out.real[begin : begin + rows] += parts[..., n_parts - 1 if chirps.q_first else 0]
            if n_parts == 2:
                out.imag[begin : begin + rows] += parts[..., 0 if chirps.q_first else 1]
    out *= VOLTS_PER_CODE
    return out

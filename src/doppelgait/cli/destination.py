"""Where a simulated recording goes: our HDF5 file, a XeThru folder, NumPy arrays or SigMF."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from doppelgait.cli.output import check_output

if TYPE_CHECKING:
    from doppelgait.radar import Recording

SUFFIXES = (".h5", ".npz", ".sigmf-meta")
START_TIME = "2000-01-01T00:00:00"
"""Start of a XeThru recording unless another is given: a clock's time would make equal runs differ."""


@dataclass(frozen=True)
class XethruNames:
    """What a XeThru recording is called and holds, as the command line has it; None where it was not given."""

    data_type: str | None = None
    start_time: str | None = None
    session_id: str | None = None

    def given(self) -> list[str]:
        """Options that were given."""
        return [f"--{name.replace('_', '-')}" for name, value in vars(self).items() if value is not None]


def check_destination(path: Path, names: XethruNames) -> None:
    """Refuse, before any work is done, a name that says no format, a missing folder or options of another format."""
    from doppelgait.core.errors import ConfigError

    suffix = path.suffix.lower()
    if suffix and suffix not in SUFFIXES:
        raise ConfigError(f"-o {path}: must end in {', '.join(SUFFIXES)}, or be a folder for a XeThru recording")
    if suffix and names.given():
        raise ConfigError(f"{names.given()[0]} is for XeThru recordings: give a folder instead of -o {path}")
    check_output(path, suffix)
    if not suffix:
        _start(names)
        _check_type(names.data_type)


def write_to(recording: Recording, path: Path, names: XethruNames) -> Path:
    """Write a recording in the format that its destination says; returns what was made."""
    from doppelgait.radar import write_arrays, write_recording, write_sigmf
    from doppelgait.radar.xethru import write_xethru_recording

    suffix = path.suffix.lower()
    if not suffix:
        return write_xethru_recording(
            recording,
            path,
            data_type=names.data_type or "baseband_iq",
            start_time=_start(names),
            session_id=names.session_id or f"doppelgait_{recording.seed or 0}",
        )
    writers = {".h5": write_recording, ".npz": write_arrays, ".sigmf-meta": write_sigmf}
    writers[suffix](recording, path)
    return path


def _check_type(data_type: str | None) -> None:
    from doppelgait.core.errors import ConfigError
    from doppelgait.radar.xethru.convert import CONVERTIBLE

    allowed = [name for name in CONVERTIBLE if name != "radar_rf"]  # counters, whose scale only Python can give
    if data_type is not None and data_type not in allowed:
        raise ConfigError(f"--data-type {data_type}: is not allowed; writable are {', '.join(allowed)}")


def _start(names: XethruNames) -> datetime:
    from doppelgait.core.errors import ConfigError

    text = names.start_time or START_TIME
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise ConfigError(f"--start-time {text}: must be a time such as {START_TIME}; UTC unless it says so") from None
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)

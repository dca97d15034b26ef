"""Which files a recording is, and where they are."""

from __future__ import annotations

import hashlib
from difflib import get_close_matches
from pathlib import Path

from doppelgait.core.errors import ConfigError
from doppelgait.dataset.shard import file_sha256
from doppelgait.radar.xethru.meta import META_NAME

PAIRS = (("_RE.txt", "_IM.txt"), (".sigmf-meta", ".sigmf-data"))
WITH_SIDECAR = (".npy", ".npz")
"""Arrays, whose meaning stands in a TOML file of the same stem."""


def find_recordings(folder: Path, pattern: str) -> list[str]:
    """Recordings of a folder that a name or a pattern with ``*``, ``?`` and ``**`` means.

    Parameters
    ----------
    folder : Path
    pattern : str
        Relative to the folder; a backslash may stand for a slash.

    Returns
    -------
    list of str
        Relative paths with slashes, sorted. Files of one recording (a pair, an array and its TOML) count once.

    Raises
    ------
    ConfigError
        If nothing is there, or it is outside the folder.
    """
    name = pattern if _exists(folder / pattern) else pattern.replace("\\", "/")
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise ConfigError(f"{pattern!r} is not allowed: it must be in {folder}, written from there")
    found = [folder / name] if _exists(folder / name) else []
    if not found and any(sign in name for sign in "*?["):
        try:
            found = sorted(folder.glob(name))
        except ValueError as error:
            raise ConfigError(f"{pattern!r} is no pattern: {error}; ** must stand alone between slashes") from None
    if not found:
        raise ConfigError(f"{pattern!r}: is not in {folder}{_near(folder, name)}")
    return sorted({_main_of(path).relative_to(folder).as_posix() for path in found})


def _main_of(path: Path) -> Path:
    """The file that a recording is called by, whichever of its files was named."""
    for main, other in PAIRS:
        partner = path.with_name(path.name.removesuffix(other) + main)
        if path.name.endswith(other) and partner.is_file():
            return partner
    if path.suffix == ".toml":
        return next((path.with_suffix(end) for end in WITH_SIDECAR if path.with_suffix(end).is_file()), path)
    return path


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # too long for a name, or with a zero byte
        return False


def _near(folder: Path, name: str) -> str:
    place = (folder / name).parent
    if not _exists(place) or not place.is_dir():
        place = folder
    names = sorted(path.name for path in place.iterdir())
    close = get_close_matches(Path(name).name, names, n=3, cutoff=0.6)
    return f"; near in spelling: {', '.join(close)}" if close else f"; {len(names)} others are there"


def files_of(path: Path) -> tuple[Path, ...]:
    """All files that a recording consists of, by the names that its format gives them."""
    if path.is_dir():
        return tuple(sorted(inner for inner in path.rglob("*") if inner.is_file()))
    for pair in PAIRS:
        for end in pair:
            if path.name.endswith(end):
                both = (path.with_name(path.name.removesuffix(end) + other) for other in pair)
                return tuple(sorted(one for one in both if one.is_file()))
    if path.suffix in WITH_SIDECAR and path.with_suffix(".toml").is_file():
        return path, path.with_suffix(".toml")
    meta = path.with_name(META_NAME)
    if path.suffix == ".dat" and meta.is_file():
        return tuple(sorted({path, meta})) if path != meta else tuple(sorted(path.parent.glob("xethru_*.dat")))
    return (path,)


def recording_sha256(folder: Path, recording: str) -> str:
    """SHA-256 of names and bytes of all files of a recording, hex; a file that cannot be read counts as such."""
    digest = hashlib.sha256()
    for path in files_of(folder / recording):
        try:
            content = file_sha256(path)
        except OSError:
            content = "unreadable"
        digest.update(f"{path.relative_to(folder).as_posix()}\n{content}\n".encode())
    return digest.hexdigest()

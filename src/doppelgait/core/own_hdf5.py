"""Protection against HDF5 files that read values from other files.

HDF5 has three ways to make a file show what lies in another one: links, datasets with external storage (the bytes of
any file become numbers) and virtual datasets. We write none of them, so a file that has one is not as we wrote it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any


def stated_format(path: str | Path) -> str | None:
    """Return the format that an HDF5 file states, or None.

    None for any file that is not of doppelgait.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            stated = file.attrs.get("format")
    except (OSError, RuntimeError, ValueError, TypeError, LookupError):
        return None
    return stated if isinstance(stated, str) else None


def own_member(group: Any, name: str) -> Any:
    """Return a dataset or group that the HDF5 group itself holds.

    Parameters
    ----------
    group : h5py.Group
    name : str
        Of a direct member.

    Returns
    -------
    h5py.Dataset, h5py.Group or None
        None where there is none.

    Raises
    ------
    ValueError
        If it is a link, or its values lie elsewhere.
    """
    import h5py

    key = name.encode()
    if "/" in name:  # every part of a path could be a link
        raise ValueError(f"{name!r} is not allowed as a name")
    if not group.id.links.exists(key):
        return None
    if group.id.links.get_info(key).type != h5py.h5l.TYPE_HARD:
        raise ValueError(f"{name!r} is a link, which is not followed: it may lead to another file")
    found = group[name]
    _check_values(found, name)
    return found


def check_own(file: Any) -> None:
    """Check that an HDF5 file holds all of its members itself.

    It reads no values.

    Parameters
    ----------
    file : h5py.File

    Raises
    ------
    ValueError
        Naming the first that is a link or whose values lie elsewhere.
    """
    import h5py

    found: list[tuple[str, int]] = []
    file.id.links.visit(lambda name, link: found.append((name.decode(errors="replace"), link.type)), info=True)
    for name, kind in found:
        if kind != h5py.h5l.TYPE_HARD:
            raise ValueError(f"{name!r} is a link, which is not followed: it may lead to another file")
        _check_values(file[name], name)


def _check_values(found: Any, name: str) -> None:
    import h5py

    if isinstance(found, h5py.Dataset) and (found.external or found.is_virtual):
        raise ValueError(f"the values of {name!r} lie in another file, which is not read")

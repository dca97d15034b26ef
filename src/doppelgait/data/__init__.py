"""Recordings to begin with: public ones by their names, and one that is simulated."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from doppelgait.core.config import read_toml
from doppelgait.core.errors import DatasetError, list_choices

if TYPE_CHECKING:
    import pandas as pd

    from doppelgait.radar.recording import Recording

__all__ = ["fetch", "list_recordings", "sample"]

TABLE = Path(__file__).with_name("recordings.toml")
DEMO = Path(__file__).with_name("demo.toml")
"""Scene file of the sample: an approaching person and a receding dog pass each other."""


def list_recordings() -> pd.DataFrame:
    """List the public recordings that :func:`fetch` knows.

    Returns
    -------
    pandas.DataFrame
        ``name``, ``what``, ``licence``, ``reader``, ``read`` (the call that reads ``path``) and ``bytes``.

    Examples
    --------
    >>> import doppelgait as dg
    >>> "dog-walk" in dg.data.list_recordings()["name"].tolist()
    True
    """
    import pandas as pd

    return pd.DataFrame([{"name": name, **row} for name, row in read_toml(TABLE)[0].items()]).drop(columns="files")


def fetch(name: str) -> Path:
    """Download a public recording, once, and return its path.

    The licence is printed before the download. Files are compared with their SHA-256, and kept in the cache folder of
    the user, or in the folder that the environment variable ``DOPPELGAIT_DATA`` names.

    Parameters
    ----------
    name : str
        A name of :func:`list_recordings`.

    Returns
    -------
    Path
        File to read; others of the recording are beside it.

    Raises
    ------
    DatasetError
        If there is no such name, pooch is not installed, or a file cannot be had or is another one; the message says
        where to put it by hand.

    Examples
    --------
    >>> import doppelgait as dg
    >>> motion = dg.motion.read(dg.data.fetch("dog-walk"))  # doctest: +SKIP
    """
    rows: dict[str, dict[str, Any]] = read_toml(TABLE)[0]
    if name not in rows:
        raise DatasetError(f"fetch: there is no recording {name!r}; known are {list_choices(rows, name)}")
    try:
        import pooch
    except ImportError:
        raise DatasetError("pooch is not installed; install it with pip install 'doppelgait[data]'") from None
    pooch.get_logger().setLevel("WARNING")
    urls = {f"{name}/{url.rpartition('/')[2]}": url for url in rows[name]["files"]}
    sums = dict(zip(urls, rows[name]["files"].values(), strict=True))
    folder = pooch.os_cache("doppelgait")
    store = pooch.create(folder, base_url="", env="DOPPELGAIT_DATA", registry=sums, urls=urls)
    paths = {key: Path(store.path) / key for key in urls}
    if not all(path.is_file() for path in paths.values()):
        print(f"{name}: {rows[name]['what']}; licence: {rows[name]['licence']}", file=sys.stderr, flush=True)
    for key, path in paths.items():
        try:
            store.fetch(key)
        except (OSError, ValueError) as error:
            raise DatasetError(
                f"{name}: cannot be fetched: {' '.join(str(error).split())}; download {urls[key]} by hand and put "
                f"it at {path}; its SHA-256 is {sums[key]}"
            ) from None
    return next(iter(paths.values()))


def sample() -> Recording:
    """Simulate a recording to try things with: a person and a dog pass each other.

    It needs no network and no file, takes a fraction of a second, and is always the same.

    Returns
    -------
    Recording
        4 s of an XeThru X4, with truth.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> [result.label for result in dg.analyze(recording, gate="truth")]
    ['human', 'dog']
    """
    from doppelgait.pipeline import parse_run, run_simulation

    return run_simulation(parse_run(read_toml(DEMO)[0], where="demo"))

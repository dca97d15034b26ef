"""WebDataset: tar files in which the files of an example follow each other and share a name."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from doppelgait.dataset.example import plain_row
from doppelgait.dataset.export.rows import arrays_of, file_name, flat_index, splits_of
from doppelgait.dataset.open import Dataset

EXAMPLES_PER_TAR = 1000


def write_webdataset(dataset: Dataset, folder: Path, fields: tuple[str, ...], done: Callable[[int], None]) -> None:
    """``SPLIT-NNNNNN.tar``; of every example ``ID.FIELD.npy``, its axes, ``ID.json`` (its row) and ``ID.cls``.

    The same dataset gives the same bytes: no time, no user. Dots of an id are escaped: the first one ends the key.
    """
    table, numbers = flat_index(dataset), dataset.class_numbers()
    for split, rows in splits_of(dataset):
        for tar_number, first in enumerate(range(0, rows.size, EXAMPLES_PER_TAR)):
            with tarfile.open(folder / f"{split}-{tar_number:06d}.tar", "w", format=tarfile.PAX_FORMAT) as tar:
                for row in rows[first : first + EXAMPLES_PER_TAR]:
                    key = file_name(str(table["id"].iat[row]))
                    for name, values in arrays_of(dataset, int(row), fields).items():
                        buffer = io.BytesIO()
                        np.save(buffer, values, allow_pickle=False)
                        _add(tar, f"{key}.{name}.npy", buffer.getvalue())
                    facts = plain_row(table.iloc[row].to_dict())
                    _add(tar, f"{key}.json", json.dumps(facts, allow_nan=False).encode())
                    _add(tar, f"{key}.cls", str(numbers[row]).encode())
                    done(1)


def _add(tar: tarfile.TarFile, name: str, content: bytes) -> None:
    entry = tarfile.TarInfo(name)  # time 0, no user and no group
    entry.size = len(content)
    tar.addfile(entry, io.BytesIO(content))

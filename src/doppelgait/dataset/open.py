"""Open a dataset: its index, features ready for scikit-learn, and arrays."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from doppelgait.core.errors import DatasetError
from doppelgait.features import FEATURE_UNITS


@dataclass(frozen=True)
class Dataset:
    """A built dataset, or a part of it.

    Parameters
    ----------
    directory : Path
    description : dict
        ``dataset.json``: identity, classes, fields, configuration.
    index : pandas.DataFrame
        One row per example.
    """

    directory: Path
    description: dict[str, Any]
    index: pd.DataFrame

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, split: str) -> Dataset:
        """The examples of one split."""
        known = sorted(self.index["split"].unique())
        if split not in known:
            raise DatasetError(f"{self.directory}: no split {split!r}; there are {', '.join(known)}")
        return self.select(f"split == {split!r}")

    def select(self, query: str) -> Dataset:
        """The examples that fulfil a pandas query, for example ``"truth_aspect_deg < 30 and label == 'dog'"``."""
        return Dataset(self.directory, self.description, self.index.query(query).reset_index(drop=True))

    def features(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.str_], npt.NDArray[np.str_]]:
        """Features, labels and groups for scikit-learn.

        Returns
        -------
        X : ndarray, shape (n, 6)
            The six features in the order of :data:`doppelgait.features.FEATURE_UNITS`; NaN where undetermined.
        y : ndarray of str, shape (n,)
        groups : ndarray of str, shape (n,)
            Subjects: keep each in one fold.
        """
        columns = [f"feature_{name}" for name in FEATURE_UNITS]
        X = self.index[columns].to_numpy(dtype=np.float64)
        return X, self.index["label"].to_numpy(dtype=str), self.index["subject"].to_numpy(dtype=str)

    def array(self, field: str, number: int) -> npt.NDArray[Any]:
        """Stored array of the ``number``-th example of this part."""
        import h5py

        if field not in self.description["fields"]:
            raise DatasetError(
                f"{self.directory}: keeps no {field!r}; it keeps {', '.join(self.description['fields'])}"
            )
        row = self.index.iloc[number]
        with h5py.File(self.directory / "shards" / f"{row['shard']}.h5", "r") as file:
            stored = file[field]
            values = stored[int(row["row"])] if isinstance(stored, h5py.Dataset) else stored[str(row["row"])][:]
        return np.asarray(values)


def open_dataset(directory: str | Path) -> Dataset:
    """Open a built dataset.

    Raises
    ------
    DatasetError
        If the folder holds none, or it is not finished.
    """
    folder = Path(directory)
    try:
        description = json.loads((folder / "dataset.json").read_text())
        index = pd.read_parquet(folder / "index.parquet")
    except FileNotFoundError as error:
        raise DatasetError(
            f"{folder}: no finished dataset here ({error.filename} is missing); build it first"
        ) from None
    except (OSError, ValueError) as error:
        raise DatasetError(f"{folder}: is damaged: {error}") from None
    return Dataset(folder, description, index)

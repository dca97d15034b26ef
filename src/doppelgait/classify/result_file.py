"""Results of ``analyze -o`` read back, as far as a model looks at them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import SIGNATURE, make_array
from doppelgait.core.units import doppler_to_velocity_mps
from doppelgait.features import FEATURE_UNITS
from doppelgait.pipeline.results import FORMAT, FORMAT_VERSION
from doppelgait.radar.recordings import SIGNATURE as HDF5_SIGNATURE

Columns = tuple[dict[str, Any], xr.DataArray]


def is_result_file(path: str | Path) -> bool:
    """Whether a file holds results of :func:`doppelgait.pipeline.write_results`; other files are not looked into."""
    target = Path(path)
    if not target.is_file():
        return False
    with target.open("rb") as file:
        if file.read(len(HDF5_SIGNATURE)) != HDF5_SIGNATURE:
            return False
    import h5py

    try:
        with h5py.File(target, "r") as file:
            return bool(file.attrs.get("format") == FORMAT)
    except OSError:
        return False


def read_columns(path: str | Path) -> tuple[list[Columns], dict[str, Any]]:
    """Targets of a result file, and the parameters of its analysis.

    Returns
    -------
    list of (dict, DataArray)
        Columns as in the index of a dataset, and the signature, of every target.
    dict

    Raises
    ------
    AnalysisError
        If the file is damaged or of a newer version.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            if int(file.attrs["format_version"]) > FORMAT_VERSION:
                raise AnalysisError(f"{path}: holds results of a newer doppelgait; install that one")
            groups = file.get("targets", {})
            found = [_target(groups[name]) for name in sorted(groups, key=int)]
            return found, dict(json.loads(file.attrs["analysis"]))
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise AnalysisError(f"{path}: is damaged: {' '.join(str(error).split())}") from None


def _target(group: Any) -> Columns:
    attrs = group.attrs
    columns: dict[str, Any] = {f"feature_{name}": float(attrs[name]) for name in FEATURE_UNITS}
    columns["gait_frequency_hz"] = float(attrs["gait_frequency_hz"])
    for name, prefix in (("quality", "quality_"), ("extended", "extended_")):
        columns |= {f"{prefix}{key}": value for key, value in json.loads(attrs[name]).items()}
    columns["flags"] = ";".join(json.loads(attrs["flags"]))
    stored = group["signature"]
    wavelength_m = float(stored.attrs["wavelength_m"])
    doppler_hz = np.asarray(group["doppler_hz"])
    coords = {
        "time": np.asarray(group["time_s"]),
        "doppler": doppler_hz,
        "velocity": ("doppler", doppler_to_velocity_mps(doppler_hz, wavelength_m)),
    }
    return columns, make_array(SIGNATURE, np.asarray(stored), coords, {"wavelength_m": wavelength_m})

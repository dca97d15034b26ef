"""TRC files and marker tables of the shared test data, and tables that ``motion convert`` writes."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from doppelgait.cli.app import app
from doppelgait.motion.readers import MOTION_READERS
from recorded import read_manifests, read_quietly

pytestmark = pytest.mark.shared

FILES = {
    "accad_run1.txt": "table",
    "accad_swagger1.txt": "table",
    "bmc_walk1.trc": "trc",
    "opensim_moco_markers_walk.trc": "trc",
}
SWAGGER = "accad_swagger1.txt"


def _path(shared: Path, name: str) -> Path:
    return shared / "data" / "mocap" / read_manifests(shared, "human")[name]["file"]


def test_these_readers_take_these_files_and_no_others(shared: Path) -> None:
    folders = [shared / "data" / "mocap", shared / "data" / "c3d-edge-cases"]
    files = [path for folder in folders for path in folder.rglob("*") if path.is_file() and path.stat().st_size]
    assert len(files) > 100
    for path in files:
        with path.open("rb") as file:
            head = file.read(4096)
        taken = [name for name in ("trc", "table", "arrays", "c3d") if MOTION_READERS[name].facts["sniff"](path, head)]
        expected = FILES.get(path.name) or ("c3d" if path.suffix == ".c3d" else None)
        if path.parent.name == "vhdc-csv":
            expected = "table"
        assert taken == ([expected] if expected else []), path.name


@pytest.mark.parametrize("name", FILES)
def test_coordinates_are_those_in_the_text(shared: Path, name: str) -> None:
    """Another reader of the same numbers: pandas, told the layout by hand."""
    trc = FILES[name] == "trc"
    table = pd.read_csv(_path(shared, name), sep="\t", header=None, skiprows=5 if trc else 1, skip_blank_lines=True)
    motion = read_quietly(_path(shared, name), clean=False)
    theirs = table.iloc[:, 2:].dropna(axis=1, how="all").to_numpy(float).reshape(len(table), -1, 3)
    theirs = np.where(theirs == -9999.99, np.nan, theirs) * 1e-3
    if trc:
        theirs = np.stack([theirs[..., 0], -theirs[..., 2], theirs[..., 1]], axis=-1)
    if name == SWAGGER:
        theirs = np.delete(theirs, 11, axis=1)
        assert motion.report["dropped"] == {"ghost of marker LHEE": ["LHEE-1"]}
    np.testing.assert_allclose(motion.position_m, theirs, atol=1e-12)


@pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")
@pytest.mark.parametrize("name", [SWAGGER, "cmu_07_01.c3d", "ktk_optitrack_walk_legs.c3d"])
def test_what_convert_writes_reads_back(shared: Path, name: str, tmp_path: Path) -> None:
    source, out = _path(shared, name), tmp_path / "walk.csv"
    first = read_quietly(source)
    result = CliRunner().invoke(app, ["motion", "convert", str(source), "-o", str(out)])
    assert result.exit_code == 0, result.output
    second = read_quietly(out, clean=False)
    assert second.markers == first.markers
    assert second.parts == first.parts
    assert second.rate_hz == pytest.approx(first.rate_hz, rel=1e-9)
    # written with nine significant digits
    np.testing.assert_allclose(second.position_m, first.position_m, rtol=5e-9, atol=1e-15)
    assert (second.report["up_axis"], second.report["length_unit"]) == ("z", "m")

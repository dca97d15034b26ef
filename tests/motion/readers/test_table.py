"""Delimited marker tables that these tests write themselves."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import doppelgait.motion.readers.table
from doppelgait.cli.app import app
from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.motion.readers import MOTION_READERS, read
from recorded import read_manifests, read_quietly
from walking_body import NAMES, walking_body

METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "ft": 0.3048}
BODY_M = walking_body()
FORMS = {
    "NAME_x_UNIT": "{name}_{axis}_{unit}",
    "NAME X (UNIT)": "{name} {Axis} ({unit})",
    "NAME.x [UNIT]": "{name}.{axis} [{unit}]",
    "NAME:X_UNIT": "{name}:{Axis}_{unit}",
}


def titles(form: str, *, unit: str = "m", names: Sequence[str] = NAMES) -> list[str]:
    return [form.format(name=n, axis=a, Axis=a.upper(), unit=unit) for n in names for a in "xyz"]


def write_table(
    path: Path, position: np.ndarray, head: Sequence[str], *, separator: str = ",", time: str | None = "time_s"
) -> Path:
    """Write positions (T, P, 3) at 100 Hz below the column names ``head``."""
    table = pd.DataFrame(position.reshape(len(position), -1))
    table.columns = pd.Index(head)
    if time:
        table.insert(0, time, np.arange(len(position)) * (10.0 if "ms" in time else 0.01))
    table.to_csv(path, index=False, sep=separator, float_format="%.9g")
    return path


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("unit", METRES)
def test_units_in_names_give_the_same_motion(tmp_path: Path, form: str, unit: str, separator: str) -> None:
    head = titles(FORMS[form], unit=unit)
    motion = read(write_table(tmp_path / "w.csv", BODY_M / METRES[unit], head, separator=separator), clean=False)
    np.testing.assert_allclose(motion.position_m, BODY_M, atol=1e-8)
    assert (motion.markers, motion.rate_hz) == (NAMES, 100.0)
    report = motion.report
    assert (report["metres_per_unit"], report["up_axis"], report["format"]) == (METRES[unit], "z", "table")


@pytest.mark.parametrize("form", ["{name}_{axis}", "{name}:{Axis}", "{name} {Axis}"])
def test_units_given_where_names_hold_none(tmp_path: Path, form: str) -> None:
    path = write_table(tmp_path / "w.csv", BODY_M * 100, titles(form))
    np.testing.assert_allclose(read(path, clean=False, units="cm").position_m, BODY_M, atol=1e-8)
    with pytest.raises(MotionError, match=r"'LFHD.[xX]' names no length unit; give it: units="):
        read(path, clean=False)
    write_table(path, BODY_M, titles(form + "_furlong"))
    with pytest.raises(MotionError, match=r"'LFHD.[xX]_furlong' names the unit 'furlong', not a known unit of length"):
        read(path, clean=False)


def test_units_in_names_of_each_column_win_over_the_option(tmp_path: Path) -> None:
    head = [n + "_m" if n[-1] == "z" else n + "_mm" for n in titles("{name}_{axis}")]
    path = write_table(tmp_path / "w.csv", BODY_M * [1e3, 1e3, 1.0], head)
    with pytest.warns(DoppelgaitWarning, match="column names give m+, mm?; units=cm was not used"):
        motion = read(path, clean=False, units="cm")
    np.testing.assert_allclose(motion.position_m, BODY_M, atol=1e-8)


@pytest.mark.parametrize("long", ["", "long" * 80])  # a header may be longer than the head that sniffers get
def test_two_rows_of_names(tmp_path: Path, long: str) -> None:
    names = [long + name for name in NAMES]
    first = "Frame,Time," + ",".join(f"Jim:{name},," for name in names)
    axes = ",," + ",".join("X,Y,Z" for _ in NAMES)
    rows = [f"{k + 1},{k / 100:.2f}," + ",".join(f"{v:.6f}" for v in frame.ravel()) for k, frame in enumerate(BODY_M)]
    (tmp_path / "w.csv").write_text("\n".join([first, axes, *rows]) + "\n")
    motion = read(tmp_path / "w.csv", clean=False, units="m", up_axis="z")
    np.testing.assert_allclose(motion.position_m, BODY_M, atol=1e-6)
    assert (motion.markers, motion.facts.subject, motion.report["notes"]) == (names, "Jim", [])


def test_accad_text_is_in_mm_and_marks_gaps(tmp_path: Path) -> None:
    body = BODY_M.copy()
    body[5:8, 3] = np.nan
    for name, factor in (("run.txt", 1e3), ("metres.txt", 1.0)):
        values = np.where(np.isnan(body), -9999.99, factor * body)
        path = write_table(tmp_path / name, values, titles("{name}:{Axis}"), separator="\t", time="Time")
        rows = path.read_text().strip().split("\n")
        path.write_text("\n".join(f"{n or 'Field'}\t{row}" for n, row in enumerate(rows)))
    np.testing.assert_allclose(read(tmp_path / "run.txt", clean=False).position_m, body, atol=1e-6)
    with pytest.raises(MotionError, match=r"its points span 0.00167 m; .*Is the unit wrong"):
        read(tmp_path / "metres.txt", clean=False)


def test_missing_value_and_blank_cells(tmp_path: Path) -> None:
    body = BODY_M.copy()
    body[4, 2] = 999.0
    body[6, 3] = np.nan
    body[8, 5, 1] = 999.0  # one coordinate alone is a coordinate
    path = write_table(tmp_path / "w.csv", body, titles("{name}_{axis}_m"))
    lost = np.isnan(read(path, clean=False, missing=999).position_m).any(axis=2)
    assert np.argwhere(lost).tolist() == [[4, 2], [6, 3]]
    with pytest.raises(MotionError, match="missing = 'gone' is not allowed; it must be a number"):
        read(path, clean=False, missing="gone")


@pytest.mark.parametrize("separator", [";", "\t", ","])
def test_decimal_comma(tmp_path: Path, separator: str) -> None:
    path = write_table(tmp_path / "w.csv", BODY_M, titles("{name}_{axis}_m"), separator=separator)
    if separator == ",":
        quoted = [",".join(f'"{cell}"' for cell in row.split(",")) for row in path.read_text().split("\n") if row]
        path.write_text("\n".join(quoted))
    path.write_text(path.read_text().replace(".", ","))
    motion = read(path, clean=False)
    np.testing.assert_allclose(motion.position_m, BODY_M, atol=1e-8)
    assert motion.rate_hz == 100.0


def timed(path: Path, times: Sequence[str], position: np.ndarray) -> Path:
    rows = [",".join([t, *(f"{v:.9g}" for v in frame.ravel())]) for t, frame in zip(times, position, strict=True)]
    path.write_text("\n".join([",".join(["time_s", *titles("{name}_{axis}_m")]), *rows]))
    return path


@pytest.mark.parametrize(
    ("times", "rate_hz", "left_out"),
    [
        ([f"{round(k / 60, 3):.6f}" for k in range(40)], 60.0, 0),
        ([f"{round(7.3 + k / 120, 3):.5f}" for k in range(40)], 120.0, 0),
        ([*(f"{k / 25:.3f}" for k in range(39)), "1.549"], 25.0, 1),
        ([*(f"{k / 90:.7f}" for k in range(39)), "0.9"], 90.0, 1),
        ([f"{(k + (k > 20)) / 50:.6f}" for k in range(40)], None, 0),  # a frame is missing
        ([f"{(k + 0.5 * (k == 20)) / 50:.6f}" for k in range(40)], None, 0),  # multiples of 10 ms, but no raster
    ],
)
def test_times_that_are_rounded_or_end_off_the_raster(
    tmp_path: Path, times: list[str], rate_hz: float | None, left_out: int
) -> None:
    path = timed(tmp_path / "w.csv", times, BODY_M)
    if rate_hz is None:
        with pytest.raises(MotionError, match=r"Frames must be evenly spaced.*resample_hz"):
            read(path, clean=False)
        return
    motion = read(path, clean=False)
    assert (motion.rate_hz, motion.n_frames) == (rate_hz, 40 - left_out)
    assert [note.startswith("the last frame") for note in motion.report["notes"]] == [True] * left_out


def test_irregular_times_are_interpolated_over(tmp_path: Path) -> None:
    """A jittery camera that repeats one frame and pauses for 0.3 s; the formula gives the truth at any time."""
    rng = np.random.default_rng(3)
    time_s = 0.01 + np.arange(75) / 31.0 + rng.uniform(-0.008, 0.008, 75)
    time_s[50:] += 0.3
    time_s[30] = time_s[29]
    dense = walking_body(n_frames=30_000, rate_hz=10_000.0)
    path = timed(tmp_path / "w.csv", [f"{t:.5f}" for t in time_s], dense[np.rint(1e4 * time_s).astype(int)])
    with pytest.raises(MotionError, match=r"does not increase.*resample_hz"):
        read(path, clean=False)
    motion = read(path, clean=False, resample_hz=50)
    even_s = round(time_s[0], 5) + motion.time_s
    truth = dense[np.rint(1e4 * even_s).astype(int)]
    paused = (even_s > time_s[49]) & (even_s < time_s[50])
    assert motion.rate_hz == 50.0
    assert (np.isnan(motion.position_m).any(axis=(1, 2)) == paused).all()
    assert np.abs(motion.position_m - truth)[~paused].max() < 2e-3
    with pytest.raises(MotionError, match="must be 1 to 10000"):
        read(path, clean=False, resample_hz=0.1)
    assert read(path, clean=False, rate_hz=25.0, resample_hz=50.0).n_frames == 149  # even frames


def test_milliseconds_frames_other_columns_and_names_with_axis_letters(tmp_path: Path) -> None:
    names = ["left_x", "my_y_z", "T8_2", *NAMES[3:]]
    path = write_table(tmp_path / "w.csv", BODY_M, titles("{name}_{axis}_m", names=names), time="time_ms")
    table = pd.read_csv(path)
    table.insert(0, "Frame", range(len(table)))
    table["emg"] = "strong"
    table["LTOE_x_velocity"] = 1.0
    table.to_csv(path, index=False)
    motion = read(path, clean=False)
    assert (motion.markers, motion.rate_hz) == (names, 100.0)
    assert motion.report["notes"] == ["columns left out: emg, LTOE_x_velocity"]


@pytest.mark.parametrize(
    ("line", "old", "new", "message"),
    [
        (5, ",1.7", ",tall", r"line 5, column 'LFHD_z_m': 'tall\d*' is not a number"),
        (5, "0.03,", ",", "line 5 has no time.*rate_hz="),
        (5, "0.03,", "soon,", "line 5, column 'time_s': 'soon' is not a number"),
        (5, "0.03,", "0.02,", "line 5: the time does not increase"),
        (5, "0.03,", "0.035,", "line [56]: the time steps by 0.0[01]5 s, but most frames are 0.01 s apart"),
        (5, "0.03,", '"0.03,', "line 5: a quoted cell is damaged"),
        (5, "0.03,", "0.03;", "line 5 has 48 cells; its header names 49 columns"),
        (5, "0.03,", "0.03,1.0,", "line 5 has 50 cells"),
        (1, "LFHD_y_m", "LFHD_q_m", "line 1: point 'LFHD' has no y column"),
        (1, "time_s", "time_ms", "its times step by 1e-05 s"),
    ],
)
def test_a_damaged_cell_has_one_clear_error(tmp_path: Path, line: int, old: str, new: str, message: str) -> None:
    path = write_table(tmp_path / "w.csv", BODY_M, titles("{name}_{axis}_m"))
    lines = path.read_text().split("\n")
    assert old in lines[line - 1]
    lines[line - 1] = lines[line - 1].replace(old, new, 1)
    path.write_text("\n".join(lines))
    with pytest.raises(MotionError, match=message) as error:
        read(path, clean=False)
    assert "w.csv" in str(error.value)


@pytest.mark.parametrize(
    "form", ["{name}{Axis}", "{name}{axis}", "{Axis}_{name}", "{axis}{name}", "{Axis}{number}", "{Axis}"]
)
def test_triples_without_a_mark_or_a_name(tmp_path: Path, form: str) -> None:
    head = [form.format(name=name, number=n + 1, Axis=a.upper(), axis=a) for n, name in enumerate(NAMES) for a in "xyz"]
    motion = read(write_table(tmp_path / "w.csv", BODY_M, head, time="Time"), clean=False, units="m", up_axis="z")
    np.testing.assert_allclose(motion.position_m, BODY_M, atol=1e-8)
    assert motion.markers == (NAMES if "{name}" in form else [f"point_{n + 1}" for n in range(len(NAMES))])


@pytest.mark.parametrize(
    "name", ["CoM", "COM_L", "center of mass", "CentreOfPressure", "Virtual_Hip", "V_Pelvis", "LGRF", "knee velocity"]
)
def test_computed_points_are_no_markers(tmp_path: Path, name: str) -> None:
    names = [*NAMES[:-1], name]
    path = write_table(tmp_path / "w.csv", BODY_M, titles("{name}_{axis}_m", names=names))
    motion = read(path, clean=False)
    assert motion.markers == NAMES[:-1]
    assert motion.report["points_measured"] == len(NAMES) - 1


@pytest.mark.parametrize(
    "text",
    [
        "HIERARCHY\nROOT Hips\n{\n\tOFFSET 0 0 0\n\tCHANNELS 3 Xposition Yposition Zposition\n}\n",
        "file,class,speed_mps\na,b,1.0\n",
        '{"positions": [], "LFHD_x_m": 0}',
        "max,x,y\n1,2,3\n",
        "time_s,maxX,maxY,minZ\n0.1,1,2,3\n",
    ],
)
def test_other_text_is_not_taken(tmp_path: Path, text: str) -> None:
    path = tmp_path / "other.txt"
    path.write_text(text)
    assert not doppelgait.motion.readers.table.sniff_table(path, path.read_bytes()[:4096])


SHARED_FILES = {
    "accad_run1.txt": "table",
    "accad_swagger1.txt": "table",
    "bmc_walk1.trc": "trc",
    "opensim_moco_markers_walk.trc": "trc",
}
SWAGGER = "accad_swagger1.txt"


def _path(shared: Path, name: str) -> Path:
    return shared / "data" / "mocap" / read_manifests(shared, "human")[name]["file"]


@pytest.mark.shared
def test_these_readers_take_these_files_and_no_others(shared: Path) -> None:
    folders = [shared / "data" / "mocap", shared / "data" / "c3d-edge-cases"]
    files = [path for folder in folders for path in folder.rglob("*") if path.is_file() and path.stat().st_size]
    assert len(files) > 100
    for path in files:
        with path.open("rb") as file:
            head = file.read(4096)
        taken = [name for name in ("trc", "table", "arrays", "c3d") if MOTION_READERS[name].facts["sniff"](path, head)]
        expected = SHARED_FILES.get(path.name) or ("c3d" if path.suffix == ".c3d" else None)
        if path.parent.name == "vhdc-csv":
            expected = "table"
        assert taken == ([expected] if expected else []), path.name


@pytest.mark.shared
@pytest.mark.parametrize("name", SHARED_FILES)
def test_coordinates_are_those_in_the_text(shared: Path, name: str) -> None:
    """Another reader of the same numbers: pandas, told the layout by hand."""
    trc = SHARED_FILES[name] == "trc"
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


@pytest.mark.shared
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

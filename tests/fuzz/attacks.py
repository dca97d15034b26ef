"""Findings of earlier rounds, made by code: small files that took minutes, gigabytes, or other files' bytes.

Every function writes the files of one case into an empty folder and names the target that must refuse, or survive, it.
"""

import io
import json
import struct
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from readers import TARGETS, body

Attack = Callable[[Path], str]
ATTACKS: dict[str, Attack] = {}
READ = {"platform_with_blanks", "a_long_word_among_short_ones", "halves_of_characters_in_names", "trc_with_no_rate"}
"""Those that may be read, within the limits; all others must be refused."""


def attack(make: Attack) -> Attack:
    ATTACKS[make.__name__] = make
    return make


def _seed(target: str, folder: Path, number: int = 0) -> None:
    """Write one seed of a target right into a folder."""
    TARGETS[target].seeds(folder / "seeds")
    for file in (folder / "seeds" / str(number)).iterdir():
        file.rename(folder / file.name)


def by(write: Callable[..., str]) -> Callable[..., Callable[[Callable[..., Any]], Attack]]:
    """Make a decorator of what ``write(folder, change, ...)`` takes after the function that it decorates."""

    def take(*arguments: Any) -> Callable[[Callable[..., Any]], Attack]:
        def register(change: Callable[..., Any]) -> Attack:
            make = partial(write, change=change, arguments=arguments)
            ATTACKS[change.__name__] = make
            return make

        return register

    return take


@by
def edited(folder: Path, change: Callable[[str], str], arguments: Any) -> str:
    """A seed of a target with a function of the text of one of its files."""
    target, file, *number = arguments
    _seed(target, folder, *number)
    (folder / file).write_text(change((folder / file).read_text()))
    return str(target)


@by
def written(folder: Path, change: Callable[[], str], arguments: Any) -> str:
    """A text alone."""
    target, file = arguments
    (folder / file).write_text(change())
    return str(target)


@by
def points(folder: Path, change: Callable[[], dict[str, Any]], arguments: Any) -> str:
    """Points of a body in an npz file, with a rate or names of their own."""
    np.savez(folder / "a.npz", **{"positions": body(), "rate_hz": 50.0, "units": "m", **change()})
    return "motion-arrays"


@written("motion-table", "a.csv")
def header_with_blanks() -> str:
    return "time_s,a" + " " * 4000 + "!,b_x_m\n0,0,0\n1,1,1\n2,2,2\n"


@written("motion-table", "a.csv")
def header_with_marks() -> str:
    return "time_s,a" + " _ " * 4000 + "!,b_x(" + "_x(" * 9000 + ",c_x_m\n0,0,0,0\n1,1,1,1\n2,2,2,2\n"


@written("motion-table", "a.csv")
def many_headers_with_marks() -> str:
    return "time_s" + (",a" + "_x(" * 130) * 2000 + "\n" + "0," * 2000 + "0\n" * 3


@written("motion-table", "a.csv")
def points_of_one_name() -> str:
    return "time_s," + ("a_x_m,a_y_m,a_z_m," * 19_000).rstrip(",") + "\n" + ("0," * 57_000 + "0\n") * 3


@written("motion-table", "a.csv")
def table_of_single_digits() -> str:
    titles = "t," + ",".join(f"p{n}_{axis}_m" for n in range(50) for axis in "xyz")
    return titles + "\n" + "".join(f"{t}" + ",1" * 150 + "\n" for t in range(40_000))


@written("motion-bvh", "a.bvh")
def joints_without_channels() -> str:
    sites = "End Site\n{\nOFFSET 0 1 0\n}\n" * 990
    head = "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n"
    return f"{head}{sites}}}\nMOTION\nFrames: 20000\nFrame Time: 0.01\n" + "0\n" * 20_000


@written("motion-arrays", "a.json")
def json_of_brackets() -> str:
    return '{"rate_hz": 1, "positions": [' + "[]," * 5_000_000 + "[]]}"


@written("radar-points", "a.csv")
def points_of_large_numbers() -> str:
    return "x,y,doppler,track,time\n" + f"{'9' * 400},1,1,1,0\n0,1,1,1,1\n"


@points()
def names_of_digits() -> dict[str, Any]:
    return {"names": np.array(["1" * 400_000 + "x", *"bcdefghijklmnop"])}


@points()
def names_of_no_characters() -> dict[str, Any]:
    names = np.array(["abcd"] * 16)
    names.view("u4")[5] = 2**31
    return {"names": names}


@points()
def frame_rate_of_almost_nothing() -> dict[str, Any]:
    return {"rate_hz": 1e-308}


@edited("motion-amc", "07_01.amc")
def skeleton_comment_with_blanks(text: str) -> str:
    return "#!OML:ASF " + " " * 40_000 + "\\" * 40_000 + "\n" + text.split("\n", 1)[1]


@edited("motion-amc", "07_01.amc")
def a_long_word_among_short_ones(text: str) -> str:
    frames = "".join(f"{t}\nroot 0 0 0 0 0 {'0' * 90 if t == 5 else 0}\n" for t in range(1, 60_000))
    return "#!OML:ASF 07.asf\n:FULLY-SPECIFIED\n:DEGREES\n" + frames


@edited("motion-bvh", "a.bvh")
def frames_with_blanks(text: str) -> str:
    return text.replace("Frames: 12", "Frames" + " " * 200_000 + "1 2")


@edited("motion-bvh", "a.bvh")
def frame_time_with_blanks(text: str) -> str:
    return text.replace("Frame Time: 0.02", "Frame" + " " * 100_000 + "Time" + " " * 100_000 + "1 2")


@edited("motion-trc", "a.trc")
def trc_with_no_rate(text: str) -> str:
    head = text.split("\n")
    return "\n".join([*head[:2], "1e-308" + head[2][head[2].index("\t") :], *head[3:]])


@edited("motion-trc", "a.trc")
def trc_with_one_wide_row(text: str) -> str:
    rows = ["1\t0.1" + "\t1" * 36] * 3000
    return "\n".join([*text.split("\n")[:6], "1\t0.0" + "\t1" * 150_000, *rows])


@edited("motion-expmap", "skeleton.json")
def expmap_parents_that_are_true(text: str) -> str:
    content = json.loads(text)
    content["parents"][2] = True
    return json.dumps(content)


@edited("radar-dca1000", "a.cfg", 2)
def platform_with_blanks(text: str) -> str:
    return "% platform" + " " * 300_000 + "\n" + text


@edited("radar-arrays", "a.toml", 1)
def settings_with_brackets(text: str) -> str:
    row = "x = '''" + "[" * 20_000 + "prf_hz " * 20_000 + "'''\n"
    return row + text.replace("prf_hz = 25.0", "prf_hz = 'x'")


@edited("radar-sigmf", "walk.sigmf-meta")
def sigmf_without_ranges(text: str) -> str:
    content = json.loads(text)
    content["global"]["doppelgait:range_m"] = []
    return json.dumps(content)


@by
def members(folder: Path, change: Callable[[Any], object], arguments: Any) -> str:
    """A seed of a target whose HDF5 file is changed by its members."""
    import h5py

    _seed(arguments[0], folder, *arguments[1:])
    with h5py.File(next(path for path in folder.iterdir() if path.suffix in (".h5", ".mat")), "r+") as file:
        change(file)
    return str(arguments[0])


@by
def content(folder: Path, change: Callable[[bytearray], None], arguments: Any) -> str:
    """A seed of a target with a function of the bytes of its HDF5 file."""
    _seed(arguments[0], folder)
    damaged = bytearray((folder / "a.h5").read_bytes())
    change(damaged)
    (folder / "a.h5").write_bytes(damaged)
    return str(arguments[0])


@members("radar-acconeer")
def gzip_in_acconeer_text(file: Any) -> None:
    del file["sessions/session_0/session_config"]
    file.create_dataset("sessions/session_0/session_config", (1,), "S2000000000", chunks=(1,), compression="gzip")


@attack
def matlab_fact_of_a_matrix(folder: Path) -> str:
    from scipy.io import savemat

    frames = np.random.default_rng(0).normal(size=(10, 96))
    fact = np.zeros((1, 20_000_000), "u1")
    content = {"Data_Matrix": frames, "actual_fps": fact, "bin_length": 0.00643, "frame_start": 0.4}
    savemat(folder / "a.mat", content, do_compression=True)
    return "radar-matlab"


@attack
def matlab_matrix_of_zeros(folder: Path) -> str:
    from scipy.io import savemat

    frames = np.zeros((600_000, 100), "u1")
    content = {"Data_Matrix": frames, "actual_fps": 25.0, "bin_length": 0.00643, "frame_start": 0.4}
    savemat(folder / "a.mat", content, do_compression=True)
    return "radar-matlab"


def _packed_npz(path: Path, shape: tuple[int, ...], code: str, name: str, **others: Any) -> None:
    """An npz file with an array of zeros that is never in memory."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
            np.lib.format.write_array_header_1_0(stream, {"descr": code, "fortran_order": False, "shape": shape})
            left = int(np.prod(shape)) * np.dtype(code).itemsize
            while left:
                left -= stream.write(bytes(min(left, 1 << 22)))
        for key, value in others.items():
            buffer = io.BytesIO()
            np.save(buffer, value)
            archive.writestr(f"{key}.npy", buffer.getvalue())


@attack
def radar_npz_of_bytes(folder: Path) -> str:
    _seed("radar-arrays", folder, 1)
    _packed_npz(folder / "a.npz", (200_000, 200), "|i1", "i", q=np.zeros(1, "i1"))
    return "radar-arrays"


@attack
def motion_npz_of_bytes(folder: Path) -> str:
    _packed_npz(folder / "a.npz", (700_000, 20, 3), "|i1", "positions", rate_hz=np.array(50.0))
    return "motion-arrays"


@attack
def motion_npz_of_80_gigabytes(folder: Path) -> str:
    with zipfile.ZipFile(folder / "a.npz", "w") as archive:
        header = io.BytesIO()
        np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**9, 3, 3)})
        archive.writestr("positions.npy", header.getvalue())
    return "motion-arrays"


@attack
def xethru_meta_that_lists_a_file_often(folder: Path) -> str:
    from doppelgait.radar.xethru.records import pack_meta, parse_meta

    _seed("radar-xethru", folder)
    meta = next(folder.rglob("xethru_recording_meta.dat"))
    content = meta.read_bytes()
    name = next(path.name for path in meta.parent.iterdir() if "baseband_iq" in path.name)
    parsed = parse_meta(content, where="meta")
    meta.write_bytes(pack_meta(replace(parsed, file_names=parsed.file_names + (name,) * 3000)))
    (meta.parent / name).write_bytes((meta.parent / name).read_bytes() * 2000)
    return "radar-xethru"


@content("radar-own")
def parts_of_complex_numbers_that_overlap(damaged: bytearray) -> None:
    """Declare exponents of the real part that take a double: its values then overlap the imaginary part."""
    at = damaged.index(b"r\0\0\0\0\0\0\0" + bytes(4)) + 56
    assert damaged[at : at + 4] == struct.pack("<I", 127)
    damaged[at] = 130


@content("radar-own")
def sequence_for_a_text(damaged: bytearray) -> None:
    """Declare a text of variable length as a sequence of characters."""
    text_of_any_length = b"\x19\x01\x01\0\x10\0\0\0"
    damaged[damaged.index(text_of_any_length, damaged.index(b"units\0")) + 1] = 9


@attack
def halves_of_characters_in_names(folder: Path) -> str:
    _seed("motion-arrays", folder)
    with np.load(folder / "a.npz") as seed:
        content = dict(seed)
    names = content["names"].tolist()
    names[2] = "left_sh\udd6fulder"
    np.savez(folder / "a.npz", **{**content, "names": np.array(names), "rate_hz": 10.0})
    return "motion-arrays"


@members("radar-matlab", 2)
def matlab_axis_of_texts(file: Any) -> None:
    file.pop("range_axis", None)
    file["range_axis"] = np.full((1, file["Data_Matrix"].shape[0]), b"0.\x8b", "S3")
    file.pop("frame_start", None)

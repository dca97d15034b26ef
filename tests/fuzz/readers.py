"""Targets of the fuzzer: every reader of motions and of radar recordings, with small seeds of our own making."""

import json
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import acconeer_file
import motion_files
import recording_files
from walking_body import NAMES, walking_body


@dataclass(frozen=True)
class Target:
    """What is fuzzed.

    Parameters
    ----------
    seeds : callable
        Writes the files of one seed into each of some new folders below a folder.
    run : callable
        Uses the files of a folder; raises ``AssertionError`` where the result is nonsense.
    share : int
        Share of a run's cases, of about 1,000; a case of few takes long.
    """

    seeds: Callable[[Path], None]
    run: Callable[[Path], None]
    share: int = 50


def main_file(folder: Path, *endings: str) -> Path:
    return next((path for path in sorted(folder.iterdir()) if path.name.endswith(endings)), folder / "moved")


FRAMES = 12


def body(n_frames: int = FRAMES) -> Any:
    """Sixteen points of a person who walks along x, (T, P, 3) in m."""
    return walking_body(n_frames=n_frames, rate_hz=50.0)


def _text(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def _table(n_frames: int = FRAMES) -> tuple[list[str], list[list[str]]]:
    titles = ["time_s", *(f"{name}_{axis}_m" for name in NAMES for axis in "xyz")]
    rows = [[f"{t / 50:.3f}", *(f"{value:.5f}" for value in frame.ravel())] for t, frame in enumerate(body(n_frames))]
    return titles, rows


def table_seeds(folder: Path) -> None:
    titles, rows = _table()
    lines = [titles, *rows]
    _text(folder / "0" / "a.csv", "\n".join(map(",".join, lines)) + "\n")
    in_mm = [[row[0], *(f"{1000 * float(value):.2f}" for value in row[1:])] for row in rows]
    other = [["time", *(title.removesuffix("_m").replace("_", " ") + " (mm)" for title in titles[1:])], *in_mm]
    _text(folder / "1" / "a.csv", "\n".join(";".join(cells).replace(".", ",") for cells in other))
    _text(folder / "2" / "x.txt", "\n".join("\t".join(cells) for cells in [["Frame", *[n for n in NAMES for _ in "xyz"]],
          ["", *["X", "Y", "Z"] * len(NAMES)], *[[str(t), *row[1:]] for t, row in enumerate(rows)]]))  # fmt: skip
    accad = ["Field", "Time", *(f"{name}:{axis}" for name in NAMES for axis in "XYZ")]
    _text(
        folder / "3" / "a.txt",
        "\n".join("\t".join(c) for c in [accad, *([str(t), *row] for t, row in enumerate(in_mm))]),
    )
    glued = ["t", *(f"{name.replace('_', '')}{axis}" for name in NAMES for axis in "XYZ")]
    _text(folder / "4" / "a.tsv", "\n".join("\t".join(cells) for cells in [glued, *rows]))


def trc_seeds(folder: Path) -> None:
    _text(folder / "0" / "a.trc", motion_files.trc(walking_body(n_frames=FRAMES)))


def bvh_seeds(folder: Path) -> None:
    tree = [("Spine", 20), ("Chest", 15), ("Neck", 20), ("Head", 10)]
    text = "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"
    for name, length in tree:
        text += f"JOINT {name}\n{{\nOFFSET 0 {length} 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
    text += "End Site\n{\nOFFSET 0 8 0\n}\n" + "}\n" * len(tree)
    for side, sign in (("Left", 1), ("Right", -1)):
        for name, y, z in (("UpLeg", -5, 0), ("Leg", -42, 0), ("Foot", -40, 0), ("ToeBase", -6, 12)):
            text += f"JOINT {side}{name}\n{{\nOFFSET {9 * sign} {y} {z}\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
        text += "End Site\n{\nOFFSET 0 0 4\n}\n" + "}\n" * 4
    n_values = 6 + 3 * (len(tree) + 8)
    rows = [" ".join(["0", "95", f"{2.4 * t:.2f}", *(f"{5 * math.sin(t + n):.3f}" for n in range(n_values - 3))])
            for t in range(FRAMES)]  # fmt: skip
    _text(folder / "0" / "a.bvh", text + f"}}\nMOTION\nFrames: {FRAMES}\nFrame Time: 0.02\n" + "\n".join(rows) + "\n")


BONES = {
    "lfemur": ("root", "0.3 -0.9 0", 7.0, "rx ry rz"), "ltibia": ("lfemur", "0.3 -0.9 0", 7.2, "rx"),
    "lfoot": ("ltibia", "0.1 -0.2 0.9", 2.0, "rx rz"), "rfemur": ("root", "-0.3 -0.9 0", 7.0, "rx ry rz"),
    "rtibia": ("rfemur", "-0.3 -0.9 0", 7.2, "rx"), "rfoot": ("rtibia", "-0.1 -0.2 0.9", 2.0, ""),
    "lowerback": ("root", "0 1 0", 9.0, "rx ry rz"), "head": ("lowerback", "0 1 0.1", 3.0, "rx"),
}  # fmt: skip


def amc_seeds(folder: Path) -> None:
    data = "".join(
        f"  begin\n  id {n}\n  name {name}\n  direction {way}\n  length {size}\n  axis 0 0 20 XYZ\n"
        + (f"  dof {dof}\n" if dof else "") + "  end\n"
        for n, (name, (_, way, size, dof)) in enumerate(BONES.items())
    )  # fmt: skip
    tree = "".join(f"    {parent} {name}\n" for name, (parent, *_) in BONES.items())
    _text(folder / "0" / "07.asf", "# c\n:version 1.10\n:units\n  length 0.45\n  angle deg\n:root\n  order TX TY TZ RX RY RZ\n"
          f"  axis XYZ\n  position 1 0 0\n  orientation 0 0 0\n:bonedata\n{data}:hierarchy\n  begin\n{tree}  end\n")  # fmt: skip
    frames = "".join(
        f"{t + 1}\nroot 0 17 {0.4 * t:.2f} 0 0 {t}\n"
        + "".join(f"{n} {' '.join(f'{9 * math.sin(t + k):.4f}' for k in range(len(d.split())))}\n"
                  for n, (*_, d) in BONES.items() if d)
        for t in range(FRAMES)
    )  # fmt: skip
    _text(folder / "0" / "07_01.amc", f"#!OML:ASF H:\\a\\07.ASF\n:FULLY-SPECIFIED\n:DEGREES\n{frames}")


def expmap_seeds(folder: Path) -> None:
    joints = NAMES + [f"j{n}" for n in range(32 - len(NAMES))]
    skeleton = {"joint_names": joints, "parents": [-1, *range(31)], "offsets": [[0.0, 60.0, 10.0 * (n % 3)] for n in range(32)],
                "metres_per_unit": 0.001, "frame_rate_hz": 50, "up_axis": "y"}  # fmt: skip
    _text(folder / "0" / "skeleton.json", json.dumps(skeleton))
    _text(
        folder / "0" / "a.txt",
        "\n".join(",".join(f"{0.01 * t + 0.1 * math.sin(t + n):.4f}" for n in range(99)) for t in range(FRAMES)),
    )


def arrays_seeds(folder: Path) -> None:
    (folder / "0").mkdir(parents=True)
    np.savez(folder / "0" / "a.npz", positions=body(), names=np.array(NAMES), rate_hz=50.0, units="m")
    (folder / "1").mkdir()
    np.savez_compressed(
        folder / "1" / "a.npz", joints=1000 * body().astype("f4"), fps=50, joint_names=np.array(NAMES, "S")
    )
    content = {"rate_hz": 50, "units": "m", "names": NAMES, "positions": body().round(4).tolist()}
    _text(folder / "2" / "a.json", json.dumps(content))


def c3d_seeds(folder: Path) -> None:
    import c3d

    frames = np.zeros((FRAMES, len(NAMES), 5))
    frames[..., :3] = 1000 * body()
    for n, scale in enumerate((-1.0, 0.1)):  # floating-point numbers, integers
        writer = c3d.Writer(point_rate=50.0, point_scale=scale)
        writer.add_frames([(frame, np.zeros((0, 0))) for frame in frames])
        writer.set_point_labels(NAMES)
        (folder / str(n)).mkdir(parents=True)
        with (folder / str(n) / "a.c3d").open("wb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # no analog data
            writer.write(file)


VENDORS = motion_files.TEXTS | motion_files.JOINTS


def vendor_seeds(folder: Path) -> None:
    """Exports of the programs that record motions; the names of the files are those of ``VENDORS``."""
    for name, (suffix, write, _) in VENDORS.items():
        _text(folder / name / f"{name}.{suffix}", write(motion_files.BODY_M))
    (folder / "gltf").mkdir()
    motion_files.glb(folder / "gltf" / "a.glb")
    (folder / "movement").mkdir()
    axes = ("time", "space", "keypoints", "individuals")
    motion_files.write_movement(folder / "movement" / "a.h5", axes=axes, fps=50.0)


LARGEST_M = 1e4
"""Farther from the origin is no place of a body."""


def run_motion(folder: Path) -> None:
    from doppelgait.motion.readers import read

    path = next((path for path in sorted(folder.iterdir()) if path.name not in ("07.asf", "skeleton.json")), folder)
    options: dict[str, Any] = VENDORS[path.stem][2] if path.stem in VENDORS else {}
    if path.name == "x.txt":
        options = {"rate_hz": 50.0, "units": "m"}
    elif path.name == "a.tsv":
        options = {"units": "m"}
    elif path.name == "a.h5":
        options = {"units": "m", "subject": "Eva"}
    motion = read(path, clean=False, **options)
    check_motion(motion)
    cleaned = read(path, **options)
    check_motion(cleaned)
    assert np.isfinite(cleaned.position_m).all(), "gaps in a cleaned motion"


def check_motion(motion: Any) -> None:
    position = motion.position_m
    assert np.isfinite(motion.rate_hz) and 0 < motion.rate_hz <= 1e4, f"rate {motion.rate_hz}"
    seen = np.isfinite(position)
    assert not np.isinf(position).any(), "infinite positions"
    if not seen.any():
        return  # cleaning reports it
    assert np.abs(position[seen]).max() <= LARGEST_M, f"{np.abs(position[seen]).max():g} m from the origin"
    span = np.nanmax(position, axis=1) - np.nanmin(position, axis=1)
    sizes = np.linalg.norm(span, axis=1)
    sizes = sizes[np.isfinite(sizes)]
    least, most = np.percentile(sizes, (60, 80)) if sizes.size else (1.0, 1.0)
    assert least > 0.02 and most < 27.0, f"a body of {least:g} to {most:g} m"


def simulated() -> Any:
    import doppelgait as dg

    scene = dg.Scene(
        targets=[dg.Target(motion=dg.motion.generate("human", duration_s=0.6), range_m=3.0)], duration_s=0.3
    )
    return dg.simulate(scene, dg.Radar.preset("x4", prf_hz=60.0, range_start_m=2.0, range_stop_m=3.0))


def own_seeds(folder: Path) -> None:
    from doppelgait.radar import write_recording

    (folder / "0").mkdir(parents=True)
    noted = replace(recording_files.make_recording(), notes=["n"], noise_power_v2=0.1)
    write_recording(noted, folder / "0" / "a.h5")
    (folder / "1").mkdir()
    write_recording(simulated(), folder / "1" / "a.h5")


def result_seeds(folder: Path) -> None:
    import doppelgait as dg
    from doppelgait.pipeline import write_results

    scene = dg.Scene(
        targets=[dg.Target(motion=dg.motion.generate("human", duration_s=2.5), range_m=3.0)], duration_s=2.0
    )
    recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=400.0, range_start_m=1.0, range_stop_m=4.0))
    (folder / "0").mkdir(parents=True)
    write_results(folder / "0" / "a.h5", recording, dg.analyze(recording, gate="truth"))


def radar_arrays_seeds(folder: Path) -> None:
    recording_files.write_sample("arrays", folder / "0")
    rng = np.random.default_rng(2)
    facts = 'prf_hz = 25.0\ncarrier_hz = 7.29e9\nrange_start_m = 0.4\nbin_spacing_m = 0.05\nscale_v = 1e-3\n[radar]\npreset = "x4"\n'
    _text(folder / "1" / "a.toml", facts)
    np.savez(folder / "1" / "a.npz", i=rng.integers(-99, 99, (12, 5), "i2"), q=rng.integers(-99, 99, (12, 5), "i2"))
    _text(folder / "2" / "a.toml", facts)
    np.save(folder / "2" / "a.npy", rng.normal(size=(12, 5, 2)))


def matlab_seeds(folder: Path) -> None:
    import h5py
    from scipy.io import savemat

    frames = np.random.default_rng(0).normal(size=(10, 96))
    content = {"Data_Matrix": frames, "actual_fps": 25.0, "bin_length": 0.00643004, "baseband": 0.0,
               "range_axis": 0.4 + 0.00643004 * np.arange(96)}  # fmt: skip
    for n in range(2):
        (folder / str(n)).mkdir(parents=True)
        savemat(folder / str(n) / "a.mat", content, do_compression=bool(n))
    (folder / "2").mkdir()
    with h5py.File(folder / "2" / "a.mat", "w", userblock_size=512) as file:
        for name, value in content.items():
            file[name] = np.atleast_2d(value).T
    with (folder / "2" / "a.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")


def acconeer_seeds(folder: Path) -> None:
    import h5py

    pairs = np.random.default_rng(0).integers(-300, 300, (2, 9, 4, 6))
    (folder / "0").mkdir(parents=True)
    path = acconeer_file.write_file(folder / "0" / "a.h5", pairs[0] + 1j * pairs[1], data_saturated=np.zeros(9, bool))
    with h5py.File(path, "r+") as file:
        file["session"] = h5py.SoftLink("/sessions/session_0")
        result = file["sessions/session_0/group_0/entry_0/result"]
        stored = result["frame"][:]
        del result["frame"]
        result.create_dataset("frame", data=stored, compression="gzip", maxshape=(None, 4, 6))


def sigmf_seeds(folder: Path) -> None:
    recording_files.write_sample("sigmf", folder / "0")
    meta = {"global": {"core:datatype": "ci16_le", "core:version": "1.0.0", "core:sample_rate": 400.0},
            "captures": [{"core:sample_start": 0, "core:frequency": 24e9}], "annotations": []}  # fmt: skip
    _text(folder / "1" / "a.sigmf-meta", json.dumps(meta))
    (folder / "1" / "a.sigmf-data").write_bytes(np.random.default_rng(0).integers(-99, 99, 200, "<i2").tobytes())


def xethru_seeds(folder: Path) -> None:
    from doppelgait.radar.xethru import write_xethru
    from xethru_files import add_user_headers, make_mixed_records

    folder.mkdir(exist_ok=True)
    made = write_xethru(folder / "0", make_mixed_records(), **recording_files.XETHRU)
    add_user_headers(made, b"HI")


DCA1000 = {**recording_files.CHIRPS, "receivers": [0, 1], "n_samples": 8, "loops": 4}
CFG = """% Platform:xWR18xx
channelCfg 3 1 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 77 50 5 50 0 0 20 1 8 2000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
frameCfg 0 0 4 0 1.6 1 0
"""


def dca1000_seeds(folder: Path) -> None:
    samples = np.random.default_rng(0).integers(-500, 500, 3 * 4 * 2 * 8 * 2, "<i2").tobytes()
    _text(folder / "0" / "a.json", json.dumps(DCA1000))
    _text(folder / "1" / "a.toml", "".join(f"{key} = {json.dumps(value)}\n" for key, value in DCA1000.items()))
    _text(folder / "2" / "a.cfg", CFG)
    for n in range(3):
        (folder / str(n) / "a.bin").write_bytes(samples)


FURTHER = {".h5": "acconeer-a111", ".npy": "infineon", ".wav": "wav", ".cfile": "raw", ".csv": "csv", ".txt": "cw-text",
           ".dat": "glasgow", ".dgf": "frames"}  # fmt: skip
"""Readers of formats that are sampled here and nowhere else, by the ending of their files."""


def further_seeds(folder: Path) -> None:
    for name in FURTHER.values():
        recording_files.write_sample(name, folder / name)


def run_further(folder: Path) -> None:
    from doppelgait.radar import read_recording

    path = main_file(folder, *FURTHER)
    name = FURTHER.get(path.suffix, "wav")  # of a file that was deleted meanwhile
    check_recording(read_recording(path, format=name, **recording_files.sample_options(name)))


def run_recording(folder: Path) -> None:
    from doppelgait.radar import read_recording

    endings = (".h5", ".npz", ".npy", ".mat", ".sigmf-meta", ".bin")
    path = next((path for path in sorted(folder.iterdir()) if path.name.endswith(endings)), folder)
    check_recording(read_recording(path))


def check_recording(recording: Any) -> None:
    assert np.isfinite(recording.baseband.values).all(), "values that are not finite"
    for name in ("slow_time_s", "range_m"):
        values = getattr(recording, name)
        assert np.isfinite(values).all(), f"{name} is not finite"
        assert (np.diff(values) > 0).all(), f"{name} does not rise"
    assert recording.range_m[0] >= -1e3 and recording.range_m[-1] <= 1e6, f"ranges up to {recording.range_m[-1]:g} m"
    assert not recording.noise_power_v2 < 0 and not np.isinf(recording.noise_power_v2), "negative noise"
    step_s = float(np.quantile(np.diff(recording.slow_time_s), 0.5, method="lower"))  # of three pulses one may be late
    rate = step_s * recording.radar.prf_hz
    assert 0.5 < rate < 2.0 or "burst_pulses" in recording.facts, f"{rate:g} times the stated rate"
    for truth in recording.truth:
        for name in ("centre_range_m", "centre_velocity_mps", "centre_aspect_rad"):
            values = getattr(truth, name)
            known = np.isfinite(values) | (np.isnan(values) & ("aspect" in name))  # none while it stands
            assert values.shape == recording.slow_time_s.shape and known.all(), name
        assert np.isfinite(truth.scatterers["range"].values).all(), "range of a scatterer"


def run_result(folder: Path) -> None:
    from doppelgait.pipeline import read_results

    for result in read_results(main_file(folder, ".h5")).targets:
        for array in result.arrays.values():
            assert np.asarray(array).dtype.kind in "fciubUSO"


def points_seeds(folder: Path) -> None:
    rows = [
        f"{t},{t / 18:.3f},{0.1 * k:.2f},{3 - 0.05 * t:.2f},0.9,{-0.9 - 0.1 * k:.2f},20,{k % 2}"
        for t in range(8)
        for k in range(4)
    ]
    _text(folder / "0" / "a.csv", "frame,time_s,x,y,z,doppler,snr,track\n" + "\n".join(rows) + "\n")
    data = [{"timestamp": 55.0 * t, "frameData": {"pointCloud": [[0.1, 3 - 0.05 * t, 0.9, -0.9, 20, 3, k % 2] for k in range(4)],
             "trackIndexes": [0, 1, 0, 1]}} for t in range(8)]  # fmt: skip
    _text(folder / "1" / "a.json", json.dumps({"data": data}))


def run_points(folder: Path) -> None:
    from doppelgait.radar.point_clouds import collect_tracks, read_points, tabulate_tracks

    points = read_points(main_file(folder, ".csv", ".json"))
    assert np.isfinite(points[["time_s", "x_m", "y_m", "velocity_mps"]].to_numpy()).all(), "points that are not finite"
    tabulate_tracks(collect_tracks(points))


TARGETS = {
    "motion-table": Target(table_seeds, run_motion, 40),
    "motion-trc": Target(trc_seeds, run_motion, 40),
    "motion-bvh": Target(bvh_seeds, run_motion, 60),
    "motion-amc": Target(amc_seeds, run_motion, 45),
    "motion-expmap": Target(expmap_seeds, run_motion, 40),
    "motion-arrays": Target(arrays_seeds, run_motion, 45),
    "motion-c3d": Target(c3d_seeds, run_motion, 25),
    "motion-vendor": Target(vendor_seeds, run_motion, 60),
    "radar-own": Target(own_seeds, run_recording, 30),
    "radar-arrays": Target(radar_arrays_seeds, run_recording, 60),
    "radar-matlab": Target(matlab_seeds, run_recording, 50),
    "radar-acconeer": Target(acconeer_seeds, run_recording, 30),
    "radar-sigmf": Target(sigmf_seeds, run_recording, 60),
    "radar-xethru": Target(xethru_seeds, run_recording, 50),
    "radar-dca1000": Target(dca1000_seeds, run_recording, 60),
    "radar-further": Target(further_seeds, run_further, 180),
    "radar-points": Target(points_seeds, run_points, 50),
    "result": Target(result_seeds, run_result, 12),
}

"""A small file of every radar reader."""

import json
from datetime import UTC, datetime

import numpy as np
from scipy.io import savemat, wavfile

from acconeer_file import write_a111
from acconeer_file import write_file as write_acconeer
from beat import write_glasgow
from doppelgait.radar import RADAR_WRITERS, Radar, Recording
from doppelgait.radar.simulate import label_baseband


def make_recording(n_bins=6, prf_hz=25.0):
    rng = np.random.default_rng(4)
    radar = Radar.preset("x4", prf_hz=prf_hz, range_start_m=0.5, range_stop_m=0.5 + n_bins * 0.0514)
    values = (rng.normal(size=(30, n_bins)) + 1j * rng.normal(size=(30, n_bins))).astype(np.complex64)
    return Recording.from_baseband(label_baseband(values, np.arange(30) / prf_hz, radar), radar, seed=3)


XETHRU = {"start_time": datetime(2020, 5, 1, 12, tzinfo=UTC), "session_id": "a"}
WRITERS = {"doppelgait": {}, "arrays": {}, "frames": {}, "sigmf": {}, "xethru": {**XETHRU, "rtol": 1e-5}}


CHIRPS = {"device": "xwr18xx", "receivers": [0], "n_samples": 64, "sample_rate_hz": 2e6, "start_hz": 60e9,
          "slope_hz_per_s": 20e12, "idle_s": 1e-4, "ramp_s": 5e-5, "loops": 8, "frame_period_s": 0.01}  # fmt: skip


INFINEON = {"device_config": {"fmcw_single_shape": {
    "start_frequency_Hz": 60e9, "end_frequency_Hz": 61e9, "num_chirps_per_frame": 4, "num_samples_per_chirp": 64,
    "chirp_repetition_time_s": 5e-4, "frame_repetition_time_s": 2e-3, "sample_rate_Hz": 2e6}}}  # fmt: skip
PAIRS = np.random.default_rng(2).normal(scale=0.1, size=(200, 2))
FRAMES = np.random.default_rng(1).normal(size=(20, 256))
MATLAB = {"Data_Matrix": FRAMES, "actual_fps": 25.0, "bin_length": 0.00643, "frame_start": 0.4}
PLAIN = ("wav", "raw", "csv")
FILES = {
    "acconeer": ("walk.h5", write_acconeer),
    "acconeer-a111": ("walk.h5", write_a111),
    "glasgow": ("1P36A01R01.dat", lambda path: write_glasgow(path, np.ones((20, 64)))),
    "matlab-rf": ("walk.mat", lambda path: savemat(path, MATLAB)),
    "wav": ("walk.wav", lambda path: wavfile.write(path, 100, PAIRS)),
    "raw": ("walk.cfile", lambda path: PAIRS.astype("<f4").tofile(path)),
    "csv": ("walk.csv", lambda path: np.savetxt(path, PAIRS, delimiter=",", header="i,q", comments="")),
}


def write_sample(name, folder):
    """A good file of a reader's format, alone in its folder."""
    folder.mkdir(parents=True)
    if name in WRITERS:
        options = {key: value for key, value in WRITERS[name].items() if key != "rtol"}
        path = folder / f"walk{RADAR_WRITERS[name].facts['suffix']}"
        return RADAR_WRITERS[name].run(make_recording(), path, **options) or path
    if name == "infineon":
        (folder / "config.json").write_text(json.dumps(INFINEON))
        np.save(folder / "radar.npy", np.random.default_rng(1).uniform(size=(20, 3, 4, 64)).astype(np.float32))
        return folder / "radar.npy"
    if name == "cw-text":
        for part in ("RE", "IM"):
            (folder / f"walk_{part}.txt").write_text("\n".join(str(2000 + n % 90) for n in range(512)))
        return folder / "walk_RE.txt"
    if name == "dca1000":
        (folder / "walk.json").write_text(json.dumps(CHIRPS))
        np.arange(4 * 8 * 64 * 2, dtype="<i2").tofile(folder / "walk.bin")
        return folder / "walk.bin"
    file_name, write = FILES[name]
    write(folder / file_name)
    return folder / file_name


def sample_options(name):
    return {"carrier_hz": 24e9, **({} if name == "wav" else {"prf_hz": 100.0})} if name in PLAIN else {}

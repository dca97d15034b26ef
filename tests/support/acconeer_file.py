"""Files of Acconeer's exploration tool, made here."""

import json

import h5py
import numpy as np

STEP_M = 0.0025


def subsweep(**changes):
    return {
        "start_point": 200, "num_points": 6, "step_length": 24, "profile": "PROFILE_3", "hwaas": 8,
        "receiver_gain": 16, "enable_tx": True, "prf": "PRF_15_6_MHz", **changes,
    }  # fmt: skip


def write_file(
    path, values=None, *, subsweeps=None, config=None, metadata=None, ticks=None, sensor="1", root="sessions/session_0",
    generation="a121", place="group_0/entry_0", ticks_per_second=1_000_000, **marked,
):  # fmt: skip
    """Frames (frames, sweeps, points) of complex numbers as a file."""
    subsweeps = subsweeps or [subsweep()]
    n_points = sum(one["num_points"] for one in subsweeps)
    if values is None:
        rng = np.random.default_rng(0)
        values = rng.integers(-300, 300, (9, 16, n_points)) + 1j * rng.integers(-300, 300, (9, 16, n_points))
    per_frame = values.shape[1]
    settings = {
        "sweep_rate": None, "frame_rate": 20.0, "continuous_sweep_mode": False, "sweeps_per_frame": per_frame,
        "subsweeps": subsweeps, **(config or {}),
    }  # fmt: skip
    pairs = np.empty(values.shape, dtype=[("real", "<i2"), ("imag", "<i2")])
    pairs["real"], pairs["imag"] = np.round(values.real), np.round(values.imag)
    ticks = 7_000_000 + 50_000 * np.arange(len(values)) if ticks is None else ticks
    facts = {"base_step_length_m": STEP_M, "max_sweep_rate": 2000.0, **(metadata or {})}
    with h5py.File(path, "w") as file:
        file["generation"] = generation
        file["server_info"] = json.dumps({"ticks_per_second": ticks_per_second})
        n_group = int(place.split("/")[0].removeprefix("group_"))
        file[f"{root}/session_config"] = json.dumps({"groups": [{"1": settings, "3": settings}] * (n_group + 1)})
        node = file.create_group(f"{root}/{place}")
        node["sensor_id"] = int(sensor)
        node["metadata"] = json.dumps(facts)
        node["result/frame"] = pairs
        node["result/tick"] = np.asarray(ticks, dtype=np.int64)
        for name, flags in marked.items():
            node[f"result/{name}"] = flags
    return path

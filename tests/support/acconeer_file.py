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


def write_a111(path, mode="iq", *, data=None, config=None, session=None):
    """A record of the older sensor: data (frames, sensors, points), or (frames, sensors, sweeps, points) if sparse."""
    time_s = np.arange(200) / 100.0
    turn = np.exp(2j * np.pi * 12.0 * time_s)[:, None, None] * np.array([0.1, 0.5, 0.2])
    if data is None:
        data = turn if mode == "iq" else np.round(2**15 + 1000 * turn.real[:, :, None]).astype(np.uint16)
    with h5py.File(path, "w") as file:
        file["mode"], file["data"], file["data_info"] = mode, data, "[]"
        file["sensor_config_dump"] = json.dumps({"profile": "PROFILE_2", "update_rate": 100.0, **(config or {})})
        facts = {"range_start_m": 0.3, "range_length_m": 0.12, "step_length_m": 0.06, **(session or {})}
        file["session_info"] = json.dumps({key: value for key, value in facts.items() if value is not None})
    return path

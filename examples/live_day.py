"""A day of `doppelgait live` in two minutes: a sensor that comes back every hour, strangers, drift and bad order.

    python examples/live_day.py [HOURS]

Every hour the sensor connects, sends a minute of frames of a point that walks to and fro, and leaves. Its clock and its
rate drift, frames are lost, sent twice and exchanged, and other clients connect. The script ends with status 1 unless
all speeds are right within 1 %, the service ran to the end, and its memory did not grow.
"""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

from doppelgait.radar import Radar
from doppelgait.radar.frames import END_RECORD, Header, encode_frame, encode_header

RADAR = Radar.preset("x4", prf_hz=200.0, range_stop_m=6.0)
RANGE_M = RADAR.range_axis_m()
SPEED_MPS, NEAR_M, FAR_M = 0.5, 1.5, 5.5
TURN_S = (FAR_M - NEAR_M) / SPEED_MPS  # two windows: none has a turn inside
ON_S, LIMIT_S = 60.0, 60.0
DRIFTS = (0.0, 1e-4, -1e-3, 0.02)  # of the rate; the last one is measured from the sender's clock
FLAT = 1.1  # the largest memory, relative to that after three hours


def make_frames(rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Return the frames of a point that walks to and fro, in noise."""
    time_s = np.arange(round(ON_S * rate_hz)) / rate_hz
    phase = np.mod(time_s / TURN_S, 2.0)
    range_m = NEAR_M + (FAR_M - NEAR_M) * np.where(phase < 1.0, phase, 2.0 - phase)[:, None]
    echo = np.exp(-((RANGE_M - range_m) ** 2) / 0.02 - 4j * np.pi * range_m / RADAR.wavelength_m)
    noise = rng.normal(size=(*echo.shape, 2)) @ np.array([1, 1j])
    return (1e-3 * (echo + 0.03 * noise)).astype(np.complex64)


def order_frames(count: int, rng: np.random.Generator) -> list[int]:
    """Return counters as they come: some lost, some twice, some exchanged with the next."""
    kept = np.flatnonzero(rng.random(count) > 0.002)
    kept = np.repeat(kept, 1 + (rng.random(kept.size) < 0.05))
    for at in np.flatnonzero(rng.random(kept.size - 1) < 0.05):
        kept[[at, at + 1]] = kept[[at + 1, at]]
    return kept.tolist()


def send_hour(address: tuple[str, int], hour: int, rng: np.random.Generator) -> None:
    """Connect a sensor, and strangers before and after it; send its frames and leave."""
    rate_hz = RADAR.prf_hz * (1.0 + DRIFTS[hour % len(DRIFTS)])
    rows, order = make_frames(rate_hz, rng), order_frames(round(ON_S * rate_hz), rng)
    header, first = encode_header(Header(RADAR, RANGE_M)), int(rng.integers(0, 1_000_000))
    silent, talking, gone = (socket.create_connection(address) for _ in range(3))
    talking.sendall(b"GET / HTTP/1.0\r\n\r\n")
    gone.close()
    with silent, talking, socket.create_connection(address) as sensor:
        sensor.sendall(header)
        for at in range(0, len(order), 200):
            part = ((n, 3600.0 * hour + n / rate_hz) for n in order[at : at + 200])
            sensor.sendall(b"".join(encode_frame(first + n, clock_s, rows[n]) for n, clock_s in part))
            time.sleep(0.02)
            if at == 2000:
                with socket.create_connection(address) as late:
                    late.sendall(header + END_RECORD)
        sensor.sendall(END_RECORD if hour % 2 else header[:20])  # every other time it is killed


def read_memory_kb(pid: int) -> int:
    """Return the memory of a process that is in use; 0 where the system does not state it."""
    status = Path(f"/proc/{pid}/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((int(line.split()[1]) for line in lines if line.startswith("VmRSS")), 0)


def main(hours: int) -> int:
    """Play the day; return 1 if something is not as it should be."""
    rng, lines, memory_kb = np.random.default_rng(4), [], []
    command = [sys.executable, "-m", "doppelgait", "live", "tcp://127.0.0.1:0"]
    command += ["--model", "x4", "--window-s", "4", "--hop-s", "4"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        reader = threading.Thread(target=lambda: lines.extend(map(json.loads, process.stdout)))
        address = ("127.0.0.1", int(process.stderr.readline().rpartition(":")[2]))
        threading.Thread(target=process.stderr.read, daemon=True).start()
        reader.start()
        for hour in range(hours):
            send_hour(address, hour, rng)
            stop_s = time.monotonic() + LIMIT_S
            while sum(line["kind"] == "end" for line in lines) <= hour and time.monotonic() < stop_s:
                time.sleep(0.05)
            memory_kb.append(read_memory_kb(process.pid))
        process.send_signal(signal.SIGTERM)
        status = process.wait(LIMIT_S)
        reader.join(LIMIT_S)
    finally:
        process.kill()
    decisions = [line for line in lines if line["kind"] == "decision"]
    ends = [line["stream"] for line in lines if line["kind"] == "end"]
    speeds_mps = np.array([line["window"]["quality"]["speed_mps"] for line in decisions])
    tracks = {(line["track"], line["run"]) for line in decisions}
    checks = {
        "ended by its signal alone": status == 130,
        "a run every hour": [line["run"] for line in lines if line["kind"] == "start"] == list(range(hours)),
        "decisions in every run": {run for _, run in tracks} == set(range(hours)),
        "times of the sensor's clock": all(line["start_s"] // 3600.0 == line["run"] for line in decisions),
        "a track belongs to one run": len({track for track, _ in tracks}) == len(tracks),
        "speeds within 1 %": bool((np.abs(speeds_mps / SPEED_MPS - 1.0) < 0.01).all()),
        "repeated and late frames counted": all(min(one["repeated"], one["late"]) > 100 for one in ends),
        "strangers counted": sum(one["refused"] for one in ends) >= 2 * hours,
        "memory flat": hours < 4 or max(memory_kb) <= FLAT * memory_kb[2],
    }
    for name, is_met in checks.items():
        print(f"{'ok    ' if is_met else 'FAILED'} {name}")
    print(f"{len(decisions)} decisions, {speeds_mps.min():.4f} to {speeds_mps.max():.4f} m/s, {max(memory_kb)} kB")
    return int(not all(checks.values()))


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 24))

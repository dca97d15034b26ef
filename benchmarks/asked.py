"""What was asked of the chain, beside what one run measured."""

from __future__ import annotations

from typing import Any

from clock import Timing, combine
from stages import BY_BIN, SHORT_TIME_FFT, SPECTROGRAM


def asked_rows(results: dict[str, Any]) -> list[dict[str, Any]]:
    """One row for everything that was asked."""
    seconds, ratios = (results["stages"][key] for key in ("seconds", "ratios"))
    milliseconds = {name: combine(lambda s: 1e3 * s, row) for name, row in seconds.items()}
    matrix, planes = ratios["synthesis + signature, hop 1"], ratios["synthesis + signature, hop 1, planes"]
    cpu_s = results["startup"]["cpu_s"]
    error, memory_mb = max(results["accuracy"].values()), max(row["peak_mb"] for row in results["workers"])
    conditions = {name: combine(lambda s: 1e3 * s, row) for name, row in results["conditions"]["seconds"].items()}
    examples = {name: combine(lambda s: 1e3 * s, row) for name, row in results["datasets"]["seconds"].items()}
    whole = combine(lambda *ms: sum(ms), examples["home-alarm, made"], examples["home-alarm, written"])
    builds = {name: {"min": value, "median": value} for name, value in results["datasets"]["builds"].items()}
    kib = results["datasets"]["KiB of a row, home-alarm"]
    rows = [
        at_least(50, 50, "x", "synthesis + hop-1 signature / obvious NumPy", matrix),
        at_least(50, 50, "x", "synthesis + hop-1 signature, planes / obvious NumPy", planes),
        at_least(15, 15, "x", "hop-1 signature / spectrogram", ratios[f"signature / {SPECTROGRAM}"]),
        at_least(15, 15, "x", "hop-1 signature / spectrogram bin by bin", ratios[f"signature / {BY_BIN}"]),
        at_least(15, 15, "x", "hop-1 signature / ShortTimeFFT", ratios[f"signature / {SHORT_TIME_FFT}"]),
        at_least(290, 350, "/s", "examples, lossless hop, 2 workers", worker_rate(results, "lossless hop")),
        at_least(160, 250, "/s", "examples, hop 1, 2 workers", worker_rate(results, "hop 1")),
        at_most(5.2, 4.3, "ms", "hop-1 signature of planes", milliseconds["signature of planes, hop 1"]),
        at_most(2.0, 1.3, "ms", "features of one example, lossless hop", milliseconds["features, lossless hop"]),
        at_most(22, 16, "ms", "example of the rooms plan", examples["rooms plan, made"]),
        at_most(2, 1.5, "ms", "oscillator phase noise", conditions["impairment phase_noise, oscillator"]),
        at_most(0.5, 0.35, "ms", "adc", conditions["impairment adc"]),
        at_most(0.5, 0.35, "ms", "x4_counts", conditions["impairment x4_counts"]),
        at_most(8, 5, "ms", "lfm", conditions["synthesis, lfm"]),
        at_most(6, 4, "ms", "fmcw", conditions["synthesis, fmcw, 256 samples"]),
        at_most(6, 4, "ms", "stepped", conditions["synthesis, stepped, 256 steps"]),
        at_most(8, 5.6, "ms", "home-alarm example, made and written", whole),
        at_most(420, 300, "s", "100,000 home-alarm examples, 2 workers", combine(lambda ms: 50.0 * ms, whole)),
        at_most(45, 45, "KiB", "stored row of home-alarm", {"min": kib, "median": kib}),
        at_most(1e-6, 1e-6, "", "accuracy, the largest error", {"min": error, "median": error}),
        at_most(0.6, 0.5, "s", "first signature, processor time", cpu_s["first signature"]),
        at_most(0.15, 0.15, "s", "doppelgait --help, processor time", cpu_s["doppelgait --help"]),
        at_most(250, 250, "MB", "memory of a worker", {"min": memory_mb, "median": memory_mb}),
    ]
    for name, asked, aim in (
        ("dataset build of 400, 2 workers, wall s", 10, 6), ("600 s recording, analyze, s", 2, 2),
        ("600 s recording, peak MB", 400, 400),
    ):  # fmt: skip
        if name in builds:
            rows.append(at_most(asked, aim, "", name, builds[name]))
    return rows


def worker_rate(results: dict[str, Any], hop: str) -> Timing:
    """Examples a second of two workers."""
    found = [row["per_second"] for row in results["workers"] if (row["workers"], row["hop"]) == (2, hop)]
    rate: Timing = found[0]
    return rate


def at_least(asked: float, aim: float, unit: str, name: str, measured: Timing) -> dict[str, Any]:
    return _row((asked, aim), unit, name, measured, {key: value >= asked for key, value in measured.items()}, True)


def at_most(asked: float, aim: float, unit: str, name: str, measured: Timing) -> dict[str, Any]:
    return _row((asked, aim), unit, name, measured, {key: value <= asked for key, value in measured.items()}, False)


def _row(
    wanted: tuple[float, float], unit: str, name: str, measured: Timing, met: dict[str, bool], lower_bound: bool
) -> dict[str, Any]:
    names = {(True, True): "ok", (False, False): "missed", (True, False): "missed (ok of minima)"}
    verdict = names.get((met["min"], met["median"]), "ok (missed of minima)")
    return {
        "name": name,
        "asked": wanted[0],
        "aim": wanted[1],
        "unit": unit,
        "at_least": lower_bound,
        "measured": measured,
        "verdict": verdict,
    }

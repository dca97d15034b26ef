"""What was asked of the chain, beside what one run measured."""

from __future__ import annotations

from typing import Any

from clock import Timing, combine
from stages import BY_BIN, SHORT_TIME_FFT, SPECTROGRAM


def asked_rows(results: dict[str, Any]) -> list[dict[str, Any]]:
    """One row for everything that was asked."""
    seconds, ratios, floors = (results["stages"][key] for key in ("seconds", "ratios", "floor_ratios"))
    milliseconds = {name: combine(lambda s: 1e3 * s, row) for name, row in seconds.items()}
    matrix, planes = ratios["synthesis + signature, hop 1"], ratios["synthesis + signature, hop 1, planes"]
    cpu_s = results["startup"]["cpu_s"]
    error, memory_mb = max(results["accuracy"].values()), max(row["peak_mb"] for row in results["workers"])
    return [
        at_least(50, "x", "synthesis + hop-1 signature / obvious NumPy", matrix),
        at_least(50, "x", "synthesis + hop-1 signature, planes / obvious NumPy", planes),
        at_least(15, "x", "hop-1 signature / spectrogram", ratios[f"signature / {SPECTROGRAM}"]),
        at_least(15, "x", "hop-1 signature of planes / spectrogram", ratios[f"signature of planes / {SPECTROGRAM}"]),
        at_least(15, "x", "hop-1 signature / spectrogram bin by bin", ratios[f"signature / {BY_BIN}"]),
        at_least(15, "x", "hop-1 signature / ShortTimeFFT", ratios[f"signature / {SHORT_TIME_FFT}"]),
        at_least(150, "/s", "examples, hop 1, 2 workers", worker_rate(results, "hop 1")),
        at_least(220, "/s", "examples, default hop, 2 workers", worker_rate(results, "lossless hop")),
        at_most(5, "ms", "features of one example, default hop", milliseconds["features, lossless hop"]),
        at_most(5, "ms", "features of one example, hop 1", milliseconds["features, hop 1"]),
        at_most(20, "ms", "full-rate matrix of 5 s, fresh memory", milliseconds["synthesis, data matrix, full rate"]),
        at_most(20, "ms", "full-rate matrix, reused memory", milliseconds["synthesis, reused matrix, full rate"]),
        at_most(20, "ms", "full-rate planes, reused memory", milliseconds["synthesis, planes, full rate"]),
        at_most(8, "x", "synthesis of planes / write floor", floors["synthesis, planes / write floor"]),
        at_most(8, "x", "full-rate planes / write floor", floors["synthesis, planes, full rate / write floor"]),
        at_most(1e-6, "", "accuracy, the largest error", {"min": error, "median": error}),
        at_most(2.0, "s", "first signature, processor time", cpu_s["first signature"]),
        at_most(0.3, "s", "doppelgait --help, processor time", cpu_s["doppelgait --help"]),
        at_most(350, "MB", "memory of a worker", {"min": memory_mb, "median": memory_mb}),
    ]


def worker_rate(results: dict[str, Any], hop: str) -> Timing:
    """Examples a second of two workers."""
    found = [row["per_second"] for row in results["workers"] if (row["workers"], row["hop"]) == (2, hop)]
    rate: Timing = found[0]
    return rate


def at_least(asked: float, unit: str, name: str, measured: Timing) -> dict[str, Any]:
    return _row(asked, unit, name, measured, {key: value >= asked for key, value in measured.items()}, True)


def at_most(asked: float, unit: str, name: str, measured: Timing) -> dict[str, Any]:
    return _row(asked, unit, name, measured, {key: value <= asked for key, value in measured.items()}, False)


def _row(
    asked: float, unit: str, name: str, measured: Timing, met: dict[str, bool], lower_bound: bool
) -> dict[str, Any]:
    names = {(True, True): "ok", (False, False): "missed", (True, False): "missed (ok of minima)"}
    verdict = names.get((met["min"], met["median"]), "ok (missed of minima)")
    return {
        "name": name,
        "asked": asked,
        "unit": unit,
        "at_least": lower_bound,
        "measured": measured,
        "verdict": verdict,
    }

"""Speed, accuracy, growth and start-up of the chain from motion to features, all in one run.

Scenario S: 41 scatterers of a walking person, 5 s at 1000 Hz, X4 decimated to 187 bins, M = 101, K = 128, gate 1.0 m.
Stages are interleaved: every round runs each of them, the obvious NumPy, SciPy and the machine's own floors. Every
figure comes twice, from the least and from the median time of the rounds; ratios are of minima and of medians.

    python benchmarks/chain.py [--rounds 7] [--quick] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
from typing import Any

import numpy as np
import report
import scipy
from accuracy import measure_accuracy
from asked import asked_rows
from clock import total
from conditions import measure_conditions
from datasets import measure_builds, measure_datasets
from growth import AXES, QUICK_AXES, measure_growth
from stages import measure_stages
from startup import measure_startup
from threadpoolctl import threadpool_limits
from workers import measure_workers

import doppelgait


def machine() -> dict[str, Any]:
    """Describe the machine of the measurement."""
    return {
        "machine": platform.machine(),
        "processor": processor_name(),
        "processors": os.cpu_count(),
        "load": os.getloadavg() if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "doppelgait": doppelgait.__version__,
    }


def processor_name() -> str:
    """Return the processor's name, on Linux."""
    try:
        with open("/proc/cpuinfo") as facts:
            return next(line.split(":")[1].strip() for line in facts if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor()


def run_stages(rounds: int) -> dict[str, Any]:
    result = measure_stages(rounds)
    report.print_title(f"1. Stages of scenario S, {rounds} interleaved rounds, one thread")
    report.print_timings(result["seconds"], unit="ms", factor=1e3)
    report.print_title("Times faster than the obvious NumPy (synthesis + hop-1 signature), or than what stands after /")
    report.print_ratios(result["ratios"])
    sizes = result["sizes"]
    report.print_title(f"Floors (planes {sizes['planes']}, {sizes['transforms, hop 1']} transforms)")
    report.print_timings(result["floors"])
    report.print_title("Times slower than the floor")
    report.print_ratios(result["floor_ratios"])
    return result


def run_accuracy() -> dict[str, float]:
    result = measure_accuracy()
    report.print_title("2. Accuracy: relative L2 error against the obvious NumPy in float64")
    report.print_values(result, "9.1e")
    return result


def run_conditions(rounds: int) -> dict[str, Any]:
    result = measure_conditions(rounds)
    report.print_title("3. Impairments, environment and waveforms on scenario S")
    report.print_timings(result["seconds"], unit="ms", factor=1e3)
    report.print_title("Times the synthesis by the impulse radar")
    report.print_ratios(result["ratios"])
    return result


def run_growth(quick: bool, rounds: int) -> list[dict[str, Any]]:
    result = measure_growth(QUICK_AXES if quick else AXES, rounds)
    report.print_title("4. Growth: min, median ms (least ms per unit of what varies, where time should follow it)")
    report.print_growth(result)
    return result


def run_workers(quick: bool, stages: dict[str, Any]) -> list[dict[str, Any]]:
    obvious = total(stages["seconds"]["obvious: synthesis"], stages["seconds"]["obvious: signature, hop 1"])
    counts = [2] if quick else [1, 2, 4] if (os.cpu_count() or 1) >= 4 else [1, 2]
    result = measure_workers(counts, 1.5 if quick else 4.0, obvious)
    report.print_title("5. Worker processes: examples with noise and features (x: one process of obvious NumPy)")
    report.print_workers(result)
    return result


def run_datasets(quick: bool) -> dict[str, Any]:
    with threadpool_limits(1):
        result = measure_datasets(2 if quick else 5, quick=quick)
    report.print_title("6. Examples of datasets: processor ms each")
    report.print_timings(result["seconds"], unit="ms", factor=1e3)
    report.print_values({key: value for key, value in result.items() if key != "seconds"}, "9.1f")
    result["builds"] = measure_builds(quick=quick)
    report.print_title("Builds and long recordings of fresh processes")
    report.print_values(result["builds"], "9.2f")
    return result


def run_startup(rounds: int) -> dict[str, Any]:
    result = measure_startup(rounds)
    report.print_title("7. Start-up: processor seconds (user + system) of a fresh process")
    report.print_timings(result["cpu_s"], unit="s", digits=3)
    report.print_title("Peak memory of the same processes")
    report.print_values(result["peak_mb"], "9.0f", "MB")
    return result


def run_all(rounds: int, quick: bool) -> dict[str, Any]:
    """All sections, printed one after the other."""
    results: dict[str, Any] = {"machine": machine()}
    print(", ".join(f"{name} {value}" for name, value in results["machine"].items()))
    with threadpool_limits(1):
        results["stages"] = run_stages(rounds)
        results["accuracy"] = run_accuracy()
        results["conditions"] = run_conditions(2 if quick else 5)
        results["growth"] = run_growth(quick, 2 if quick else 5)
    results["workers"] = run_workers(quick, results["stages"])
    results["datasets"] = run_datasets(quick)
    results["startup"] = run_startup(1 if quick else 4)
    results["asked"] = asked_rows(results)
    report.print_title("8. Asked and measured")
    report.print_asked(results["asked"])
    if hasattr(os, "getloadavg"):  # not on Windows
        print(f"load average now {os.getloadavg()}")
    return results


def positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("must be 1 or more")
    return number


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=positive, help="rounds of the stages (default 7; 2 with --quick)")
    parser.add_argument("--quick", action="store_true", help="few rounds, small growth: half a minute")
    parser.add_argument("--json", metavar="FILE", help="also write all figures to this file")
    arguments = parser.parse_args()
    results = run_all(arguments.rounds or (2 if arguments.quick else 7), arguments.quick)
    if arguments.json:
        with open(arguments.json, "w") as handle:
            json.dump(results, handle, indent=2)


if __name__ == "__main__":
    main()

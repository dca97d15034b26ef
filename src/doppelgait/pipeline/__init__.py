"""Simulation and analysis of one scene with one radar."""

from doppelgait.pipeline.analyze import analyze
from doppelgait.pipeline.radar_table import Conditions, Noise, parse_radar
from doppelgait.pipeline.result import Result, TargetList
from doppelgait.pipeline.result_files import Results, describe_results, read_results, write_results
from doppelgait.pipeline.run import Run, parse_run, run_simulation
from doppelgait.pipeline.simulate import choose_lowest_prf, simulate
from doppelgait.pipeline.tracking import Tracking

__all__ = [
    "Conditions",
    "Noise",
    "Result",
    "Results",
    "Run",
    "TargetList",
    "Tracking",
    "analyze",
    "choose_lowest_prf",
    "describe_results",
    "parse_radar",
    "parse_run",
    "read_results",
    "run_simulation",
    "simulate",
    "write_results",
]

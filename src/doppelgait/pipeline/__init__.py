"""One run: scene + radar -> recording -> results."""

from doppelgait.pipeline.analyze import TargetResult, analyze
from doppelgait.pipeline.echoes import Conditions, Noise
from doppelgait.pipeline.results import analysis_as_dict, read_results, result_as_dict, write_results
from doppelgait.pipeline.run import RunSpec, load_run, parse_radar, parse_run, run_example, run_simulation
from doppelgait.pipeline.simulate import simulate, with_lowest_prf
from doppelgait.pipeline.tracked import Tracking

__all__ = [
    "Conditions", "Noise", "RunSpec", "TargetResult", "Tracking", "analysis_as_dict", "analyze", "load_run",
    "parse_radar", "parse_run", "read_results", "result_as_dict", "run_example", "run_simulation", "simulate",
    "with_lowest_prf", "write_results",
]  # fmt: skip

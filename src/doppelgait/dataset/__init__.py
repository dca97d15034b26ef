"""Datasets: plan, build, verify, import, open, stream, export."""

from doppelgait.dataset.build import BuildReport, build_dataset
from doppelgait.dataset.config import PlanConfig, load_plan, plan_names
from doppelgait.dataset.example import Example, Features
from doppelgait.dataset.open import Dataset, open_dataset
from doppelgait.dataset.plan import plan_dataset
from doppelgait.dataset.rows import LabelledArrays
from doppelgait.dataset.stream import ExampleStream, stream_examples

__all__ = [
    "BuildReport",
    "Dataset",
    "Example",
    "ExampleStream",
    "Features",
    "LabelledArrays",
    "PlanConfig",
    "build_dataset",
    "load_plan",
    "open_dataset",
    "plan_dataset",
    "plan_names",
    "stream_examples",
]

"""Datasets: plan, build, open."""

from doppelgait.dataset.build import BuildReport, build_dataset
from doppelgait.dataset.config import PlanConfig, load_plan, plan_names
from doppelgait.dataset.open import Dataset, open_dataset
from doppelgait.dataset.plan import plan_examples

__all__ = [
    "BuildReport", "Dataset", "PlanConfig", "build_dataset", "load_plan", "open_dataset", "plan_examples", "plan_names",
]  # fmt: skip

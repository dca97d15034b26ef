"""What a process of the crash tests runs. Importing it compiles and loads everything, once, in the fork server."""

from __future__ import annotations

from pathlib import Path

from dataset_plans import tiny_plan
from doppelgait.dataset.build import build_dataset
from doppelgait.dataset.plan import plan_dataset
from doppelgait.dataset.shard import BuildContext, build_planned


def build(folder, executor):
    build_dataset(tiny_plan(), folder, executor=executor, workers=2)


def warm_up():
    plan = plan_dataset(tiny_plan(), folder=Path())
    for number in (0, 12):
        build_planned(plan.examples[number], BuildContext(plan.config, ".", "."))


warm_up()

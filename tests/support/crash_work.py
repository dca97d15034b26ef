"""What a process of the crash tests runs. Importing it compiles and loads everything, once, in the fork server."""

import os
import signal
import sys
from pathlib import Path

from dataset_plans import mini_plan
from doppelgait.core.errors import DatasetError
from doppelgait.dataset.build import build_dataset
from doppelgait.dataset.plan import plan_dataset
from doppelgait.dataset.shard import BuildContext, build_planned


def build_until(folder, number, after):
    """Build, and die at the ``number``-th file that takes its name: with it half written, or just complete."""
    real, left = os.replace, [number]

    def replace(source, target):
        left[0] -= 1
        if left[0] == 0 and after:
            real(source, target)
        if left[0] == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        real(source, target)

    os.replace = replace
    build_dataset(mini_plan(), folder, executor="serial")


def build_for(folder, calls):
    """Build, and die at the ``calls``-th call; returns how many a whole build takes."""
    left = [calls]

    def count(*_):
        left[0] -= 1
        if left[0] == 0:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.setprofile(count)
    build_dataset(mini_plan(), folder, executor="serial")
    sys.setprofile(None)
    return calls - left[0]


def build_or_refuse(folder):
    """Build, or end with status 3 where another process builds."""
    try:
        build_dataset(mini_plan(), folder, executor="serial")
    except DatasetError as error:
        sys.exit(3 if "is being built" in str(error) else 1)


def warm_up():
    plan = plan_dataset(mini_plan(), folder=Path())
    for number in (0, 2):
        build_planned([plan.examples[number]], BuildContext(plan.config, ".", "."))


warm_up()

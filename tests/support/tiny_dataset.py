"""Two small datasets for the tests of reading, exporting and streaming; built once per run."""

from functools import partial

import numpy as np

from doppelgait.dataset import PlanConfig, build_dataset
from shared_work import made_once

WALK = {"kind": "boulic", "speed_mps": {"uniform": [0.8, 1.6]}}
TROT = {"kind": "quadruped", "gait": "trot", "froude": {"uniform": [0.4, 1.0]}}


def tiny_plan(**dataset):
    """Every field in full precision; shapes differ in the truth only."""
    section = {
        "name": "tiny",
        "examples_per_class": 6,
        "shard_size": 3,
        "fractions": {"train": 0.5, "test": 0.5},
        "fields": [
            {"name": "signature", "dtype": "full"},
            "cadence_map",
            "baseband",
            "truth_range_m",
            "truth_radial_velocity_mps",
        ],
    }
    return PlanConfig.model_validate({
        "dataset": section | dataset,
        "scene": {"duration_s": 0.8},
        "target": {"range_m": {"uniform": [3.0, 4.0]}},
        "noise": {"kind": "snr", "snr_db": {"uniform": [5.0, 20.0]}},
        "classes": [{"label": "human", "motion": WALK}, {"label": "dog", "motion": TROT}],
    })  # fmt: skip


def mixed_plan():
    """Two targets in a scene, two pulse rates and so two shapes, half precision with every second column."""
    return PlanConfig.model_validate({
        "dataset": {
            "name": "mixed",
            "examples_per_class": 4,
            "fractions": {"train": 1.0},
            "fields": [{"name": "signature", "dtype": "half", "hop": 2}, "baseband"],
        },
        "scene": {"duration_s": 0.8},
        "target": {"range_m": 3.0},
        "companions": [{"label": "dog", "motion": TROT, "range_m": 5.0}],
        "radar": {"preset": "x4", "prf_hz": {"cycle": [800, 1000]}},
        "classes": [{"label": "human", "motion": WALK}],
    })  # fmt: skip


def built(tmp_path_factory, plan):
    """Folder of the built plan; all tests share it and do not change it."""
    make = partial(build_dataset, plan, executor="serial")
    return made_once(tmp_path_factory, f"dataset-{plan.dataset.name}", make)


def sum_signatures(dataset):
    """Sum of all signatures; a worker process can import it."""
    return sum(float(dataset.array("signature", number).sum(dtype=np.float64)) for number in range(len(dataset)))

"""Batches of examples: each is as if it were made alone."""

from typing import Literal

import numpy as np
import pytest

from checkout import ROOT
from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import ConfigError, warn_caller
from doppelgait.dataset.config import load_plan
from doppelgait.dataset.plan import plan_dataset
from doppelgait.dataset.shard import BuildContext
from doppelgait.motion.models.boulic import boulic_walk


def make_all(plan, size):
    """Return rows, bytes of arrays and failures of a plan's examples, made some at a time."""
    context = BuildContext(plan.config, str(plan.folder), ".")
    made = [data for n in range(0, len(plan.examples), size) for data in context.make(plan.examples[n : n + size])]
    return [(data.rows, [{k: v.tobytes() for k, v in a.items()} for a in data.arrays], data.failures) for data in made]


@pytest.mark.parametrize("name", ["home-alarm", str(ROOT / "examples" / "rooms-plan.toml")])
def test_bytes_do_not_depend_on_the_batch(name):
    config, folder = load_plan(name, overrides=["dataset.examples_per_class=7"])
    plan = plan_dataset(config, folder=folder)
    alone = make_all(plan, 1)
    assert not any(failures for _, _, failures in alone)
    assert make_all(plan, 4) == make_all(plan, 16) == alone


def test_a_batch_is_bounded_by_its_time_and_its_bytes():
    long, large = ["scene.duration_s={uniform=[10,30]}"], ["radar={preset='ti-77'}", "analysis.parts=true"]
    for size, changes in ((16, []), (3, long), (8, large), (9, ['dataset.fields=["baseband"]'])):
        assert BuildContext(load_plan("home-alarm", overrides=changes)[0], ".").batch_size == size


class Moody(FrozenModel):
    kind: Literal["moody"] = "moody"
    mood: str = "calm"


def test_warnings_and_faults_are_those_of_their_example(register):
    @register("motion_model", parameters=Moody)
    def walk_moodily(parameters: Moody, duration_s: float, rng: np.random.Generator | None):
        if parameters.mood == "angry":
            raise ConfigError("mood: is too bad to walk")
        if parameters.mood == "sour":
            warn_caller("sour_mood: walks all the same")
        return boulic_walk(duration_s=duration_s)

    moods = ["calm", "calm", "sour", "calm", "angry", "calm"]
    config, folder = load_plan("home-alarm", overrides=["dataset.examples_per_class=6"])
    section = config.classes[0].model_copy(update={"motion": {"kind": "moody", "mood": {"cycle": moods}}})
    plan = plan_dataset(config.model_copy(update={"classes": (section,)}), folder=folder)
    made = make_all(plan, 6)
    assert [[row["warnings"] for row in rows] for rows, _, _ in made] == [[""], [""], ["sour_mood"], [""], [], [""]]
    assert [len(failures) for _, _, failures in made] == [0, 0, 0, 0, 1, 0]
    assert "mood: is too bad to walk" in made[4][2][0]["reason"]
    assert make_all(plan, 4) == make_all(plan, 1) == made  # the first four without the fault

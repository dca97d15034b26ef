"""Every registered model: its name alone gives a motion, and what is out of its range is refused."""

import inspect
import pickle

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import ConfigError
from doppelgait.core.keys import list_keys
from doppelgait.motion.models.registry import check_table, generate, generate_all

MODELS = {
    # kind: (function, species, gait)
    "boulic": (dg.motion.models.boulic_walk, "human", "walk"),
    "breathing": (dg.motion.models.breathing_person, "human", "stand"),
    "crawl": (dg.motion.models.crawling_person, "human", "crawl"),
    "curtain": (dg.motion.models.curtain, "", ""),
    "fan": (dg.motion.models.fan, "", ""),
    "human": (dg.motion.models.human_gait, "human", "walk"),
    "pendulum": (dg.motion.models.pendulum, "", ""),
    "point": (dg.motion.models.moving_point, "", ""),
    "quadruped": (dg.motion.models.quadruped_gait, "dog", "trot"),
    "rotor": (dg.motion.models.rotor, "", ""),
    "vacuum": (dg.motion.models.robot_vacuum, "", ""),
}
STRIDES = ("human", "quadruped", "boulic", "crawl")
LONG_STEPS = {"gait": "walk", "speed_mps": 2.5, "walk_ratio": 1.4, "step_length_sd": 0.1, "length_asymmetry": 0.4}


def test_a_table_is_checked_again_after_a_change_only():
    first = check_table({"kind": "boulic"})
    second = check_table(first)
    assert second.parameters is first.parameters
    second["speed_mps"] = 0.6
    assert (check_table(second).parameters.speed_mps, "speed_mps" in first) == (0.6, False)
    third = check_table({"kind": "boulic", "speed_mps": 1.0})
    for third["speed_mps"] in (True, np.array([1.0, 2.0])):  # True equals 1.0, and an array has no truth value
        with pytest.raises(ConfigError):
            check_table(third)


@pytest.mark.parametrize("kind", MODELS)
def test_each_name_alone_gives_a_motion(kind):
    make, species, gait = MODELS[kind]
    motion = dg.motion.models.generate(kind, duration_s=2.0)
    np.testing.assert_array_equal(motion.position_m, make(duration_s=2.0).position_m)
    facts = motion.facts
    assert (facts.kind, facts.source, facts.species, facts.gait) == (kind, kind, species, gait)
    assert float(motion.time_s[-1]) == 2.0
    assert motion.position_m[..., 2].min() >= (-1e-5 if kind == "boulic" else 0.0)


def test_motions_of_a_batch_are_those_made_alone():
    base = [{"kind": kind, "rate_hz": rate_hz, "start_phase": 0.3} for rate_hz in (100.0, 250.0) for kind in STRIDES]
    models = base + [model | {"pace_sd": 0.02} for model in base]
    models += [{"kind": "quadruped", "gait": gait, "length_asymmetry": 0.02} for gait in ("walk", "gallop")]
    models += [{"kind": "human", "gait": "run", "speed_mps": 3.1}, {"kind": "human", "left_hand": "bag"}]
    models += [{"kind": "human", "foot_lock": False}, {"kind": "fan"}]
    durations_s = [1.0 + 0.13 * number for number in range(len(models))]
    rngs = [np.random.default_rng(n) for n in range(len(models))]
    together = generate_all(models, durations_s=durations_s, rngs=rngs)
    for number, (model, duration_s, motion) in enumerate(zip(models, durations_s, together, strict=True)):
        alone, other = (generate(model, duration_s=duration_s, rng=np.random.default_rng(number + n)) for n in (0, 1))
        assert alone.position_m.tobytes() == motion.position_m.tobytes(), model
        assert (repr(alone.facts), alone.report) == (repr(motion.facts), motion.report)
        assert alone.time_s.tobytes() == motion.time_s.tobytes()
        assert (other.position_m.tobytes() == motion.position_m.tobytes()) is ("pace_sd" not in model)


@pytest.mark.parametrize(("setting", "memory", "share"), [("stride_variation", 0.5, 0), ("pace_sd", 0.56, 0.5)])
@pytest.mark.parametrize(
    ("kind", "foot"), [("quadruped", "left_hind"), ("boulic", "right_foot"), ("crawl", "right_hand")]
)
def test_strides_vary_with_the_given_deviation_and_memory(kind, foot, setting, memory, share):
    make, sd = MODELS[kind][0], 0.06
    motion = make(**{setting: sd}, duration_s=1500, rate_hz=50, rng=np.random.default_rng(7))
    lands_s, body = np.array(motion.facts.footfalls[foot]), "rump" if kind == "quadruped" else "base"
    x = motion.position_m[:, motion.markers.index(body), 0]
    length = np.log(np.diff(np.interp(lands_s, motion.time_s, x)))
    speed = length - np.log(np.diff(lands_s))
    # 1,100 to 2,900 strides: four standard errors
    assert speed.std() == pytest.approx(sd, rel=4 * 0.03)
    assert np.corrcoef(speed[1:], speed[:-1])[0, 1] == pytest.approx(memory, abs=4 * 0.03)
    assert np.polyfit(speed, length, 1)[0] == pytest.approx(share, abs=0.02)
    assert np.exp(speed.mean()) == pytest.approx(np.ptp(make(duration_s=60).position_m[:, 0, 0]) / 60, rel=0.02)


@pytest.mark.parametrize(
    ("kind", "options", "expected"),
    [
        ("boulic", {"speed_mps": 2.7, "height_m": 1.8}, "2.7|1.8|2.65 m/s"),
        ("boulic", {"speed_mps": float("nan")}, "speed_mps|nan"),
        ("boulic", {"height_m": 0.3}, "height_m|0.3|0.6"),
        ("boulic", {"form": "chen"}, "form|chen|chen2011"),
        ("boulic", {"duration_s": float("inf")}, "duration_s|inf"),
        ("human", {"gait": "walk", "speed_mps": 3}, "speed_mps|3|2.58|walk"),
        ("human", {"gait": "run", "speed_mps": 1.0}, "speed_mps|1.8|9|run"),
        ("human", {"gait": "run", "speed_mps": 3, "foot_lock": False}, "foot_lock|run"),
        ("human", {"body": "child", "height_m": 1.75}, "height_m|1.75|child|1.6"),
        ("human", {"left_hand": "waving"}, "left_hand|waving|pockets"),
        ("human", {"step_time_sd": 0.02}, "step_time_sd = 0.02|rng"),
        ("human", {**LONG_STEPS, "rng": np.random.default_rng(0)}, "too long|walk_ratio"),
        ("quadruped", {"gait": "trot", "withers_m": 0.5, "speed_mps": 5.0}, "5|trot|1.08 to 3.13 m/s"),
        ("quadruped", {"gait": "gallop", "withers_m": 0.5, "speed_mps": 1.0}, "1|gallop|2.17 to 6.26 m/s"),
        ("quadruped", {"gait": "hop"}, "gait|hop|transverse_gallop"),
        ("quadruped", {"gait": "auto"}, "'auto' depends on the speed: give speed_mps or froude"),
        ("quadruped", {"gait": "auto", "speed_mps": 7.0}, "7 is not allowed: a dog|2.17 to 6.26 m/s in a gallop"),
        ("quadruped", {"gait": "auto", "speed_mps": 0.1}, "moves at 0.313 to 1.4 m/s in a walk"),
        ("quadruped", {"froude": 1.0, "speed_mps": 2.0}, "speed_mps or froude, not both"),
        ("quadruped", {"build": "cat", "gait": "walk", "speed_mps": 2.0}, "a cat with withers_m = 0.25"),
        ("quadruped", {"withers_m": 1.2}, "withers_m|1.2|0.15 to 0.9"),
        ("quadruped", {"step_length_sd": 0.05}, "step_length_sd = 0.05|rng"),
        ("vacuum", {"brush_hz": 20, "rate_hz": 100}, "rate_hz|100|16|brush_hz"),
        ("curtain", {"drop_m": 3}, "rail_height_m|2|3"),
        ("fan", {"rotation_hz": 60, "rate_hz": 500}, "rate_hz|500|rotation_hz"),
        ("crawl", {"speed_mps": 0.8, "height_m": 0.9}, "speed_mps|0.8|0.77"),
        ("crawl", {"pace_sd": 0.05}, "pace_sd|0.05|rng"),
        ("pendulum", {"length_m": 2.0}, "pivot_height_m|1|2"),
        ("rotor", {"radius_m": 1.5}, "hub_height_m|1|1.5"),
        ("rotor", {"plane": "zz"}, "plane|zz|xz"),
    ],
)
def test_what_is_out_of_range_is_refused_with_the_value_and_the_range(kind, options, expected):
    with pytest.raises(ConfigError) as caught:
        MODELS[kind][0](**options)
    assert [text for text in expected.split("|") if text not in str(caught.value)] == []


@pytest.mark.parametrize("kind", MODELS)
def test_a_function_refuses_and_shows_the_parameters_of_its_model(kind):
    make, model = MODELS[kind][0], dg.motion.models.MOTION_MODELS[kind].parameters
    with pytest.raises(ConfigError, match=rf"^{make.__name__}: speed: unknown parameter; allowed are ") as caught:
        make(speed=1.0)
    own = [name for name in model.model_fields if name != "kind"]
    assert str(caught.value).split("allowed are ")[1].split(", ") == sorted([*own, "duration_s", "rng"])
    shown = inspect.signature(make).parameters
    assert list(shown) == ["duration_s", "rng", *own]
    assert [shown[name].default for name in own] == [model.model_fields[name].default for name in own]
    assert make().duration_s == shown["duration_s"].default
    for key in list_keys(model)[1:]:
        facts = ", ".join(filter(None, (key.unit, key.limits, key.default and f"default {key.default}"))).replace(
            "`", ""
        )
        for text in (make.__doc__, model.__doc__):
            entry = text.split(f"\n{key.key} : ")[1].split("\n")
            assert facts in entry[0]
            assert entry[1].startswith("    ")
            assert key.description.startswith(entry[1].strip())
    assert getattr(dg.motion, make.__name__) is pickle.loads(pickle.dumps(make))

"""Plans whose preset holds distributions: one sensor per example."""

from pathlib import Path

import numpy as np
import pytest

from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset import PlanConfig, build_dataset, plan_dataset
from doppelgait.dataset.finish import compute_dataset_id
from doppelgait.dataset.verify import verify_dataset
from doppelgait.pipeline import Run
from doppelgait.radar import Radar
from doppelgait.viewer.examples import check_files

SENSOR = """
carrier_hz = 7.29e9
prf_hz = 200
sample_rate_hz = 23.328e9
decimation = 8
range_stop_m = 9.6
bandwidth_hz = 1.4e9
noise_figure_db = { normal = [8.0, 1.5] }

[[impairments]]
kind = "static_clutter"
levels = [[0.5, { normal = [-60.0, 3.0] }], [8.0, -90.0]]

[[impairments]]
kind = "phase_noise"
white_rad = { uniform = [0.001, 0.003] }
"""


def plan_of(preset: str, **radar: object) -> PlanConfig:
    section = {"name": "sensors", "examples_per_class": 40}
    classes = [{"label": "human", "motion": {"kind": "boulic"}}]
    return PlanConfig(dataset=section, classes=classes, radar={"preset": preset, **radar})


@pytest.fixture
def sensor(tmp_path: Path) -> Path:
    path = tmp_path / "my-sensor.toml"
    path.write_text(SENSOR, encoding="utf-8")
    return path


def test_every_example_draws_its_sensor_from_the_file(sensor: Path) -> None:
    laid_out = plan_dataset(plan_of("my-sensor.toml"), folder=sensor.parent)
    runs = [laid_out.example(n).run for n in range(40)]
    figures = np.array([run.radar.noise_figure_db for run in runs])
    jitters = np.array([run.impairments[1].white_rad for run in runs])
    levels = np.array([run.impairments[0].levels[0][1] for run in runs])
    assert abs(figures.mean() - 8.0) < 4 * 1.5 / np.sqrt(40)
    assert 1.0 < figures.std() < 2.1
    assert 0.001 <= jitters.min() < 0.0015 < 0.0025 < jitters.max() <= 0.003
    assert 2.0 < levels.std() < 4.2
    for one, other in ((figures, jitters), (figures, levels), (jitters, levels)):  # streams of their own
        assert abs(np.corrcoef(one, other)[0, 1]) < 0.5
    assert {run.impairments[0].levels[1][1] for run in runs} == {-90.0}


def test_a_key_of_the_plan_replaces_a_draw_and_shifts_no_other(sensor: Path) -> None:
    sampled = plan_dataset(plan_of("my-sensor.toml"), folder=sensor.parent).example(3).run
    fixed = plan_dataset(plan_of("my-sensor.toml", noise_figure_db=5.0), folder=sensor.parent).example(3).run
    assert fixed.radar.noise_figure_db == 5.0
    assert fixed.impairments == sampled.impairments


@pytest.mark.parametrize(
    ("name", "content", "is_same"),
    [
        ("deep/other.toml", SENSOR, True),
        ("my-sensor.toml", "# measured in March\n" + SENSOR.replace(" = ", "  =  "), True),
        ("my-sensor.toml", SENSOR.replace("1.5]", "1.6]"), False),
    ],
)
def test_the_identity_is_that_of_the_content_not_of_path_and_comments(
    sensor: Path, name: str, content: str, is_same: bool
) -> None:
    here = compute_dataset_id(plan_of("my-sensor.toml"), sensor.parent)
    (sensor.parent / "deep").mkdir()
    (sensor.parent / name).write_text(content, encoding="utf-8")
    assert (compute_dataset_id(plan_of(name), sensor.parent) == here) == is_same


def test_elsewhere_the_middle_counts_and_a_scene_draws_by_its_seed(sensor: Path) -> None:
    assert Radar.preset(sensor).noise_figure_db == 8.0
    scene = sensor.parent / "scene.toml"
    text = 'seed = {}\nduration_s = 2\n[radar]\npreset = "my-sensor.toml"\n'
    found = []
    for seed in (1, 1, 2):
        scene.write_text(text.format(seed), encoding="utf-8")
        found.append(Run.from_toml(scene).radar.noise_figure_db)
    assert found[0] == found[1] != found[2]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("normal = [8.0, 1.5]", "normal = [8.0, -1]", "noise_figure_db: normal = .*: needs a mean and a standard"),
        ("normal = [8.0, 1.5]", "gauss = [8.0, 1]", r"noise_figure_db = \{'gauss'.*uniform, log_uniform, normal"),
        ("noise_figure_db", "noise_figur_db", "noise_figur_db: unknown key; .*mean noise_figure_db"),
    ],
)
def test_errors_name_the_file_and_the_key(sensor: Path, old: str, new: str, said: str) -> None:
    sensor.write_text(SENSOR.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError, match=f"radar.preset my-sensor.toml: {said}"):
        plan_dataset(plan_of("my-sensor.toml"), folder=sensor.parent).example(0)
    if "-1" in new:  # an impossible draw is refused where the middle counts, too
        with pytest.raises(ConfigError, match=r"my-sensor.toml: noise_figure_db: normal = \[8.0, -1\]"):
            Radar.preset(sensor)
    with pytest.raises(ConfigError, match=r"radar.preset none.toml: .*none.toml: cannot be read"):
        plan_dataset(plan_of("none.toml"), folder=sensor.parent).example(0)


def test_values_in_place_of_the_file_change_no_identity(sensor: Path) -> None:
    config = plan_of({"choice": ["my-sensor.toml", "x4"]})
    stored = plan_dataset(config, folder=sensor.parent).config
    assert stored.radar["preset"]["choice"][1] == "x4"
    assert compute_dataset_id(stored, sensor.parent / "elsewhere") == compute_dataset_id(config, sensor.parent)
    # as before the values were stored
    assert compute_dataset_id(plan_of("my-sensor.toml"), sensor.parent) == "5678662cd93f453a"


def build_small(sensor: Path) -> Path:
    """Build two examples of the plan of a sensor."""
    target = sensor.parent / "built"
    config = plan_of("my-sensor.toml").model_dump()
    config["dataset"] |= {"examples_per_class": 2, "fractions": {"train": 0.5, "test": 0.5}}
    config["scene"] = {"duration_s": 1.0}
    build_dataset(PlanConfig.model_validate(config), target, folder=sensor.parent, executor="serial")
    return target


def test_a_build_with_a_changed_radar_file_shows_the_difference(sensor: Path) -> None:
    target = build_small(sensor)
    text = sensor.read_text(encoding="utf-8")
    sensor.write_text(text.replace("range_stop_m = 9.6", "range_stop_m = 8.6"), encoding="utf-8")
    with pytest.raises(DatasetError, match=r"\(radar.preset.values.range_stop_m: 9.6 -> 8.6\)"):
        build_small(sensor)
    sensor.unlink()
    found = verify_dataset(target, folder=sensor.parent, rng=np.random.default_rng(0))
    assert found.check("identity").status == "passed"
    assert found.check("re-simulation").status == "passed"


def test_the_viewer_simulates_with_stored_values_and_opens_no_radar_file(sensor: Path) -> None:
    config = plan_of("my-sensor.toml")
    check_files(plan_dataset(config, folder=sensor.parent).config, 0, None)
    with pytest.raises(DatasetError, match=r"'my-sensor.toml', which is not part of the dataset"):
        check_files(config, 0, None)

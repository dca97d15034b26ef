"""What "Try it" offers, what it simulates, mistakes in one sentence, and the scene file."""

from urllib.parse import urlencode

import numpy as np
import pytest

from doppelgait.core.config import validate, write_toml
from doppelgait.core.errors import ConfigError
from doppelgait.motion.models.registry import MOTION_MODELS
from doppelgait.pipeline import Run, run_simulation
from doppelgait.viewer import try_it as page
from viewer_client import served

pytestmark = pytest.mark.filterwarnings("ignore::doppelgait.core.errors.DoppelgaitWarning")
SHORT = {"duration_s": "2", "radar": "x4-255fps", "range_m": "3"}


@pytest.mark.parametrize("who", ["person", "dog", "cat", "fan", "curtain", "vacuum"])
def test_every_target_can_be_simulated_as_it_stands(who):
    run = page.run_of({"who": who, **SHORT})
    recording = run.require_recording()
    assert recording.n_pulses == 510
    assert [truth.label for truth in recording.truth] == ["human" if who == "person" else who]
    assert np.abs(recording.baseband.values).max() > 0


def test_what_is_asked_for_is_what_is_analysed():
    given = {"who": "dog", "speed_mps": "2", "withers_m": "0.6", "aspect_deg": "180", "cpi_s": "0.15"}
    run = page.run_of({**given, **SHORT, "radar": "x4-512fps"})
    truth = run.require_recording().truth[0]
    assert (truth.height_m, truth.gait) == (0.6, "trot")
    assert truth.ground_speed_mps == pytest.approx(2.0, rel=0.03)
    target = run.targets(None)[0].result
    assert target.gate_source == "truth"
    assert target.signature.attrs["cpi_pulses"] == 77  # 0.15 s at 512 Hz, odd
    assert target.features.torso_velocity_mps == pytest.approx(-2.0, rel=0.1)  # receding


def test_two_go_side_by_side_a_metre_apart():
    run = page.run_of({"company": "dog", "aspect_deg": "30", **SHORT})
    bodies = [truth.body.mean("marker").values for truth in run.require_recording().truth]
    apart = bodies[1][:, :2] - bodies[0][:, :2]
    assert np.hypot(*apart.T) == pytest.approx(1.0, abs=0.25)  # centres of the points, which legs move
    way = bodies[0][-1, :2] - bodies[0][0, :2]
    assert abs(apart.mean(axis=0) @ way) < 0.15 * np.hypot(*way)  # beside, not behind
    assert [target.result.label for target in run.targets(None)] == ["human", "dog"]


def test_the_same_values_give_the_same_data_and_the_seed_another():
    first, again, other = (page.run_of({"seed": seed, **SHORT}).require_recording() for seed in ("3", "3", "4"))
    assert np.array_equal(first.baseband.values, again.baseband.values)
    assert not np.array_equal(first.baseband.values, other.baseband.values)
    assert np.isinf(page.run_of({"noise": "off", **SHORT}).require_recording().snr_frame_db)
    assert page.run_of({"snr_db": "10", **SHORT}).require_recording().snr_frame_db == pytest.approx(10.0, abs=0.5)


def test_warnings_become_notes():
    assert not page.run_of({"range_m": "3", "duration_s": "2"}).notes
    notes = page.run_of({"speed_mps": "4", **SHORT}).notes
    assert any(note.startswith("aliasing") for note in notes)
    assert any(note.startswith("outside the frame") for note in notes)


@pytest.mark.parametrize(("given", "says"), [
    ({"who": "dog", "gait": "gallop", "speed_mps": "0.5"}, r"^speed_mps: 0\.5 .* 2\.17 to 6\.26 m/s in a gallop"),
    ({"range_m": "12"}, r"^range_m: 12 .* radar x4 covers 0 to 9\.66 m; use x4-long or a smaller range$"),
    ({"range_m": "5.1", "radar": "x4-255fps"}, r"^range_m: 5\.1 .* x4-255fps covers 0\.386 to 5\.06 m; "),
    ({"gait": "run", "speed_mps": "0.5"}, r"^speed_mps: 0\.5 .* 1\.8 to 9 m/s in a run"),
    ({"speed_mps": "11"}, r"^speed_mps: '11' is not allowed; it must be a number from 0\.3 to 10$"),
    ({"who": "vacuum", "speed_mps": "2"}, r"from 0\.05 to 1$"),
    ({"speed_mps": "nan"}, r"from 0\.3 to 10$"),
    ({"seed": "1.5"}, r"^seed: '1\.5' .* whole number"),
    ({"who": "cow"}, r"^who: 'cow' is not allowed; it must be one of person, dog, cat"),
    ({"gait": "trot"}, r"^gait: 'trot' is not allowed; it must be one of auto, walk, run$"),
    ({"who": "dog", "height_m": "1.7"}, r"^height_m: is not available for who = dog; it is for person$"),
    ({"radar": "../../etc/passwd"}, r"^radar: .* must be one of acconeer-a121, "),
    ({"mass_kg": "80"}, r"^mass_kg: is not a control"),
])  # fmt: skip
def test_a_mistake_is_one_sentence_that_says_what_is_allowed(given, says):
    with pytest.raises(ConfigError, match=says):
        page.run_of(given)


@pytest.mark.parametrize(
    "given",
    [
        {"aspect_deg": "-20", "snr_db": "12.5"},
        {"who": "dog", "gait": "trot", "speed_mps": "2", "company": "person", "noise": "off"},
        {"who": "fan", "rotation_hz": "2.5"},
    ],
)
def test_the_scene_file_gives_the_same_baseband(tmp_path, given):
    parameters = {**given, **SHORT}
    (tmp_path / "scene.toml").write_text(write_toml(page.make_scene_table(parameters)), encoding="utf-8")
    again = run_simulation(Run.from_toml(tmp_path / "scene.toml"))
    assert np.array_equal(again.baseband.values, page.run_of(parameters).require_recording().baseband.values)


@pytest.mark.parametrize("given", [
    {"range_m": "1"},
    {"range_m": "1", "aspect_deg": "80", "company": "dog"},
    {"range_m": "1.2", "aspect_deg": "-90", "company": "person"},  # the second one passes between
    {"range_m": "4", "aspect_deg": "10", "speed_mps": "3"},
    {"range_m": "3", "aspect_deg": "170", "speed_mps": "5", "company": "dog"},
    {"range_m": "1", "radar": "acconeer-a121"},  # sees from 1.385 m
])  # fmt: skip
def test_nobody_comes_nearer_than_a_metre_and_the_page_says_so(given):
    low = 1.385 if given.get("radar") else 1.0
    run = page.run_of({**given, "noise": "off"})
    ways = [truth.body.mean("marker").values[:, :2] for truth in run.require_recording().truth]
    radar = run.require_recording().radar_position_m
    nearest = min(np.hypot(*(way - radar[:2]).T).min() for way in ways)
    assert low - 0.25 < nearest < low + 0.25  # legs move the mean of the points; no farther than needed
    assert run.notes[0].startswith(f"range: {page.make_scene_table(given)['targets'][0]['range_m']:g} m in the middle")


def test_a_range_that_is_far_enough_stays():
    for given in ({"range_m": "3.4"}, {"range_m": "1", "who": "fan"}, {"range_m": "15", "radar": "xband-cw"}):
        assert page.make_scene_table(given)["targets"][0]["range_m"] == float(given["range_m"])
    assert (
        page.make_scene_table({"range_m": "1", "who": "fan", "radar": "acconeer-a121"})["targets"][0]["range_m"] == 1.4
    )


def limits_of(name, **values):
    control = next(control for control in page.list_controls() if control.name == name)
    fits = [limit for limit in control.limits if all(values.get(key) == value for key, value in limit.when.items())]
    scales = [float(values[limit.size]) ** limit.power if limit.size else 1.0 for limit in fits]
    lows = [limit.low * scale for limit, scale in zip(fits, scales, strict=True) if limit.low is not None]
    highs = [limit.high * scale for limit, scale in zip(fits, scales, strict=True) if limit.high is not None]
    return max(lows), min(highs)


def motions(given):
    table = page.make_scene_table({key: str(value) for key, value in given.items()})
    for motion in (target["motion"] for target in table["targets"]):
        model = MOTION_MODELS[motion["kind"]]
        validate(model.parameters, {key: value for key, value in motion.items() if key != "kind"}, where="motion")


@pytest.mark.parametrize("given", [
    {"who": "person", "gait": "run", "height_m": 1.3},
    {"who": "person", "gait": "walk", "height_m": 2.0},
    {"who": "person", "gait": "auto", "height_m": 0.9},
    {"who": "dog", "gait": "gallop", "withers_m": 0.3},
    {"who": "dog", "gait": "auto", "withers_m": 0.7},
    {"who": "cat", "gait": "trot", "withers_m": 0.2},
    {"who": "cat", "gait": "auto", "withers_m": 0.2, "company": "dog"},
])  # fmt: skip
def test_the_limits_of_the_speed_are_those_of_the_models(given):
    low, high = limits_of("speed_mps", **given)
    own = next(control for control in page.list_controls() if control.name == "speed_mps").by_who.get(given["who"], {})
    compared = 0
    for inside, outside in ((low * 1.001, low * 0.999), (high * 0.999, high * 1.001)):
        if own.get("low", 0.3) <= min(inside, outside) and max(inside, outside) <= own.get("high", 10.0):
            motions({**given, "speed_mps": inside})
            with pytest.raises(ConfigError, match="speed_mps"):
                motions({**given, "speed_mps": outside})
            compared += 1
    assert compared


def test_the_limits_of_the_range_are_those_of_the_frame():
    assert limits_of("range_m", radar="x4") == (0.0, 9.664)
    limits = next(control["limits"] for control in page.describe_controls() if control["name"] == "range_m")
    assert {"when": {"radar": "xband-cw"}, "low": 0.0, "high": None, "size": "", "power": 1.0} in limits


def test_the_server_gives_the_scene_file_or_the_mistake():
    short = urlencode({"try": "1", **SHORT})
    with served(None) as client:
        assert client.facts(f"scene?{short}")["toml"].startswith("# doppelgait simulate")
        assert "speed_mps" in client.fault("scene?try=1&speed_mps=11")
        assert "try" in client.fault("scene")
        sound = client.get(f"sound?{short}&channels=sides")
        assert (sound.status, sound.body[:4]) == (200, b"RIFF")

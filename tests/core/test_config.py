"""Configuration: every fault is one ConfigError that names key, line, value and what is allowed."""

import re
from importlib import import_module

import pytest

import doppelgait as dg
from doppelgait.classify.model_file import open_model
from doppelgait.core import config
from doppelgait.core.errors import ConfigError
from doppelgait.core.plugins import list_plugin_groups
from doppelgait.data import DEMO
from doppelgait.dataset.config import PlanConfig, load_plan
from doppelgait.pipeline import Noise, Run, parse_radar, parse_run
from doppelgait.processing import Analysis
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target

SCENE = """\
seed = 3
duration_s = 2.0

[radar]
preset = "x4"
prf_hz = 900

[noise]
kind = "snr"
snr_db = 15.0

[analysis]
cpi_s = 0.1
gate_span_m = 1.2

[[targets]]
label = "human"
range_m = 5.0
[targets.motion]
kind = "boulic"
speed_mps = 1.1

[[targets]]
label = "child"
range_m = 6.0
motion = { kind = "boulic", speed_mps = 0.9, height_m = 1.2 }
"""


@pytest.fixture
def scene_file(tmp_path):
    def write(old="", new=""):
        assert old in SCENE
        path = tmp_path / "scene.toml"
        path.write_text(SCENE.replace(old, new, 1) if old else SCENE)
        return path

    return write


def fault(path, *overrides):
    with pytest.raises(ConfigError) as caught:
        Run.from_toml(path, overrides=overrides)
    return str(caught.value)


def line_in(text, needle):
    return next(n for n, row in enumerate(text.splitlines(), start=1) if needle in row)


# (old, new, dotted key, text of the faulty line or "", value or "", what is allowed)
FAULTS = [
    ("cpi_s = 0.1", "cpi = 0.1", "analysis.cpi", "cpi = 0.1", "", "cpi_s"),
    ("cpi_s = 0.1", 'cpi_s = "long"', "analysis.cpi_s", "cpi_s =", "'long'", "number"),
    ("cpi_s = 0.1", "cpi_s = -0.1", "analysis.cpi_s", "cpi_s =", "-0.1", "greater than 0"),
    ("cpi_s = 0.1", "cpi_s = nan", "analysis.cpi_s", "cpi_s =", "nan", "finite"),
    ("cpi_s = 0.1", 'method = "best"', "analysis.method", "method =", "'best'", "'standard' or 'liland2018'"),
    ("cpi_s = 0.1", "doppler_bins = 12.5", "analysis.doppler_bins", "doppler_bins", "12.5", "integer"),
    ("cpi_s = 0.1", "gate_doppler_hz = [50, -50]", "analysis", "[analysis]", "", "must rise"),
    ("snr_db = 15.0", "snr_db = 1000", "noise.snr_db", "snr_db =", "1000", "less than or equal to 200"),
    ('kind = "snr"', 'kind = "pink"', "noise.kind", 'kind = "pink"', "'pink'", "'thermal', 'snr' or 'none'"),
    ("seed = 3", "seed = -3", "seed", "seed =", "-3", "greater than or equal to 0"),
    ("range_m = 6.0", "range_m = -6.0", "targets.1.range_m", "range_m = -6.0", "-6.0", "greater than 0"),
    ("range_m = 5.0", "colour = 9", "targets.0.colour", "colour = 9", "", "aspect_deg"),
    ("range_m = 5.0", "start_position_m = [1]", "targets.0.start_position_m", "start_position_m", "", "required"),
    ("prf_hz = 900", "prf = 900", "radar", "prf = 900", "", "prf_hz"),
    ("prf_hz = 900", 'prf_hz = "900"', "prf_hz", "", "'900'", "number"),
    ("prf_hz = 900", "bandwidth_hz = 1e9\npulse_sigma_s = 1e-9", "", "", "", "exactly one of bandwidth_hz and"),
    ('preset = "x4"', 'preset = "x5"', "preset", "preset =", "'x5'", "x4-long"),
    ("seed = 3", "sed = 3", "sed", "sed =", "", "seed"),
    ('kind = "boulic"\n', "", "kind", "", "", ""),
    ('kind = "boulic"', 'kind = "moonwalk"', "targets.0.motion", "[targets.motion]", "moonwalk", "boulic"),
    ("speed_mps = 1.1", "speed_mps = 11", "targets.0.motion.speed_mps", "speed_mps = 11", "11", "a walker"),
]


@pytest.mark.parametrize(("old", "new", "key", "line", "value", "allowed"), FAULTS)
def test_a_fault_names_file_key_value_and_what_is_allowed(scene_file, old, new, key, line, value, allowed):
    path = scene_file(old, new)
    message = fault(path)
    assert str(path) in message
    assert key in message
    assert value in message
    assert allowed in message
    if line:
        assert re.search(rf"\bline {line_in(path.read_text(), line)}\b", message)


def test_noise_has_one_level(scene_file):
    message = fault(scene_file('kind = "snr"', 'kind = "thermal"'))
    assert "noise (line" in message
    assert "kind = 'thermal' and snr_db = 15 both set the noise level: leave snr_db out" in message
    with pytest.raises(ConfigError, match="kind = 'thermal' and snr_db = 3 both set"):
        Noise(snr_db=3)
    for noise in (Noise(), Noise(kind="snr"), Noise(kind="snr", snr_db=3), Noise(kind="none")):
        assert Noise.model_validate_json(noise.model_dump_json()) == noise
    assert dg.Noise is Noise
    assert Noise(kind="none", snr_db=3).kind == "none"  # --set noise.kind=none turns off the noise of a file


# --- Python -------------------------------------------------------------------------------------------------------


PLAN = {"dataset": {"name": "a", "examples_per_class": 3}, "classes": [{"label": "a"}]}
WRONG = ("x", -1, float("nan"), None, {}, [1], {"a": 1}, (1, "x", {}), True, object())
LEAKS = re.compile(
    r"pydantic|Input should|\[type=|function-|valid dictionary|instance of|\[key\]|\.(list|dict|tuple)\["
)
"""What only somebody who knows pydantic can read."""


def test_no_wrong_value_of_any_key_leaks_the_library_that_checks_it() -> None:
    for group in list_plugin_groups().values():
        group.values()
    for module in ("dataset.config", "dataset.motions", "classify.alarm", "pipeline.pictures", "motion.hybrid"):
        import_module(f"doppelgait.{module}")
    classes, queue = set(), [config.FrozenModel]
    while queue:
        below = queue.pop().__subclasses__()
        classes.update(below)
        queue += below
    ours = [model for model in classes if model.__module__.startswith("doppelgait.")]
    models = sorted(ours, key=lambda model: f"{model.__module__}.{model.__name__}")
    assert len(models) > 80
    said = []
    for model in models:
        for change in ({}, {"T_d": 1}, *({key: value} for key in model.model_fields for value in WRONG)):
            said += [refusal(lambda: model(**change)), refusal(lambda: model.model_validate(change))]  # noqa: B023
    assert sum(bool(text) for text in said) > 5000
    assert not [text for text in said if LEAKS.search(text)]


def refusal(build) -> str:
    """The message of a ConfigError; any other error fails the test."""
    try:
        build()
    except ConfigError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Radar(prf=1), r"prf: unknown key; allowed are .*did you mean prf_hz\?"),
        (lambda: Target("Boulic"), r"'Boulic'; known are: file, .*did you mean boulic\?"),
        (lambda: open_model("X4"), r"shipped models are .*did you mean x4\?"),
        (lambda: load_plan("home-alrm"), r"built-in plans are: .*did you mean home-alarm\?"),
        (lambda: load_plan(DEMO), r"is a scene, not a plan: doppelgait simulate .*demo\.toml"),
        (lambda: parse_run({"dataset": {}}, where="a.toml"), "a plan, not a scene: doppelgait dataset build a.toml"),
        (lambda: Analysis.model_validate({"cpi_s": -1}), "^Analysis: cpi_s: -1 is not allowed: .*than 0$"),
        (lambda: Analysis.model_validate_json("{"), r"^Analysis: .*JSON"),
        (lambda: setattr(Analysis(), "cpi_s", 0.1), r"Analysis\.cpi_s: is frozen; .* \.replace\(cpi_s=\.\.\."),
        (lambda: delattr(Analysis(), "cpi_s"), "is frozen"),
        (lambda: PlanConfig(**PLAN, companions=3), "companions: 3 is not allowed: must be a list or a table$"),
        (lambda: Target({"kind": "boulic"}, rcs={"foo": 1}), r"^Target: rcs\.foo: unknown key; .*fluctuation"),
        (lambda: dg.Conditions(noise=3), r"or Noise\(\.\.\.\) in Python"),
    ],
)
def test_what_is_wrong_in_python_is_refused_with_what_was_meant(make, words) -> None:
    with pytest.raises(ConfigError, match=words):
        make()


def test_names_of_a_model_are_its_own() -> None:
    shown = {*dir(Radar), *dir(Radar.preset("x4"))}
    assert {"preset", "from_toml", "prf_hz", "wavelength_m", "replace"} <= shown
    assert not {"model_construct", "copy", "parse_obj", "model_validate_json"} & shown


def test_parameters_are_named() -> None:
    with pytest.raises(TypeError, match=r"Analysis takes 0 positional arguments, not 1: name the parameters"):
        Analysis(0.2)


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ({"motion": {"kind": "boulic", "pace": 1}}, r"motion\.pace: unknown key; allowed are .*speed_mps"),
        ({"rcs": {"total_m2": -1}}, r"rcs\.total_m2: -1 is not allowed: must be greater than"),
        ({"path": {"kind": "arc", "radius_m": 2.0}}, r"path\.turn_deg: is required"),
    ],
)
def test_a_fault_in_a_table_of_a_kind_has_a_dotted_key(target, message) -> None:
    place = {"motion": {"kind": "boulic"}, "start_position_m": [5.0, 0.0], "heading_deg": 0.0}
    with pytest.raises(ConfigError, match=rf"^scene: targets\.0\.{message}"):
        parse_run({"targets": [{**place, **target}]}, where="scene")


def test_all_faults_of_inner_tables_come_in_one_message() -> None:
    wall = {"kind": "wall", "thickness_m": -1, "material": {"permittivity": 0, "loss": 1}}
    with pytest.raises(ConfigError) as caught:
        parse_run({"environment": [wall], "radar": {"preset": "x4"}, "duration_s": 1, "seed": -1})
    message = str(caught.value)
    for key in ("environment.0.thickness_m: -1", "environment.0.material.permittivity: 0", "seed: -1"):
        assert f"{key} is not allowed: must be greater than" in message
    assert "environment.0.material.loss: unknown key; allowed are conductivity_s_per_m, permittivity" in message
    assert "this value" not in message


# --- Overrides ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("radar.prf_hz", r"--set radar\.prf_hz: must be KEY=VALUE"),
        ("targets.7.label=dog", r"'7' is not an entry of that list \(0 to 1\)"),
        ("seed.part=3", "--set seed.part=3"),
        ("seed.part.more=3", "'part' is inside a value|not a key"),
        ("radar.prf_hz=-5", r"prf_hz.*-5.*greater than or equal to 0.001"),
        ("radar.sped=5", r"sped.*unknown key.*prf_hz"),
        ("nothing=5", "nothing: unknown key; allowed are seed"),
        ("targets.5=5", "targets.5"),
    ],
)
def test_wrong_overrides_are_explained(scene_file, override, message):
    with pytest.raises(ConfigError, match=message):
        Run.from_toml(scene_file(), overrides=[override])


def test_overrides_do_not_change_the_table_given():
    table = {"a": {"b": [1, {"f": 2}]}}
    assert config.apply_overrides(table, ["a.b.0=5", "a.b.1.f=6", "a.c=text", "d.e=true"]) == {
        "a": {"b": [5, {"f": 6}], "c": "text"},
        "d": {"e": True},
    }
    assert table == {"a": {"b": [1, {"f": 2}]}}


# --- Files --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("read", [config.read_toml, Scene.from_toml, Run.from_toml])
def test_missing_broken_and_binary_files_are_named(tmp_path, read):
    (tmp_path / "broken.toml").write_text("a = \n")
    (tmp_path / "walk.h5").write_bytes(b"\x89HDF\r\n\x1a\n\xff\xfe")
    for name, message in (
        ("none.toml", r"none\.toml: cannot be read: No such file or directory$"),
        ("broken.toml", r"broken\.toml: is not TOML.*line 1"),
        ("walk.h5", r"walk\.h5: is not TOML: it is a binary file or not UTF-8 text$"),
        ("", "cannot be read"),
    ):
        with pytest.raises(ConfigError, match=message):
            read(tmp_path / name)
    with pytest.raises(ConfigError, match="targets"):
        parse_run({})


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        (["seed"], "seed = 3"),
        (["noise", "snr_db"], "snr_db = 15.0"),
        (["radar", "prf_hz"], "prf_hz = 900"),
        (["noise", "kind"], 'kind = "snr"'),
        (["targets", "motion", "speed_mps"], "speed_mps = 1.1"),
        (["noise"], "[noise]"),
        (["radar", "colour"], ""),
    ],
)
def test_line_of_a_key(keys, line):
    assert config.format_line_note(SCENE, keys) == (f" (line {line_in(SCENE, line)})" if line else "")
    assert config.format_line_note("", keys) == ""
    assert config.format_line_note('# seed = 1\nseed = 2  # seed = "x"\n', ["seed"]) == " (line 2)"


# --- Models -------------------------------------------------------------------------------------------------------


def test_canonical_json_does_not_depend_on_the_order():
    assert config.format_canonical_json({"b": 1, "a": [1.5, None]}) == '{"a":[1.5,null],"b":1}'
    one, two = Analysis(cpi_s=0.2, hop=3), Analysis(hop=3, cpi_s=0.2)
    assert config.format_canonical_json(one) == config.format_canonical_json(two)
    radar = Radar.preset("x4")
    assert Radar.model_validate_json(config.format_canonical_json(radar)) == radar


def test_the_pulse_rate_of_a_preset_can_be_left_to_the_scene():
    found = parse_radar({"preset": "x4-255fps", "prf_hz": "auto"})
    assert (found["radar"], found["auto_prf"]) == (Radar.preset("x4-255fps"), True)


@pytest.mark.parametrize("value", ["c", None, ["a"], "a, b"])
def test_a_name_that_is_not_allowed_is_refused_with_those_that_are(value):
    config.check_choice("a", ("a", "b"), "letter")
    with pytest.raises(ConfigError) as caught:
        config.check_choice(value, ("a", "b"), "letter")
    assert str(caught.value) == f"letter: {value!r} is not allowed; it must be one of a, b"

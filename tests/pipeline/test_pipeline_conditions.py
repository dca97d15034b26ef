"""Environment and impairments from the scene file to the recording, the example and the dataset."""

from datetime import UTC, datetime

import numpy as np
import pytest

import literal
from doppelgait.core.errors import ConfigError, DoppelgaitWarning, RecordingError
from doppelgait.core.rng import rng
from doppelgait.dataset.config import PlanConfig
from doppelgait.dataset.plan import plan_dataset
from doppelgait.motion import boulic_walk, fan
from doppelgait.pipeline import Conditions, analyze, parse_run, run_simulation, simulate
from doppelgait.radar import Radar, echo_amplitude_v, read_recording, write_arrays
from doppelgait.radar.xethru import write_xethru_recording
from doppelgait.scene import Scene, Target, assemble

WALK = boulic_walk(speed_mps=1.3, height_m=1.7, duration_s=2.0)
RADAR = Radar.preset("x4")
CLUTTER = {"kind": "static_clutter", "levels": [[1.0, -60.0], [8.0, -90.0]]}
WALL = {"kind": "wall", "loss_db": 6.0, "delay_m": 0.2}

SCENE = {
    "duration_s": 2.0,
    "noise": {"kind": "none"},
    "targets": [{"label": "human", "motion": {"kind": "boulic", "speed_mps": 1.3}, "range_m": 5.0}],
}


def examples_of(plan, folder=None):
    laid_out = plan_dataset(plan, folder=folder)
    return [laid_out.example(number) for number in range(len(laid_out.examples))]


def run(**changes):
    return run_simulation(parse_run({**SCENE, **changes})).baseband.values


def test_the_order_of_the_list_is_the_order_of_the_chain():
    saturating = {"kind": "adc", "bits": 10, "full_scale_v": 1e-4}
    loud = {"kind": "dc_leak", "level_db": -40.0}
    with pytest.warns(UserWarning, match="full scale"):
        before, after = run(impairments=[loud, saturating]), run(impairments=[saturating, loud])
    assert np.abs(before.real).max() <= 1.0001e-4
    assert np.abs(after).max() > 5e-3


def test_frame_jitter_moves_the_scene_and_not_the_axis():
    table = {**SCENE, "impairments": [{"kind": "frame_jitter", "sd_s": 5e-5}]}
    jittered, even = run_simulation(parse_run(table)), run_simulation(parse_run(SCENE))
    assert np.array_equal(jittered.baseband.slow_time, even.baseband.slow_time)
    bin_ = int(np.abs(even.baseband.values).mean(axis=0).argmax())
    turned = np.angle(jittered.baseband.values[:, bin_] * np.conj(even.baseband.values[:, bin_]))
    strong = np.abs(even.baseband.values[:, bin_]) > 0.3 * np.abs(even.baseband.values[:, bin_]).max()
    # a body at 1.3 m/s turns the phase by 4 pi v / lambda times the jitter: 0.02 rad
    assert np.std(turned[strong]) == pytest.approx(4 * np.pi * 1.3 / RADAR.wavelength_m * 5e-5, rel=0.4)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["x4", "xband-cw"])
def test_background_targets_scatter_but_are_neither_truth_nor_signal_nor_result(name):
    """The signal has every path of the targets: here three, with a metal wall 1 m beside the radar (two-ray field)."""
    radar = Radar.preset(name, prf_hz=1000)
    blades = Target(fan(duration_s=2.0), background=True, rcs={"kind": "equal", "total_m2": 50.0})
    walker = Target(WALK, label="human", range_m=5.0)
    room = Conditions(environment=[{"kind": "wall_ghost", "material": "metal", "thickness_m": 0.1, "side_m": 1.0}])
    made = simulate(Scene([blades, walker], duration_s=0.5), radar, rng=rng(1), snr_db=20.0, conditions=room)
    draw = {"wavelength_m": radar.wavelength_m, "rng": rng(1).generator("scene")}
    table = assemble(Scene([walker], duration_s=0.5), made.slow_time_s, **draw)
    direct_m, azimuth, elevation = (table[part].values for part in ("range", "azimuth", "elevation"))
    image_m = np.sqrt(direct_m**2 + 4.0 * (1.0 - direct_m * np.cos(elevation) * np.sin(azimuth)))
    mean_m = (direct_m + image_m) / 2
    paths_m = np.hstack([direct_m, mean_m, image_m])
    field = np.hstack([np.ones_like(mean_m), -2 * mean_m**2 / (direct_m * image_m), np.ones_like(mean_m)])
    field = field * np.exp(1j * np.tile(table["path_phase"].values, 3))
    field *= echo_amplitude_v(radar, range_m=paths_m, rcs_m2=np.tile(table["rcs"].values, 3))
    axis_m, sigma_s = (radar.range_axis_m(), radar.sigma_s) if name == "x4" else (np.zeros(1), np.inf)
    echo = literal.baseband(paths_m, field, axis_m, sigma_s=sigma_s, wavelength_m=radar.wavelength_m, theta_rad=0.0)
    level_v2 = (np.abs(echo) ** 2).max(axis=1).mean()
    assert 10 * np.log10(level_v2 / made.noise_power_v2) == pytest.approx(20.0, abs=0.1)
    assert np.abs(made.baseband.values).max() > 2 * np.abs(echo).max()
    assert [truth.label for truth in made.truth] == ["human"]
    assert len(analyze(made, gate="truth")) == 1


def test_thermal_noise_in_the_list_replaces_the_runs_own():
    scene = {**SCENE, "noise": {"kind": "thermal"}, "targets": [], "seed": 2}
    own = run_simulation(parse_run(scene)).baseband.values
    twice = run_simulation(parse_run({**scene, "impairments": [{"kind": "thermal_noise"}]})).baseband.values
    power = [float((np.abs(values) ** 2).mean()) for values in (own, twice)]
    assert power[1] == pytest.approx(power[0], rel=0.02)  # once, not twice
    with pytest.raises(ConfigError, match="leave one out"):
        run_simulation(parse_run({**SCENE, "noise": {"kind": "snr"}, "impairments": [{"kind": "thermal_noise"}]}))


PLAN = {
    "dataset": {"name": "t", "examples_per_class": 12, "fractions": {"train": 1.0}},
    "classes": [
        {"label": "human", "motion": {"kind": "boulic"}},
        {"label": "dog", "motion": {"kind": "quadruped", "gait": "trot"}},
    ],
    "scene": {"duration_s": 1.0, "radar_tilt_deg": {"uniform": [-20, 0]}},
    "background": [{"motion": {"kind": "curtain"}, "range_m": {"uniform": [3, 6]}}],
    "environment": [{"choice": [WALL, {}]}],
    "impairments": [{"kind": "phase_noise", "white_rad": {"uniform": [0.0, 0.01]}}],
}


@pytest.mark.parametrize(("noise", "kind"), [("thermal", "level"), ("none", "level"), ("thermal", "figure")])
def test_the_recorded_noise_is_that_of_the_list(noise, kind):
    own = {"kind": "thermal_noise", **({"level_db": -60.0} if kind == "level" else {"noise_figure_db": 16.0})}
    made = run_simulation(parse_run({**SCENE, "noise": {"kind": noise}, "targets": [], "impairments": [own]}))
    measured = float((np.abs(made.baseband.values) ** 2).mean())
    assert made.noise_power_v2 == pytest.approx(measured, rel=0.02)


def test_clutter_does_not_fold_into_the_other_end_of_a_frame():
    radar = Radar.preset("ti-60")
    profile = {"kind": "static_clutter", "levels": [[0.5, -40.0], [8.0, -90.0]]}
    empty = Scene([], duration_s=3.0 / radar.prf_hz)
    conditions = Conditions(noise={"kind": "none"}, impairments=[profile])
    power = np.mean(
        [
            np.abs(simulate(empty, radar, rng=rng(seed), conditions=conditions).baseband.values[0]) ** 2
            for seed in range(200)
        ],
        axis=0,
    )  # fmt: skip
    far = int(np.argmin(np.abs(radar.range_axis_m() - 7.5)))  # clear of the window's own reach over the end
    assert 10 * np.log10(power[far]) == pytest.approx(np.interp(7.5, [0.5, 8.0], [-40.0, -90.0]), abs=2.5)


def test_a_target_that_walks_through_a_wall_is_told():
    wall = {"kind": "wall", "material": "concrete", "thickness_m": 0.2, "range_m": 5.0}
    with pytest.warns(DoppelgaitWarning, match=r"wall at 5.0 m: a scatterer crosses the wall"):
        run(environment=[wall])


@pytest.fixture(scope="module")
def made():
    return run_simulation(parse_run(SCENE))


def test_a_gate_as_text_is_that_of_the_numbers(made):
    assert analyze(made, gate="1.2:6.8")[0].features == analyze(made, gate=[1.2, 6.8])[0].features


MISTAKES = {
    "scene": (
        lambda made, changes: parse_run({**SCENE, **changes}),
        [
            ({"environment": [{"kind": "fog"}]}, r"environment.0.*'fog' is not allowed: known are .*wall"),
            ({"impairments": [{"kind": "adc", "bitz": 8}]}, r"impairments.0.*bitz: unknown key; allowed are .*bits"),
            ({"environment": [{"kind": "ground_bounce"}, {"kind": "ground_bounce"}]}, "twice"),
        ],
    ),
    "plan": (
        lambda made, changes: examples_of(PlanConfig.model_validate({**PLAN, **changes})),
        [
            ({"impairments": [{"kind": "adc", "bits": {"uniform": [2, 3]}}]}, "impairments.0.*bits"),
            ({"background": [{"range_m": 3}]}, r"background.0.*needs motion"),
            ({"background": [{"motion": {"kind": "file", "path": "x.c3d"}}]}, "no subject"),
            ({"target": {"background": True}}, r"target.background: belongs in \[\[background\]\]"),
            ({"environment": {"choice": [3, 4]}}, "environment: .* must be a list of tables"),
        ],
    ),
    "analyze": (
        lambda made, arguments: analyze(**{"recording": made, **arguments}),
        [
            ({"gate": "trak"}, r"gate: 'trak' is not allowed; it must be track, truth or FROM:TO in m"),
            ({"gate": "trut"}, r"for example 1\.2:2\.8, or \(1\.2, 2\.8\) in Python"),
            ({"recording": 3}, r"recording: int is not allowed; give a path, or doppelgait.radar.read_rec"),
            ({"analysis": {"hop": 4}}, r"analysis: dict is not allowed"),
            ({"tracking": {"pieces": 3}}, r"tracking: dict is not allowed"),
            ({"gate": "track", "gate_error_m": 0.1}, r"gate_error_m: .* with gate='truth'"),
            ({"gate": "truth", "gate_error_m": float("nan")}, r"gate_error_m: .* with gate='truth'"),
        ],
    ),
    "simulate": (
        lambda made, arguments: simulate(
            **{"scene": Scene([Target(WALK)]), "radar": RADAR, "rng": rng(1), **arguments}
        ),
        [
            ({"scene": SCENE}, r"scene: dict is not allowed; make one with doppelgait.Scene"),
            ({"radar": {"preset": "x4"}}, r"radar: dict is not allowed"),
            ({"snr_db": float("-inf")}, r"snr_db is -inf"),
            ({"snr_db": "20"}, r"snr_db: str is not allowed; give a number of dB"),
            ({"rng": None, "conditions": Conditions(impairments=[CLUTTER])}, "pass rng"),
        ],
    ),
}


@pytest.mark.parametrize(
    ("name", "changes", "message"), [(name, *row) for name, (_, rows) in MISTAKES.items() for row in rows]
)
def test_mistakes_name_the_entry_and_what_is_allowed(made, name, changes, message):
    with pytest.raises((ConfigError, ValueError), match=message):
        MISTAKES[name][0](made, changes)


def test_only_impulse_radars_are_written_as_xethru(tmp_path):
    made = run_simulation(parse_run({**SCENE, "duration_s": 0.1, "radar": {"preset": "ti-77"}}))
    with pytest.raises(RecordingError, match=r"'fmcw': write .h5"):
        write_xethru_recording(made, tmp_path, start_time=datetime(2020, 1, 1, tzinfo=UTC), session_id="s")


def test_switches_of_readers_are_true_or_false(tmp_path):
    write_arrays(run_simulation(parse_run({**SCENE, "duration_s": 0.1})), tmp_path / "walk.npz")
    with pytest.raises(RecordingError, match="conjugate = 'no' is not allowed; it must be true or false"):
        read_recording(tmp_path / "walk.npz", conjugate="no")
    assert read_recording(tmp_path / "walk.npz", conjugate=False).baseband.sizes["range"] == 188

"""What a notebook shows of an object: a few lines, a table of facts, a picture."""

import base64
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure

import doppelgait as dg
from doppelgait.core.errors import ConfigError
from doppelgait.dataset import Dataset
from doppelgait.viz.objects import plot_dataset, plot_radar
from doppelgait.viz.style import make_axes

SCENE = dg.Scene([dg.Target("boulic", label="human", range_m=4.0, aspect_deg=20.0)], duration_s=2.0)


@pytest.fixture(scope="module")
def recording() -> dg.Recording:
    return dg.simulate(SCENE, dg.Radar.preset("x4", prf_hz=640.0), angles=False)


@pytest.fixture(scope="module")
def shown(recording: dg.Recording) -> dict[str, object]:
    rows = pd.DataFrame({"label": ["human", "dog", "dog"], "split": ["train", "train", "test"], "id": list("abc")})
    return {
        "Recording": recording,
        "Result": dg.analyze(recording, gate="truth")[0],
        "Scene": SCENE,
        "Target": SCENE.targets[0],
        "Radar": recording.radar,
        "Motion": dg.motion.boulic_walk(duration_s=2.0),
        "Model": dg.classify.open_model("x4"),
        "Dataset": Dataset(Path("walks"), {"id": "0123"}, rows, None),  # type: ignore[arg-type]
    }


WORDS = {
    "Recording": ("640", "1280 in", "human"), "Result": ("human", "torso_velocity_mps"), "Scene": ("boulic", "2 s"),
    "Target": ("human (boulic) at 4 m aspect 20 deg",), "Radar": ("7.29 GHz", "640 Hz", "0 to 9.664 m"),
    "Motion": ("boulic", "17", "2 s at 250 Hz"), "Model": ("animal", "no decision below"),
    "Dataset": ("walks", "2 dog, 1 human", "1 test, 2 train"),
}  # fmt: skip


@pytest.mark.parametrize("name", WORDS)
def test_text_is_one_to_five_lines_with_the_facts(name: str, shown: dict[str, object]) -> None:
    text = repr(shown[name])
    assert text.startswith(name)
    assert 1 <= len(text.splitlines()) <= 5
    assert len(text) < 600
    for words in WORDS[name][name == "Recording" :]:
        assert words in text


@pytest.mark.parametrize("name", ["Recording", "Result", "Scene", "Radar", "Model", "Dataset"])
def test_html_has_a_table_and_a_small_picture(name: str, shown: dict[str, object]) -> None:
    html = shown[name]._repr_html_()  # type: ignore[attr-defined]
    picture = base64.b64decode(re.search(r'src="data:image/png;base64,([^"]+)"', html)[1])
    assert picture.startswith(b"\x89PNG")
    assert 1000 < len(picture) < 100_000
    assert html.count("<tr>") >= 2
    assert "http" not in html


def test_a_dataset_has_its_identity_and_a_legend_that_covers_no_bar(shown: dict[str, object]) -> None:
    dataset: Any = shown["Dataset"]
    assert dataset.description["id"] in dataset._repr_html_()
    figure, axes = make_axes(width_in=5.2, height_in=3.2)
    plot_dataset(dataset, ax=axes)
    figure.canvas.draw()
    legend = figure.legends[0].get_window_extent()
    assert not [bar for bar in axes.patches if bar.get_width() and bar.get_window_extent().overlaps(legend)]


def test_a_scene_shows_its_targets_where_they_are_placed(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = []
    monkeypatch.setattr("doppelgait.scene.placement.show_html", lambda *facts: shown.append(facts[-1]))
    walk = dg.motion.boulic_walk(speed_mps=2.0, duration_s=5.0)
    scene = dg.Scene([dg.Target(walk, label="human"), dg.Target("boulic", vary={}), dg.Target(walk, range_m=4.0)])
    scene._repr_html_()
    assert [target.range_m for target in shown[0].targets] == pytest.approx([7.0, 5.1, 4.0], abs=0.2)
    middle = dg.scene.place(dg.Scene([dg.Target(walk)])).targets[0].motion
    frame = middle.n_frames // 2
    assert middle.position_m[frame, :, 0].mean() == pytest.approx(shown[0].targets[0].range_m, abs=0.1)
    missing = dg.Scene([dg.Target("missing.c3d")])
    missing._repr_html_()
    assert shown[1] is missing


def test_a_scene_states_its_duration() -> None:
    walk = dg.motion.boulic_walk(speed_mps=1.2, duration_s=8.0)
    for targets, words in (
        (["boulic"], "duration 5 s"),
        ([walk], "duration 8 s"),
        ([walk, "boulic"], "duration 8 s"),
        ([walk, "missing.c3d"], "duration that of the shortest motion"),
    ):
        scene = dg.Scene([dg.Target(motion) for motion in targets])
        assert words in repr(scene)
        if "missing" not in str(targets[-1]):
            assert dg.scene.place(scene).observation_s == float(words.split()[1])


def test_html_is_escaped_and_has_no_picture_without_arrays() -> None:
    html = dg.Radar.preset("x4", name="<script>")._repr_html_()
    assert "&lt;script&gt;" in html
    assert "<script>" not in html
    html = dg.Result(dg.Analysis(), label="dog")._repr_html_()
    assert "dog" in html
    assert "<img" not in html


def test_a_plot_is_a_figure_of_pyplot_and_a_picture_is_none() -> None:
    pyplot.close("all")
    SCENE._repr_html_()  # type: ignore[operator]
    assert not pyplot.get_fignums()
    figure = SCENE.plot().figure
    assert pyplot.get_fignums() == [figure.number]
    assert SCENE.plot(ax=figure.axes[0]) is figure.axes[0]
    pyplot.close("all")


def test_the_overview_takes_a_recording_and_a_result(recording: dg.Recording) -> None:
    results = dg.analyze(recording, gate="truth")
    figure = dg.viz.overview(recording, results[0])
    assert figure.get_suptitle() == "human"
    for value in (results, None):
        with pytest.raises(ConfigError, match=rf"result: {type(value).__name__} is not allowed; give one of"):
            dg.viz.overview(recording, value)


def test_a_radar_shows_its_frame_and_a_label_is_off_the_arrow() -> None:
    ax = Figure().subplots()
    plot_radar(dg.Radar.preset("ti-77"), ax=ax)
    assert (ax.get_title(loc="left"), ax.get_xlabel()) == ("Frame and unambiguous velocity", "range of the frame (m)")
    for heading_deg in range(0, 360, 15):
        ax = Figure(figsize=(5.2, 3.2)).subplots()
        dg.Scene([{"motion": "boulic", "start_position_m": (4, 0), "heading_deg": heading_deg}]).plot(ax=ax)
        ax.figure.draw_without_rendering()
        label, arrow = ax.texts[-2:]
        ends = ax.transData.transform([arrow.xyann, arrow.xy])
        assert not any(label.get_window_extent().contains(*point) for point in np.linspace(*ends))
        assert ax.bbox.contains(*ends[1])

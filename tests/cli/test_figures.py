"""Figures of ``analyze``: no fault that a reader would see, and vector files."""

import pytest

import doppelgait as dg
from doppelgait.cli.figures import make_figures, save_figures
from figure_faults import faults


@pytest.fixture(scope="module")
def analysed():
    radar = dg.Radar.preset("x4", range_stop_m=8.0)
    walk, trot = (
        dg.motion.human_gait(speed_mps=1.3, duration_s=2.5),
        dg.motion.quadruped_gait(gait="trot", duration_s=2.5),
    )
    scene = dg.Scene([dg.Target(walk, label="human", range_m=5.0), dg.Target(trot, label="dog", range_m=3.5)])
    recording = dg.simulate(scene, radar, rng=dg.rng(2), snr_db=20)
    return recording, dg.analyze(recording, gate="truth")


@pytest.fixture(scope="module")
def figures(analysed):
    return dict(make_figures(*analysed, dg.Analysis().resolved(None)))


def test_every_figure_is_named_by_the_vocabulary(figures):
    kinds = {name.removeprefix("0-human-").removeprefix("1-dog-") for name in figures}
    assert kinds >= {"range-time", "overview", "range-doppler", "signature", "cadence-velocity", "cadence-spectrum"}
    assert not [name for name in figures if "step-doppler" in name]


def test_a_frame_rate_too_low_for_doppler_leaves_out_one_figure(analysed, figures, capsys):
    """A still person is found by breathing at 17 frames/s, where 0.1 s hold one pulse."""
    kinds = {name for name, _ in make_figures(*analysed, dg.Analysis(cpi_s=0.001).resolved(None))}
    assert set(figures) - kinds == {"0-human-range-doppler", "1-dog-range-doppler"}
    assert "note: no figure 0-human-range-doppler: cpi_s = 0.001" in capsys.readouterr().err


def test_a_paper_has_no_overview(figures, monkeypatch, tmp_path):
    monkeypatch.setattr("doppelgait.cli.figures.make_figures", lambda *_: iter(figures.items()))
    monkeypatch.setattr("doppelgait.viz.save_figure", lambda figure, path, **look: (path.stem, look))
    saved = list(save_figures(folder=tmp_path, style="paper", dpi=200.0))
    assert {name for name, _ in saved} == {name for name in figures if not name.endswith("overview")}
    assert saved[0][1] == {"style": "paper", "dpi": 200.0}


@pytest.mark.release
def test_no_figure_has_faults(figures):
    found = {name: faults(figure, "pdf" if "dog" in name else "svg") for name, figure in figures.items()}
    assert {name: words for name, words in found.items() if words} == {}


def test_faults_are_found(figures):
    figure = figures["range-time"]
    axes = figure.axes[0]
    axes.text(0.5, 0.5, "one word", transform=axes.transAxes)
    axes.text(0.5, 0.5, "another", transform=axes.transAxes)
    axes.text(1.5, 0.5, "far to the right", transform=axes.transAxes, in_layout=False)
    axes.set_xlabel("D_g")
    words = "; ".join(faults(figure))
    for fault in ("'one word' overlaps 'another'", "leaves the canvas", "'D_g' has no unit", "'D_g' has a symbol"):
        assert fault in words

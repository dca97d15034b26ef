"""Figures of ``analyze``: no fault that a reader would see, and vector files."""

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

import doppelgait as dg
from doppelgait.cli.figures import make_figures, save_figures
from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.viz.style import fit_to_paper
from figure_faults import faults


@pytest.fixture(scope="module")
def analysed():
    targets = [dg.Target("human", label="human", range_m=5.0), dg.Target("quadruped", label="dog", range_m=3.5)]
    recording = dg.simulate(dg.Scene(targets, duration_s=2.5), "x4", rng=dg.rng(2), snr_db=20)
    return recording, dg.analyze(recording, gate="truth")


def test_a_frame_rate_too_low_for_doppler_leaves_out_one_figure(analysed, capsys):
    """A still person is found by breathing at 17 frames/s, where 0.1 s hold one pulse."""
    names = {name for name, _ in make_figures(*analysed, dg.Analysis(cpi_s=0.001).resolved(None))}
    assert "0-human-signature" in names
    assert not [name for name in names if "range-doppler" in name]
    assert "note: no figure 0-human-range-doppler: cpi_s = 0.001" in capsys.readouterr().err


def test_figures_are_chosen_and_have_limits(analysed, tmp_path):
    settings = (*analysed, dg.Analysis().resolved(None), {"db_range": 25.0, "cmap": "viridis"}, (-200.0, 100.0))
    paths = save_figures(*settings, folder=tmp_path, only="dog-signature")
    assert [path.stem for path in paths] == [f"1-dog-signature{end}" for end in ("", "-normalised", "-truth")]
    found = dict(make_figures(*settings))
    for name, panel in (("signature", 0), ("overview", 1), ("signature-truth", 0)):
        axes = found[f"1-dog-{name}"].axes[panel]
        low_db, high_db = axes.images[0].get_clim()
        look = (axes.get_ylim(), high_db - low_db, axes.images[0].get_cmap().name)
        assert look == ((-200.0, 100.0), 25.0, "viridis")
    with pytest.raises(ConfigError, match="--only sgnature: "):
        list(save_figures(*settings, folder=tmp_path, only="sgnature"))
    with pytest.raises(AnalysisError, match="cmap = 'jett': "):
        dg.viz.range_time(analysed[0].baseband, cmap="jett")


@pytest.mark.filterwarnings("error::UserWarning")
@pytest.mark.parametrize("radar", ["x4", *(pytest.param(f"infineon-{n}", marks=pytest.mark.release) for n in (60, 24))])
def test_no_figure_has_faults_on_a_screen_or_in_a_paper(radar):
    """No axes collapse, and no text is over another or leaves the figure."""
    target = dg.Target("quadruped" if radar == "x4" else "human", range_m=4.0)
    recording = dg.simulate(dg.Scene([target], duration_s=2.0), radar, rng=dg.rng(2), snr_db=20)
    found = {}
    for name, figure in make_figures(recording, dg.analyze(recording, gate="truth"), dg.Analysis().resolved(None)):
        paper = fit_to_paper(figure)
        FigureCanvasAgg(paper)
        panels = [axes.bbox for axes in paper.axes if axes.get_label() != "<colorbar>"]
        least = (0.3 if len(panels) == 1 else 0.03) * paper.bbox.width * paper.bbox.height
        collapsed = [f"{box} collapsed" for box in panels if box.width * box.height < least]
        found[name] = faults(figure) + faults(paper, "pdf") + collapsed
        assert paper.get_size_inches()[0] == (3.5 if len(panels) == 1 else 7.2)
    assert {name: words for name, words in found.items() if words} == {}
    kinds = {name.removeprefix("0-target-") for name in found}
    assert kinds > {"overview", "signature", "cadence-velocity", "cadence-spectrum", "truth-range", "truth-doppler"}
    assert ("range-time" in kinds) == ("range-doppler" in kinds) == ("level-time" not in kinds) == (radar[-2:] != "24")

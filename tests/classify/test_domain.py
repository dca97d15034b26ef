"""Domain classifier: the same sensor is not told apart, another one is, by the statistic that differs."""

import json
from pathlib import Path

import numpy as np
import pytest

from doppelgait.classify import domain
from doppelgait.cli.radar import compare
from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.dataset import PlanConfig
from doppelgait.radar import Radar, Recording
from doppelgait.radar.recordings import write_recording
from doppelgait.viz.tables import plot_domains

MODEL = """
waveform = "impulse"
carrier_hz = 7.29e9
sample_rate_hz = 23.328e9
decimation = 8
prf_hz = 100
range_stop_m = 2.0
bandwidth_hz = 1.4e9
"""
RADAR = Radar.preset("x4", prf_hz=100.0, range_start_m=0.5, range_stop_m=2.0)


def sensors(seed: int, count: int = 8, *, rho: float = 0.0, jitter_db: float = 3.0) -> list[Recording]:
    """Empty rooms before sensors of random level, by their definition."""
    found = []
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        n = RADAR.n_range_bins
        noise = rng.normal(size=(640, n + 1)) + 1j * rng.normal(size=(640, n + 1))
        noise = noise[:, 1:] + rho * noise[:, :-1]
        samples = 10 ** (rng.normal(-100, jitter_db) / 20) * noise / np.sqrt(2 * (1 + rho**2)) + 1e-3
        coords = {"slow_time": np.arange(640) / 100.0, "range": RADAR.range_axis_m()}
        array = make_array(BASEBAND, samples.astype(np.complex64), coords)
        found.append(Recording.from_baseband(array, RADAR, source=f"{number}.h5"))
    return found


def test_the_same_kind_is_not_told_apart_and_another_is_by_what_differs() -> None:
    same = domain.compare_recordings(sensors(0), sensors(1))
    assert same.held_out == "recordings"
    assert same.auc_of_shape[1] < 0.5 < same.auc_of_shape[2]
    assert same.auc_of_shape[0] == pytest.approx(0.5, abs=0.12)
    other = domain.compare_recordings(sensors(0), sensors(1, rho=0.4))
    assert other.auc_of_shape[0] > 0.97
    assert next(iter(other.distances)).startswith("correlation, 1 bin")
    assert other.distances["correlation, 1 bin apart"][1] > 0.97
    rows = domain.comparison_rows({"before": other, "after": same})
    assert rows[0]["before"].startswith(f"{other.auc[0]:.2f} (")


def test_simulated_recordings_have_the_pulses_and_bins_of_the_real_ones(tmp_path: Path) -> None:
    cw = Radar.preset("infineon-24")
    times_s = (0.2 * np.arange(6)[:, None] + np.arange(128) / 3000.0).ravel()
    coords = {"slow_time": times_s, "range": cw.range_axis_m()}
    values = np.ones((times_s.size, 1), np.complex64)
    real = [Recording.from_baseband(make_array(BASEBAND, values, coords, {"burst_pulses": 128}), cw) for _ in range(2)]
    model = tmp_path / "my.toml"
    text = 'waveform = "cw"\ncarrier_hz = 24e9\nprf_hz = 3000\nrange_stop_m = 10\n'
    text += "noise_figure_db = { uniform = [5, 9] }\n"
    model.write_text(text, encoding="utf-8")
    classes = [{"label": "human", "motion": {"kind": "boulic"}}]
    plan = PlanConfig(dataset={"name": "walk", "examples_per_class": 2}, classes=classes, target={"range_m": 4.0})
    empty, walk = domain.simulate_like(real, model), domain.simulate_like(real, model, plan=plan)
    for one in (*empty, *walk):
        assert one.samples.shape == real[0].samples.shape
        assert one.slow_time_s == pytest.approx(times_s)
        assert one.facts["burst_pulses"] == 128
    assert empty[0].radar.noise_figure_db != empty[1].radar.noise_figure_db
    power = [float(np.mean(np.abs(r.samples.matrix) ** 2)) for r in (empty[0], walk[0])]
    assert power[1] > 10 * power[0]
    again = domain.simulate_like(real, model, plan=plan)
    assert all(np.array_equal(a.samples.matrix, b.samples.matrix) for a, b in zip(walk, again, strict=True))


def test_pictures_and_page() -> None:
    room = sensors(0, 1)[0]
    level_db, axis, label = domain.plot_recording(room)
    assert (level_db.shape, label) == ((640, RADAR.n_range_bins), "range (m)")
    assert axis == pytest.approx(room.range_m)
    page = plot_domains({"real": [domain.plot_recording(room)]}, [{"": "AUC", "model": "0.50"}], title="a page")
    assert len(page.axes) == 3
    assert page.axes[1].get_ylabel() == "level above the median (dB)"
    assert page.axes[0].get_xlabel() == "pulse number"
    assert "distance in standard deviations" in page.axes[2].get_title(loc="left")
    bursts = plot_domains({"real": [(level_db, axis, "Doppler frequency (Hz)")]}, [{"": "AUC"}], title="a page")
    assert bursts.axes[0].get_xlabel() == "window number"


def test_statistics_of_a_repeating_and_clipping_sensor() -> None:
    room = sensors(0, 1)[0]
    values = np.array(room.samples.matrix)
    values[10:20] = values[10]
    (first, *_) = domain.measure_windows(room.with_baseband(room.baseband.copy(data=values)))
    assert first["repeated pulses"] == pytest.approx(9 / 31)
    assert first["values at the largest"] < 0.01


@pytest.mark.parametrize("pulses", [1, 3, 31])
def test_a_recording_of_a_few_pulses_is_refused(pulses: int) -> None:
    room = sensors(0, 1)[0]
    short = room.with_baseband(room.baseband[:pulses, :1], truth=())
    for use in (domain.measure_windows, domain.plot_recording):
        with pytest.raises(AnalysisError, match=f"{pulses} pulses are too few to compare: 32 are needed"):
            use(short)
    assert len(domain.measure_windows(room.with_baseband(room.baseband[:32], truth=()))) == 4


def test_the_command_leaves_out_what_is_too_short_and_tells_models_of_one_name_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (long, *_) = sensors(0, 1)
    for name, recording in {"long": long, "short": long.with_baseband(long.baseband[:3], truth=())}.items():
        write_recording(recording, tmp_path / f"{name}.h5")
    models = [str(tmp_path / folder / "my.toml") for folder in ("old", "new")]
    for model in models:
        Path(model).parent.mkdir()
        Path(model).write_text(MODEL, encoding="utf-8")
    page = tmp_path / "page.png"
    compare([tmp_path / "long.h5", tmp_path / "short.h5"], models, page, as_json=True)
    printed = capsys.readouterr()
    assert "short.h5: 3 pulses are too few to compare" in printed.err
    document = json.loads(printed.out)
    assert list(document) == models
    assert [one["held_out"] for one in document.values()] == ["parts of recordings"] * 2
    assert page.stat().st_size > 0
    with pytest.raises(AnalysisError, match=r"no recording can be compared: .*short\.h5: 3 pulses"):
        compare([tmp_path / "short.h5"], models, page)

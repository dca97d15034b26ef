"""Figures hold the data they are given, on axes with units; tiny labelled arrays with known answers."""

import re
import struct
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib import pyplot, rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

import processes
from doppelgait import Analysis, motion, viz
from doppelgait.core import labels
from doppelgait.core.errors import AnalysisError, ConfigError, OutputError
from doppelgait.viz.maps import doppler_limits_hz, level_limits_db
from doppelgait.viz.motion import PART_COLOURS, find_part_group
from doppelgait.viz.spectra import densest_band_hz
from doppelgait.viz.style import fit_to_paper, label_quantity

WAVELENGTH_M = 0.04
DOPPLER_HZ = 8.0 * np.arange(-32, 32)
PARTS = ("torso", "torso", "head", "left_foot", "right_foot", "left_hand", "left_shank")


def doppler_coords() -> dict[str, object]:
    return {"doppler": DOPPLER_HZ, "velocity": ("doppler", DOPPLER_HZ * WAVELENGTH_M / 2)}


def make_signature(*, normalised: bool = False, noise: float = 1e-3) -> xr.DataArray:
    """A line of five bins around +80 Hz over exponential noise, 40 columns."""
    power = noise * np.random.default_rng(3).exponential(size=(40, 64))
    power[:, 40:45] += [0.1, 0.5, 1.0, 0.5, 0.1]
    schema = labels.NORMALISED_SIGNATURE if normalised else labels.SIGNATURE
    return labels.make_array(schema, power.astype(np.float32), {"time": 0.5 + 0.05 * np.arange(40), **doppler_coords()})


def make_baseband() -> xr.DataArray:
    values = np.full((50, 20), 1e-3 + 0j, dtype=np.complex64)
    values[:, 7] = 1j
    return labels.make_array(
        labels.BASEBAND, values, {"slow_time": 0.01 * np.arange(50), "range": 1.0 + 0.05 * np.arange(20)}
    )


def make_gate(low_m: float = 1.2, high_m: float = 1.6, band_hz: float = np.inf) -> xr.Dataset:
    time_s = np.linspace(0.0, 0.5, 11)
    values = {"range_low": low_m, "range_high": high_m, "doppler_low": -band_hz, "doppler_high": band_hz}
    return xr.Dataset({name: ("time", np.full(11, v)) for name, v in values.items()}, coords={"time": time_s})


def make_scatterers() -> xr.Dataset:
    time_s = 0.01 * np.arange(30)
    number = np.arange(len(PARTS))
    dims = ("slow_time", "scatterer")
    return xr.Dataset(
        {
            "range": (dims, 5.0 - time_s[:, None] + 0.1 * number),
            "radial_velocity": (dims, 1.0 + 0.0 * time_s[:, None] + 0.5 * number),
        },
        coords={"slow_time": time_s, "part": ("scatterer", list(PARTS)), "target": ("scatterer", np.full(7, 4))},
    )


def make_cadence_map() -> xr.DataArray:
    values = np.full((101, 64), 1e-4)
    values[20, 38:46] = 0.1
    return labels.make_array(labels.CADENCE_MAP, values, {"cadence": 0.1 * np.arange(101), **doppler_coords()})


def make_spectrum() -> xr.DataArray:
    values = np.full(201, 1e-3)
    values[[20, 40, 60]] = [1.0, 0.1, 0.05]
    return labels.make_array(labels.CADENCE_SPECTRUM, values, {"cadence": 0.1 * np.arange(201)})


def make_motion(*, stride_hz: float = 1.0) -> motion.Motion:
    """A body walking along -y at 2 m/s with a head above and a foot in front of it."""
    time_s = np.arange(101) / 50.0
    base = np.stack([np.full(101, 3.0), -2.0 * time_s, np.ones(101)], axis=-1)
    points = base[:, None] + np.array([[0, 0, 0], [0, 0, 0.7], [0, -0.4, -1.0], [0, 0.4, -0.9]])
    names, parts = ["chest", "top", "toe", "shin"], ["torso", "head", "left_foot", "left_shank"]
    facts = {"stride_frequency_hz": stride_hz}
    return motion.make_motion(points, rate_hz=50.0, markers=names, parts=parts, facts=facts)


def make_table() -> pd.DataFrame:
    return pd.DataFrame(
        {
            "label": ["human"] * 5 + ["dog"] * 4,
            "torso_velocity_mps": [1.0, 1.1, 1.2, None, 1.4, 2.0, 2.1, 2.2, 2.3],
            "step_length_m": [0.6, np.nan, 0.7, 0.7, 0.8, 0.9, 1.0, 1.1, np.nan],
        }
    )


def image_db(axes: Axes) -> np.ndarray:
    return np.asarray(axes.images[0].get_array(), dtype=float)


def second_axis_limits(axes: Axes, *, side: str = "y") -> tuple[np.ndarray, np.ndarray]:
    axes.figure.canvas.draw()
    (second,) = (child for child in axes.child_axes)
    return np.array(getattr(axes, f"get_{side}lim")()), np.array(getattr(second, f"get_{side}lim")())


def labels_of(axes: Axes) -> list[str]:
    return axes.get_legend_handles_labels()[1]


def texts(axes: Axes) -> str:
    return "\n".join(text.get_text() for text in axes.texts)


def test_signature_draws_db_of_the_input_clipped_to_the_range() -> None:
    mu = make_signature()
    axes = viz.signature(mu, db_range=20.0).axes[0]
    level = 10 * np.log10(mu.values.T.astype(float))
    np.testing.assert_allclose(image_db(axes), np.clip(level, level.max() - 20.0, level.max()), atol=1e-9)
    assert (image_db(axes) == level.max() - 20.0).any()
    assert axes.images[0].get_clim() == pytest.approx((level.max() - 20.0, level.max()))
    assert axes.images[0].get_extent() == pytest.approx((0.475, 2.475, -260.0, 252.0))
    assert axes.images[0].origin == "lower"  # approaching is up, and time runs right
    assert axes.get_ylim()[0] < 0.0 < 80.0 < axes.get_ylim()[1]
    assert axes.get_xlim()[0] < axes.get_xlim()[1]


def test_second_axis_is_half_a_wavelength_per_hertz() -> None:
    hertz, metres = second_axis_limits(viz.signature(make_signature()).axes[0])
    np.testing.assert_allclose(metres, hertz * WAVELENGTH_M / 2)
    figure = viz.doppler_lines(make_scatterers(), wavelength_m=0.1)
    hertz, metres = second_axis_limits(figure.axes[0])
    np.testing.assert_allclose(metres, hertz * 0.05)


def test_automatic_limits_hold_the_line_and_zero_and_leave_out_the_noise() -> None:
    low, high = doppler_limits_hz(make_signature())
    assert -60.0 < low < 0.0
    assert 96.0 < high < 150.0
    assert doppler_limits_hz(make_signature(), lines_hz=[-150.0, np.nan])[0] < -150.0
    only_noise = make_signature().copy(data=make_signature().values[:, ::-1] * 0 + 1)
    assert doppler_limits_hz(only_noise) == (DOPPLER_HZ[0], DOPPLER_HZ[-1])


def test_automatic_range_ends_below_the_noise_but_not_beyond_40_db() -> None:
    noise = np.zeros(1001)
    noise[0] = 27.0
    assert level_limits_db(noise, None) == (-3.0, 27.0)
    noise[300:] = -np.inf
    assert level_limits_db(noise, None) == (-3.0, 27.0)
    noise[0] = 90.0
    assert level_limits_db(noise, None) == (50.0, 90.0)
    noise[0] = 1.0
    assert level_limits_db(noise, None) == (-19.0, 1.0)


def test_zero_columns_are_dark_and_nan_columns_stay_unknown() -> None:
    mu = make_signature()
    mu.values[3] = 0.0
    mu.values[5] = np.nan
    axes = viz.signature(mu, db_range=25.0).axes[0]
    low, _ = axes.images[0].get_clim()
    plotted = image_db(axes)
    assert (plotted[:, 3] == low).all()
    assert np.ma.getmaskarray(axes.images[0].get_array())[:, 5].all()
    assert axes.images[0].get_cmap().get_bad()[:3] == pytest.approx([0xBD / 255] * 3)


def test_uneven_time_axis_is_drawn_where_it_is() -> None:
    mu = make_signature()
    uneven = mu.assign_coords(time=("time", np.arange(40) ** 1.5, {"units": "s"}))
    axes = viz.signature(uneven, db_range=20.0).axes[0]
    mesh = axes.collections[0]
    level = 10 * np.log10(mu.values.T.astype(float))
    np.testing.assert_allclose(np.asarray(mesh.get_array()), np.maximum(level, level.max() - 20.0), atol=1e-9)
    assert not axes.images


def test_truth_lines_are_one_a_scatterer_in_their_parts_colours() -> None:
    truth = viz.scatterer_doppler(make_scatterers(), wavelength_m=WAVELENGTH_M)
    axes = viz.signature(make_signature(), truth_doppler=truth, main_line_hz=80.0).axes[0]
    assert len(axes.lines) == len(PARTS) + 1
    assert [line.get_color() for line in axes.lines[:-1]] == [PART_COLOURS[find_part_group(part)] for part in PARTS]
    np.testing.assert_allclose(axes.lines[3].get_ydata(), 2 * 2.5 / WAVELENGTH_M)
    assert labels_of(axes) == ["torso", "head", "left leg", "right leg", "left arm", "main line"]
    assert axes.get_ylim()[1] > 2 * 4.0 / WAVELENGTH_M


def test_normalisation_pair_shares_the_doppler_axis() -> None:
    raw, normalised = make_signature(), make_signature(normalised=True) * 0.25
    normalised.attrs["units"] = "1"
    left, right, *bars = viz.signature_normalisation(raw, normalised=normalised).axes
    assert left.get_ylim() == right.get_ylim()
    assert right.images[0].get_clim()[1] == pytest.approx(left.images[0].get_clim()[1] + 10 * np.log10(0.25), abs=1e-4)
    assert "re 1 V²" in bars[0].get_ylabel()
    assert bars[1].get_ylabel().startswith("normalised power (dB)")


def test_contact_sheet_has_one_scale_for_all() -> None:
    loud, quiet = make_signature(), make_signature() * 0.01
    quiet.attrs["units"] = "V^2"
    figure = viz.contact_sheet([loud, quiet, loud], titles=["a", "b", "c"], db_range=30.0)
    panels = [axes for axes in figure.axes if axes.images]
    assert [axes.get_title(loc="left") for axes in panels] == ["a", "b", "c"]
    assert len({axes.images[0].get_clim() for axes in panels}) == 1
    assert len({axes.get_ylim() for axes in panels}) == 1
    assert image_db(panels[1]).max() == pytest.approx(image_db(panels[0]).max() - 20.0, abs=1e-4)


def test_range_time_draws_the_magnitude_in_db_with_range_up() -> None:
    axes, bar = viz.range_time(make_baseband(), db_range=70.0).axes
    expected = np.full((20, 50), -60.0)
    expected[7] = 0.0
    np.testing.assert_allclose(image_db(axes), expected, atol=1e-4)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time (s)", "range (m)")
    assert axes.get_ylim() == pytest.approx((0.975, 1.975))
    assert bar.get_ylabel() == "magnitude (dB re 1 V), 70 dB shown"


def test_range_time_of_a_long_recording_draws_some_of_its_pulses(monkeypatch) -> None:
    baseband = make_baseband()
    whole = image_db(viz.range_time(baseband, db_range=70.0).axes[0])
    assert whole.shape == (20, 50)
    monkeypatch.setattr("doppelgait.viz.ranges.LONG_PULSES", 40)
    monkeypatch.setattr("doppelgait.viz.ranges.MOST_COLUMNS", 10)
    np.testing.assert_array_equal(image_db(viz.range_time(baseband, db_range=70.0).axes[0]), whole[:, ::5])


def test_tracks_are_drawn_two_lines_each_with_their_labels() -> None:
    axes = viz.range_time(make_baseband(), tracks={"human 1": make_gate(), "human 2": make_gate(1.7, 5.0)}).axes[0]
    assert len(axes.lines) == 4
    assert labels_of(axes) == ["gate: human 1", "gate: human 2"]
    assert len({line.get_color() for line in axes.lines}) == 1, "a class has one colour"
    assert [line.get_linestyle() for line in axes.lines] == ["-", "-", "--", "--"]
    np.testing.assert_array_equal(axes.lines[3].get_ydata(), 5.0)
    assert axes.get_ylim() == pytest.approx((0.975, 1.975))
    assert labels_of(viz.range_time(make_baseband(), tracks=make_gate()).axes[0]) == ["gate"]


def make_range_doppler() -> xr.DataArray:
    values = np.full((1, 64, 20), 1e-3)
    values[0, 42, 7] = 1.0
    coords = {"time": [0.3], "range": 1.0 + 0.05 * np.arange(20), **doppler_coords()}
    return labels.make_array(labels.RANGE_DOPPLER, values, coords).isel(time=0)


def test_range_doppler_map_and_its_gate() -> None:
    axes = viz.range_doppler_map(make_range_doppler(), gate=make_gate(band_hz=100.0)).axes[0]
    assert axes.get_title(loc="left") == "Range-Doppler map at 0.30 s"
    assert np.unravel_index(image_db(axes).argmax(), (64, 20)) == (42, 7)
    (gate,) = axes.patches
    assert gate.get_bbox().extents == pytest.approx((1.2, -100.0, 1.6, 100.0))


def test_moving_gate_is_drawn_where_it_is_at_the_time_of_the_map() -> None:
    gate = make_gate()
    gate["range_low"].values[:] = 1.0 + gate.coords["time"].values
    assert viz.range_doppler_map(make_range_doppler(), gate=gate).axes[0].patches[0].get_x() == pytest.approx(1.3)
    timeless = make_range_doppler().drop_vars("time")
    assert viz.range_doppler_map(timeless, gate=gate).axes[0].patches[0].get_x() == pytest.approx(1.25)


def test_range_lines_are_thin_for_points_and_bold_for_torso_and_feet() -> None:
    axes = viz.range_lines(make_scatterers()).axes[0]
    bold = [line for line in axes.lines if line.get_linewidth() > 2.0]
    assert [line.get_label() for line in bold] == ["torso (mean)", "left foot (mean)", "right foot (mean)"]
    assert len(axes.lines) == len(PARTS) + 3
    np.testing.assert_allclose(bold[0].get_ydata(), 5.05 - 0.01 * np.arange(30))
    assert {line.get_linestyle() for line in axes.lines} == {"-"}
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time (s)", "range (m)")


def frames_of(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.get_visible()]


def test_stick_frames_cover_one_stride_on_equal_axes() -> None:
    panels = frames_of(viz.stick_frames(make_motion(stride_hz=2.0), n_frames=6))
    assert [axes.get_title() for axes in panels] == [f"{t:.2f} s" for t in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)]
    assert {axes.get_aspect() for axes in panels} == {1.0}
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in panels}) == 1
    assert panels[0].get_ylabel() == "height (m)"
    assert "(m)" in panels[-1].get_xlabel()


def test_stick_frames_look_along_the_path_with_the_body_in_the_middle() -> None:
    panels = frames_of(viz.stick_frames(make_motion(), n_frames=4))
    foot = next(points for points in panels[2].collections if points.get_label() == "left leg")
    np.testing.assert_allclose(foot.get_offsets(), [[0.4, 0.0], [-0.4, 0.1]], atol=1e-9)
    limb = panels[2].lines[-1]
    np.testing.assert_allclose(limb.get_ydata(), [0.1, 0.0], atol=1e-9)


def test_stick_frames_of_a_standing_body_and_of_unknown_stride() -> None:
    still = make_motion(stride_hz=np.nan)
    still.position_m[..., 1] -= still.position_m[:, :1, 1]
    panels = frames_of(viz.stick_frames(still, n_frames=2))
    assert [axes.get_title() for axes in panels] == ["0.00 s", "2.00 s"]
    reach = np.ptp([points.get_offsets()[:, 0] for points in panels[0].collections if points.get_label() == "left leg"])
    assert reach == pytest.approx(0.8)


def test_step_doppler_is_amplitude_in_db_over_cadence() -> None:
    axes, bar = viz.cadence_map(make_cadence_map(), db_range=35.0, gait_frequency_hz=2.0).axes
    plotted = image_db(axes)
    assert plotted.shape == (64, 81)
    assert plotted[40, 20] == pytest.approx(-20.0)
    assert plotted.min() == pytest.approx(-55.0)
    assert axes.get_xlim() == pytest.approx((0.0, 8.0))
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("cadence (Hz)", "Doppler frequency (Hz)")
    assert [text.get_text() for text in axes.texts] == ["1", "2", "3"]
    assert labels_of(axes) == ["1: gait frequency, 2.00 Hz"]
    assert "35 dB shown" in bar.get_ylabel()
    aligned = make_cadence_map().assign_attrs(aligned=True)
    with rc_context({"image.cmap": "gray"}):
        axes = viz.cadence_map(aligned).axes[0]
    assert axes.images[0].get_cmap().name == "gray"
    assert "from the torso" in axes.child_axes[0].get_ylabel()
    assert axes.get_ylabel() == "Doppler frequency from the main line (Hz)"


@pytest.mark.parametrize(
    ("harmonics_hz", "doubtful", "marks"),
    [([None, None], True, ["1"]), ([None, 5.9], False, ["1", "3"]), ([4.1, 5.9], True, ["1", "2", "3"])],
)
def test_the_cadence_map_marks_only_harmonics_that_were_found(harmonics_hz, doubtful, marks):
    figure = viz.cadence_map(make_cadence_map(), gait_frequency_hz=2.0, harmonics_hz=harmonics_hz, doubtful=doubtful)
    axes = figure.axes[0]
    assert labels_of(axes) == ["1: gait frequency, 2.00 Hz" + " ?" * doubtful]
    assert [text.get_text() for text in axes.texts] == marks


def test_cadence_axis_reaches_the_third_harmonic() -> None:
    assert viz.cadence_spectrum(make_spectrum(), gait_frequency_hz=4.0).axes[0].get_xlim()[1] == pytest.approx(14.4)
    assert viz.cadence_spectrum(make_spectrum()).axes[0].get_xlim()[1] == pytest.approx(8.0)
    figure = viz.cadence_spectrum(make_spectrum(), gait_frequency_hz=4.0, max_cadence_hz=5.0)
    assert figure.axes[0].get_xlim()[1] == pytest.approx(5.0)


def test_cadence_spectrum_marks_its_peaks_with_their_values() -> None:
    figure = viz.cadence_spectrum(make_spectrum(), gait_frequency_hz=2.0, harmonics_hz=(4.0, None))
    axes = figure.axes[0]
    curve, *marks = axes.lines
    np.testing.assert_allclose(np.asarray(curve.get_ydata())[[20, 40, 50]], [0.0, -10.0, -30.0], atol=1e-9)
    assert [(m.get_xdata()[0], m.get_ydata()[0]) for m in marks] == [
        (2.0, pytest.approx(0.0)),
        (4.0, pytest.approx(-10.0)),
    ]
    assert [text.get_text() for text in axes.texts] == ["1", "2"]
    assert labels_of(axes) == ["1: gait frequency, 2.00 Hz", "2: harmonic, 4.00 Hz"]
    assert axes.get_ylabel() == "level (dB re maximum)"


def test_no_gait_frequency_is_said_and_a_zero_spectrum_can_be_drawn() -> None:
    silent = make_spectrum() * 0.0
    silent.attrs["units"] = "1"
    axes = viz.cadence_spectrum(silent).axes[0]
    assert "no gait frequency" in texts(axes)
    assert len(axes.lines) == 1
    assert np.isfinite(np.asarray(axes.lines[0].get_ydata())).all()


def test_mean_doppler_spectrum_shades_the_bandwidth_and_states_the_threshold() -> None:
    values = make_signature().values.mean(axis=0)
    axes = viz.mean_doppler_spectrum(
        values, doppler_hz=DOPPLER_HZ, wavelength_m=WAVELENGTH_M, torso_doppler_hz=80.0,
        bandwidth_hz=(40.0, 120.0), threshold=0.1,
    ).axes[0]  # fmt: skip
    curve = np.asarray(axes.lines[0].get_ydata())
    np.testing.assert_allclose(curve, 10 * np.log10(values / values.max()), atol=1e-6)
    assert axes.patches[0].get_x() == pytest.approx(40.0)
    assert axes.patches[0].get_width() == pytest.approx(80.0)
    assert labels_of(axes) == ["bandwidth 80 Hz", "threshold 0.1 (-10.0 dB)", "torso 80.0 Hz"]
    hertz, metres = second_axis_limits(axes, side="x")
    np.testing.assert_allclose(metres, hertz * WAVELENGTH_M / 2)


def test_bandwidth_given_as_a_width_is_put_where_the_power_is() -> None:
    power = np.zeros(64)
    power[40:45] = 1.0
    low, high = densest_band_hz(power, DOPPLER_HZ, 64.0)
    assert high - low == pytest.approx(64.0)
    assert low < DOPPLER_HZ[40] <= DOPPLER_HZ[44] < high
    assert (low + high) / 2 == pytest.approx(80.0, abs=6.0)


def test_scatter_leaves_out_unknown_rows_and_counts_them() -> None:
    axes = viz.feature_scatter(make_table(), x="torso_velocity_mps", y="step_length_m").axes[0]
    assert labels_of(axes) == ["dog (n = 3, 1 left out)", "human (n = 3, 2 left out)"]
    np.testing.assert_allclose(axes.collections[0].get_offsets(), [[2.0, 0.9], [2.1, 1.0], [2.2, 1.1]])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("torso velocity (m/s)", "step length, radial (m)")


def test_matrix_shows_shares_of_each_class() -> None:
    figure = viz.feature_matrix(make_table(), features=("torso_velocity_mps", "step_length_m"))
    first, second = (axes for axes in figure.axes if axes.get_visible())
    for stairs in (*first.patches, *second.patches):
        assert stairs.get_data().values.sum() == pytest.approx(100.0)
    assert labels_of(second) == ["dog", "human"]
    assert second.get_title(loc="left") == "dog (n = 3, 1 left out), human (n = 4, 1 left out)"
    assert second.get_xlabel() == "step length, radial (m)"


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("harmonic_ratio_2", "second harmonic ratio"), ("ground_speed_mps", "ground speed (m/s)"),
        ("snr_mu_db", "SNR of the signature (dB)"), ("m", "m"),
    ],
)  # fmt: skip
def test_units_come_from_the_column_names(name: str, label: str) -> None:
    assert label_quantity(name) == label


def make_overview(**changes: object) -> Figure:
    result = {
        "signature": make_signature(), "cadence_map": make_cadence_map(), "cadence_spectrum": make_spectrum(),
        "shown_features": {"torso_velocity_mps": 1.234, "step_length_m": None, "harmonic_ratio_2": 2.0},
        "gate_limits": None, "gait_frequency_hz": 2.0, "flags": ("low_confidence",), "label": "human",
        "main_line_hz": None, "doubtful": (), "analysis": Analysis(), **changes,
    }  # fmt: skip
    return viz.overview(make_baseband(), SimpleNamespace(**result))


def test_overview_shows_all_of_one_target() -> None:
    figure = make_overview()
    titles = {axes.get_title(loc="left"): axes for axes in figure.axes}
    assert "Range against time" in titles
    table = texts(titles["Features"])
    for entry in ("+1.23 m/s", "step length", "not determined", "2.00 Hz", "low confidence"):
        assert entry in table
    assert texts(titles["Cadence spectrum"]) == "1\n2"
    assert labels_of(titles["Cadence spectrum"])[0] == "1: gait frequency, 2.00 Hz"
    assert titles["Cadence-velocity diagram"].get_ylim() == titles["Micro-Doppler signature"].get_ylim()


def test_overview_shows_doubts_next_to_the_values() -> None:
    figure = make_overview(doubtful=("gait_frequency_hz", "step_length_m"))
    said = "\n".join(texts(axes) for axes in figure.axes)
    assert "2.00 Hz ?" in said
    assert [words for axes in figure.axes for words in labels_of(axes)].count("1: gait frequency, 2.00 Hz ?") == 2
    assert said.count("? low confidence") == said.count("low confidence") == 1
    assert "?" not in "\n".join(texts(axes) for axes in make_overview().axes)
    assert "+" not in "\n".join(texts(axes) for axes in make_overview(flags=("no_direction",)).axes)


def test_threads_draw_the_same_bytes(tmp_path: Path) -> None:
    paths = [tmp_path / f"{number}.png" for number in range(4)]
    jobs = [threading.Thread(target=lambda p=p: viz.save_figure(viz.signature(make_signature()), p)) for p in paths]
    for job in jobs:
        job.start()
    for job in jobs:
        processes.join(job)
    assert len({path.read_bytes() for path in paths}) == 1


def test_failed_save_leaves_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "a.png"
    target.mkdir()
    with pytest.raises(OutputError, match="cannot be written"):
        viz.save_figure(Figure().subplots(), target)
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
    with pytest.raises(OutputError, match="cannot be written"):
        viz.save_figure(Figure(), tmp_path / "nowhere" / "a.png")
    with pytest.raises(AnalysisError, match=r"in \.png, \.svg or \.pdf"):
        viz.save_figure(viz.signature(make_signature()), tmp_path / "a.jpg")


@pytest.mark.parametrize(("suffix", "head"), [(".svg", b"<?xml"), (".PDF", b"%PDF"), (".png", b"\x89PNG\r\n\x1a\n")])
def test_vector_files_keep_the_axes_words_and_their_bytes(tmp_path: Path, suffix: str, head: bytes) -> None:
    files = [viz.save_figure(viz.signature(make_signature()), tmp_path / f"{n}{suffix}") for n in range(2)]
    assert files[0].read_bytes().startswith(head)
    assert files[0].read_bytes() == files[1].read_bytes()
    assert not [word for word in (b"Date", b"tEXt", b"tIME") if word in files[0].read_bytes()]


def test_a_figure_for_a_paper_has_the_size_and_text_of_a_journal(tmp_path: Path) -> None:
    figure = viz.range_time(make_baseband(), tracks={name: make_gate() for name in ("human", "dog")})
    paper = fit_to_paper(figure)
    assert (paper.get_size_inches()[0], paper.dpi, figure.get_size_inches()[0]) == (3.5, 300, 10.5)
    assert {text.get_fontsize() for text in paper.findobj(Text) if text.get_text()} == {8}
    assert not [axes for axes in paper.axes if axes.get_title(loc="left")]
    assert paper.axes[1].get_ylabel() == "magnitude (dB re 1 V)"
    page = viz.save_figure(figure, tmp_path / "a.pdf", style="paper").read_bytes()
    assert b"/CIDFontType2" in page
    assert b"/Type3" not in page
    assert re.search(rb"/Height 20\b", page), "the map has the resolution of its data"
    assert re.search(rb"/Width 50\b", page)
    pair = fit_to_paper(viz.signature_normalisation(make_signature(), normalised=make_signature(normalised=True)))
    assert (pair.get_size_inches()[0], pair.axes[0].get_title(loc="left")) == (7.2, "(a) signature")
    with pytest.raises(ConfigError, match=r"style: 'papre' is not allowed.*did you mean paper\?"):
        viz.save_figure(pair, tmp_path / "a.png", style="papre")


def describe(figure: Figure) -> list[object]:
    words = [(text.get_text(), text.get_fontsize()) for text in figure.findobj(Text)]
    return [*figure.get_size_inches(), figure.dpi, figure.canvas, figure.axes[0].images[0].get_interpolation(), words]


@pytest.mark.parametrize("name", ["a.png", "a.pdf"])
def test_a_figure_of_the_user_keeps_its_size_and_saving_changes_no_figure(tmp_path: Path, name: str) -> None:
    pyplot.close("all")
    stack, chosen, ours = pyplot.figure(figsize=(3.5, 6.0)), *(viz.signature(make_signature()) for _ in range(2))
    viz.signature(make_signature(), ax=stack.subplots(3, 1)[0], title="(a)")
    chosen.set_size_inches(3.0, 2.0)
    for figure, size in ((stack, (350, 600)), (chosen, (300, 200)), (ours, (350, 245))):
        before = describe(figure)
        page = viz.save_figure(figure, tmp_path / name, dpi=100, style="paper").read_bytes()
        points = " ".join(f"{0.72 * side:g}" for side in size)
        assert (struct.pack(">II", *size) if name == "a.png" else f"/MediaBox [ 0 0 {points} ]".encode()) in page
        assert describe(figure) == before
    assert pyplot.get_fignums() == [stack.number]
    assert fit_to_paper(stack).axes[0].get_title(loc="left") == "(a)"


def test_small_panels_have_the_text_of_the_user_and_short_labels() -> None:
    with rc_context({"font.size": 7.0}):
        axes = Figure(figsize=(3.5, 6.0), layout="constrained").subplots(3, 1)[0]
        viz.signature(make_signature(), ax=axes, main_line_hz=80.0, title="")
        axes.figure.draw_without_rendering()
    assert {text.get_fontsize() for text in axes.figure.findobj(Text) if text.get_text()} == {7.0}
    assert axes.child_axes[0].get_ylabel() == "radial velocity (m/s)"
    assert not axes.get_legend().get_in_layout()


def test_a_radar_without_range_has_no_range_axis() -> None:
    (axes,) = viz.range_time(make_baseband().isel(range=[7]), tracks=make_gate()).axes
    assert axes.get_ylabel() == "level (dB re 1 V)"
    np.testing.assert_allclose(axes.lines[0].get_ydata(), 0.0, atol=1e-6)
    axes = viz.range_doppler_map(make_range_doppler().isel(range=[7])).axes[0]
    assert (axes.get_xlabel(), list(axes.get_xticks())) == ("", [])


def single_panels() -> dict[str, Callable[..., Figure]]:
    return {
        "signature": partial(viz.signature, make_signature(), main_line_hz=80.0),
        "range_time": partial(viz.range_time, make_baseband(), tracks=make_gate()),
        "range_doppler_map": partial(viz.range_doppler_map, make_range_doppler(), gate=make_gate()),
        "cadence_map": partial(viz.cadence_map, make_cadence_map()),
        "cadence_spectrum": partial(viz.cadence_spectrum, make_spectrum()),
        "mean_doppler_spectrum": partial(
            viz.mean_doppler_spectrum, np.ones(64), doppler_hz=DOPPLER_HZ, wavelength_m=WAVELENGTH_M
        ),
        "range_lines": partial(viz.range_lines, make_scatterers()),
        "doppler_lines": partial(viz.doppler_lines, make_scatterers(), wavelength_m=WAVELENGTH_M),
        "feature_scatter": partial(viz.feature_scatter, make_table(), x="torso_velocity_mps", y="step_length_m"),
    }


@pytest.mark.parametrize("name", single_panels())
def test_single_panels_take_the_axes_of_a_figure_of_the_user(name: str) -> None:
    figure = Figure(layout="constrained")
    left, right = figure.subplots(1, 2)
    plot = single_panels()[name]
    assert plot(ax=right) is figure
    assert not left.has_data()
    alone = plot().axes[0]
    assert (right.get_title(loc="left"), right.get_ylabel()) == (alone.get_title(loc="left"), alone.get_ylabel())
    assert len(right.lines) == len(alone.lines) > 0 or len(right.images) + len(right.collections) > 0
    assert not figure.legends, "a legend of the figure would cover the user's other panels"
    words = alone.get_legend_handles_labels()[1]
    assert [
        text.get_text() for text in (right.get_legend().get_texts() if words and right.get_legend() else [])
    ] == words
    bare = Figure().add_subplot()
    plot(ax=bare, colorbar=False, velocity_axis=False, legend=False)
    assert (bare.figure.axes, bare.child_axes, bare.get_legend()) == ([bare], [], None)
    with pytest.raises(ConfigError, match=r"ax: int is not allowed; make axes with matplotlib\.pyplot\.subplots"):
        plot(ax=3)


def wrong_calls() -> dict[str, tuple[object, str]]:
    mu, table = make_signature(), make_table()
    no_unit = mu.copy()
    no_unit.attrs = {}
    zero_axis = mu.isel(doppler=[32])
    truth = viz.scatterer_doppler(make_scatterers(), wavelength_m=WAVELENGTH_M)
    return {
        "numpy": (lambda: viz.signature(mu.values), "signature must be an xarray.DataArray"),
        "result": (lambda: viz.signature(SimpleNamespace(signature=mu)), "give the signature of this SimpleNamespace"),
        "units": (lambda: viz.signature(no_unit), "units are None"),
        "transposed": (lambda: viz.signature(mu.T), "dimensions are"),
        "empty": (lambda: viz.signature(mu.isel(time=slice(0))), "nothing to plot"),
        "db range": (lambda: viz.signature(mu, db_range=0.0), "db_range is 0.0"),
        "db limits": (lambda: viz.signature(mu, db_range=(0.0, -30.0)), "two limits in dB must rise"),
        "line length": (lambda: viz.signature(mu, main_line_hz=[1.0, 2.0]), r"\(40,\)"),
        "only 0 Hz": (lambda: viz.signature(zero_axis), "has only 0 Hz"),
        "truth without parts": (lambda: viz.signature(mu, truth_doppler=truth.drop_vars("part")), "'part'"),
        "truth over time": (lambda: viz.signature(mu, truth_doppler=mu), "must be .'slow_time', 'scatterer'"),
        "sheet units": (
            lambda: viz.contact_sheet([mu, make_signature(normalised=True)], titles="ab"), "no common dB scale",
        ),
        "sheet titles": (lambda: viz.contact_sheet([mu], titles=[]), "one title each"),
        "sheet empty": (lambda: viz.contact_sheet([], titles=[]), "1 to 64"),
        "sheet columns": (lambda: viz.contact_sheet([mu], titles=["a"], columns=-1), "columns is -1"),
        "real baseband": (lambda: viz.range_time(make_baseband().real), "complex"),
        "gate": (lambda: viz.range_time(make_baseband(), tracks=make_gate().drop_vars("range_high")), "range_high"),
        "gate without band": (
            lambda: viz.range_doppler_map(make_range_doppler(), gate=make_gate().drop_vars("doppler_low")),
            "missing: doppler_low",
        ),
        "no velocity": (lambda: viz.doppler_lines(xr.Dataset(), wavelength_m=0.04), "'radial_velocity'"),
        "no dataset": (lambda: viz.range_lines(mu), "must be a Dataset"),
        "wavelength": (lambda: viz.doppler_lines(make_scatterers(), wavelength_m=0.0), "must be positive"),
        "frames": (lambda: viz.stick_frames(make_motion(), n_frames=1), "2 to 16"),
        "frames beyond": (lambda: viz.stick_frames(make_motion(), start_s=1.9, duration_s=1.0), "do not lie in"),
        "no points": (
            lambda: viz.stick_frames(make_motion().with_positions(np.full((101, 4, 3), np.nan))), "no known point",
        ),
        "cadence": (lambda: viz.cadence_map(make_cadence_map(), max_cadence_hz=0.05), "fewer than two cadences"),
        "spectrum": (lambda: viz.cadence_spectrum(make_cadence_map()), "dimensions are"),
        "lengths": (
            lambda: viz.mean_doppler_spectrum([1.0], doppler_hz=DOPPLER_HZ, wavelength_m=0.04), "equally long",
        ),
        "threshold": (
            lambda: viz.mean_doppler_spectrum(DOPPLER_HZ, doppler_hz=DOPPLER_HZ, wavelength_m=0.04, threshold=4.0),
            "between 0 and 1",
        ),
        "column": (lambda: viz.feature_scatter(table, x="speed", y="step_length_m"), r"no columns \['speed'\]"),
        "words": (lambda: viz.feature_scatter(table, x="label", y="step_length_m"), "must be numbers"),
        "no rows": (lambda: viz.feature_matrix(table[:0], features=("step_length_m",)), "no rows"),
        "no features": (lambda: viz.feature_matrix(table, features=()), "1 to 12"),
    }  # fmt: skip


@pytest.mark.parametrize("name", wrong_calls())
def test_wrong_input_is_refused_in_clear_words(name: str) -> None:
    call, message = wrong_calls()[name]
    with pytest.raises(AnalysisError, match=message):
        call()  # type: ignore[operator]

"""The gate as one value: constructors, text, equality and the check against the recorded frame."""

from types import SimpleNamespace

import numpy as np
import pytest

from doppelgait.core.errors import AnalysisError, ConfigError
from doppelgait.processing import Analysis, Gate

TIMES_S = np.linspace(0.0, 2.0, 21)
CELLS_M = np.linspace(1.0, 3.0, 5)


def test_equal_gates_have_the_same_track_span_band_and_source():
    gate = Gate.around(TIMES_S, TIMES_S + 1.0, span_m=1.0, doppler_hz=(-3.0, 9.0))
    assert gate == Gate.around(TIMES_S, TIMES_S + 1.0, span_m=1.0, doppler_hz=(-3.0, 9.0))
    for other in (
        Gate.around(TIMES_S, TIMES_S, span_m=1.0, doppler_hz=(-3.0, 9.0)),
        Gate.around(TIMES_S, TIMES_S + 1.0, span_m=2.0, doppler_hz=(-3.0, 9.0)),
        Gate.around(TIMES_S, TIMES_S + 1.0, span_m=1.0),
        Gate.around(TIMES_S, TIMES_S + 1.0, span_m=1.0, doppler_hz=(-3.0, 9.0), source="truth"),
        "given",
    ):
        assert gate != other


@pytest.mark.parametrize(
    ("text", "choice"),
    [("track", "track"), ("truth", "truth"), ("1.2:2.8", (1.2, 2.8)), ((1, 2.5), (1.0, 2.5)), ("-1:1e1", (-1.0, 10.0))],
)
def test_text_of_a_gate(text, choice):
    assert Gate.parse(text) == choice


@pytest.mark.parametrize("value", ["1:2:3", "a:b", "", 3, None, (1,), "2:1", "1:1", "0:inf", "nan:1", "way"])
def test_what_is_no_gate_names_key_and_value(value):
    with pytest.raises(ConfigError, match=r"^--gate: .* is not allowed; it must be"):
        Gate.parse(value, where="--gate")


def test_a_fixed_gate_is_cut_to_the_frame():
    gate = Gate.fixed(-5.0, 2.0, time_s=TIMES_S, range_m=CELLS_M)
    assert (gate.low_m[0], gate.high_m[0], gate.start_s, gate.stop_s) == (0.75, 2.0, 0.0, 2.0)
    assert Gate.fixed(50.0, 60.0, time_s=TIMES_S, range_m=[0.0]).span_m == 10.0  # a radar without range


def test_every_gate_outside_the_frame_is_refused_in_the_same_words():
    says = r"gate 5 to 6 m: lies outside the recorded frame, 0\.75 to 3\.25 m"
    with pytest.raises(AnalysisError, match=says):
        Gate.fixed(5.0, 6.0, time_s=TIMES_S, range_m=CELLS_M)
    gate = Gate.fixed(5.0, 6.0, time_s=TIMES_S)
    with pytest.raises(AnalysisError, match=says):
        gate.touched_bins(*gate.edges(CELLS_M, TIMES_S, sharp=False), CELLS_M)


def test_the_truth_gives_span_and_band_of_the_analysis_or_the_report():
    truth = SimpleNamespace(
        label="dog",
        centre_range_m=TIMES_S + 2.0,
        doppler_hz=lambda wavelength_m: np.array([[-4.0, 8.0]]) / wavelength_m,
    )
    gate = Gate.from_truth(truth, TIMES_S, Analysis(gate_span_m=1.2), error_m=0.5)
    assert gate == Gate.around(TIMES_S, TIMES_S + 2.5, span_m=1.2, source="truth")
    report = Gate.from_truth(truth, TIMES_S, Analysis(method="liland2018"), wavelength_m=2.0)
    assert (report.span_m, report.doppler_hz) == (1.5, (-2.0, 4.0))
    with pytest.raises(AnalysisError, match="wavelength_m"):
        Gate.from_truth(truth, TIMES_S, Analysis(method="liland2018"))


def test_gates_overlap_where_they_share_ranges_at_a_time_of_both():
    gate = Gate.fixed(1.0, 2.0, time_s=[0.0, 1.0])
    assert gate.overlaps(Gate.fixed(1.9, 3.0, time_s=[0.5, 3.0]))
    assert not gate.overlaps(Gate.fixed(2.1, 3.0, time_s=[0.0, 1.0]))
    assert not gate.overlaps(Gate.fixed(1.0, 2.0, time_s=[5.0, 6.0]))

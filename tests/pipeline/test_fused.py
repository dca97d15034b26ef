"""The fused path gives the same bytes as simulating and analysing step by step."""

from __future__ import annotations

import numpy as np
import pytest

from doppelgait.core.rng import rng
from doppelgait.motion import boulic_walk, quadruped_gait
from doppelgait.pipeline import analyze, simulate
from doppelgait.pipeline.fused import run_fused
from doppelgait.processing import Analysis
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target

WALK = boulic_walk(speed_mps=1.3, height_m=1.7, duration_s=3.0)
TROT = quadruped_gait(gait="trot", withers_m=0.4, duration_s=3.0)

SCENES = {
    "one": Scene([Target(WALK, label="human", aspect_deg=20.0)]),
    "receding": Scene([Target(TROT, label="dog", aspect_deg=180.0, range_m=4.0)]),
    "passing": Scene([Target(WALK, label="human", range_m=5.0), Target(TROT, range_m=5.0, aspect_deg=180.0)]),
}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("hop", [None, 1])
@pytest.mark.parametrize(("snr_db", "gate_error_m"), [(None, 0.0), (10.0, 0.25), (float("inf"), -0.2)])
def test_signature_and_features_are_the_same_to_the_byte(scene, hop, snr_db, gate_error_m):
    radar, analysis = Radar.preset("x4"), Analysis(hop=hop)
    stepwise = simulate(SCENES[scene], radar, rng=rng(4), snr_db=snr_db)
    expected = analyze(stepwise, gate="truth", analysis=analysis, gate_error_m=gate_error_m)
    found = run_fused(SCENES[scene], radar, analysis, rng=rng(4), snr_db=snr_db, gate_error_m=gate_error_m)
    assert found.noise_power_v2 == stepwise.noise_power_v2
    assert found.snr_frame_db == stepwise.snr_frame_db
    assert found.n_pulses == stepwise.n_pulses
    for one, other in zip(found.results, expected, strict=True):
        assert one.signature.values.tobytes() == other.signature.values.tobytes()
        assert one.features == other.features
        assert one.quality == other.quality
        assert one.flags == other.flags


def test_the_reports_method_and_a_second_example_in_the_same_buffers():
    radar = Radar.preset("x4")
    for analysis, scene in ((Analysis(method="liland2018", hop=10), "one"), (Analysis(), "passing")):
        expected = analyze(simulate(SCENES[scene], radar, rng=rng(1)), gate="truth", analysis=analysis)
        found = run_fused(SCENES[scene], radar, analysis, rng=rng(1))
        for one, other in zip(found.results, expected, strict=True):
            np.testing.assert_array_equal(one.signature.values, other.signature.values)
            assert one.features == other.features


def test_a_data_matrix_that_cannot_fit_is_refused():
    from doppelgait.core.errors import ConfigError

    radar = Radar.preset("x4", range_stop_m=5000.0, prf_hz=9000)
    with pytest.raises(ConfigError, match=r"more than 2e\+09 samples"):
        simulate(Scene([Target(boulic_walk(speed_mps=1.0, duration_s=30.0))]), radar)


def test_features_do_not_depend_on_a_hop_finer_than_the_lossless_one():
    """Hop 8 at 1000 Hz loses nothing; hops 1, 2 and 4 hold its columns and give the same features to the bit."""
    radar, scene = Radar.preset("x4"), SCENES["one"]
    by_hop = {hop: run_fused(scene, radar, Analysis(hop=hop), rng=rng(2)).results[0] for hop in (1, 2, 4, 8)}
    for hop in (1, 2, 4):
        one, other = by_hop[hop], by_hop[8]
        assert one.features == other.features
        assert one.quality == other.quality
        np.testing.assert_array_equal(one.signature.values[:: 8 // hop], other.signature.values)
        assert one.main_line_hz.size == one.signature.sizes["time"]
        np.testing.assert_allclose(one.main_line_hz[:: 8 // hop], other.main_line_hz, rtol=1e-12)
    coarse = run_fused(scene, radar, Analysis(hop=16), rng=rng(2)).results[0]
    assert coarse.features != by_hop[8].features  # a coarser hop is taken as it is


def test_noise_reaches_every_cell_that_the_signature_reads():
    """Of all pulses and bins, those not declared needed may hold anything."""
    from doppelgait.processing import Gate
    from doppelgait.processing.signature import cut_out, signature_of_planes

    slow_time_s, range_m = np.arange(700) / 1000.0, 1.0 + 0.05 * np.arange(60)
    gate = Gate.around(slow_time_s, 3.5 - 1.7 * slow_time_s, span_m=0.9, source="given")
    for analysis in (Analysis(), Analysis(hop=1), Analysis(method="liland2018")):
        cut = cut_out(gate, slow_time_s, range_m, analysis)
        needed = cut.needed_pulses()
        planes = np.random.default_rng(0).standard_normal((2, 60, 700)).astype(np.float32)
        expected = signature_of_planes(*planes, 0, cut, wavelength_m=0.04).values
        for n, (first, stop) in enumerate(needed):
            planes[:, n, :first] = planes[:, n, max(stop, first) :] = 1e6
        found = signature_of_planes(*planes, 0, cut, wavelength_m=0.04).values
        np.testing.assert_array_equal(found, expected)
        assert (needed[:, 1] - needed[:, 0]).clip(0).sum() < 0.9 * 60 * 700


def test_a_cropped_signature_is_thinned_from_the_same_columns():
    """Where the gate leaves the frame the first columns go: before that, hop 1 must pick the columns of hop 8."""
    radar = Radar.preset("x4", range_start_m=3.0, range_stop_m=6.0)
    found = {}
    for hop in (1, 2, 8):
        with pytest.warns(match="outside the frame"):
            found[hop] = run_fused(SCENES["one"], radar, Analysis(hop=hop), rng=rng(2)).results[0]
    assert "gate_leaves_frame" in found[8].flags
    for hop in (1, 2):
        assert found[hop].features == found[8].features
        assert found[hop].main_line_hz.size == found[hop].signature.sizes["time"]


def test_a_record_too_short_for_the_features_is_too_short_at_every_hop():
    from doppelgait.core.errors import AnalysisError

    short = Scene([Target(WALK, label="human")], duration_s=0.15)
    for hop in (1, 8):
        with pytest.raises(AnalysisError, match="at least 8 are needed"):
            run_fused(short, Radar.preset("x4"), Analysis(hop=hop))
    assert len(run_fused(short, Radar.preset("x4"), Analysis(method="liland2018")).results) == 1


def test_a_body_that_is_never_in_the_frame_has_no_snr():
    radar = Radar.preset("x4", range_start_m=50.0, range_stop_m=55.0)
    with pytest.warns(match="outside the frame"):
        recording = simulate(SCENES["one"], radar, rng=rng(0))
    assert recording.snr_frame_db == -np.inf

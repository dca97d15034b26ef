"""Features beyond the six on drawn signatures with known answers, and what must not change them."""

from types import SimpleNamespace

import numpy as np
import pytest

import doppelgait as dg
from doppelgait import processing
from doppelgait.core import plugins
from doppelgait.core.errors import ConfigError
from doppelgait.core.rng import Streams
from doppelgait.features import FEATURE_UNITS, FEATURES, Extraction, GaitFeatures
from doppelgait.features.extended import list_features, measure_extended
from doppelgait.features.feature_set import NEEDS
from doppelgait.features.observed import REASONS, compute_autocorrelation_at
from doppelgait.features.uncertainty import estimate_uncertainties
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.pipeline import analyze, simulate
from doppelgait.pipeline.target import analyze_signature, observe
from doppelgait.processing import Analysis, Gate
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target
from exact_signatures import RATE_HZ, T, block, evidence_of, extended_of, extraction_of, line_at, with_extraction


@pytest.mark.parametrize("sense", [1, -1])
def test_envelope_statistics_of_a_swinging_block(sense):
    swing = np.sin(2 * np.pi * 2.0 * T)
    ahead, behind = 2.0 + 1.0 * swing, 1.0 + 0.2 * swing
    line = 1.5
    edges = (line - behind, line + ahead) if sense > 0 else (-line - ahead, -line + behind)
    found = extended_of(block(*edges), sense * line)
    # the quantiles leave 1 % of the block's power on either side
    width = ahead + behind
    ahead, behind = ahead - 0.01 * width, behind - 0.01 * width
    wanted = {
        "forward_envelope_mean_mps": ahead.mean(), "backward_envelope_mean_mps": behind.mean(),
        "forward_envelope_sd_mps": ahead.std(), "backward_envelope_sd_mps": behind.std(),
        "forward_envelope_range_mps": 2 * np.sin(0.45 * np.pi) * (1 - 0.012),
        "backward_envelope_range_mps": 2 * np.sin(0.45 * np.pi) * (0.2 - 0.012),
        "envelope_offset_mps": (2.0 - 1.0) / 2,
        "torso_bandwidth_mps": (3.0 - 1.2 * np.sin(0.45 * np.pi)) * 0.98,
    }  # fmt: skip
    for name, value in wanted.items():
        assert found[name] == pytest.approx(value, abs=0.015), name
    high, low = np.percentile(ahead, 95), np.percentile(behind, 95)
    assert found["envelope_asymmetry"] == pytest.approx((high - low) / (high + low), abs=0.01)
    assert found["swing_duty"] == pytest.approx(0.5, abs=0.02)
    assert found["envelope_periodicity"] == pytest.approx(1.0, abs=0.01)


def test_swing_duty_is_the_share_of_the_time_far_out():
    ahead = np.where((2.0 * T) % 1.0 < 0.3, 3.0, 1.0)
    assert extended_of(block(0.5, 1.5 + ahead), 1.5)["swing_duty"] == pytest.approx(0.3, abs=0.01)
    assert extended_of(block(0.5, 2.5), 1.5)["swing_duty"] is None


def test_envelope_periodicity_is_low_at_another_period():
    ahead = 2.0 + np.sin(2 * np.pi * 2.0 * T)
    values = block(0.5, 1.5 + ahead)
    assert extended_of(values, 1.5, 4.0)["envelope_periodicity"] == pytest.approx(-1.0, abs=0.05)


def test_strength_variation_takes_the_range_out():
    range_m = np.linspace(6.0, 3.0, T.size)
    swing = 1.0 + 0.5 * np.sin(2 * np.pi * 2.0 * T)
    values = line_at(1.0) * (swing / range_m**4)[:, None]
    assert extended_of(values, 1.0, range_m=range_m)["strength_variation"] == pytest.approx(0.5 / np.sqrt(2), rel=0.01)


def test_torso_ripple_and_its_parts_at_the_gait_and_half_of_it():
    swing = 0.3 * np.sin(2 * np.pi * 2.0 * T + 0.4) + 0.1 * np.sin(2 * np.pi * 1.0 * T + 1.0)
    found = extended_of(line_at(1.5 + swing), 1.5)
    whole, half = (a / np.sqrt(2) * np.exp(-0.5 * (2 * np.pi * f * 0.04) ** 2) for a, f in ((0.3, 2.0), (0.1, 1.0)))
    assert found["torso_ripple_gait_mps"] == pytest.approx(whole, rel=0.03)
    assert found["torso_ripple_half_mps"] == pytest.approx(half, rel=0.10)  # the removed polynomial takes some
    assert found["torso_ripple_mps"] == pytest.approx(np.hypot(whole, half), rel=0.03)


def test_torso_ripple_needs_three_periods_for_the_half_and_ignores_a_slow_drift():
    drifting = 1.5 + 0.2 * (T / T[-1] - 0.5) ** 2
    found = extended_of(line_at(drifting), 1.5, 0.55)
    assert found["torso_ripple_half_mps"] is None
    assert found["torso_ripple_mps"] < 0.002


def test_alternate_likeness_tells_steps_from_strides():
    rng = np.random.default_rng(1)
    left, right = np.kron(rng.random((2, 12, 40)), np.ones((1, 5, 1)))  # 60 columns a step, 12 shapes of 5 columns
    pad = np.zeros((60, 44))
    for pair, wanted in (((left, left), 1.0), ((left, right), None)):
        steps = [np.concatenate([pad, pair[n % 2], pad[:, :43]], axis=1) for n in range(11)]
        values = np.concatenate(steps)[: T.size] + 1e-9
        found = extended_of(values, 0.3, RATE_HZ / 60)["alternate_likeness"]
        if wanted is None:
            rows = values[:, 44:84] / values.sum(axis=1, keepdims=True)
            rows = rows - rows.mean(axis=0)
            a, b = rows[:-60], rows[60:]
            once = 2 * (a * b).sum() / (a**2 + b**2).sum()
            a, b = rows[:-120], rows[120:]
            wanted = once / (2 * (a * b).sum() / (a**2 + b**2).sum())
            assert wanted < 0.3
        assert found == pytest.approx(wanted, abs=0.01)


def test_likeness_between_whole_lags_and_beyond_the_record():
    wave = np.sin(2 * np.pi * np.arange(400) / 37.5)
    assert compute_autocorrelation_at(wave, 37.5) == pytest.approx(1.0, abs=0.005)
    assert compute_autocorrelation_at(wave, 37.5 / 2) == pytest.approx(-1.0, abs=0.02)
    assert compute_autocorrelation_at(wave, 399.5) is None
    assert compute_autocorrelation_at(wave, 0.5) is None


@pytest.mark.parametrize("line_mps", [1.3, -1.3])
def test_power_shares_by_velocity(line_mps):
    s = np.sign(line_mps)
    values = 0.5 * line_at(line_mps) + 0.3 * line_at(line_mps + s) + 0.15 * line_at(line_mps + 2.2 * s)
    values += 0.05 * line_at(0.0) + 0.01
    found = extended_of(values, line_mps, floor=0.01)
    wanted = {"torso_share": 0.5, "limb_share": 0.35, "far_limb_share": 0.15, "stance_share": 0.05}
    for name, value in wanted.items():
        assert found[name] == pytest.approx(value, abs=0.002), name
    assert extended_of(values, 0.5 * s, floor=0.01)["stance_share"] is None


@pytest.mark.parametrize("k", [127, 255, 1023])
def test_band_edges_cut_cells_in_part(k):
    found = extended_of(block(-1.5, 4.5, k), np.linspace(1.4, 1.6, T.size), None)
    assert found["torso_share"] == pytest.approx(0.8 / 6, rel=0.01)
    assert found["limb_share"] == pytest.approx(2.4 / 6, rel=0.01)


def test_entropy_width_of_an_even_spread_does_not_depend_on_the_transform():
    for k in (511, 2047):
        assert extended_of(block(0.5, 2.5, k), 1.5)["entropy_width_mps"] == pytest.approx(2.0, rel=0.02)


def lines(cadence_hz, powers, level=0.0):
    values = np.full(cadence_hz.size, level)
    for f, p in powers.items():
        values[np.abs(cadence_hz - f).argmin()] += p
    return values


def test_cadence_moments():
    found = extended_of(line_at(1.5), 1.5, spectrum=lambda f: lines(f, {0.2: 9.0, 2.0: 3.0, 4.0: 1.0}))
    assert found["cadence_centroid_hz"] == pytest.approx(2.5)
    assert found["cadence_bandwidth_hz"] == pytest.approx(np.sqrt(0.75 * 0.5**2 + 0.25 * 1.5**2))


def test_relative_harmonics_without_the_noise():
    spectrum = {2.0: 8.0, 4.05: 4.0, 6.0: 2.0, 7.7: 5.0}
    found = extended_of(line_at(1.5), 1.5, spectrum=lambda f: lines(f, spectrum, level=1.0))
    assert found["relative_harmonic_2"] == pytest.approx(0.5)
    assert found["relative_harmonic_3"] == pytest.approx(0.25)
    assert found["relative_harmonic_4"] == 0.0  # 7.7 is more than half a resolution cell (0.1 Hz) from 8
    assert extended_of(line_at(1.5), 1.5, 5.5)["relative_harmonic_4"] is None


def test_reasons_for_what_is_missing():
    evidence = evidence_of(line_at(0.1), 0.1)
    nothing = with_extraction(evidence, Extraction(GaitFeatures(), None, None, None))
    assert set(measure_extended(nothing).values()) == {None}
    assert nothing.describe_missing(()) == "no_signal"
    slow = with_extraction(evidence_of(line_at(0.1), 0.1), extraction_of(0.1, None))
    assert slow.describe_missing(("direction",)) == "slower_than_0.2_mps_towards_or_away"
    assert slow.describe_missing(("gait_frequency",)) == "needs_a_gait_frequency"
    values = measure_extended(slow)
    assert values["forward_envelope_mean_mps"] is values["alternate_likeness"] is None
    assert values["torso_ripple_mps"] is not None
    gone = np.where(T[:, None] < 3.0, 0.0, block(0.5, 2.5))
    found = with_extraction(evidence_of(gone + 1e-12, 1.5, floor=2e-12), extraction_of(1.5))
    assert measure_extended(found)["torso_ripple_mps"] is measure_extended(found)["envelope_offset_mps"] is None
    assert found.describe_missing(("envelope",)) == "signal_in_too_few_columns"
    assert found.describe_missing(("line",)) == "main_line_lost_in_noise"


def test_features_of_other_packages_and_values_that_are_not_finite(monkeypatch):
    with pytest.raises(ConfigError, match="torso_share"):
        dg.plugin("feature", "torso_share", unit="1", source="here")(lambda observed: 1.0)
    len(FEATURES)  # the built-in ones first
    own = {name: FEATURES[name] for name in FEATURE_UNITS}
    monkeypatch.setitem(plugins._REGISTERED, "feature", own)
    dg.plugin("feature", "mine", unit="1", source="here")(lambda observed: 2.0 * observed.observation_s)
    dg.plugin("feature", "broken", unit="1", source="here")(lambda observed: float("nan"))
    found = measure_extended(with_extraction(evidence_of(line_at(1.5), 1.5), extraction_of(1.5)))
    assert found == {"broken": None, "mine": 10.0}


@pytest.mark.parametrize(
    ("facts", "text"),
    [
        ({"needs": ("enveloppe",)}, r"needs \('enveloppe',\) is not allowed; it is a tuple of gait_frequency"),
        ({"needs": "envelope"}, "needs 'envelope' is not allowed"),
        ({"unit": None}, "unit None is not allowed"),
    ],
)
def test_a_feature_with_wrong_facts_is_refused(facts, text):
    with pytest.raises(ConfigError, match=f"feature 'wrong' of .*test_extended: {text}"):
        dg.plugin("feature", "wrong", **{"unit": "1", "source": "here", **facts})(lambda observed: 1.0)
    assert "wrong" not in FEATURES


def test_what_features_can_need_is_known():
    assert {*NEEDS, "signal"} == set(REASONS)
    observed = evidence_of(line_at(1.5), 1.5)
    assert all(hasattr(observed, f"has_{need}") for need in NEEDS)


def test_the_set_f_is_part_of_the_registry_in_its_order():
    marked = sorted((item for item in FEATURES.values() if "set_f" in item.facts), key=lambda item: item.facts["set_f"])
    assert {item.name: item.facts["unit"] for item in marked} == FEATURE_UNITS
    assert [item.facts["set_f"] for item in marked] == list(range(6))
    assert len(FEATURES) == 6 + len(list_features())


def test_registered_features_are_in_results_rows_and_tables(register, walker_mu):
    register("feature", "columns", unit="1", source="here")(lambda observed: float(observed.power_v2.shape[0]))
    gate = Gate.around([0, 4], [8, 3], span_m=1.6)
    result = analyze_signature(walker_mu, gate, Analysis(doppler_bins=127), label=None)
    assert result.extended["columns"] == walker_mu.sizes["time"] == result.to_row()["extended_columns"]
    assert ("columns", "1", "here") in list_features()
    register("feature", "words", unit="1", source="here")(lambda observed: "many")
    with pytest.raises(ConfigError, match="feature 'words': 'many' is no number"):
        analyze_signature(walker_mu, gate, Analysis(doppler_bins=127), label=None)


@pytest.fixture(scope="module", params=["body_parts", "surfaces"])
def walker_mu(request):
    motion = boulic_walk(height_m=1.75, speed_mps=1.3, duration_s=4.1)
    scene = Scene([Target(motion, range_m=5.0, rcs=request.param)], duration_s=4.0)
    recording = simulate(scene, Radar.preset("x4"), rng=Streams(3), snr_db=20.0)
    return analyze(recording, gate="truth", analysis=Analysis(doppler_bins=127))[0].signature


def assessed(mu):
    observed = observe(processing.decimate(mu), Analysis(doppler_bins=127))
    return SimpleNamespace(
        extended=measure_extended(observed), standard_deviations=estimate_uncertainties([observed])[0]
    )


def test_power_direction_and_time_reversal_do_not_matter(walker_mu, request):
    wanted, points = assessed(walker_mu), request.node.callspec.params["walker_mu"] == "body_parts"
    assert None not in wanted.extended.values()
    assert all(v is not None for n, v in wanted.standard_deviations.items() if n != "harmonic_ratio_3")
    mirrored = walker_mu.values[:, ::-1]
    backwards = walker_mu.copy(data=mirrored[::-1])
    backwards = backwards.assign_coords(centre_range=("time", walker_mu.coords["centre_range"].values[::-1]))
    variants = {
        "power": (walker_mu.copy(data=walker_mu.values * np.float32(1e-3)), 1e-3),
        "direction": (walker_mu.copy(data=mirrored), 1e-3 if points else 6e-3),  # deviations of weak harmonics
        "played backwards": (backwards, 0.03),
    }
    for name, (mu, tolerance) in variants.items():
        found = assessed(mu)
        for feature, value in wanted.extended.items():
            assert found.extended[feature] == pytest.approx(value, rel=tolerance, abs=0.005), (name, feature)
        for feature, value in wanted.standard_deviations.items():
            if value is not None:
                spare = 2e-4 if feature == "gait_frequency_hz" else None  # it has the difference of two rates
                wanted_sd = pytest.approx(value, rel=10 * tolerance, abs=spare)
                assert found.standard_deviations[feature] == wanted_sd, (name, feature)

"""Standard deviations of the features against closed forms, brute force and repeated observations."""

import itertools

import numpy as np
import pytest

import doppelgait.features as feature_layer
from doppelgait.core.rng import Streams
from doppelgait.features import Extraction, GaitFeatures, uncertainty
from doppelgait.features.doppler import width_of_bins
from doppelgait.motion.models import human_gait
from doppelgait.pipeline import analyze, simulate
from doppelgait.processing import Analysis
from doppelgait.radar import Radar
from doppelgait.scene import Scene, Target
from exact_signatures import T, block, evidence_of, extraction_of, line_at, with_extraction


def periods_with(phase_rad, rows=None, frequency_hz=2.0):
    """Periods whose fundamental is late by the given phases and whose harmonics follow it."""
    rng = np.random.default_rng(0)
    shape = np.array([1.0, 0.5, 0.2])[:, None] * np.exp(2j * np.pi * rng.random((3, 20))) if rows is None else rows
    turned = np.exp(1j * np.arange(1, 4) * np.asarray(phase_rad)[:, None])[:, :, None] * shape
    centre_s = (np.arange(len(phase_rad)) + 0.5) / frequency_hz
    return uncertainty.Periods(turned, np.ones((len(phase_rad), 20)), centre_s, frequency_hz)


def test_frequency_sd_is_that_of_the_rate_of_the_phases():
    phase = np.array([-0.09, 0.05, -0.03, 0.02])
    periods = periods_with(phase)
    (slope, _), cov = np.polyfit(periods.centre_s, phase, 1, cov=True)
    share = np.sqrt(0.25 * slope**2 + cov[0, 0]) / (2 * np.pi * 2.0)
    assert uncertainty.frequency_sd_hz(periods, 4.0) == pytest.approx(
        2.0 * np.hypot(share, np.hypot(0.4 / 16, 0.0025)), rel=0.03
    )


@pytest.mark.parametrize(("n", "share"), [(3, 0.05), (24, 0.006), (40, 0.02), (40, 0.05)])
def test_frequency_that_the_phases_contradict_is_uncertain(n, share):
    late = uncertainty.frequency_sd_hz(periods_with(2 * np.pi * share * np.arange(n)), float(n))
    assert late / 2.0 == pytest.approx(np.hypot(share / 2, np.hypot(0.4 / n**2, 0.0025)), rel=0.01)


def test_harmonic_ratio_sd_is_that_of_two_straight_lines():
    rng = np.random.default_rng(3)
    late = rng.normal(scale=0.01, size=(25, 3))
    shape = np.exp(2j * np.pi * rng.random((3, 20)))
    harmonics = np.exp(1j * np.arange(1, 4) * late)[:, :, None] * shape
    centre_s = (np.arange(25) + 0.5) / 2.0
    found = uncertainty.estimate_harmonic_ratio_sd(uncertainty.Periods(harmonics, np.ones((25, 20)), centre_s, 2.0), 2)
    # ratio = h (1 + (slope_h - slope_1) / (2 pi f)), slopes of the phase in terms of the fundamental
    variance = sum(np.polyfit(centre_s, late[:, h], 1, cov=True)[1][0, 0] for h in (0, 1))
    assert found == pytest.approx(uncertainty.HARMONIC_FACTOR * 2 * np.sqrt(variance) / (2 * np.pi * 2.0), rel=0.02)


def test_ratio_sd_is_that_of_a_mean_over_periods():
    strength = np.random.default_rng(4).normal(1.0, 0.1, 12)
    periods = periods_with(np.zeros(12))
    periods.harmonics[:] *= strength[:, None, None]
    energy = 20 * (1.0 + 0.25 + 0.04)
    each = strength * np.sqrt(4 * energy / 20.0)
    assert uncertainty.estimate_ratio_sd(periods) == pytest.approx(
        np.hypot(uncertainty.RATIO_FACTOR * each.std(ddof=1) / np.sqrt(12), 0.05 * each.mean() / 12), rel=0.01
    )


def test_velocity_sd_of_independent_columns():
    rng = np.random.default_rng(5)
    taper = 1 - np.linspace(-1, 1, T.size) ** 2
    wanted = 0.1 * np.sqrt((taper**2).sum()) / taper.sum()
    found = []
    for _ in range(8):  # every column's strongest cell is off by 0.1 m/s, independently of the next
        evidence = evidence_of(line_at(1.5 + rng.normal(scale=0.1, size=T.size), k=255), 1.5)
        for frequency_hz in (2.0, 3.0, 5.0, None):
            observed = with_extraction(evidence, extraction_of(1.5, frequency_hz))
            found.append(uncertainty.estimate_velocity_sd([observed])[0] ** 2 - uncertainty.VELOCITY_LEAST_MPS**2)
    # Cauchy weights with this tuning are 95 % efficient on Gaussian errors
    assert np.sqrt(np.mean(found)) == pytest.approx(wanted / np.sqrt(0.95), rel=0.12)


def test_velocity_sd_ignores_what_repeats_in_every_period():
    swing = 0.2 * np.sin(2 * np.pi * 2.0 * T)
    observed = with_extraction(evidence_of(line_at(1.5 + swing), 1.5), extraction_of(1.5, 2.0))
    ripple = np.sqrt(np.mean(observed.torso_ripple_mps**2))
    (alone,) = uncertainty.estimate_velocity_sd([observed])
    assert alone == pytest.approx(np.hypot(0.05 * ripple, uncertainty.VELOCITY_LEAST_MPS), rel=0.3)
    other = with_extraction(evidence_of(line_at(1.5 + swing), 1.5), extraction_of(1.5, 3.1))
    assert uncertainty.estimate_velocity_sd([observed, other])[1] > 1.5 * alone


def test_bandwidth_sd_is_a_jackknife_over_groups_of_periods():
    rng = np.random.default_rng(6)
    ahead = 1.5 + 0.5 * np.sin(2 * np.pi * 2.0 * T) + np.repeat(rng.normal(scale=0.5, size=10), 63)[: T.size]
    observed = with_extraction(evidence_of(block(0.5, 1.5 + ahead), 1.5), extraction_of(1.5, 2.0))
    above = observed.excess.values >= observed.raised_level_v2[:, None]
    edges = np.rint(np.arange(11) * 62.5).astype(int)[np.arange(9) * 10 // 8]  # of eight groups of ten periods
    bin_mps = observed.velocity_mps[1] - observed.velocity_mps[0]
    kept = [np.delete(above, slice(*group), axis=0) for group in itertools.pairwise(edges)]
    without = [width_of_bins(above.mean(axis=0)) * bin_mps for above in kept]
    scatter = np.sqrt(7 / 8 * ((without - np.mean(without)) ** 2).sum())
    wanted = np.sqrt(scatter**2 + 2 * bin_mps**2 / 12) / observed.mps_per_hz
    assert uncertainty.estimate_bandwidth_sd([observed]) == pytest.approx([wanted], rel=1e-6)
    assert scatter > 2 * bin_mps


def swinging():
    swing = np.sin(2 * np.pi * 2.0 * T)
    values = line_at(1.5) * (1.2 + swing)[:, None] + 0.4 * line_at(2.5) * (1.2 - swing)[:, None]
    features = GaitFeatures(1.5, 80.0, 0.75, 2.0, 3.0, 0.6)
    return evidence_of(values, 1.5), Extraction(features, 2.0, 1.5 / extraction_of(1.5).torso_doppler_hz, 10.0)


def test_step_length_sd_adds_relative_variances_and_the_third_harmonic_has_none():
    (found,) = uncertainty.estimate_uncertainties([with_extraction(*swinging())])
    share = np.hypot(found["torso_velocity_mps"] / 1.5, found["gait_frequency_hz"] / 2.0)
    assert found["step_length_m"] == pytest.approx(0.75 * share)
    assert found["harmonic_ratio_3"] is None
    # even periods: what the ends may do is left, a twentieth of the ratio over ten periods
    rows = swinging()[0].aligned.values[:, 480:]
    power = np.abs(np.fft.fft(rows, axis=0)[[10, 20, 30]] / T.size) ** 2
    ratio = np.sqrt(4 * power.sum() / (rows.mean(axis=0) ** 2).sum())
    assert found["limb_torso_ratio"] == pytest.approx(0.05 * ratio / 10, rel=0.05)


def test_no_signal_and_few_periods_have_no_uncertainty():
    evidence, extraction = swinging()
    torso_hz = extraction.torso_doppler_hz
    nothing, slow, without = uncertainty.estimate_uncertainties(
        [
            with_extraction(evidence, Extraction(GaitFeatures(), None, None, None)),
            with_extraction(evidence, Extraction(extraction.features, 2.9 / 5.0, torso_hz, 2.9)),
            with_extraction(evidence, Extraction(GaitFeatures(1.5), None, torso_hz, None)),
        ]
    )
    assert set(nothing.values()) == {None}
    assert set(slow.values()) == {None}
    assert [name for name, value in without.items() if value is not None] == ["torso_velocity_mps"]


def test_flags_name_what_is_known_only_roughly():
    _, extraction = swinging()
    sd = {"gait_frequency_hz": 0.11, "step_length_m": 0.01, "torso_velocity_mps": None, "limb_torso_ratio": 0.13}
    assert uncertainty.flag_uncertain_features(extraction, sd) == (
        "gait_frequency_hz:uncertain_by_more_than_5_per_cent",
        "limb_torso_ratio:uncertain_by_more_than_20_per_cent",
    )
    receding = Extraction(GaitFeatures(torso_velocity_mps=-1.5), None, -73.0, None)
    assert uncertainty.flag_uncertain_features(receding, {"torso_velocity_mps": 0.2}) == ()


def observations(monkeypatch, rcs, count=24):
    """Errors over standard deviations of one uneven walker, seen again and again."""
    kept = []
    extract = feature_layer.extract
    monkeypatch.setattr(feature_layer, "extract", lambda e, **k: kept.append((e, extract(e, **k))) or kept[-1][1])
    radar = Radar.preset("x4-long", range_stop_m=12.0)
    for n in range(count):
        rng = np.random.default_rng([n, 20])
        motion = human_gait(
            speed_mps=1.2, duration_s=4.1, start_phase=n / count, step_time_sd=0.025, step_length_sd=0.02, pace_sd=0.02,
            rng=rng,
        )  # fmt: skip
        scene = Scene([Target(motion, aspect_deg=10.0, rcs=rcs)], duration_s=4.0)
        made = simulate(scene, radar, rng=Streams(20, n), snr_db=15.0, angles=False)
        truth = made.truth[0]
        analyze(made, gate="truth", analysis=Analysis(hop=8))
        (sd,) = uncertainty.estimate_uncertainties([with_extraction(*kept[-1])])
        found = kept[-1][1]
        yield (
            (found.features.torso_velocity_mps - truth.centre_velocity_mps.mean()) / sd["torso_velocity_mps"],
            (found.gait_frequency_hz - truth.gait_frequency_hz) / sd["gait_frequency_hz"],
            found.gait_frequency_hz / truth.gait_frequency_hz,
            (found.features.limb_torso_ratio, sd["limb_torso_ratio"]),
        )


@pytest.mark.parametrize("rcs", ["body_parts", "surfaces"])
def test_errors_are_as_large_as_stated(monkeypatch, rcs):
    velocity, frequency, octave, ratios = zip(*observations(monkeypatch, rcs), strict=True)
    right = np.abs(np.log2(octave)) < 0.5  # an octave is the confidence's concern
    assert right.mean() > 0.9
    for z in (velocity, np.array(frequency)[right]):
        assert 0.15 < np.sqrt(np.mean(np.square(z))) < 1.8
        assert np.abs(z).max() < 4
    values, stated = np.array(ratios).T
    if rcs == "body_parts":  # other bodies have other limbs, and other ratios
        assert 0.3 < np.std(values, ddof=1) / np.sqrt(np.mean(stated**2)) < 2.0

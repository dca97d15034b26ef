"""Swerling fluctuation (E-08d) and the spread of totals (E-08b): laws, correlation time, what draws."""

import numpy as np
import pytest
from scipy import stats

from doppelgait.core.errors import ConfigError
from doppelgait.motion.models.boulic import boulic_walk
from doppelgait.scene import RcsSpec, Scene, Target, assemble
from doppelgait.scene.rcs import sample_fluctuation

LAW = {"swerling1": stats.expon, "swerling3": stats.gamma(a=2, scale=0.5)}
WALK = boulic_walk(duration_s=1.0)
T = np.arange(0, 1.0, 0.01)


@pytest.mark.parametrize("kind", sorted(LAW))
def test_the_law_is_the_swerling_one(kind):
    found = sample_fluctuation(kind, [0.0, 0.333], 20_000, correlation_s=0.1, rng=np.random.default_rng(1))
    for sample in found:
        assert stats.kstest(sample, LAW[kind].cdf).pvalue > 0.01
        assert sample.mean() == pytest.approx(1.0, abs=0.02)
    wanted = {"swerling1": 1.0, "swerling3": 0.5}[kind]
    assert found.var() == pytest.approx(wanted, rel=0.05)
    other = "swerling3" if kind == "swerling1" else "swerling1"
    assert stats.kstest(found[0], LAW[other].cdf).pvalue < 1e-6


@pytest.mark.parametrize("kind", sorted(LAW))
def test_autocovariance_falls_to_1_over_e_at_the_correlation_time(kind):
    lag_s = np.array([0.0, 0.03, 0.06, 0.12])
    found = sample_fluctuation(kind, 0.017 + lag_s, 100_000, correlation_s=0.06, rng=np.random.default_rng(2))
    centred = found - 1.0
    covariance = (centred[0] * centred).mean(axis=1) / (centred[0] ** 2).mean()
    np.testing.assert_allclose(covariance, np.exp(-((lag_s / 0.06) ** 2)), atol=0.02)


def test_smooth_no_clicks_from_pulse_to_pulse():
    """Mean square slope of the Gaussian process is 1 / T_c^2, so that of the exponential factor is 4 / (2 T_c^2)."""
    step_s = 1e-4
    found = sample_fluctuation(
        "swerling1", np.arange(3) * step_s, 50_000, correlation_s=0.1, rng=np.random.default_rng(5)
    )
    slope = np.diff(found, axis=0) / step_s
    assert (slope**2).mean() == pytest.approx(2 / 0.1**2, rel=0.05)
    assert np.abs(np.diff(slope, axis=0)).max() < 0.1 * np.abs(slope).max()


def test_a_time_does_not_depend_on_the_others():
    all_of_them = sample_fluctuation("swerling3", T, 3, correlation_s=0.1, rng=np.random.default_rng(6))
    some = sample_fluctuation("swerling3", T[[40, 7]], 3, correlation_s=0.1, rng=np.random.default_rng(6))
    np.testing.assert_array_equal(some, all_of_them[[40, 7]])
    assert sample_fluctuation("swerling1", [], 3, correlation_s=0.1, rng=np.random.default_rng(6)).shape == (0, 3)


def rcs_of(spec, seed=None, walkers=1, **scene):
    targets = [Target(WALK, rcs=spec) for _ in range(walkers)]
    return assemble(
        Scene(targets, **scene), T, angles=False, rng=None if seed is None else np.random.default_rng(seed)
    )["rcs"].values


def test_one_total_per_target_around_the_stated_mean():
    found = np.array([rcs_of(RcsSpec(total_m2=0.8, total_spread_db=2.0), seed=s, walkers=2) for s in range(200)])
    assert np.ptp(found, axis=1).max() == 0.0  # constant in time
    totals = found[:, 0].reshape(200, 2, 17).sum(axis=-1)
    assert totals.mean() == pytest.approx(0.8, rel=0.06)
    assert (10 * np.log10(totals)).std() == pytest.approx(2.0, rel=0.1)
    assert abs(np.corrcoef(totals.T)[0, 1]) < 0.2


def test_what_is_drawn_needs_a_source_and_nothing_else_touches_it():
    for spec in (RcsSpec(fluctuation="swerling1"), RcsSpec(total_spread_db=2.0)):
        with pytest.raises(ConfigError, match="needs rng"):
            rcs_of(spec)
    source = np.random.default_rng(9)
    assemble(Scene([Target(WALK, rcs=RcsSpec(kind="body_parts", occlusion=True))]), T, rng=source)
    assert source.integers(2**63) == np.random.default_rng(9).integers(2**63)

"""Sensor model of real X4 modules: noise, clutter and phase of an empty room, and a person who is none of it."""

from pathlib import Path

import numpy as np
import pytest

from doppelgait.radar import Recording
from doppelgait.radar.fit import SensorFit, fit_sensor
from doppelgait.radar.readers import read_recording

pytestmark = pytest.mark.shared

HOST_DB = 20 * np.log10(2 * 0.7817)
"""Level in the chip's baseband over that behind the host's 27 taps, whose gain is 1/2."""
EMPTY = "rf_empty_room_two_radars_20220222_143239.mat"
BREATHING = "rf_breathing_20220303_131324.mat"


@pytest.fixture(scope="module")
def folder(shared: Path) -> Path:
    return shared / "data" / "radar" / "x4_rf_giraffe_yin"


@pytest.fixture(scope="module", params=["Data_Matrix_1", "Data_Matrix_2"])
def empty(request: pytest.FixtureRequest, folder: Path) -> Recording:
    return read_recording(folder / EMPTY, matrix=request.param)


@pytest.fixture(scope="module")
def fit(empty: Recording) -> SensorFit:
    return fit_sensor(empty)


def unit_db(fit: SensorFit) -> float:
    assert fit.level_of_unit_db is not None
    return fit.level_of_unit_db


def test_noise_is_that_measured_by_hand(fit: SensorFit) -> None:
    """-105 dB re one unit after a 27-tap low-pass; white, so flat in range."""
    assert fit.noise_level_db.value - unit_db(fit) - HOST_DB == pytest.approx(-105.0, abs=0.6)
    assert fit.noise_level_db.sd < 0.1
    assert fit.noise.flat
    assert fit.noise_figure_db.value == pytest.approx(6.0, abs=0.6)  # by the choice of threshold_step_v


def test_clutter_falls_from_the_direct_path_into_the_room(fit: SensorFit) -> None:
    """-51 dB near 0.85 m, -60 to -88 dB by 8 m, in units; single bins scatter by more than the profile."""
    levels = fit.clutter.level_db - unit_db(fit) - HOST_DB
    single = 20 * np.log10(np.abs(fit.echo_v)) - unit_db(fit) - HOST_DB
    near = single[np.argmin(np.abs(fit.range_m - 0.85))]
    assert near == pytest.approx(-51.0, abs=4.0)
    far = fit.clutter.range_m > 5.0
    assert np.all((levels[far] > -80.0) & (levels[far] < -52.0))
    assert np.mean(single[fit.range_m > 2.0] < -60.0) > 0.75
    assert levels[0] - levels[far].max() > 5.0


def test_phase_is_common_to_all_ranges_and_drifts_slowly(empty: Recording, fit: SensorFit) -> None:
    """The phase steps of the direct path and those of the room beyond 1.5 m, each on its own, are the same steps."""
    assert fit.phase is not None
    assert 0.002 < fit.phase.white.value < 0.007
    assert abs(fit.phase.drift_per_s.value * 60) < 1.0
    values = empty.baseband.values.astype(complex)
    steps = []
    for part in (fit.range_m < 1.1, fit.range_m > 1.5):
        alone = values[:, part] @ values[:, part].mean(axis=0).conj()
        steps.append(np.diff(np.unwrap(np.angle(alone))))
    assert np.corrcoef(steps)[0, 1] > 0.85
    # white jitter s gives steps of s sqrt(2); the walk adds its own
    assert fit.phase.white.value * np.sqrt(2) == pytest.approx(np.std(steps[0]), rel=0.3)


def test_restless_places_of_the_room_are_named(folder: Path) -> None:
    """Slow-time variance 7 to 12 dB over the noise far back in the room: 7.4 and 7.7 m, and 7.05 m."""
    first, second = (fit_sensor(read_recording(folder / EMPTY, matrix=f"Data_Matrix_{n}")) for n in (1, 2))
    assert {round(m.start_m) for m in first.moving} == {3, 7, 8}
    (only,) = second.moving
    assert only.start_m == pytest.approx(7.05, abs=0.1)
    assert not any("cannot be trusted" in flag for flag in (*first.flags, *second.flags))


def test_a_room_with_a_person_is_not_called_empty(folder: Path) -> None:
    fit = fit_sensor(read_recording(folder / BREATHING))
    assert any(m.start_m < 1.73 < m.stop_m for m in fit.moving)
    assert any("cannot be trusted" in flag for flag in fit.flags)

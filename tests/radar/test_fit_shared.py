"""Sensor model of real X4 modules: noise, clutter and phase of an empty room, and a person who is none of it."""

from pathlib import Path

import numpy as np
import pytest

from doppelgait.radar import Recording
from doppelgait.radar.fit import SensorKind, fit_sensor, measure_recording
from doppelgait.radar.fit.room import Room
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
def kind(empty: Recording) -> SensorKind:
    return fit_sensor(empty)


@pytest.fixture(scope="module")
def room(kind: SensorKind) -> Room:
    assert kind.recordings[0].room is not None
    return kind.recordings[0].room


def measure_unit_db(empty: Recording) -> float:
    return float(20.0 * np.log10(empty.radar.volts_per_unit))


def test_noise_is_that_measured_by_hand(empty: Recording, kind: SensorKind) -> None:
    """-105 dB re one unit after a 27-tap low-pass; white, so flat in range."""
    noise = kind.pooled["noise_level_db"].mean
    assert noise.value - measure_unit_db(empty) - HOST_DB == pytest.approx(-105.0, abs=0.6)
    assert noise.sd < 0.1
    assert kind.range_db == ()
    assert kind.radar.noise_figure_db == pytest.approx(6.0, abs=0.6)  # by the choice of threshold_step_v


def test_phase_is_common_to_all_ranges_and_drifts_slowly(empty: Recording, room: Room) -> None:
    """The phase steps of the direct path and those of the room beyond 1.5 m, each on its own, are the same steps."""
    assert room.phase is not None
    assert 0.002 < room.phase.white.value < 0.007
    assert abs(room.phase.drift_per_s.value * 60) < 1.0
    values = empty.baseband.values.astype(complex)
    steps = []
    for part in (empty.range_m < 1.1, empty.range_m > 1.5):
        alone = values[:, part] @ values[:, part].mean(axis=0).conj()
        steps.append(np.diff(np.unwrap(np.angle(alone))))
    assert np.corrcoef(steps)[0, 1] > 0.85
    # white jitter s gives steps of s sqrt(2); the walk adds its own
    assert room.phase.white.value * np.sqrt(2) == pytest.approx(np.std(steps[0]), rel=0.3)


def test_a_room_with_a_person_is_not_called_empty(folder: Path) -> None:
    measured = measure_recording(read_recording(folder / BREATHING))
    assert measured.room is not None
    assert any(m.start_m < 1.73 < m.stop_m for m in measured.room.moving)
    assert "cannot be trusted" in measured.notes["motion"]
    assert "more than a third" in measured.refused["phase noise"]
    # from the windows: frame differences contain the person and give -93 dB
    assert measured.estimates["noise_level_db"].value == pytest.approx(-117.7, abs=1.0)

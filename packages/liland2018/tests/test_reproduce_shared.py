"""The reproduction with real motion: a CMU walk, which the report used too, and a galloping dog."""

import shutil

import numpy as np
import pytest

from checkout import SHARED
from doppelgait_liland2018.entry import ENTRIES
from doppelgait_liland2018.material import Material

pytestmark = [
    pytest.mark.shared,
    pytest.mark.skipif(not SHARED.is_dir(), reason="the shared test data is not beside this checkout (../shared)"),
]

FILES = {"human": "c3d/cmu_07_01.c3d", "dog": "mann-bvh/D1_010_KAN01_002.bvh"}


@pytest.fixture(scope="module")
def material(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mocap")
    for label, name in FILES.items():
        (folder / label).mkdir()
        shutil.copy(SHARED / "data/mocap" / label / name, folder / label)
    return Material(motion_folder=folder)


@pytest.fixture(scope="module")
def made(material):
    return lambda number: {r.name: r for r in ENTRIES[number].make(material).readings}


def test_recordings_take_the_place_of_models(material):
    assert [one.name for one in material.people()] == ["human/cmu_07_01.c3d, segment 1"]
    assert [one.gait for one in material.dogs()] == ["gallop"]
    # the manifest of the shared data: 1.368 m/s, and a stride of 0.92 Hz to +-0.1 Hz
    person = material.person()
    way_m = np.linalg.norm(np.diff(person.motion.position_m[[0, -1], :, :2].mean(axis=1), axis=0))
    assert way_m / person.seconds == pytest.approx(1.368, abs=0.02)
    assert person.strides / person.seconds == pytest.approx(0.92, abs=0.03)


def test_a_recorded_walk_is_as_the_report_describes_it(made):
    cycle, ranges, shifts = made("fig-2.12"), made("fig-2.13"), made("fig-2.14")
    assert cycle["points of the body"].ours == 41
    for found in (cycle, ranges, shifts):
        assert not [name for name, reading in found.items() if reading.agrees is False]


def test_a_rotary_gallop_is_not_called_a_bound(made):
    found = made("fig-2.18")
    # lags of the touchdowns of this recording in the shared table of segments: 0.16 of a stride (hind), 0.15 (fore)
    assert found["phase between left and right hind paw"].ours == pytest.approx(0.16 * 360, abs=10)
    assert found["phase between left and right fore paw"].ours == pytest.approx(0.15 * 360, abs=10)
    assert found["phase between left and right hind paw"].agrees is False
    assert "gallop" in found["phase between left and right hind paw"].note
    assert made("fig-3.14")["stronger when nearer (1: yes)"].agrees is True

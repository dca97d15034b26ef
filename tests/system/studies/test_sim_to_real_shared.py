"""The quick form of the 24 GHz study on the real recordings (the X-band one: ``test_sim_to_real_xband``)."""

from importlib import import_module
from itertools import pairwise
from pathlib import Path

import pytest

pytestmark = pytest.mark.shared


def test_the_reported_half_of_people_is_measured_and_compared(shared: Path) -> None:
    radar_data = shared / "data" / "radar"
    study = import_module("sim_to_real_cw")
    text = "\n".join(study.compare(radar_data, None, count=4, seeds=1, real=4).values())
    real = [float(cell) for cell in text.split("| real, reported half |")[1].split("|")[:4]]
    assert all(-42 < after < before < -8 for before, after in pairwise(real))
    made = text.split("| models |")[1].split("|")[:8]
    assert all(float(cell.split()[0]) < -5 for cell in made[:4])
    assert all(0.3 < float(cell.split()[0]) <= 1.0 for cell in made[5:])
    halves = [study.real_people(radar_data, persons) for persons in (study.DEVELOPMENT, study.REPORTED)]
    assert [len(half) for half in halves] == [42, 74]
    assert not {one.person for one in halves[0]} & {one.person for one in halves[1]}

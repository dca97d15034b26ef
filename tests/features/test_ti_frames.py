"""Four numbers per frame against loops over every cell."""

import math

import numpy as np
import pytest

import doppelgait as dg
from doppelgait.features.ti_frames import NUMBERS, measure_columns, measure_windows


@pytest.fixture(scope="module")
def signature():
    walk = dg.Target(dg.motion.human_gait(speed_mps=1.2, duration_s=3.0), range_m=4.0, label="human")
    recording = dg.simulate(dg.Scene(targets=[walk]), dg.Radar.preset("ti-60-burst"), rng=dg.rng(4), snr_db=15)
    return dg.analyze(recording, gate="truth")[0].signature


def literal(powers: list[float], velocities: list[float], floor: float) -> list[float]:
    """The definition, one cell after the other."""
    cells = [max(p - floor, 0.0) for p in powers]
    total = math.fsum(cells)
    if total <= 0:
        return [math.nan, math.nan, 0.0, math.nan]
    edges = []
    for part in (0.125, 0.875):
        found = 0.0
        for number, cell in enumerate(cells):
            found += cell
            if found >= part * total:
                edges.append(number)
                break
    entropy = -math.fsum(c / total * math.log(c / total) for c in cells if c > 0) / math.log(len(cells))
    between = math.fsum(cells[edges[0] : edges[1] + 1])
    return [velocities[edges[0]], velocities[edges[1]], between, entropy]


@pytest.mark.parametrize("floor_share", [0.0, 0.5, 3.0])
def test_numbers_are_those_of_the_definition(signature, floor_share):
    floor = floor_share * float(np.median(signature.values))
    found = measure_columns(signature, noise_floor_v2=floor)
    velocities = signature.coords["velocity"].values.tolist()
    wanted = [literal(row.tolist(), velocities, floor) for row in signature.values.astype(float)]
    assert found.dims == ("time", "number")
    assert tuple(found["number"].values) == NUMBERS
    np.testing.assert_allclose(found.values, np.array(wanted, dtype=np.float32), rtol=1e-6)


def test_windows_have_the_mean_and_the_spread_of_their_frames(signature):
    numbers = measure_columns(signature).values
    numbers[3] = [np.nan, np.nan, 0.0, np.nan]
    found = measure_windows(numbers, frames=10)
    assert found.shape == (len(numbers) // 10, 8)
    for window, got in enumerate(found):
        rows = [n.astype(float) for n in numbers[10 * window : 10 * window + 10] if n[2] > 0]
        columns = [[10 * math.log10(row[k]) if k == 2 else row[k] for row in rows] for k in range(4)]
        means = [math.fsum(column) / len(column) for column in columns]
        spreads = [
            math.sqrt(math.fsum((x - mean) ** 2 for x in column) / len(column))
            for column, mean in zip(columns, means, strict=True)
        ]
        np.testing.assert_allclose(got, [*means, *spreads], rtol=1e-9, atol=1e-9)
    assert measure_windows(numbers).shape == (1, 8)
    assert np.isnan(measure_windows(np.zeros((5, 4)))).all()

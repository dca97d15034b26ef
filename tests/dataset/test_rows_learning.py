"""Pictures against closed forms, the shares of workers, and balanced weights against scikit-learn."""

import numpy as np
import pandas as pd
import pytest

from doppelgait.core.errors import DatasetError
from doppelgait.core.labels import SIGNATURE, make_array
from doppelgait.dataset.rows import epoch_rows, make_picture, picture_format
from doppelgait.processing.patches import Patch

INDEX = pd.DataFrame({"shard": np.repeat(["a", "b", "c"], 10)})


def band(level_db, *, seconds=2.5, prf_hz=1000.0, wavelength_m=0.04):
    """Power of 1, and so many dB more at 2 to 3 m/s."""
    velocity = (np.arange(200) - 100) * prf_hz / 200 * wavelength_m / 2
    power = np.where((velocity > 2) & (velocity < 3), 10 ** (level_db / 10), 1.0) * np.ones((round(seconds * 100), 1))
    coords = {
        "time": 0.01 * np.arange(power.shape[0]),
        "doppler": velocity * 2 / wavelength_m,
        "velocity": ("doppler", velocity),
    }
    return make_array(SIGNATURE, power.astype(np.float32), coords)


def test_a_picture_is_the_middle_and_has_the_floor_around_a_short_signature():
    picture = make_picture(band(30.0, seconds=1.0), Patch())
    seen = picture.max(axis=0) > 0.7
    assert seen.tolist() == [False] * 16 + [True] * 32 + [False] * 16
    wide = make_picture(band(30.0, seconds=4.0), Patch(n_time=128, n_velocity=32, range_db=20.0))
    assert wide.shape == (32, 128)
    assert wide.max() == 1.0
    assert (wide.max(axis=0) > 0.95).all()


def test_without_a_signature_the_picture_is_the_floor():
    for signature in (None, band(30.0)[:1]):
        picture = make_picture(signature, Patch())
        assert picture.shape == (64, 64)
        assert not picture.any()


def test_formats():
    assert picture_format("array", ["baseband"]) is None
    assert picture_format("picture", ["signature"]) == Patch()
    assert picture_format(Patch(n_time=32), ["signature"]).n_time == 32
    with pytest.raises(DatasetError, match="as_: 'db' is not allowed; it must be 'array', 'picture' or"):
        picture_format("db", ["signature"])
    with pytest.raises(DatasetError, match=r"only the field signature has a picture; read baseband with as_='array'"):
        picture_format("picture", ["signature", "baseband"])


@pytest.mark.parametrize("seed", [None, 7])
@pytest.mark.parametrize("workers", [1, 2, 3, 40])
def test_workers_share_the_rows_of_an_epoch(seed, workers):
    whole = epoch_rows(INDEX, seed, 3, 0, 1)
    shares = [epoch_rows(INDEX, seed, 3, worker, workers) for worker in range(workers)]
    assert sorted(np.concatenate(shares)) == list(range(30))
    for worker, share in enumerate(shares):
        assert np.array_equal(share, whole[worker::workers])


def test_the_order_depends_on_seed_and_epoch_alone():
    assert epoch_rows(INDEX, None, 5, 0, 1).tolist() == list(range(30))
    orders = {(seed, epoch): tuple(epoch_rows(INDEX, seed, epoch, 0, 1)) for seed in (0, 1) for epoch in (0, 1)}
    assert len(set(orders.values())) == 4
    assert orders[1, 1] == tuple(epoch_rows(INDEX.copy(), 1, 1, 0, 1))

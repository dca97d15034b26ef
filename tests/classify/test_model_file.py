"""Model files with damage: one short error, or a model that gives probabilities."""

import io
import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from doppelgait.classify.model_file import FOLDER, load_model, save_model
from doppelgait.core.errors import DatasetError
from export_models import export_model_of, model_of_tracks

SHIPPED = FOLDER / "x4.npz"


def changed(path, **changes):
    """The shipped model with other arrays."""
    with np.load(SHIPPED) as archive:
        arrays = {name: archive[name] for name in archive.files}
    np.savez(path, **arrays | changes)
    return path


def test_the_shipped_model_with_its_own_arrays_is_read(tmp_path):
    assert load_model(changed(tmp_path / "m.npz")).facts.alarm == "human"


def test_a_model_of_tracks_is_kept_next_to_one_of_windows(tmp_path):
    track, rows = model_of_tracks()
    model = replace(export_model_of("trees"), track=track)
    again = load_model(save_model(model, tmp_path / "m.npz"))
    assert again.of_tracks.facts == track.facts
    assert np.array_equal(again.of_tracks.probability(rows.values), track.probability(rows.values))
    assert save_model(again, tmp_path / "n.npz").read_bytes() == (tmp_path / "m.npz").read_bytes()
    for field, change in (("forgetting_hz", -1.0), ("gate_bias", np.nan), ("embed_weight", 1e200)):
        arrays = track.learned.arrays | {field: track.learned.arrays[field].astype(float) * 0 + change}
        damaged = replace(model, track=replace(track, learned=replace(track.learned, arrays=arrays)))
        with pytest.raises(DatasetError, match="is not a model of doppelgait, or is damaged"):
            load_model(save_model(damaged, tmp_path / "d.npz"))


@pytest.mark.parametrize(
    ("ending", "change"),
    [
        ("told", lambda values: values[:, None]),
        ("novelty.held", lambda values: values[:, None]),
        ("novelty.held", lambda values: np.full(values.shape, np.nan)),
        ("novelty.whitening", lambda values: values * 1e200),
        ("calibration.slope", lambda values: np.array([1e300])),
        ("calibration.shift", lambda values: values + 1e300),
        ("kernel.0", lambda values: values * np.float32(1e38)),
        (".weight", lambda values: values * 1e300),
        ("scale", lambda values: values * 1e-300),
        ("model", lambda values: values[:-1]),
        ("model", lambda values: np.frombuffer(b"[" * 100_000, dtype=np.uint8)),
        ("model", lambda values: np.frombuffer(b'{"doppelgait-model": ' + b"9" * 5000 + b"}", dtype=np.uint8)),
    ],
)
def test_arrays_that_do_not_fit_are_one_error(tmp_path, ending, change):
    with np.load(SHIPPED) as archive:
        name = next(name for name in archive.files if name.endswith(ending))
        path = changed(tmp_path / "m.npz", **{name: change(archive[name])})
    with pytest.raises(DatasetError, match=r"m\.npz: is not a model of doppelgait, or is damaged") as refused:
        load_model(path)
    assert len(str(refused.value)) <= 2000


def test_an_archive_that_cannot_be_unpacked_is_one_error(tmp_path):
    buffer = io.BytesIO()
    with zipfile.ZipFile(SHIPPED) as source, zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as target:
        for name in source.namelist():
            target.writestr(name, source.read(name))
    whole, path, refused = buffer.getvalue(), tmp_path / "m.npz", 0
    for at in range(60, 4000, 97):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 255]) + whole[at + 1 :])
        try:
            load_model(path)
        except DatasetError:
            refused += 1
    assert refused > 20  # a date in the archive changes nothing


@pytest.mark.parametrize("header", [b"{'descr': '<f8', 'fortran_order': False, 'shape': (", b"(" * 118])
def test_a_header_that_is_no_python_is_one_error(tmp_path, header):
    path = tmp_path / "m.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("model.npy", b"\x93NUMPY\x01\x00v\x00" + header.ljust(117) + b"\n")
    with pytest.raises(DatasetError, match="is not a model of doppelgait, or is damaged"):
        load_model(path)


def test_more_faults_than_can_be_read_are_counted(tmp_path):
    with np.load(SHIPPED) as archive:
        document = json.loads(archive["model"].tobytes())
    document["facts"] |= {f"key{number}": number for number in range(5000)}
    text = np.frombuffer(json.dumps(document).encode(), dtype=np.uint8)
    with pytest.raises(DatasetError, match="and 4992 more"):
        load_model(changed(tmp_path / "m.npz", model=text))

"""One safe way to open HDF5: endless heaps, values of other files, and small files that declare or unpack to a lot."""

import io
import re
import struct
import zlib
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import h5py
import numpy as np
import pytest

from checkout import ROOT
from doppelgait.core import own_hdf5
from doppelgait.core.documents import DEFAULT_MB, VARIABLE, check_cost, limit_bytes
from doppelgait.core.errors import ConfigError, MotionError
from doppelgait.core.own_hdf5 import HEAP, _find, _find_endless_heaps, get_own_member, open_hdf5


def plain(path: Path, **datasets: object) -> Path:
    with h5py.File(path, "w") as file:
        for name, values in datasets.items():
            file[name] = values
    return path


def test_no_other_place_of_the_package_opens_hdf5_for_reading() -> None:
    package = ROOT / "src" / "doppelgait"
    found = {
        str(path.relative_to(package))
        for path in package.rglob("*.py")
        if re.search(r"(?<!\w)(h5py\.)?File\((?![^)]*\"w\")[^)]*\"r|h5py\.is_hdf5", path.read_text(encoding="utf-8"))
    }
    assert found == {"core/own_hdf5.py"}, "use open_hdf5 of core/own_hdf5.py"


def test_addresses_of_other_sizes_are_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "small.h5", "w", libver="earliest"):
        pass
    content = bytearray((tmp_path / "small.h5").read_bytes())
    content[14] = 4
    (tmp_path / "small.h5").write_bytes(content)
    with pytest.raises(ValueError, match="have \\(8, 4\\) bytes, not 8"):
        open_hdf5(tmp_path / "small.h5")


def chain_ends(content: bytes, start: int) -> bool:
    """The literal rule for one heap: its objects follow each other up to its end."""
    end = min(start + struct.unpack_from("<Q", content, start + 8)[0], len(content))
    at = start + 16
    while at + 16 <= end:
        number, n_bytes = struct.unpack_from("<H6xQ", content, at)
        step = 16 + -(-n_bytes // 8) * 8 if number else n_bytes
        if step < 16 or step >= 1 << 63:
            return False
        at += step
    return True


def endless(content: bytes) -> Iterator[int]:
    return _find_endless_heaps(io.BytesIO(content), [at for at, _ in _find(io.BytesIO(content), HEAP)])


def test_heaps_are_found_across_the_blocks_that_a_file_is_read_in(monkeypatch) -> None:
    content = b"".join(HEAP + bytes(gap) for gap in range(40)) + HEAP[:4]
    wanted = [match.start() for match in re.finditer(re.escape(HEAP), content)]
    for size in (1, 7, 8, 9, 100):
        monkeypatch.setattr(own_hdf5, "READ_SIZE", size)
        assert [at for at, _ in _find(io.BytesIO(content), HEAP)] == wanted


def test_heaps_without_end_are_those_of_the_literal_rule() -> None:
    rng = np.random.default_rng(4)
    for _ in range(300):
        content = bytearray()
        for _ in range(rng.integers(1, 12)):
            if rng.random() < 0.4:
                content += HEAP + bytes(3) + struct.pack("<Q", int(rng.integers(0, 400)))
            step = [0, 8, 16, 24, 40, 2**63, 2**64 - 16][rng.integers(7)]
            content += struct.pack("<H6xQ", int(rng.integers(0, 2)), step)
        starts = [match.start() for match in re.finditer(re.escape(HEAP), bytes(content))]
        wanted = [start for start in starts if start + 16 <= len(content) and not chain_ends(bytes(content), start)]
        assert list(endless(bytes(content))) == wanted


def test_every_object_of_a_heap_is_looked_at_once() -> None:
    """20,000 heaps, the chain of each through all later ones: the literal rule needs 200 million steps."""

    one = HEAP + bytes(3) + struct.pack("<Q", 2**40) + struct.pack("<H6xQ", 1, 16) + bytes(16)
    assert list(endless(one * 20_000)) == []


def test_marks_of_heaps_are_followed_one_by_one(tmp_path: Path, monkeypatch) -> None:
    path, found = plain(tmp_path / "a.h5", x=np.zeros(3)), []
    path.write_bytes(path.read_bytes() + HEAP * 10_000)
    monkeypatch.setattr(own_hdf5, "MAX_OBJECTS", 100)
    monkeypatch.setattr(own_hdf5, "_find", lambda *given: (found.append(0) or one for one in _find(*given)))
    with pytest.raises(ValueError, match="has no end"):
        open_hdf5(path)
    assert len(found) < 1000


@pytest.mark.parametrize("way", ["external", "external link", "virtual", "soft link"])
def test_values_of_other_files_are_refused(tmp_path: Path, way: str) -> None:
    (tmp_path / "secret").write_bytes(bytes(800))
    plain(tmp_path / "other.h5", values=np.zeros(100))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        if way == "external":
            file.create_dataset("x", (100,), "f8", external=[(str(tmp_path / "secret"), 0, 800)])
        elif way == "external link":
            file["x"] = h5py.ExternalLink("other.h5", "/values")
        elif way == "soft link":
            file["x"] = h5py.SoftLink("/y")
        else:
            layout = h5py.VirtualLayout((100,), "f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "values", shape=(100,))
            file.create_virtual_dataset("x", layout)
    with pytest.raises(ValueError, match=r"is a link, which is not followed|are in another file, which is not read"):
        open_hdf5(tmp_path / "a.h5")
    with (
        open_hdf5(tmp_path / "a.h5", members=False) as file,
        pytest.raises(ValueError, match=r"is a link|another file"),
    ):
        get_own_member(file, "x")
    if way == "soft link":
        with open_hdf5(tmp_path / "a.h5", soft_links=True):
            pass


def test_declared_shapes_are_checked_before_anything_is_allocated(tmp_path: Path, monkeypatch) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (10_000_000_000,), "f8", chunks=(1_000_000,))
    with pytest.raises(ValueError, match=r"would take 80,060 MB .* bytes is 256 MB.*DOPPELGAIT_READ_LIMIT_MB=80060"):
        open_hdf5(tmp_path / "a.h5")
    with open_hdf5(tmp_path / "a.h5", members=False) as file, pytest.raises(ValueError, match="80,060 MB"):
        get_own_member(file, "x")
    monkeypatch.setenv(VARIABLE, "80060")
    with open_hdf5(tmp_path / "a.h5") as file:
        assert file["x"].shape == (10_000_000_000,)


def test_an_honest_large_chunk_is_read(tmp_path: Path) -> None:
    values = np.random.default_rng(0).integers(0, 255, 600_000, dtype="u1")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", data=values, chunks=(600_000,), compression="gzip", shuffle=True, fletcher32=True)
    with open_hdf5(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(file["x"][:], values)


def write_twice_deflated(file: h5py.File) -> None:
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_chunk((100,))
    properties.set_deflate(9)
    properties.set_deflate(9)
    h5py.h5d.create(file.id, b"x", h5py.h5t.NATIVE_UINT8, h5py.h5s.create_simple((100,)), properties)


def write_bomb(file: h5py.File) -> None:
    packed = file.create_dataset("x", (4096,), "u1", chunks=(4096,), compression="gzip")
    packed.id.write_direct_chunk((0,), zlib.compress(bytes(400_000_000), 9))


def write_group_in_itself(file: h5py.File) -> None:
    file["a/b/values"] = 1.0
    file["a/b/again"] = file["a"]


TEXTS = np.array(["a" * 60_000] + [""] * 9_999, dtype=h5py.string_dtype())


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda file: file.create_dataset("x", (10,), "f8", maxshape=(None,), chunks=(100_000_000,)), "801 MB"),
        (lambda file: file.create_dataset("x", data=TEXTS), "MB of memory"),
        (
            lambda file: file.create_dataset("x", (100,), "u1", chunks=(100,), compression="lzf"),
            r"has the filters \[32000\]",
        ),
        (lambda file: file.create_dataset("y", (2,), h5py.vlen_dtype("f8")), "type class 9"),
        (write_twice_deflated, r"has the filters \[1, 1\]"),
        (write_bomb, "a chunk of 'x' decompresses to more than its 4,096 bytes"),
        (write_group_in_itself, "has two names"),
    ],
)
def test_what_is_larger_than_it_looks_or_unusual_is_refused(tmp_path: Path, write, words: str) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        write(file)
    with pytest.raises(ValueError, match=words):
        open_hdf5(tmp_path / "a.h5")


# ---- the budget


def test_the_limit_is_the_larger_of_a_number_and_a_multiple_of_the_file(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert limit_bytes(1000) == DEFAULT_MB * 1e6
    assert limit_bytes(10**9) == 16 * 10**9
    monkeypatch.setenv(VARIABLE, "2000.5")
    assert limit_bytes(1000) == 2_000_500_000
    for text in ("many", "0", "-3", "nan", "inf"):
        monkeypatch.setenv(VARIABLE, text)
        with pytest.raises(ConfigError, match=f"{VARIABLE} = '{text}' is not allowed"):
            limit_bytes(1000)


def test_the_error_names_file_amounts_and_remedy(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    (tmp_path / "a.csv").write_bytes(bytes(70))
    check_cost(tmp_path / "a.csv", 256_000_000, MotionError)
    words = (
        r"a\.csv: its values would take 257 MB of memory; the limit for a file of 70 bytes is 256 MB\. "
        r"If you trust the file, raise the limit: DOPPELGAIT_READ_LIMIT_MB=257"
    )
    with pytest.raises(MotionError, match=words):
        check_cost(tmp_path / "a.csv", 256_000_001, MotionError)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (np.zeros(2, [("r", "<f4"), ("i", "<f4"), ("k", "<f4")]), "compound type"),
        (np.zeros(2, [("r", "<f4"), ("i", "<f8")]), "compound type"),
        (np.zeros(2, [("r", "<i2"), ("i", "<i2")]), ""),
        (np.zeros(2, "V8"), "type class"),
        (np.zeros(2, "<f2"), ""),
        (np.zeros(2, ">c16"), ""),
        (np.zeros(2, bool), ""),
        (np.zeros(2, "S5"), ""),
    ],
)
@pytest.mark.parametrize("where", ["dataset", "attribute"])
def test_only_types_that_our_files_have_are_read(tmp_path: Path, values: np.ndarray, reason: str, where: str) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["x"] = values if where == "dataset" else 1.0
        if where == "attribute":
            file["x"].attrs["y"] = values
    with pytest.raises(ValueError, match=reason) if reason else nullcontext():
        open_hdf5(path).close()


def test_texts_longer_than_their_file_are_refused_and_others_read(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["x"] = ["a", "bc" * 3000]
        file["x"].attrs["y"] = "d" * 5000
    with open_hdf5(path) as file:
        assert [text.decode() for text in file["x"][:]] == ["a", "bc" * 3000]
        assert file["x"].attrs["y"] == "d" * 5000
    content = path.read_bytes()
    for length in (6000, 5000):
        assert content.count(struct.pack("<IQ", length, content.index(b"GCOL"))) == 1
        at = content.index(struct.pack("<IQ", length, content.index(b"GCOL")))
        path.write_bytes(content[:at] + struct.pack("<I", 1_000_000_000) + content[at + 4 :])
        with pytest.raises(ValueError, match="text of 1,000,000,000 bytes"):
            open_hdf5(path)


def test_texts_of_attributes_are_single_and_of_a_plain_type(tmp_path: Path) -> None:
    path = plain(tmp_path / "a.h5", x=np.zeros(3))
    with h5py.File(path, "r+") as file:
        file.attrs.create("list", ["a", "b"], dtype=h5py.string_dtype())
    with pytest.raises(ValueError, match="'list' of 'the root' is a list of texts"):
        open_hdf5(path)
    path = plain(tmp_path / "b.h5", x=np.zeros(3))
    with h5py.File(path, "r+") as file:
        file["named"] = h5py.string_dtype()
        file["x"].attrs.create("text", "a", dtype=file["named"])
    with pytest.raises(ValueError, match="named type"):
        open_hdf5(path)


def test_heaps_are_found_whatever_their_reserved_bytes(tmp_path: Path) -> None:
    path = plain(tmp_path / "a.h5", x=np.zeros(3))
    with h5py.File(path, "r+") as file:
        file.attrs["text"] = "a"
    content = bytearray(path.read_bytes())
    heap = content.index(HEAP)
    content[heap + 5] = 0xFF
    content[heap + 16 + 24 + 8 : heap + 16 + 24 + 16] = bytes(8)  # the object after the text
    path.write_bytes(content)
    with pytest.raises(ValueError, match="has no end"):
        open_hdf5(path)

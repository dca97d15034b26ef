"""Safe opening of HDF5 files: unsafe ones are refused.

An HDF5 file can show the content of another file by links, by datasets with external storage (which read the bytes of
any file as numbers) and by virtual datasets. Neither doppelgait's files nor the supported files of vendors use these.
A damaged file can trap the library in an endless loop. A small file can declare, or decompress to, very many values.
Damaged types of values make the library write beyond its memory, which ends the process.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from doppelgait.core.documents import describe_excess_memory, limit_bytes, stat_regular
from doppelgait.core.lazy import LateModule

if TYPE_CHECKING:
    import h5py as h5py
else:
    h5py = LateModule("h5py")

SIGNATURE = b"\x89HDF\r\n\x1a\n"  # first bytes of an HDF5 file
USER_BLOCKS = (0, 512, 1024, 2048)  # allowed positions of the signature; MATLAB's is byte 512
HEAP = b"GCOL\x01"  # signature and version of a heap of texts; the library ignores three more bytes
HEAP_BYTES, OBJECT_BYTES = 16, 16
"""Bytes before the objects of a heap, and before the content of an object with the 8-byte lengths that h5py writes."""
TEXT_BYTES = 4096  # length assumed for each text of a long list, such as ids
CHUNK_BYTES = 6000  # memory that the library allocates for each chunk (measured), however small
MAX_OBJECTS = 4_000_000  # maximum number of objects in heaps that are followed
FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32"}  # supported filters; a dataset uses each once
INFLATES = 1040  # maximum number of bytes that one byte of a deflate stream can decompress to
FLOATS = ("IEEE_F16LE", "IEEE_F32LE", "IEEE_F64LE", "IEEE_F16BE", "IEEE_F32BE", "IEEE_F64BE")
"""Names of the supported floating-point types."""
TEXT_MARK = b"\x10\x00\x00\x00"
"""Size of the reference to a text: length, address of the heap and number of the object."""
TEXT = re.compile(
    rb"\x10\x00\x00\x00"
    rb"(?:[\x10\x20\x30].{3}\x01\x00\x00\x00.{4}(?:\x00{4})?|[\x13\x23\x33].{3}\x01\x00\x00\x00)"  # of characters
    rb"(?:\x01\x00.{6}|\x02\x00.{2})"  # a single one
    rb"(.{4})",
    re.DOTALL,
)
"""Pattern of a text attribute, from its size to the length that it declares."""
TEXT_AFTER = 32  # maximum number of bytes of a match after the mark
READ_SIZE = 1 << 20  # bytes read at once
IMAGE_BYTES = 1 << 26  # larger files are not read into memory when they are opened

DAMAGE = (RuntimeError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError, MemoryError)
FAULTS = (OSError, *DAMAGE)  # exceptions that h5py raises for damaged bytes


def open_hdf5(path: str | Path, *, members: bool = True, soft_links: bool = False, **options: Any) -> Any:
    """Open an HDF5 file of unknown origin for reading."""
    place = Path(path)
    stamp = read_stamp(place)
    if fault := _find_file_fault(place, stamp):
        raise ValueError(fault)
    if stamp[1] > IMAGE_BYTES or options:
        file = h5py.File(place, "r", **options)
    else:  # of a file that is truncated meanwhile, the library reads zeros without end
        access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
        access.set_fapl_core(backing_store=False)
        access.set_file_image(place.read_bytes())
        if read_stamp(place) != stamp:
            raise ValueError("it was changed while it was read")
        name = os.fsencode(place) + b"/"  # the library refuses the name of a file that exists
        file = h5py.File(h5py.h5f.open(name, h5py.h5f.ACC_RDONLY, fapl=access))
    try:
        if not soft_links:
            _check_attributes(file, "the root")
        if members:
            _check_members(file, place, soft_links)
    except BaseException:
        file.close()
        raise
    return file


def read_stamp(path: Path) -> tuple[int, int, int]:
    """Return what changes with a file's content."""
    facts = stat_regular(path)
    return facts.st_ino, facts.st_size, facts.st_mtime_ns


def read_stated_format(path: str | Path) -> str | None:
    """Return the format that an HDF5 file states, or None if doppelgait did not write it."""
    try:
        with open_hdf5(path, members=False) as file:
            stated = file.attrs.get("format")
    except FAULTS:
        return None
    return stated if isinstance(stated, str) else None


def get_own_member(group: Any, name: str) -> Any:
    """Return a direct member (dataset or group) of an HDF5 group."""
    key = name.encode()
    if "/" in name:  # every component of a path could be a link
        raise ValueError(f"{name!r} is not allowed as a name")
    if not group.id.links.exists(key):
        return None
    if group.id.links.get_info(key).type != h5py.h5l.TYPE_HARD:
        raise ValueError(f"{name!r} is a link, which is not followed: it may lead to another file")
    found = group[name]
    _check_attributes(found, name)
    _check_limit(_value_bytes(found, name, TEXT_BYTES), Path(os.fsdecode(group.file.filename)))
    return found


def _check_limit(n_bytes: int, path: Path) -> None:
    stored_bytes = path.stat().st_size
    if n_bytes > limit_bytes(stored_bytes):
        raise ValueError(describe_excess_memory(n_bytes, stored_bytes, "its values"))


def _check_members(file: Any, path: Path, soft_links: bool) -> None:
    found: list[tuple[str, int]] = []
    file.id.links.visit(lambda name, link: found.append((name.decode(errors="replace"), link.type)), info=True)
    stored_bytes = path.stat().st_size
    groups = {h5py.h5o.get_info(file.id).addr}
    n_bytes = 0
    for name, kind in found:
        if kind == h5py.h5l.TYPE_SOFT and soft_links:
            continue
        if kind != h5py.h5l.TYPE_HARD:
            raise ValueError(f"{name[:80]!r} is a link, which is not followed: it may lead to another file")
        member = file[name]
        if not soft_links:
            _check_attributes(member, name)
        n_bytes += _value_bytes(member, name, stored_bytes, references=soft_links)
        if isinstance(member, h5py.Group):
            address = h5py.h5o.get_info(member.id).addr
            if address in groups:
                raise ValueError(f"the group {name[:80]!r} has two names, so that it may contain itself")
            groups.add(address)
    _check_limit(n_bytes, path)


def get_attribute(member: Any, name: str) -> Any:
    """Return an attribute of a supported type, or None; others may be next to it."""
    if name not in member.attrs:
        return None
    _check_attribute(h5py.h5a.open(member.id, name.encode()), str(member.name))
    return member.attrs[name]


def _check_attributes(member: Any, name: str) -> None:
    for number in range(h5py.h5a.get_num_attrs(member.id)):
        _check_attribute(h5py.h5a.open(member.id, index=number), name)


def _check_attribute(attribute: Any, name: str) -> None:
    kind = attribute.get_type()
    fault = _type_fault(kind)
    n_dims = attribute.get_space().get_simple_extent_ndims()
    if kind.get_class() == h5py.h5t.STRING and kind.is_variable_str() and (n_dims or kind.committed()):
        fault = "is a list of texts, or of a named type"  # TEXT matches texts of a plain type
    if fault:
        text = attribute.name.decode(errors="replace")
        raise ValueError(f"the attribute {text[:80]!r} of {name[:80]!r} {fault}")


def _type_fault(kind: Any, *, references: bool = False) -> str:
    """Return why values of a type must not be read, or "": the library converts without a check."""
    h5t, class_, size = h5py.h5t, kind.get_class(), kind.get_size()
    if class_ == h5t.ENUM or (references and class_ == h5t.ARRAY):  # truths, arrays in a table
        return _type_fault(kind.get_super())
    if class_ == h5t.COMPOUND:
        members = [kind.get_member_type(n) for n in range(kind.get_nmembers())]
        ends = [0, *accumulate(member.get_size() for member in members)]
        has_gaps = [kind.get_member_offset(n) for n in range(len(members))] != ends[:-1] or ends[-1] != size
        if references:  # rows of a table: numbers
            faults = [_type_fault(member, references=member.get_class() == h5t.ARRAY) for member in members]
            return "is of a compound type with gaps" if has_gaps else next(filter(None, faults), "")
        alike = len(members) == 2 and members[0].equal(members[1])  # complex numbers: two real numbers
        if has_gaps or not alike or members[0].get_class() not in (h5t.INTEGER, h5t.FLOAT):
            return "is of a compound type other than complex numbers"
        return _type_fault(members[0])
    if class_ == h5t.INTEGER:
        plain = size in (1, 2, 4, 8) and kind.get_precision() == 8 * size and kind.get_offset() == 0
        return "" if plain else f"holds integers of {size} bytes with {kind.get_precision()} bits"
    if class_ == h5t.FLOAT:
        return "" if any(kind.equal(getattr(h5t, name)) for name in FLOATS) else "holds unusual floating-point numbers"
    if class_ == h5t.STRING or (references and class_ == h5t.REFERENCE):
        return ""
    return f"is of the type class {class_}, which is not supported"


def _value_bytes(found: Any, name: str, text_bytes: int, *, references: bool = False) -> int:
    """Return the size of a dataset's values, 0 for groups; a text counts ``text_bytes``."""
    if not isinstance(found, h5py.Dataset):
        return 0
    if found.external or found.is_virtual:
        raise ValueError(f"the values of {name[:80]!r} are in another file, which is not read")
    kind, properties = found.id.get_type(), found.id.get_create_plist()
    if fault := _type_fault(kind, references=references):
        raise ValueError(f"{name[:80]!r} {fault}")
    each: int = kind.get_size()
    count: int = found.id.get_space().get_simple_extent_npoints()
    if kind.get_class() == h5py.h5t.STRING and kind.is_variable_str():  # values may share a text
        each += text_bytes
        _check_lengths(found, name, count)
    if properties.get_layout() != h5py.h5d.CHUNKED:
        return each * count
    chunk_bytes, n_chunks = each, 1
    for length, size in zip(properties.get_chunk(), found.id.get_space().get_simple_extent_dims(), strict=True):
        chunk_bytes *= length
        n_chunks *= -(-size // length)
    filters = [properties.get_filter(number)[0] for number in range(properties.get_nfilters())]
    if not set(filters) <= set(FILTERS) or len(set(filters)) < len(filters):
        raise ValueError(
            f"{name[:80]!r} has the filters {filters}; supported are {', '.join(FILTERS.values())}, each once"
        )
    if 1 in filters and found.id.get_storage_size() * INFLATES > limit_bytes(0):
        _check_chunks(found, name, chunk_bytes)
    return max(each * count, chunk_bytes) + CHUNK_BYTES * n_chunks


def _check_lengths(dataset: Any, name: str, count: int) -> None:
    """Refuse texts with a declared length beyond the file's size, which the library allocates."""
    if dataset.id.get_create_plist().get_layout() != h5py.h5d.CONTIGUOUS:
        raise ValueError(f"the texts of {name[:80]!r} are stored in chunks, which is not supported")
    start, path = dataset.id.get_offset(), Path(os.fsdecode(dataset.file.filename))
    if start is None or not count:  # never written
        return
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(start)
        stored = file.read(min(16 * count, size))
    for (length,) in struct.iter_unpack("<I12x", stored[: len(stored) // 16 * 16]):
        if length > size:
            raise ValueError(f"{name[:80]!r} holds a text of {length:,} bytes, but the file has {size:,}")


def _check_chunks(dataset: Any, name: str, chunk_bytes: int) -> None:
    """Refuse chunks that decompress to more than their size, which the library does not limit."""
    large: list[Any] = []
    dataset.id.chunk_iter(
        lambda info: large.append(info.chunk_offset) if info.size * INFLATES > limit_bytes(0) else None
    )
    for place in large:
        _, packed = dataset.id.read_direct_chunk(place)
        unpacker, size = zlib.decompressobj(), 0
        while packed and size <= chunk_bytes + 4:  # fletcher32 adds 4 bytes
            size += len(unpacker.decompress(packed, READ_SIZE))
            packed = unpacker.unconsumed_tail
        if size > chunk_bytes + 4:
            raise ValueError(f"a chunk of {name[:80]!r} decompresses to more than its {chunk_bytes:,} bytes")


@lru_cache(maxsize=64)
def _find_file_fault(path: Path, stamp: tuple[int, int, int]) -> str:
    """Return why HDF5 must not open a file, or ""."""
    with path.open("rb") as file:
        head = file.read(USER_BLOCKS[-1] + 64)
        at = find_signature(head)
        if at is None:
            return "it is not an HDF5 file"
        version = head[at + 8] if len(head) > at + 8 else 0
        sizes = head[at + 13 : at + 15] if version < 2 else head[at + 9 : at + 11]
        if sizes != b"\x08\x08":
            return f"its addresses and lengths have {tuple(sizes)} bytes, not 8"
        size = file.seek(0, os.SEEK_END)
        for _, following in _find(file, TEXT_MARK, TEXT_AFTER):
            if (found := TEXT.match(following)) and (length := int.from_bytes(found[1], "little")) > size:
                return f"one of its attributes is a text of {length:,} bytes, but the file has {size:,}"
        for start in _find_endless_heaps(file, [at for at, _ in _find(file, HEAP)]):
            return f"its heap at byte {start} has no end"
    return ""


def find_signature(head: bytes) -> int | None:
    """Return where an HDF5 file begins in its first bytes."""
    return next((at for at in USER_BLOCKS if head[at : at + len(SIGNATURE)] == SIGNATURE), None)


def _find(file: BinaryIO, mark: bytes, after: int = 0) -> Iterator[tuple[int, bytes]]:
    window, kept, first = len(mark) + after, b"", 0
    file.seek(0)
    while True:
        read = file.read(READ_SIZE)
        block = kept + read
        n_starts = max(len(block) - (window if read else len(mark)) + 1, 0)
        at = block.find(mark, 0, n_starts + len(mark) - 1)
        while at >= 0:
            yield first + at, block[at : at + window]
            at = block.find(mark, at + 1, n_starts + len(mark) - 1)
        if not read:
            return
        kept = block[n_starts:]
        first += n_starts


def _find_endless_heaps(file: BinaryIO, starts: Iterable[int]) -> Iterator[int]:
    """Yield the start of every heap with an endless chain of objects; chains may join."""
    # no memory map: one of a file that is truncated meanwhile ends the process
    size = file.seek(0, os.SEEK_END)
    faults: dict[int, int] = {}  # by the start of an object: the invalid object that ends its chain
    for start in starts:
        file.seek(start)
        if len(head := file.read(HEAP_BYTES)) == HEAP_BYTES:  # otherwise the library reports it
            end = min(start + struct.unpack_from("<Q", head, 8)[0], size)
            at, chain, fault = start + HEAP_BYTES, [], size
            while at + OBJECT_BYTES <= size:
                if at in faults:
                    fault = faults[at]
                    break
                chain.append(at)
                file.seek(at)
                entry = file.read(OBJECT_BYTES).ljust(OBJECT_BYTES, b"\0")
                number, n_bytes = struct.unpack("<H6xQ", entry)
                step = OBJECT_BYTES + -(-n_bytes // 8) * 8 if number else n_bytes  # object 0: free space with header
                if step < OBJECT_BYTES or step >= 1 << 63:
                    fault = at
                    break
                at += step
            faults.update(dict.fromkeys(chain, fault))
            if fault + OBJECT_BYTES <= end or len(faults) > MAX_OBJECTS:
                yield start

"""Structure-aware damage: text by words and lines, JSON by values, arrays and HDF5 by members, bytes by numbers."""

import io
import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Rng = np.random.Generator

WORDS = (
    b"0", b"-1", b"1", b"2", b"3", b"65535", b"4294967296", b"1e308", b"-1e308", b"1e-308", b"1e30", b"1e9", b"nan", b"inf",
    b"-inf", b"9" * 5000, b"0x" + b"f" * 60, b"", b"null", b"true", b"[]", b"{}", b"x", b"a_x_m", b"_", b"1_0", b"\xd9\xa3",
    b"\xff", b"\0", b'"', b"1.7e-9", b"42", b"1670", b"-9999.99", b"100000",
)  # fmt: skip
NUMBERS = (0, -1, 1, 2, 127, 255, 32767, 65535, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1, 80_000_000_000)
REALS = (0.0, -1.0, float("nan"), float("inf"), -float("inf"), 1e30, -1e30, 1e308, 1e-308, 1e9, 42.0, 1e-9)
VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1, 2**31, 2**63, 10**39, 1e308, -1e308, 1e-308, float("nan"), float("inf"), "", "x", "../x", "\0",
    [], {}, [[]], [None], {"a": 1}, "9" * 5000, [0.0], ["x"], 1e30, [1e308, -1e308],
)  # fmt: skip


def damage_bytes(content: bytes, rng: Rng) -> bytes:
    """One change to any bytes: values that hurt at any place, cuts, repeats."""
    if not content:
        return rng.bytes(int(rng.integers(1, 30)))
    at, kind = int(rng.integers(len(content))), int(rng.integers(8))
    changed = bytearray(content)
    if kind == 0:
        return content[:at]
    if kind == 1:
        changed[at] = int(rng.integers(256))
    elif kind == 2:
        changed[at] ^= 1 << int(rng.integers(8))
    elif kind == 3:
        code = str(rng.choice(list("bBhHiIqQ")))
        order = str(rng.choice(["<", ">"]))
        size = struct.calcsize(code)
        number = NUMBERS[rng.integers(len(NUMBERS))] & (256**size - 1)
        at -= at % size
        changed[at : at + size] = number.to_bytes(size, "little" if order == "<" else "big")
    elif kind == 4:
        code = str(rng.choice(["<f4", ">f4", "<f8", ">f8"]))
        with np.errstate(over="ignore"):
            value = np.array(REALS[rng.integers(len(REALS))]).astype(code)
        at -= at % value.itemsize
        changed[at : at + value.itemsize] = value.tobytes()
    elif kind == 5:
        del changed[at : at + int(rng.integers(1, 64))]
    elif kind == 6:
        part = content[at : at + int(rng.integers(1, 200))]
        changed[at:at] = part * int(rng.integers(1, 20))
    else:
        other = int(rng.integers(len(content)))
        part = content[other : other + int(rng.integers(1, 64))]
        changed[at : at + len(part)] = part
    return bytes(changed)


def damage_text(content: bytes, rng: Rng) -> bytes:
    """One change to a text: its words, cells and lines."""
    lines = content.split(b"\n")
    row, kind = int(rng.integers(len(lines))), int(rng.integers(10))
    line = lines[row]
    mark = max((b",", b"\t", b";", b" ", b"="), key=line.count)
    cells = line.split(mark)
    column = int(rng.integers(len(cells)))
    word = WORDS[rng.integers(len(WORDS))]
    if kind <= 2:
        cells[column] = word
        lines[row] = mark.join(cells)
    elif kind == 3:
        del cells[column]
        lines[row] = mark.join(cells)
    elif kind == 4:
        cells[column:column] = [cells[column]] * int(rng.choice([1, 2, 3, 50]))
        lines[row] = mark.join(cells)
    elif kind == 5:
        blanks = rng.choice([b" ", b"\t", b",", b"_ ", b"( ", b"[", b"{", b"1", b"a.", b"x("])
        lines[row] = line[: len(line) // 2] + bytes(blanks) * int(rng.choice([3, 400, 4000])) + line[len(line) // 2 :]
    elif kind == 6:
        del lines[row]
    elif kind == 7:
        lines[row:row] = [line] * int(rng.choice([1, 2, 100]))
    elif kind == 8:
        other = int(rng.integers(len(lines)))
        lines[row], lines[other] = lines[other], line
    else:
        return damage_bytes(content, rng)
    return b"\n".join(lines)


def damage_json(content: bytes, rng: Rng) -> bytes:
    """One change to a value of a JSON text, or to the text."""
    if rng.random() < 0.25:
        return damage_text(content, rng)
    try:
        root = json.loads(content)
    except (ValueError, RecursionError):
        return damage_text(content, rng)
    _damage_value(root, rng)
    if rng.random() < 0.03:
        return json.dumps(root).replace("1", "[" * 3000, 1).encode()
    return json.dumps(root).encode()


def _damage_value(node: Any, rng: Rng) -> None:
    """Change one entry of nested lists and tables, in place."""
    while isinstance(node, dict | list) and node:
        key = list(node)[rng.integers(len(node))] if isinstance(node, dict) else int(rng.integers(len(node)))
        if isinstance(node[key], dict | list) and node[key] and rng.random() < 0.8:
            node = node[key]
            continue
        kind = int(rng.integers(5))
        if kind == 0:
            del node[key]
        elif kind == 1 and isinstance(node, dict):
            node[str(rng.choice(["x", "", "a.b", str(key) + "2"]))] = node.pop(key)
        elif kind == 2 and isinstance(node, list):
            node[key:key] = [node[key]] * int(rng.choice([1, 2, 200]))
        else:
            node[key] = VALUES[rng.integers(len(VALUES))]
        return


def damage_array(values: Any, rng: Rng) -> Any:
    """An array with values, a type or a shape that hurt."""
    values = np.array(values)
    kind = int(rng.integers(8))
    if kind == 0 and values.size and values.dtype.kind in "fc":
        flat = values.reshape(-1)
        flat[rng.integers(flat.size)] = REALS[rng.integers(len(REALS))]
        return flat.reshape(values.shape)
    if kind == 1:
        with np.errstate(all="ignore"):
            code = str(rng.choice(["?", "u1", "i2", "i8", "f2", "f4", "f8", "c8", "c16", "S3"]))
            return (values.real if values.dtype.kind == "c" and code[0] != "c" else values).astype(code)
    if kind == 2:
        shape = list(values.shape)
        rng.shuffle(shape)
        return values.reshape(shape)
    if kind == 3:
        return values[..., np.newaxis] if rng.random() < 0.5 else values.reshape(-1)
    if kind == 4 and values.ndim:
        return values[: int(rng.integers(0, len(values) + 1))]
    if kind == 5 and values.ndim:
        return values[::-1].copy()
    if kind == 6 and values.dtype.kind in "fcui":
        with np.errstate(all="ignore"):
            return values * np.asarray(REALS[rng.integers(len(REALS))])
    if values.ndim:
        return np.repeat(values, int(rng.choice([2, 3, 30])), axis=int(rng.integers(values.ndim)))
    return VALUES[rng.integers(1, 12)]


def damage_npz(content: bytes, rng: Rng) -> bytes:
    """One change to a member of an npz file, to its header, or to the archive."""
    if rng.random() < 0.3:
        return damage_bytes(content, rng)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
    except Exception:  # an earlier change
        return damage_bytes(content, rng)
    if not members:
        return damage_bytes(content, rng)
    name = list(members)[rng.integers(len(members))]
    kind = int(rng.integers(6))
    if kind <= 2:
        try:
            buffer = io.BytesIO()
            np.save(buffer, damage_array(np.load(io.BytesIO(members[name])), rng), allow_pickle=False)
            members[name] = buffer.getvalue()
        except Exception:  # an earlier change
            members[name] = damage_bytes(members[name], rng)
    elif kind == 3:
        head = members[name][:128]
        members[name] = damage_text(head, rng)[:128].ljust(128) + members[name][128:]
    elif kind == 4:
        del members[name]
    else:
        members[str(rng.choice(["x.npy", "i.npy", "q.npy", "positions.npy", "names.npy"]))] = members.pop(name)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED if rng.random() < 0.5 else zipfile.ZIP_STORED) as archive:
        for name, value in members.items():
            archive.writestr(name, value)
    return buffer.getvalue()


def damage_hdf5(content: bytes, rng: Rng) -> bytes:
    """One change to an attribute, a dataset or a link of a whole HDF5 file."""
    import h5py

    image = io.BytesIO(content)
    try:
        with h5py.File(image, "r+") as file:
            _damage_members(file, rng)
    except Exception:  # a value that HDF5 does not take
        return content
    return image.getvalue()


def _damage_members(file: Any, rng: Rng) -> None:
    import h5py

    names: list[str] = ["/"]
    file.visit(names.append)
    name = names[rng.integers(len(names))]
    node = file[name]
    if len(node.attrs) and (rng.random() < 0.5 or name == "/"):
        key = list(node.attrs)[rng.integers(len(node.attrs))]
        old = node.attrs[key]
        kind = int(rng.integers(4))
        if kind == 0:
            del node.attrs[key]
        elif isinstance(old, str) and old[:1] in "{[" and kind < 3:
            node.attrs[key] = damage_json(old.encode(), rng).decode(errors="replace").replace("\0", "")
        elif isinstance(old, str) or kind == 3:
            value = VALUES[rng.integers(1, len(VALUES))]
            node.attrs[key] = value if isinstance(value, int | float) else str(value).replace("\0", "")
        else:
            node.attrs[key] = damage_array(old, rng)
        return
    if name == "/":
        return
    kind = int(rng.integers(8))
    parent = node.parent
    last = name.rsplit("/", 1)[-1]
    if kind == 0 or not isinstance(node, h5py.Dataset):
        if kind < 3:
            del parent[last]
        else:
            file.move(name, name + str(rng.choice(["1", "x", "-1"])))
        return
    attrs, values = dict(node.attrs), node[()]
    del parent[last]
    if kind == 1:
        parent[last] = h5py.SoftLink(names[rng.integers(len(names))])
        return
    if kind == 2:
        shape = tuple(int(n) * int(rng.choice([1, 1000, 10**6])) for n in np.shape(values)) or (10**9,)
        parent.create_dataset(last, shape, np.asarray(values).dtype if np.asarray(values).dtype.kind != "O" else "f8",
                              chunks=tuple(min(n, 50) for n in shape))  # fmt: skip
    elif isinstance(values, bytes):
        parent[last] = damage_json(values, rng).decode(errors="replace").replace("\0", "")
    elif kind == 3 and np.ndim(values):
        parent.create_dataset(last, data=values, compression="gzip", chunks=True, shuffle=bool(rng.integers(2)))
    else:
        parent[last] = damage_array(values, rng)
    parent[last].attrs.update(attrs)


MUTATORS: dict[str, Callable[[bytes, Rng], bytes]] = {
    ".h5": damage_hdf5, ".npz": damage_npz, ".json": damage_json, ".sigmf-meta": damage_json,
    **dict.fromkeys((".csv", ".tsv", ".txt", ".trc", ".bvh", ".amc", ".asf", ".toml", ".cfg", ".sto", ".mot", ".skeleton",
                     ".mvnx"), damage_text),
}  # fmt: skip


def damage_folder(folder: Path, rng: Rng) -> str:
    """Damage one file or two of a case, in place; returns their names."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    said = []
    for place in rng.permutation(len(files))[: int(rng.choice([1, 1, 1, 2]))]:
        path = files[place]
        content = path.read_bytes()
        mutate = MUTATORS.get(path.suffix, damage_bytes)
        if content[:19] == b"MATLAB 7.3 MAT-file":
            mutate = damage_mat73
        elif path.suffix == ".mat":
            mutate = damage_mat5
        elif content[:200].isascii() and content[:200].replace(b"\n", b"").isalnum():
            mutate = damage_text
        for _ in range(int(rng.choice([1, 1, 2, 3]))):
            content = mutate(content, rng)
        if mutate in (damage_hdf5, damage_mat73, damage_mat5) and rng.random() < 0.4:
            head = 128 * (mutate is damage_mat5)  # last: libraries may crash when they read it again
            content = content[:head] + damage_bytes(content[head:], rng)
        path.write_bytes(content[: 1 << 22])
        said.append(path.name)
    return ", ".join(said)


def damage_mat73(content: bytes, rng: Rng) -> bytes:
    """One change to a MATLAB 7.3 file, whose signature stands behind a block of 512 bytes."""
    kept = 512 if rng.random() < 0.2 else 0
    return content[: kept or 128] + damage_hdf5(content[kept:], rng)[0 if kept else 128 :]


def damage_mat5(content: bytes, rng: Rng) -> bytes:
    """One change to the variables of a MATLAB file of version 5."""
    from scipy.io import loadmat, savemat

    variables = {key: value for key, value in loadmat(io.BytesIO(content)).items() if key[:1] != "_"}
    name = list(variables)[rng.integers(len(variables))]
    buffer = io.BytesIO()
    try:
        variables[name] = damage_array(variables[name], rng)
        savemat(buffer, variables, do_compression=bool(rng.integers(2)))
    except Exception:  # a value that MATLAB does not take
        return content
    return buffer.getvalue()

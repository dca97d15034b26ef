"""Readers of files: which reader takes a file, and what is answered about a file that none takes."""

from contextlib import nullcontext
from typing import Annotated

import h5py
import numpy as np
import pytest

import doppelgait as dg
from doppelgait.core.errors import ConfigError, MotionError, RecordingError
from doppelgait.core.plugins import Group
from doppelgait.core.readers import Limits, check_options, find_readers


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.pcap", b"\xd4\xc3\xb2\xa1", "captured network packets.*adc_data.bin"),
        ("renamed.bin", b"TDSm....", "a measurement file of LabVIEW.*numpy.savez"),
        ("a.bag", b"#ROSBAG V2.0\n", "a recording of ROS"),
        ("a.xlsx", b"PK\x03\x04", "a spreadsheet.*csv"),
        ("a.jpeg", b"\xff\xd8", "a picture"),
        ("a.bvh", b"HIERARCHY\n", "a recorded motion.*--motion"),
        ("a.unheard", b"?", r"no known recording format; known are: .*arrays \(\.npz, \.npy\)"),
        ("movie.h5", b"\x89HDF\r\n", "movie"),
        ("a.npz", b"", "is empty"),
        ("a.npz", None, "no such file"),
        (".", None, "is a folder"),
    ],
)
def test_a_file_that_no_reader_takes_is_named_with_a_way_out(tmp_path, name, content, said):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=said):
        dg.radar.read_recording(tmp_path / name)
    if "recording" not in said and "network" not in said and "LabVIEW" not in said and "motion" not in said:
        with pytest.raises(MotionError, match=said):
            dg.motion.read(tmp_path / name)


def test_the_arrays_of_a_foreign_hdf5_file_are_named(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["radar/frames"] = np.zeros((7, 3))
    with pytest.raises(RecordingError, match=r"HDF5 of another program.*radar/frames \(7, 3\)"):
        dg.radar.read_recording(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("name", "options", "names"),
    [
        ("x.one", {}, ["first"]),
        ("x.two", {}, ["first", "second"]),
        ("x.two", {"prf_hz": 3.0}, ["second"]),
        ("x.two", {"other": 3.0}, ["first", "second"]),
        ("x.TWO", {"rate": 1}, ["first"]),
        ("x.three", {}, []),
        ("mark.two", {}, ["marked"]),
    ],
)
def test_a_reader_is_chosen_by_content_then_by_name_and_options(tmp_path, register, name, options, names):
    group = Group("radar_reader", listed=False)
    group._complete = True
    nothing = {"sniff": lambda path, head: False, "suffixes": (".x",)}
    register("radar_reader", "first", **nothing, by_name=(".one", ".two"))(lambda path, *, rate: None)
    register("radar_reader", "second", **nothing, by_name=(".two",))(lambda path, *, prf_hz: None)
    marked = {**nothing, "sniff": lambda path, head: head.startswith(b"mark")}
    register("radar_reader", "marked", **marked)(lambda path: None)
    (tmp_path / name).write_text(name)
    assert [
        n for n in find_readers(group, tmp_path / name, list(options)) if n in {"first", "second", "marked"}
    ] == names


def test_a_sniffer_of_the_former_protocol_is_refused_when_it_registers(register):
    with pytest.raises(ConfigError, match=r"'old' needs sniff=\.\.\., a function \(path, head\)"):
        register("radar_reader", "old", sniff=lambda path: True, suffixes=(".old",))(lambda path: None)


Text = str | None
Share = Annotated[float, Limits(0, 9)]
Rate = Annotated[float, Limits(0)]


def read_any(
    path, *, number: float = 1, count: int | None = 1, name: "Text" = "", free=1, some: Share = 1, rate: Rate = 1
):
    """Read nothing."""


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"number": np.float32(2), "count": np.int64(2), "name": "a", "free": object()}, None),
        ({"count": None}, None),
        ({"number": True}, "number = True is not allowed; it must be a number"),
        ({"count": 2.5}, "count = 2.5 is not allowed; it must be a whole number"),
        ({"name": 3}, "name = 3 is not allowed; it must be a text"),
        ({"some": 9}, None),
        ({"some": 9.1}, "some = 9.1 is not allowed; it must be a number above 0 and at most 9"),
        ({"some": 0}, "some = 0 is not allowed"),
        ({"rate": np.inf}, "rate = inf is not allowed; it must be a number above 0"),
    ],
)
def test_options_have_the_types_of_the_readers_signature(tmp_path, options, said):
    with pytest.raises(RecordingError, match=said) if said else nullcontext():
        check_options(tmp_path, read_any, options, error=RecordingError)

"""The log of decisions: power cuts and full disks."""

import errno
import os
from pathlib import Path

import pytest

from doppelgait.cli.live import DecisionLog
from doppelgait.core.errors import OutputError


def test_every_line_is_on_the_disk_before_the_next(tmp_path, monkeypatch):
    done = []
    write, sync = os.write, os.fsync
    monkeypatch.setattr(os, "write", lambda file, content: done.append("write") or write(file, content))
    monkeypatch.setattr(os, "fsync", lambda file: done.append("sync") or sync(file))
    log = DecisionLog(tmp_path / "log")
    assert done == ["sync"]  # of the folder
    log.write("one")
    log.write("two")
    assert done[1:] == ["write", "sync", "write", "sync"]
    assert (tmp_path / "log").read_text() == "one\ntwo\n"


def test_after_a_power_cut_lines_begin_anew(tmp_path):
    (tmp_path / "log").write_text('{"a": 1}\n{"b": ')
    DecisionLog(tmp_path / "log").write('{"c": 3}')
    assert (tmp_path / "log").read_text() == '{"a": 1}\n{"b": \n{"c": 3}\n'
    DecisionLog(tmp_path / "log").write("d")
    assert (tmp_path / "log").read_text().endswith('{"c": 3}\nd\n')


def test_a_full_disk_is_said_once_and_loses_nothing_before(tmp_path, monkeypatch, capsys):
    log, write, room = DecisionLog(tmp_path / "log"), os.write, [True]

    def half(file, content):
        if room[0]:
            return write(file, content)
        if len(content) > 2:
            return write(file, content[:2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "write", half)
    log.write("first")
    room[0] = False
    log.write("second")
    log.write("third")
    assert (tmp_path / "log").read_text() == "first\n"
    said = capsys.readouterr().err
    assert said.count("No space left on device") == 1
    assert "decisions continue on standard output" in said
    room[0] = True
    log.write("fourth")
    assert (tmp_path / "log").read_text() == "first\nfourth\n"
    assert "continues; 2 lines are missing" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
def test_a_device_that_is_always_full_ends_nothing(capsys):
    log = DecisionLog(Path("/dev/full"))
    log.write("one")
    log.write("two")
    assert capsys.readouterr().err.count("error:") == 1


def test_a_log_that_cannot_be_opened_is_one_error(tmp_path):
    with pytest.raises(OutputError, match=r"--log .*nowhere/log: cannot be written: No such file"):
        DecisionLog(tmp_path / "nowhere" / "log")

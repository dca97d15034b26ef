"""The log of decisions: power cuts and full disks; the broker that gets them, too."""

import errno
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from doppelgait.cli import live
from doppelgait.cli.live import DecisionLog, MqttSink
from doppelgait.core.errors import ConfigError, OutputError
from processes import join, wait_until


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


class Broker:
    """As much of MQTT 3.1.1 as a publisher needs."""

    def __init__(self, code: int) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"mqtt://127.0.0.1:{self.listener.getsockname()[1]}/home/hall"
        self.code, self.got, self.clients = code, [], []

    def serve(self) -> None:
        while True:
            try:
                client, _ = self.listener.accept()
                self.clients.append(client)
                self.answer(client, client.makefile("rb"))
            except OSError:
                if self.listener.fileno() < 0:
                    return

    def answer(self, client: socket.socket, file: Iterator[bytes]) -> None:
        while head := file.read(1):
            body, kind = file.read(file.read(1)[0]), head[0] >> 4  # short messages alone
            if kind == 1:
                client.sendall(bytes([0x20, 2, 0, self.code]))
            elif kind == 3:
                at = 2 + int.from_bytes(body[:2], "big")
                self.got.append((body[2:at].decode(), body[at + 2 :].decode()))
                client.sendall(b"\x40\x02" + body[at : at + 2])


@contextmanager
def broker(code: int = 0) -> Iterator[Broker]:
    pytest.importorskip("paho.mqtt.client")
    served = Broker(code)
    thread = threading.Thread(target=served.serve)
    thread.start()
    yield served
    served.listener.shutdown(socket.SHUT_RDWR)
    for one in (served.listener, *served.clients):
        one.close()
    join(thread, 10)


def test_lines_are_published_under_their_kind():
    with broker() as served:
        with closing(MqttSink(served.url)) as sink:
            wait_until(lambda: served.got, 20)
            sink.write("decision", '{"track": 1}')
            sink.write("end", "{}")
        assert served.got == [
            ("home/hall/state", "online"),
            ("home/hall/decision", '{"track": 1}'),
            ("home/hall/end", "{}"),
            ("home/hall/state", "offline"),
        ]
        assert sink.lost == 0


@pytest.mark.parametrize(("code", "says"), [(5, "no connection: Not authorized"), (None, "cannot be reached")])
def test_a_broker_that_is_not_there_ends_nothing_and_is_said_once(monkeypatch, capsys, code, says):
    monkeypatch.setattr(live, "MAX_QUEUED", 5)
    monkeypatch.setattr(live, "END_S", 0.1)
    with broker(code or 0) as served:
        url = served.url if code else "mqtt://127.0.0.1:1/home/hall"
        with closing(MqttSink(url)) as sink:
            for number in range(8):
                sink.write("decision", str(number))
            said = []
            wait_until(lambda: said.append(capsys.readouterr().err) or said[-1], 20)
        assert sink.lost == 3
    text = "".join(said) + capsys.readouterr().err
    assert text.count("error: --mqtt") == 1
    assert f"{url}: {says}; decisions continue on standard output" in text


@pytest.mark.parametrize(
    "url",
    ["127.0.0.1/hall", "http://host/a"]
    + [f"mqtt://{a}" for a in ("host", ":1883/b", "host:x/b", "host/a#", "me:secret@host/b", "host/b?password=secret")],
)
def test_an_address_that_is_no_broker_is_one_error(url):
    pytest.importorskip("paho.mqtt.client")
    with pytest.raises(ConfigError, match=r"--mqtt .*must be mqtt://HOST/TOPIC") as caught:
        MqttSink(url)
    assert "secret" not in str(caught.value)
